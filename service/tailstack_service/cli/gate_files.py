"""Files of a gate as files: found by what was typed, known by where they really are, and called as people call them.

One file has many names: through links, from another folder, in another Unicode form.  Patterns of a policy are held
against the names of the real file (links resolved) from the root of its repository and from every folder between that
and the document that holds the pattern, so that the verdict does not hang on how a file was named, or from where.  What
lies above the root, as where a repository was cloned to, is in no name.
"""

from __future__ import annotations

import os
import unicodedata
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from itertools import product, takewhile
from pathlib import Path
from stat import S_ISDIR

from ..gate.file_names import is_wild, normalise, write_fnmatch

ROOTS = ("GITHUB_WORKSPACE", "CI_PROJECT_DIR")  # where GitHub and GitLab check the repository out
STDIN = "<stdin>"


def find_paths(given: str) -> list[str]:
    """The paths that a name or a pattern of the command line stands for, sorted; none if nothing is there.

    Part by part: patterns are patterns, also where a file has their name, so that no file called ``*.yaml`` hides the
    others; then a name is looked for in another Unicode form.  Each real folder is looked through once, however many
    links lead to it.
    """
    if os.path.lexists(given) and not is_wild(given):
        return [given]
    path = Path(given)
    paths = [path.anchor]
    parts = path.parts[1:] if path.anchor else path.parts
    for index, part in enumerate(parts):
        last = index + 1 == len(parts)
        if part == "**":
            paths = list(_walk(paths))
        if part != "**" or last:
            paths = [child for folder in paths for child in _find_children(folder, "*" if part == "**" else part)]
        if not last:
            paths = list(_take_folders(paths, set()))
        elif part == "**":
            paths = [path for path in paths if not os.path.isdir(path)]
    return sorted(dict.fromkeys(child for child in paths if child))


def _find_children(folder: str, part: str) -> Iterator[str]:
    if here := os.path.lexists(os.path.join(folder, part)):
        yield os.path.join(folder, part)
    if here and not is_wild(part):
        return
    try:
        entries = os.listdir(folder or os.curdir)
    except OSError:  # no folder, or one that may not be read: nothing is found there
        return
    if is_wild(part):
        hidden, wanted = part.startswith("."), write_fnmatch(part)
        alike = [e for e in entries if hidden or not e.startswith(".") if fnmatch(normalise(e), wanted)]
    else:
        alike = [entry for entry in entries if normalise(entry) == normalise(part)]
        alike = alike if len(alike) == 1 else []
    yield from (os.path.join(folder, entry) for entry in alike)


def _take_folders(paths: Iterable[str], seen: set[tuple[int, int]]) -> Iterator[str]:
    """Those paths that are folders, each real one once, by a way without a link at its end if there is one."""
    for path in sorted(paths, key=lambda path: (os.path.islink(path), path)):
        try:
            found = os.stat(path or os.curdir)
        except OSError:
            continue
        if S_ISDIR(found.st_mode) and (found.st_dev, found.st_ino) not in seen:
            seen.add((found.st_dev, found.st_ino))
            yield path


def _walk(folders: Iterable[str]) -> Iterator[str]:
    """Folders and those below them, without hidden ones; links are followed after everything else."""
    seen: set[tuple[int, int]] = set()
    waiting, linked = list(folders), list[str]()
    while waiting or linked:
        if not waiting:
            waiting, linked = linked, []
        level, waiting = waiting, []
        for folder in _take_folders(level, seen):
            yield folder
            with suppress(OSError), os.scandir(folder or os.curdir) as entries:
                for entry in entries:
                    if not entry.name.startswith(".") and entry.is_dir():
                        (linked if entry.is_symlink() else waiting).append(os.path.join(folder, entry.name))


def resolve(name: str) -> Path:
    """Where a file really is, links resolved; what is no file (a pipe, a descriptor) is where it is named."""
    if os.path.exists(name) and not os.path.isfile(name) and not os.path.isdir(name):
        return Path(os.path.abspath(name))
    return Path(os.path.realpath(name))


def follow_link(name: str) -> str:
    """The file that a link leads to, of a link: what lies beside a design lies beside the file."""
    return str(resolve(name)) if os.path.islink(name) else name


def show_name(name: str) -> str:
    """How findings call a file: from the working directory where it is below that, in characters that can be shown."""
    if name == "-":
        return STDIN
    name = follow_link(name)
    here, real = Path.cwd().resolve(), resolve(name)
    root = find_root(real)
    if real.is_relative_to(here) or (root is not None and here.is_relative_to(root)):
        path = os.path.relpath(real, here)
    elif os.path.isabs(name):
        path = str(real)
    else:
        path = os.path.relpath(real, here) if os.pardir in Path(name).parts else os.path.normpath(name)
    return _make_readable(path)


def _make_readable(path: str) -> str:
    readable = os.fsencode(path.replace(os.sep, "/")).decode("utf-8", "replace")
    return "".join("\ufffd" if unicodedata.category(c) == "Cc" else c for c in readable)


# --- where names begin --------------------------------------------------------------------------------


def find_root(real: Path) -> Path | None:
    """From where pipelines and people name a file: the folder that the pipeline says, else the root of its repository.

    That of a submodule is another one than its patterns are for, which are those of the policy's repository.
    """
    for root in _list_pipeline_roots():
        if real.is_relative_to(root):
            return root
    return _find_repository(real.parent)


def _find_repository(folder: Path) -> Path | None:
    """The nearest folder with ``.git``, or the one where the pipeline says that it checked the repository out."""
    known = _list_pipeline_roots()
    ways = (folder, *folder.parents)
    return next((each for each in ways if each in known or os.path.lexists(each / ".git")), None)


def _list_pipeline_roots() -> list[Path]:
    return [Path(root).resolve() for variable in ROOTS if (root := os.environ.get(variable))]


@dataclass(frozen=True, slots=True)
class Anchors:
    """Folders at which patterns may begin."""

    folders: tuple[Path, ...] = ()  # of the documents that hold patterns: the policy, the waivers
    prefixes: tuple[str, ...] = ()  # folders with which patterns begin, which may be links

    @classmethod
    def of_documents(cls, names: Iterable[str | None]) -> Anchors:
        """From the files of the documents, of which "-" and None have no folder."""
        given = (name for name in names if name is not None and name != "-" and os.path.isfile(name))
        return cls(tuple(dict.fromkeys(resolve(name).parent for name in given)))

    def with_patterns(self, patterns: Iterable[str]) -> Anchors:
        """These, when the folders that patterns name are known: a file is also called by links among them."""
        begins = ("/".join(takewhile(lambda part: not is_wild(part), p.split("/")[:-1])) for p in patterns)
        return replace(self, prefixes=tuple(dict.fromkeys(begin for begin in begins if begin not in ("", "."))))

    def list_folders(self, real: Path) -> list[Path]:
        """Those for one file: the root and every folder from there to a document that holds patterns.

        Where no repository is known and no such document lies above the file, every folder from the root to the file:
        people mean one of them, and nobody knows which.
        """
        root = self._find_root(real)
        if root is None:
            return []
        known = any(each is not None and root == each for each in map(_find_repository, (*self.folders, real.parent)))
        ends = self._inside(root) if known or root in self.folders else [real.parent]
        between = [each for folder in ends for each in reversed((folder, *folder.parents))]
        return list(dict.fromkeys([root, *(each for each in between if root in each.parents and each in real.parents)]))

    def _find_root(self, real: Path) -> Path | None:
        """The root of the repository: that of the policy if the file is in it, else the file's own.

        Where nothing is known of a repository, the nearest folder that holds both.
        """
        for root in (*map(_find_repository, self.folders), _find_repository(real.parent)):
            if root is not None and real.is_relative_to(root):
                return root
        beside = next((folder for folder in self.folders if folder.drive == real.drive), None)
        return None if beside is None else Path(os.path.commonpath([real, beside]))

    def _inside(self, root: Path) -> list[Path]:
        return [folder for folder in self.folders if folder.is_relative_to(root)]

    def count_ascent(self, document: str | None) -> int | None:
        """How many folders lie between a document's own and the root of its repository; None: none is known."""
        if document is None or document == "-":
            return None
        folder = resolve(document).parent
        root = _find_repository(folder)
        return None if root is None else len(folder.relative_to(root).parts)

    def list_names(self, name: str) -> tuple[str, ...]:
        """The names of a file that patterns are held against."""
        if name == "-":
            return (STDIN,)
        real = resolve(name)
        root = self._find_root(real)
        if root is None:
            return ()
        folders = self.list_folders(real)
        # and ../designs/*, as it is written in a folder for policies
        ways = [os.path.relpath(real, folder) for folder in (*folders, *self._inside(root))]
        for folder, prefix in product((*folders, *self._inside(root)), self.prefixes):
            inside = resolve(str(folder / prefix))
            if inside != folder / prefix and real.is_relative_to(inside):
                ways.append(f"{prefix.removeprefix('./')}/{os.path.relpath(real, inside)}")
        return tuple(dict.fromkeys(_make_readable(way) for way in ways))

    def name_from_root(self, file: str) -> str:
        """A file, called as findings call it, from the root of its repository, as what knows only that one asks."""
        if file.startswith("<"):
            return file
        here, real = Path.cwd().resolve(), resolve(file)
        root, roots = find_root(real), _list_pipeline_roots()
        if roots and root not in roots:  # of another repository than the pipeline's
            return file
        if root is None:
            folders = [here, *self.list_folders(real)] if real.is_relative_to(here) else self.list_folders(real)
            root = min(folders, key=lambda folder: len(folder.parts), default=None)
        return file if root is None else _make_readable(os.path.relpath(real, root))

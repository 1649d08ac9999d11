"""Files of a gate as files: found by what was typed, known by where they really are, and called as people call them.

One file has many names: through links, from another folder, in another Unicode form.  Patterns of a policy are held
against the names of the real file (links resolved) from the root of its repository and from every folder between that
and the document that holds the pattern, so that the verdict does not hang on how a file was named, or from where.
"""

from __future__ import annotations

import glob
import os
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from itertools import product, takewhile
from pathlib import Path

from ..gate.file_names import find_literal, is_wild, normalise

ROOTS = ("GITHUB_WORKSPACE", "CI_PROJECT_DIR")  # where GitHub and GitLab check the repository out
STDIN = "<stdin>"


def find_paths(given: str) -> list[str]:
    """The paths that a name or a pattern of the command line stands for, sorted; none if nothing is there.

    Part by part: what exists as it is written is itself, whatever signs are in it; then patterns are patterns; then a
    name is looked for in another Unicode form.
    """
    if os.path.lexists(given):
        return [given]
    path = Path(given)
    paths = [path.anchor]
    parts = path.parts[1:] if path.anchor else path.parts
    for index, part in enumerate(parts):
        paths = [child for folder in paths for child in _find_children(folder, part)]
        if index + 1 < len(parts):
            paths = [child for child in paths if os.path.isdir(child or os.curdir)]
    return sorted(dict.fromkeys(child for child in paths if child))


def _find_children(folder: str, part: str) -> Iterator[str]:
    if os.path.lexists(os.path.join(folder, part)):
        yield os.path.join(folder, part)
    elif part == "**":
        yield from glob.glob(os.path.join(glob.escape(folder), part), recursive=True)
        yield folder
    else:
        try:
            entries = os.listdir(folder or os.curdir)
        except OSError:  # no folder, or one that may not be read: nothing is found there
            return
        if is_wild(part):
            hidden, wanted = part.startswith("."), normalise(part)
            alike = [e for e in entries if hidden or not e.startswith(".") if fnmatch(normalise(e), wanted)]
        else:
            alike = [entry for entry in entries if normalise(entry) == normalise(part)]
            alike = alike if len(alike) == 1 else []
        yield from (os.path.join(folder, entry) for entry in alike)


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
    """The root of the repository that a file is in: where the pipeline says, else the nearest folder with ``.git``."""
    for root in _list_pipeline_roots():
        if real.is_relative_to(root):
            return root
    return next((folder for folder in real.parents if os.path.lexists(folder / ".git")), None)


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
        """Those for one file: the root of its repository and every folder from there to a document that holds patterns.

        Where no root is known, the folder of such a document if the file is below it; else every folder from the one
        that the two have in common down to the file: the root is one of them, and nobody knows which.
        """
        root = find_root(real)
        folders = [] if root is None else [root]
        for folder in self.folders:
            if root is not None and folder.is_relative_to(root):
                between = [folder, *folder.parents]
                folders += [each for each in reversed(between) if each.is_relative_to(root)]
            else:
                folders.append(folder)
        folders = [folder for folder in folders if real.is_relative_to(folder)]
        if not folders:
            for folder in self.folders:
                if folder.drive == real.drive:
                    common = Path(os.path.commonpath([real, folder]))
                    folders += [each for each in reversed(real.parents) if each.is_relative_to(common)]
        return list(dict.fromkeys(folders))

    def list_names(self, name: str) -> tuple[str, ...]:
        """The names of a file that patterns are held against."""
        return (STDIN,) if name == "-" else self._name(resolve(name))

    def list_link_names(self, name: str) -> tuple[str, ...]:
        """The names that a file would have if the link by which it was given were the file; none if it is no link."""
        lexical = Path(os.path.realpath(os.path.dirname(name))) / os.path.basename(name)
        return () if name == "-" or lexical == resolve(name) else self._name(lexical)

    def _name(self, real: Path) -> tuple[str, ...]:
        ways = [os.path.relpath(real, folder) for folder in self.list_folders(real)]
        # ../designs/*, as it is written in a folder for policies
        ways += [os.path.relpath(real, folder) for folder in self.folders if folder.drive == real.drive]
        for folder, prefix in product((*self.list_folders(real), *self.folders), self.prefixes):
            inside = resolve(str(folder / prefix))
            if inside != folder / prefix and real.is_relative_to(inside):
                ways.append(f"{prefix.removeprefix('./')}/{os.path.relpath(real, inside)}")
        return tuple(dict.fromkeys(_make_readable(way) for way in (*ways, str(real))))

    def find_literal(self, patterns: Sequence[str], names: Sequence[str]) -> frozenset[str]:
        """Parts of patterns that are to be read as they are written, because there is such a file or folder.

        names: as they were given.
        """
        designs = [resolve(name) for name in names if name != "-"]
        literals = set(find_literal(patterns, [name for real in designs for name in self._name(real)]))
        begins = dict.fromkeys([*self.folders, *(folder for real in designs for folder in self.list_folders(real))])
        for pattern in patterns:
            folders = list(begins)
            for part in pattern.removeprefix("./").split("/") if is_wild(pattern) else ():
                folders = [folder / part for folder in folders if os.path.lexists(folder / part)]
                if is_wild(part) and folders:
                    literals.add(normalise(part))
        return frozenset(literals)

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

"""The package's own sources, as they were when this process first looked, and which of them each file can reach.

Compiled code is only as current as the sources it was made from: those of its own file and of every file that this one
imports, however far away.  They are read here once and in one go, and whatever has to name sources names these.
``check_unchanged`` refuses a module that was imported from sources of another time, so that a process whose files were
replaced under it computes with one version or not at all.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path

from ..errors import Problem, SourcesChangedError

ROOT = Path(__file__).resolve().parents[1]
COMPILER = "kernels/store.py"  # no kernel calls it: whatever it adds to one is in the name of its file
# What is imported inside of a function cannot be called by compiled code: lines that begin with the word are enough
_FROM = re.compile(rb"\nfrom (\.[\w.]*|tailstack[\w.]*) import (\([^)]*\)|[^\n]*)")
_PLAIN = re.compile(rb"\nimport ([^\n]*)")


@dataclass(frozen=True, slots=True)
class SourceFile:
    """One file, as it was read."""

    content: bytes
    modified_ns: int


def _files(directory: str) -> Iterator[str]:
    with os.scandir(directory) as entries:
        for entry in entries:
            if entry.name.endswith(".py"):
                yield entry.path
            elif entry.name != "__pycache__" and entry.is_dir():
                yield from _files(entry.path)


def read_sources(root: Path) -> dict[str, SourceFile]:
    """Every Python file below ``root``, by its path with slashes; none where it is no directory (a zip archive)."""
    files = {}
    for path in sorted(_files(str(root))) if root.is_dir() else ():
        with open(path, "rb") as file:
            name = path[len(str(root)) + 1 :].replace(os.sep, "/")
            files[name] = SourceFile(file.read(), os.fstat(file.fileno()).st_mtime_ns)
    return files


def digest_of_all(sources: dict[str, SourceFile]) -> str:
    """SHA-256 of all of them, names included."""
    total = sha256()
    for name, source in sources.items():
        total.update(f"{name}\0{len(source.content)}\0".encode() + source.content)
    return total.hexdigest()


SOURCES = read_sources(ROOT)


@cache
def digest_of_package() -> str:
    """SHA-256 of the whole package: versions name what was released, this names the code that computes."""
    return digest_of_all(SOURCES)


@cache
def imports_of(name: str) -> set[str]:
    """The files of the package that this one imports when it is imported itself."""
    content = b"\n" + SOURCES[name].content
    files: set[str] = set()
    for origin, names in _FROM.findall(content):
        module = origin.decode()
        dots = len(module) - len(module.lstrip("."))
        folder = name.split("/")[:-dots] if dots else []  # one dot is the file's own folder, a further one its parent
        package = folder + [part for part in module.split(".") if part][0 if dots else 1 :]
        for word in re.findall(r"\w+", re.sub(rb"#[^\n]*", b"", names).decode()):  # "as" and new names find no file
            files |= _module([*package, word])
        files |= _module(package)
    for names in _PLAIN.findall(content):
        for module in re.findall(r"\btailstack[\w.]*", names.decode()):
            files |= _module(module.split(".")[1:])
    return files


def _module(parts: list[str]) -> set[str]:
    path = "/".join(parts)
    return {file for file in (f"{path}.py", f"{path}/__init__.py".lstrip("/")) if file in SOURCES}


@cache
def reach(name: str) -> tuple[str, ...]:
    """Every file that the code of this one can reach by imports, itself included; not what compiles it."""
    reached: set[str] = set()
    waiting = {name}
    while waiting:
        reached |= waiting
        waiting = {file for importer in waiting for file in imports_of(importer)} - reached - {COMPILER}
    return tuple(sorted(reached))


@cache
def digest_of(name: str) -> str:
    """SHA-256 of everything that the code of this file can reach."""
    return digest_of_all({file: SOURCES[file] for file in reach(name)})


def check_unchanged(name: str) -> None:
    """Raises SourcesChangedError if what the code of this file reaches is not what this process began with."""
    for file in reach(name):
        path, source = ROOT / file, SOURCES[file]
        try:
            if path.stat().st_mtime_ns == source.modified_ns or path.read_bytes() == source.content:
                continue
        except OSError:  # gone
            pass
        detail = f"{path} was changed while this process was running, which had begun with the old one"
        raise SourcesChangedError(Problem("", "sources-changed", detail, "start the process again"))

"""Files that are written whole or not at all: beside their place first, then put there."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from tailstack.errors import Problem

from ..problems import RequestError


@dataclass(frozen=True, slots=True)
class Staged:
    """A file that is written, and not yet in its place."""

    file: str  # as it was asked for
    beside: Path
    target: Path

    def put(self) -> None:
        """Replace what is there.  Raises OSError, and leaves nothing beside it."""
        try:
            os.replace(self.beside, self.target)
        except OSError:
            self.drop()
            raise

    def drop(self) -> None:
        """Leave what is there."""
        self.beside.unlink(missing_ok=True)


def stage(file: str, content: bytes) -> Staged:
    """Content written beside a file's place.  Raises OSError, and leaves nothing there."""
    target = Path(os.path.realpath(file))  # a link stays one
    beside = target.with_name(target.name + f".{os.getpid()}.part")
    try:
        with beside.open("wb") as stream:
            stream.write(content)
    except BaseException:  # Ctrl-C as well
        beside.unlink(missing_ok=True)
        raise
    return Staged(file, beside, target)


@contextmanager
def write_in_place(file: str) -> Iterator[IO[bytes]]:
    """A stream into a file that replaces what is there when all is written, or into what is a stream itself.

    Raises OSError; what breaks off leaves nothing.
    """
    if is_stream(file):
        with open(file, "wb") as stream:
            yield stream
        return
    staged = stage(file, b"")
    try:
        with staged.beside.open("wb") as stream:
            yield stream
    except BaseException:  # Ctrl-C as well
        staged.drop()
        raise
    staged.put()


def is_stream(file: str) -> bool:
    """A pipe, a terminal, /dev/stdout: there is nothing to replace, and what is written stays written.

    Root could replace /dev/stdout, a link of the system, where a shell's output is a file.
    """
    return file.startswith("/dev/") or (os.path.exists(file) and not os.path.isfile(file))


def append(file: str, content: bytes) -> None:
    """Write to a stream.  Raises OSError."""
    with open(file, "ab", buffering=0) as stream:
        view = memoryview(content)
        while view:
            view = view[stream.write(view) :]


def replace_file(path: Path, content: str | bytes) -> None:
    """Write a file whole or not at all, or a stream.  Raises OSError."""
    encoded = content.encode() if isinstance(content, str) else content
    if is_stream(str(path)):
        append(str(path), encoded)
    else:
        stage(str(path), encoded).put()


def write_and_tell(path: Path, content: str | bytes) -> None:
    """The same, and a line on stderr that says so.  Raises OSError."""
    replace_file(path, content)
    print(f"wrote {path}", file=sys.stderr)


def writable(name: str, endings: tuple[str, ...]) -> Path:
    """A path for a new file, refused before the work and not after it.  Raises RequestError."""
    path = Path(name)
    if not path.name.lower().endswith(endings):
        hint = f"known: {', '.join(endings)}"
        raise RequestError(Problem("", "unknown-format", f"{name!r} has no known ending", hint))
    if path.is_dir():
        raise RequestError(Problem("", "file-unwritable", f"cannot write {name}: it is a directory", "name a file"))
    if not path.parent.is_dir():
        detail = f"cannot write {name}: there is no directory {path.parent}"
        raise RequestError(Problem("", "file-unwritable", detail, "make it first, or name another"))
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise RequestError(Problem("", "file-unwritable", f"cannot write {name}: no permission in its directory"))
    return path


def add_force(parser: argparse.ArgumentParser) -> None:
    """The flag of every command that writes a design."""
    parser.add_argument("--force", action="store_true", help="overwrite files that are there")


def refuse_overwriting(paths: Iterable[Path], *, force: bool, own: str | None = None) -> None:
    """Raises RequestError, before the work, if a file is there already that somebody may have written.

    own: the design that is read, which is changed in place where the same file is named for the new one.
    """
    for path in paths:
        if own is not None and os.path.realpath(path) == os.path.realpath(own):
            continue
        if path.exists() and not force and not is_stream(str(path)):
            detail = f"{path} is there already"
            raise RequestError(Problem("", "file-exists", detail, "give another name, or --force to overwrite it"))


def keep_inputs(output: str, inputs: Iterable[str]) -> None:
    """Raises RequestError where ``-o`` names a file that is read."""
    if os.path.realpath(output) in map(os.path.realpath, inputs):
        detail = f"-o {output} would overwrite a file that is read"
        raise RequestError(Problem("", "file-exists", detail, "give another name"))


def writable_directory(name: str, flag: str) -> Path:
    """Where several new files go; made if it is not there.  ``flag`` names another.  Raises RequestError."""
    if not name:
        raise RequestError(Problem("", "file-unwritable", "no directory is named", f"{flag} ."))
    path, refused = Path(name), ""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        refused = "it is not a directory"
    except OSError as error:
        refused = error.strerror or str(error)
    if not refused and not os.access(path, os.W_OK | os.X_OK):
        refused = "no permission"
    if refused:
        problem = Problem("", "file-unwritable", f"cannot write into {name}: {refused}", f"{flag} names another place")
        raise RequestError(problem)
    return path

"""Files that are written whole or not at all: beside their place first, then put there."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path


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


def staged(file: str, content: bytes) -> Staged:
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
        staged(str(path), encoded).put()

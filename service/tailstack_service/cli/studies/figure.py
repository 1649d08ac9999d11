"""Figures of studies: looked at before the work, written whole or not at all after it."""

from __future__ import annotations

import sys
from pathlib import Path


def writable_figure(name: str) -> Path:
    """Where a new figure goes.  Raises RequestError."""
    from ..optimise import writable

    return writable(name, (".svg",))


def write_figure(path: Path, svg: str) -> None:
    """Write it and say so on stderr.  Raises OSError."""
    from ..whole_files import replace_file

    replace_file(path, svg)
    print(f"wrote {path}", file=sys.stderr)


def writable_directory(name: str) -> Path:
    """Where several new figures go; made if it is not there.  Raises RequestError, OSError."""
    import os

    from tailstack.errors import Problem

    from ...problems import RequestError

    if not name:
        raise RequestError(Problem("", "file-unwritable", "no directory is named", "--figures ."))
    path = Path(name)
    if path.exists() and not path.is_dir():
        raise RequestError(Problem("", "file-unwritable", f"cannot write into {name}: it is not a directory"))
    path.mkdir(parents=True, exist_ok=True)
    if not os.access(path, os.W_OK | os.X_OK):
        raise RequestError(Problem("", "file-unwritable", f"cannot write into {name}: no permission"))
    return path

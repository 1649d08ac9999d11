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
    from ..optimise import replace_file

    replace_file(path, svg)
    print(f"wrote {path}", file=sys.stderr)

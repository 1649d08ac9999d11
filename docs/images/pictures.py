"""How a script of this folder writes what it makes, or with ``--check`` says that the file is not that."""

from __future__ import annotations

import sys
from pathlib import Path


def write_picture(file: Path, text: str) -> int:
    """Write the text, or with ``--check`` compare it with the file; the exit code."""
    if file.exists() and file.read_text(encoding="utf-8") == text:
        return 0
    if "--check" in sys.argv[1:]:
        print(f"{file} is not what {sys.argv[0]} makes: run that, look at what changed, and commit it", file=sys.stderr)
        return 1
    file.parent.mkdir(exist_ok=True)
    file.write_text(text, encoding="utf-8")
    return 0

"""Folders of the user's that this program writes into (XDG base directory specification)."""

from __future__ import annotations

import os
from pathlib import Path


def state_directory() -> Path:
    """Where a program keeps what it must not lose.  Raises RuntimeError if there is no home directory."""
    return Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state") / "tailstack"

"""The pages of the manual: in the package where it is installed, in ``docs/`` in a checkout."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path


def manual_folder() -> Path:
    """Where they are: Markdown, with the folders that their links name."""
    shipped = Path(str(files("tailstack_service"))) / "manual"  # as pyproject.toml puts them into the wheel
    return shipped if shipped.is_dir() else Path(__file__).resolve().parents[2] / "docs"

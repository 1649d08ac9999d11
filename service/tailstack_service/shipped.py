"""Folders that a wheel has inside the package and a checkout beside it."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path


def find_shipped(in_wheel: str, in_checkout: str) -> Path:
    """The folder: in the package where that is installed, as pyproject.toml puts it there, or in the checkout."""
    shipped = Path(str(files("tailstack_service"))) / in_wheel
    return shipped if shipped.is_dir() else Path(__file__).resolve().parents[2] / in_checkout


def find_manual() -> Path:
    """The pages of the manual: Markdown, with the folders that their links name."""
    return find_shipped("manual", "docs")

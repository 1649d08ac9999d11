"""The example designs: in the package where it is installed, in ``examples/`` in a checkout."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path

ELSEWHERE = ("fiducials",)  # folders that hold parts of designs


def example_folder() -> Path:
    """Where they are."""
    shipped = Path(str(files("tailstack_service"))) / "example_files"  # as pyproject.toml puts them into the wheel
    return shipped if shipped.is_dir() else Path(__file__).resolve().parents[2] / "examples"


def list_examples() -> dict[str, str]:
    """Names of designs and folders, each with one line about it."""
    folder = example_folder()
    found = {}
    for path in sorted(folder.glob("*.yaml")):
        name = re.search(r"^name: (.+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
        found[path.stem] = name[1] if name else ""
    for below in sorted(path for path in folder.iterdir() if path.is_dir() and path.name not in ELSEWHERE):
        contents = sorted(path.name for path in below.iterdir() if re.fullmatch(r"\w+\.(yaml|csv)", path.name))
        found[below.name] = f"a folder: {', '.join(contents)}"
    return found

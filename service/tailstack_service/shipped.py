"""What a wheel has inside the package and a checkout beside it: the example designs, and the manual."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from textwrap import shorten
from typing import Any

ELSEWHERE = ("fiducials",)  # folders that hold parts of designs
LINE = 60  # characters about a folder
OF_DESIGNS = ("", "gallery", "paper")  # folders whose designs stand for themselves


def find_shipped(in_wheel: str, in_checkout: str) -> Path:
    """The folder: in the package where that is installed, as pyproject.toml puts it there, or in the checkout."""
    shipped = Path(str(files("tailstack_service"))) / in_wheel
    return shipped if shipped.is_dir() else Path(__file__).resolve().parents[2] / in_checkout


def find_manual() -> Path:
    """The pages of the manual: Markdown, with the folders that their links name."""
    return find_shipped("manual", "docs")


def example_folder() -> Path:
    return find_shipped("example_files", "examples")


def list_examples() -> dict[str, str]:
    """Names of designs and folders, each with one line about it."""
    descriptions = {name: example.title for name, example in list_example_designs().items()}
    for below in sorted(path for path in example_folder().iterdir() if path.is_dir() and path.name not in ELSEWHERE):
        contents = sorted(path.name for path in below.iterdir() if re.fullmatch(r"\w+(\.(yaml|csv))?", path.name))
        descriptions[below.name] = shorten(f"a folder: {', '.join(contents)}", LINE, placeholder=" ...")
    return descriptions


@dataclass(frozen=True, slots=True)
class ExampleDesign:
    """A design to begin with."""

    name: str  # of the file, its folder before it: gallery-flat_plate
    title: str  # name of the design
    words: str  # what it shows: the first paragraph of its comments
    path: Path


@cache
def list_example_designs() -> dict[str, ExampleDesign]:
    """Every example that is one design, by its name."""
    examples = {}
    for folder in OF_DESIGNS:
        for path in sorted((example_folder() / folder).glob("*.yaml")):
            name = f"{folder}-{path.stem}" if folder else path.stem
            text = path.read_text(encoding="utf-8")
            title = re.search(r"^name: (.+)$", text, re.MULTILINE)
            examples[name] = ExampleDesign(name, title[1] if title else name, _first_paragraph(text), path)
    return examples


def _first_paragraph(text: str) -> str:
    """Of the comments that a design begins with, without the line that is for editors."""
    words = []
    for line in text.splitlines():
        if line.startswith("# yaml-language-server:"):
            continue
        if not line.startswith("# "):
            break
        words.append(line.removeprefix("# "))
    return " ".join(words)


@cache
def read_example(name: str) -> dict[str, Any]:
    """An example as plain data that stands alone: fiducials of a file are in it.  Raises KeyError."""
    from tailstack.design import design_to_data, load_design

    return design_to_data(load_design(list_example_designs()[name].path))


@cache
def write_example(name: str) -> str:
    """An example as its author wrote it, fiducials of a file in it, without the line for editors.  Raises KeyError."""
    from tailstack.design import design_to_data, load_design
    from tailstack.design.yaml_text import revise_yaml

    path = list_example_designs()[name].path
    text = re.sub(r"^# yaml-language-server:.*\n", "", path.read_text(encoding="utf-8"))
    return revise_yaml(text, design_to_data(load_design(path), inline=False), read_example(name))

"""docs/paper.md and docs/studies.md: that every command of theirs is one, and every equation is there."""

from __future__ import annotations

import argparse
import re
import shlex

import pytest
from service_scenes import ROOT

from tailstack_service.cli.main import build_parser

PAPER = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
STUDIES = (ROOT / "docs" / "studies.md").read_text(encoding="utf-8")
PAGES = PAPER + STUDIES
FENCED = re.findall(r"^```(\w*)\n(.*?)^```$", PAGES, flags=re.MULTILINE | re.DOTALL)
BLOCKS = [block for kind, block in FENCED if not kind]
COMMANDS = [
    one.partition("|")[0].partition(" > ")[0].partition("#")[0].strip(" )")
    for block in BLOCKS
    for one in re.findall(r"\btailstack \w.*", block)
]


def test_no_block_names_a_python_of_nobody_knows_which_packages() -> None:
    assert not re.search(r"^python ", "\n".join(BLOCKS), flags=re.MULTILINE)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_of_the_page_is_one_and_its_files_are_there(command: str) -> None:
    words = shlex.split(command)[1:]
    assert isinstance(build_parser().parse_args(words), argparse.Namespace)
    for word in words:
        if word.startswith("examples/"):
            assert (ROOT / word).is_file()


def test_the_equations_are_all_there() -> None:
    """published: the paper numbers its equations from 1 to 18."""
    heads = " ".join(re.findall(r"^\*\*(Eqs? .*?)\*\*", PAPER, flags=re.MULTILINE))
    numbers: set[int] = set()
    for part in re.findall(r"\d+–\d+|\d+", heads):
        first, _, last = part.partition("–")
        numbers |= set(range(int(first), int(last or first) + 1))
    assert numbers == set(range(1, 19))

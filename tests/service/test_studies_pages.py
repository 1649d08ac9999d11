"""docs/paper.md and docs/studies.md: what their snippets print, and that every command of theirs is one."""

from __future__ import annotations

import argparse
import os
import re
import shlex
import subprocess
import sys

import pytest
from service_scenes import ROOT

from tailstack_service.cli.main import build_parser
from waiting import LIMIT_SECONDS

PAPER = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
STUDIES = (ROOT / "docs" / "studies.md").read_text(encoding="utf-8")
PAGES = PAPER + STUDIES
FENCED = re.findall(r"^```(\w*)\n(.*?)^```$", PAGES, flags=re.MULTILINE | re.DOTALL)
BLOCKS = [block for kind, block in FENCED if not kind]
SNIPPETS = re.findall(
    r"\.venv/bin/python - <<'PY'\n(.*?)\nPY\n```\n```text\n(.*?)^```$", PAGES, flags=re.MULTILINE | re.DOTALL
)
COMMANDS = [
    one.partition("|")[0].partition(" > ")[0].partition("#")[0].strip(" )")
    for block in BLOCKS
    if "<<'PY'" not in block
    for one in re.findall(r"\btailstack \w.*", block)
]


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT / "solver"), str(ROOT / "service")])}


@pytest.mark.long("snippet2-physical inverse of T, q\\neq18 T q\\n")
@pytest.mark.parametrize(("snippet", "printed"), SNIPPETS)
def test_a_snippet_prints_what_the_page_says(snippet: str, printed: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", snippet], cwd=ROOT, env=environment(), capture_output=True, text=True,
        timeout=LIMIT_SECONDS, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, printed), done.stderr


def test_there_is_a_snippet_for_each_claim_that_no_command_shows() -> None:
    assert len(SNIPPETS) == 3  # rank of M, rows of Eq 5, direction of Eqs 8 and 18
    assert not re.search(r"^python ", "\n".join(BLOCKS), flags=re.MULTILINE)  # whose packages that would be, who knows


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

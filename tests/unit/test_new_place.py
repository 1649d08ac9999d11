"""A place more in the chain: the type checker names all who treat places differently, and each of them is asked."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from waiting import LIMIT_SECONDS

ROOT = Path(__file__).parents[2]
SOLVER = ROOT / "solver" / "tailstack"
LAST = "    TOOL = 8 "


@cache
def trees() -> dict[str, ast.Module]:
    """The files that name a place."""
    texts = {path.relative_to(SOLVER).as_posix(): path.read_text(encoding="utf-8") for path in SOLVER.rglob("*.py")}
    return {name: ast.parse(text) for name, text in texts.items() if "Place." in text}


@cache
def consumers() -> dict[str, list[ast.Match]]:
    """The matches on a place, by file."""
    found = {
        name: [
            node
            for node in ast.walk(tree)
            if isinstance(node, ast.Match) and any("Place." in ast.unparse(case.pattern) for case in node.cases)
        ]
        for name, tree in trees().items()
    }
    return {name: matches for name, matches in found.items() if matches}


def test_every_match_on_a_place_ends_in_assert_never() -> None:
    assert {"system.py", "propagation/linear.py", "propagation/systematic.py", "montecarlo/plan.py"} <= set(consumers())
    for name, matches in consumers().items():
        for node in matches:
            last = node.cases[-1]
            assert "assert_never(" in ast.unparse(last), (name, node.lineno)


def test_no_place_is_compared_by_its_number() -> None:
    for name, tree in trees().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Compare) and "Place." in ast.unparse(node):
                assert all(isinstance(each, ast.Is | ast.IsNot) for each in node.ops), (name, node.lineno)


@pytest.mark.long
def test_the_type_checker_names_whoever_does_not_know_a_tenth_place(tmp_path: Path) -> None:
    shutil.copytree(SOLVER, tmp_path / "solver" / "tailstack", ignore=shutil.ignore_patterns("__pycache__"))
    system = tmp_path / "solver" / "tailstack" / "system.py"
    text = system.read_text(encoding="utf-8")
    assert text.count(LAST) == 1
    system.write_text(text.replace(LAST, f"    DETECTOR = 9  # of the detector itself\n{LAST}"), encoding="utf-8")
    files = [f"solver/tailstack/{name}" for name in consumers()]
    config = ("--config-file", str(ROOT / "pyproject.toml"), "--cache-dir", str(tmp_path / "cache"))
    done = subprocess.run(
        [sys.executable, "-m", "mypy", *config, "--follow-imports", "silent", *files],
        capture_output=True,
        text=True,
        timeout=5 * LIMIT_SECONDS,
        check=False,
        cwd=tmp_path,
    )
    assert done.returncode == 1, done.stderr
    named = re.findall(r"^solver/tailstack/(\S+?):\d+: error: .*assert_never", done.stdout, re.MULTILINE)
    assert sorted(named) == sorted(name for name, matches in consumers().items() for _ in matches), done.stdout

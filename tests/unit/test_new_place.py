"""A place more in the chain: the type checker names all who treat places differently, and each of them is asked."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from waiting import LIMIT_SECONDS

ROOT = Path(__file__).parents[2]
SOLVER = ROOT / "solver" / "tailstack"
LAST = "    TOOL = 8 "


def matches_of(path: Path) -> list[ast.Match]:
    """The matches on a place of a file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    matches = (node for node in ast.walk(tree) if isinstance(node, ast.Match))
    return [node for node in matches if any("Place." in ast.unparse(case.pattern) for case in node.cases)]


def consumers() -> Counter[str]:
    found = Counter({path.relative_to(SOLVER).as_posix(): len(matches_of(path)) for path in SOLVER.rglob("*.py")})
    return +found


def test_every_match_on_a_place_ends_in_assert_never() -> None:
    assert {"system.py", "propagation/linear.py", "propagation/systematic.py", "montecarlo/plan.py"} <= set(consumers())
    for name in consumers():
        for node in matches_of(SOLVER / name):
            last = node.cases[-1]
            assert "assert_never(" in ast.unparse(last), (name, node.lineno)


def test_no_place_is_compared_by_its_number() -> None:
    for path in SOLVER.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Compare) and "Place." in ast.unparse(node):
                assert all(isinstance(each, ast.Is | ast.IsNot) for each in node.ops), (path, node.lineno)


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
    named = Counter(re.findall(r"^solver/tailstack/(\S+?):\d+: error: .*assert_never", done.stdout, re.MULTILINE))
    assert named == consumers(), done.stdout

"""What the sources are held to as text: one class name, one class; and a place more in the chain is named by the type
checker to all who treat places differently."""

from __future__ import annotations

import ast
import re
import shutil
import sys
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

from family import ROOT, run_process
from waiting import LIMIT_SECONDS

CLASS = re.compile(r" *class (\w+)[(:\[]")  # by lines: to parse all sources takes seconds


def classes_by_name() -> dict[str, list[str]]:
    """Where each class name of the two packages is defined: ``file:line``."""
    places = defaultdict(list)
    for package in ("solver/tailstack", "service/tailstack_service"):
        for path in sorted((ROOT / package).rglob("*.py")):
            for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
                if found := CLASS.match(line):
                    places[found[1]].append(f"{path.relative_to(ROOT)}:{number}")
    return places


def test_no_class_name_is_defined_twice():
    places = classes_by_name()
    assert len(places) > 500  # the sources were found
    twice = {name: found for name, found in places.items() if len(found) > 1}
    lines = "\n".join(f"  {name}: {', '.join(found)}" for name, found in sorted(twice.items()))
    assert not twice, (
        "A class name is defined twice.  Rename the less central class by what it is, with the field's noun; where "
        f"both are one thing, make them one:\n{lines}"
    )


SOLVER = ROOT / "solver" / "tailstack"
LAST = "    TOOL = 9 "


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


def test_every_match_on_a_place_ends_in_assert_never_and_none_is_compared_by_number() -> None:
    assert {"system.py", "propagation/linear.py", "montecarlo/plan.py"} <= set(consumers())
    for name, matches in consumers().items():
        for node in matches:
            last = node.cases[-1]
            assert "assert_never(" in ast.unparse(last), (name, node.lineno)
    for name, tree in trees().items():
        for part in ast.walk(tree):
            if isinstance(part, ast.Compare) and "Place." in ast.unparse(part):
                assert all(isinstance(each, ast.Is | ast.IsNot) for each in part.ops), (name, part.lineno)


@pytest.mark.long
def test_the_type_checker_names_whoever_does_not_know_an_eleventh_place(tmp_path: Path) -> None:
    shutil.copytree(SOLVER, tmp_path / "solver" / "tailstack", ignore=shutil.ignore_patterns("__pycache__"))
    system = tmp_path / "solver" / "tailstack" / "system.py"
    text = system.read_text(encoding="utf-8")
    assert text.count(LAST) == 1
    system.write_text(text.replace(LAST, f"    DETECTOR = 10  # of the detector itself\n{LAST}"), encoding="utf-8")
    files = [f"solver/tailstack/{name}" for name in consumers()]
    config = ("--config-file", str(ROOT / "pyproject.toml"), "--cache-dir", str(tmp_path / "cache"))
    command = (sys.executable, "-m", "mypy", *config, "--follow-imports", "silent", *files)
    done = run_process(*command, cwd=tmp_path, env=None, timeout=5 * LIMIT_SECONDS)
    assert done.returncode == 1, done.stderr
    named = re.findall(r"^solver/tailstack/(\S+?):\d+: error: .*assert_never", done.stdout, re.MULTILINE)
    assert sorted(named) == sorted(name for name, matches in consumers().items() for _ in matches), done.stdout

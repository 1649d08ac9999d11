"""Which tests a tier has, and what ``./run test`` says of the others; on folders of tests made here."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest

import tiers
from waiting import LIMIT_SECONDS

CONFTEST = Path(__file__).parents[1] / "conftest.py"
CASES = """
import pytest

@pytest.mark.long
def test_whole(): pass

@pytest.mark.long("b")
@pytest.mark.parametrize("k", ["a", "b"])
def test_named(k): pass

@pytest.mark.long(but=["a"])
@pytest.mark.parametrize("k", ["a", "b", "c"])
def test_others(k): pass

def test_short(run_seed): assert run_seed in (0, 5)
"""
DRAWS = """
from hypothesis import given
from hypothesis.strategies import integers

@given(integers(0, 10**9))
def test_draws(k):
    with open("drawn", "a") as file:
        print(k, file=file)
"""


def run_tests(folder: Path, *options: str, code: int = 0, said: dict[str, str] | None = None) -> str:
    """What pytest says of the folder, with our conftest."""
    (folder / "conftest.py").write_text(CONFTEST.read_text(encoding="utf-8"), encoding="utf-8")
    plugins = ["-p", "no:cacheprovider", "-p", "xdist", "-p", "_hypothesis_pytestplugin"]
    command = [sys.executable, "-m", "pytest", "-v", *plugins, "--rootdir", str(folder), *options, "."]
    given = {**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", **(said or {})}
    done = subprocess.run(
        command, cwd=folder, env=given, capture_output=True, text=True, timeout=LIMIT_SECONDS, check=False
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout


@pytest.mark.long("options0")
@pytest.mark.parametrize("options", [(), ("-n", "2")])
def test_the_short_tier_leaves_out_what_is_marked_and_says_how_much(tmp_path: Path, options: tuple[str, ...]) -> None:
    (tmp_path / "test_cases.py").write_text(CASES)
    assert "7 passed" in run_tests(tmp_path, *options)
    said = run_tests(tmp_path, "--short", *options)
    assert set(re.findall(r"test_cases\.py::(\S+)", said)) == {"test_named[a]", "test_others[a]", "test_short"}
    assert said.splitlines()[-1] == "4 tests were left out, which are long; all of them: ./run test --all"


def test_a_mark_that_names_a_case_that_there_is_not_is_refused(tmp_path: Path) -> None:
    (tmp_path / "test_cases.py").write_text(CASES.replace('long("b")', 'long("b", "B")'))
    assert "names cases that there are not: B" in run_tests(tmp_path, "-n", "1", code=1)


LEFT = """
import os, subprocess, sys

def test_nothing_is_left():
    left = sorted(name for name in os.environ if name in SAID)
    assert not left
    assert subprocess.run(["git", "rev-parse", "--git-dir"], capture_output=True).returncode  # here is no repository
"""
SAID = {
    "PYTEST_ADDOPTS": "--durations=3", "TAILSTACK_DATABASE": "sqlite:////nowhere/x",
    "TAILSTACK_TRACEBACK": "1", "TAILSTACK_COMMAND": "x", "GITHUB_WORKSPACE": "/", "GITHUB_STEP_SUMMARY": "/nowhere/x",
    "CI_PROJECT_DIR": "/", "GITLAB_CI": "1", "RUNNER_TEMP": "/", "GATE_MODE": "verify",
    "GIT_DIR": str(CONFTEST.parents[1] / ".git"), "GIT_INDEX_FILE": "/nowhere/x", "PYTHONPATH": ".", "LINES": "3",
    "PYTHONWARNINGS": "ignore", "NO_COLOR": "1", "FORCE_COLOR": "1", "COLUMNS": "20", "SOURCE_DATE_EPOCH": "0",
}  # fmt: skip


@pytest.mark.long("options1")
@pytest.mark.parametrize("options", [(), ("-n", "2")])
def test_what_the_caller_has_said_is_not_for_what_tests_start(tmp_path: Path, options: tuple[str, ...]) -> None:
    (tmp_path / "test_cases.py").write_text(LEFT.replace("SAID", repr(sorted(SAID))))
    assert " passed" in run_tests(tmp_path, *options, said=SAID)


def test_a_random_order_is_that_of_its_seed_and_keeps_files_together(tmp_path: Path) -> None:
    for name in "abcd":
        (tmp_path / f"test_{name}.py").write_text("".join(f"def test_{k}(): pass\n" for k in range(9)))
    orders = [re.findall(r"test_\w\.py::\S+", run_tests(tmp_path, *more)) for more in
              ([], ["--shuffle", "3"], ["--shuffle", "3"], ["--shuffle", "4"])]  # fmt: skip
    assert orders[1] == orders[2]
    assert orders[0] == sorted(orders[0]) != orders[1] != orders[3]
    assert sorted(orders[1]) == orders[0]
    files = [test.partition("::")[0] for test in orders[1]]
    assert sum(one != next_one for one, next_one in pairwise(files)) == 3


def test_what_hypothesis_draws_is_the_same_until_a_seed_is_given(tmp_path: Path) -> None:
    (tmp_path / "test_draws.py").write_text(DRAWS)
    drawn = []
    for options in ([], [], ["--seed", "5", "--hypothesis-seed", "5"], ["--seed", "5", "--hypothesis-seed", "5"]):
        run_tests(tmp_path, *options)
        drawn.append((tmp_path / "drawn").read_text())
        (tmp_path / "drawn").unlink()
    assert drawn[0] == drawn[1] != drawn[2] == drawn[3]


def test_costs_are_written_by_test(tmp_path: Path) -> None:
    burns = "import time\nSTART = time.process_time()\ndef test_burns():\n"
    burns += "    while time.process_time() < START + 1.0: sum(range(1000))\n"
    (tmp_path / "test_burns.py").write_text("def test_rests(): pass\n" + burns)
    run_tests(tmp_path, "--costs", str(tmp_path / "costs"))
    lines = [line.split(" ") for line in (tmp_path / "costs").read_text().splitlines()]
    costs = {test: float(seconds) for seconds, test in lines}
    assert costs["test_burns.py::test_burns"] > costs["test_burns.py::test_rests"]
    assert costs.keys() == {"test_burns.py::test_burns", "test_burns.py::test_rests"}


@pytest.mark.parametrize(("text", "seconds"), [("90s", 90), ("1.5m", 90), ("2h", 7200)])
def test_how_long_is_a_number_with_its_unit(text: str, seconds: float) -> None:
    assert tiers.seconds_of(text) == seconds


def test_a_duration_without_unit_is_refused() -> None:
    with pytest.raises(SystemExit, match="expected a number with s, m or h"):
        tiers.seconds_of("90")


def test_what_is_near_to_a_change_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By hand: a module, one that imports it, their tests, and a test that imports neither."""
    texts = {
        "solver/deep/__init__.py": "", "solver/deep/inner.py": "", "solver/deep/outer.py": "from .inner import one",
        "solver/deep/late.py": "", "solver/deep/verbs/first.py": "import json",
        "solver/deep/table.py": 'LateImport(".late", "x"), import_module(f"{__package__}.verbs.{name}")',
        "tests/unit/test_table.py": "import deep.table\ndef test_d(): pass",
        "tests/unit/test_inner.py": "from deep import inner\ndef test_a(): pass\ndef test_dear(): pass",
        "tests/unit/test_outer.py": "import pytest\nimport deep.outer\n@pytest.mark.long\ndef test_b(): pass",
        "tests/unit/test_none.py": "import json\ndef test_c(): pass",
    }  # fmt: skip
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    found = tiers.files_by_distance(["solver/deep/inner.py"])
    assert found == [
        "solver/deep/inner.py",
        "solver/deep/outer.py",
        "tests/unit/test_inner.py",
        "tests/unit/test_outer.py",
    ]
    for file in ("solver/deep/late.py", "solver/deep/verbs/first.py"):  # which no import statement names
        assert tiers.files_by_distance([file]) == [file, "solver/deep/table.py", "tests/unit/test_table.py"]
    (tmp_path / "costs.csv").write_text("test,cpu_seconds\ntests/unit/test_inner.py::test_dear,1.5\n")
    monkeypatch.setattr(tiers, "COSTS", tmp_path / "costs.csv")
    assert tiers.choose_tests(["solver/deep/inner.py"]) == (["tests/unit/test_inner.py::test_a"], 2)


def test_every_change_of_the_sources_reaches_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    """The graph by the text of imports follows the lazy names of the packages far enough."""
    monkeypatch.setattr(tiers, "users_of_files", cache(tiers.users_of_files))
    sources = [str(file) for room in ("solver", "service") for file in sorted(Path(room).rglob("*.py"))]
    lost = [
        file
        for file in sources
        if not any(Path(near).name.startswith("test_") for near in tiers.files_by_distance([file]))
    ]
    found_by_others = ("__init__.py", "__main__.py", "migrations/env.py", "migrations/versions/", "kernels_wheel/")
    assert len(sources) > 300
    assert [file for file in lost if not any(name in file for name in found_by_others)] == []
    for file in ("solver/tailstack/geometry/camera.py", "service/tailstack_service/jobs/store/queue.py"):
        assert len(tiers.choose_tests([file])[0]) > 10

"""Which tests a tier has, and what ``./run test`` says of the others; on folders of tests made here.

What a test leaves behind fails it; what a file starts for all its tests is started once, and nothing outlives a test.
"""

from __future__ import annotations

import ast
import os
import re
import sys
from functools import cache
from itertools import pairwise
from pathlib import Path

import psutil
import pytest

import tiers
from family import read_until, run_process, started
from tiers import SIDE_BY_SIDE
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
    done = run_process(*command, cwd=folder, env=given)
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout


def test_the_short_tier_leaves_out_what_is_marked_and_says_how_much(tmp_path: Path) -> None:
    """By processes of xdist, which tell the one that started them."""
    (tmp_path / "test_cases.py").write_text(CASES)
    said = run_tests(tmp_path, "--short", "-n", "2")
    assert set(re.findall(r"test_cases\.py::(\S+)", said)) == {"test_named[a]", "test_others[a]", "test_short"}
    assert said.splitlines()[-1] == "4 tests were left out, which are long; all of them: ./run test --all"


def test_a_mark_that_names_a_case_that_there_is_not_is_refused(tmp_path: Path) -> None:
    (tmp_path / "test_cases.py").write_text(CASES.replace('long("b")', 'long("b", "B")'))
    assert "names cases that there are not: B" in run_tests(tmp_path, code=1)


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


def test_what_the_caller_has_said_is_not_for_what_tests_start(tmp_path: Path) -> None:
    (tmp_path / "test_cases.py").write_text(LEFT.replace("SAID", repr(sorted(SAID))))
    assert " passed" in run_tests(tmp_path, said=SAID)


def test_orders_and_what_hypothesis_draws_are_those_of_their_seeds(tmp_path: Path) -> None:
    """Files stay together; without a seed all is as it was."""
    for name in "abcd":
        (tmp_path / f"test_{name}.py").write_text("".join(f"def test_{k}(): pass\n" for k in range(9)))
    (tmp_path / "test_e.py").write_text(DRAWS)
    orders, drawn, third = [], [], ["--seed", "5", "--hypothesis-seed", "5", "--shuffle", "3"]
    for options in ([], [], third, third, ["--shuffle", "4"]):
        orders.append(re.findall(r"test_\w\.py::\S+", run_tests(tmp_path, *options)))
        drawn.append((tmp_path / "drawn").read_text())
        (tmp_path / "drawn").unlink()
    assert drawn[0] == drawn[1] == drawn[4] != drawn[2] == drawn[3]
    assert orders[0] == orders[1] == sorted(orders[0]) != orders[2] == orders[3] != orders[4]
    assert sorted(orders[2]) == orders[0]
    files = [test.partition("::")[0] for test in orders[2]]
    assert sum(one != next_one for one, next_one in pairwise(files)) == 4


def test_costs_are_written_by_test(tmp_path: Path) -> None:
    burns = "import time\ndef test_burns():\n    start = time.process_time()\n"
    burns += "    while time.process_time() < start + 0.3: sum(range(1000))\n"
    (tmp_path / "test_burns.py").write_text("def test_rests(): pass\n" + burns)
    run_tests(tmp_path, "--costs", str(tmp_path / "costs"))
    lines = [line.split(" ") for line in (tmp_path / "costs").read_text().splitlines()]
    costs = {test: float(seconds) for seconds, test in lines}
    assert costs["test_burns.py::test_burns"] > costs["test_burns.py::test_rests"]
    assert costs.keys() == {"test_burns.py::test_burns", "test_burns.py::test_rests"}


def test_how_long_is_a_number_with_its_unit() -> None:
    for text, seconds in (("90s", 90), ("1.5m", 90), ("2h", 7200)):
        assert tiers.seconds_of(text) == seconds
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
        "tests/unit/test_whole.py": "import deep.inner\npytestmark = pytest.mark.long\ndef test_e(): pass",
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
        "tests/unit/test_whole.py",
        "tests/unit/test_outer.py",
    ]
    for file in ("solver/deep/late.py", "solver/deep/verbs/first.py"):  # which no import statement names
        assert tiers.files_by_distance([file]) == [file, "solver/deep/table.py", "tests/unit/test_table.py"]
    (tmp_path / "costs.csv").write_text("test,cpu_seconds\ntests/unit/test_inner.py::test_dear,1.5\n")
    monkeypatch.setattr(tiers, "COSTS", tmp_path / "costs.csv")
    assert tiers.choose_tests(["solver/deep/inner.py"]) == (["tests/unit/test_inner.py::test_a"], 3)


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


# Each pair: a test that leaks, and one that fails if it meets the leak
TESTS = """
import logging, os, sys
import pytest

HERE = os.getcwd()
logging.getLogger("library").setLevel(logging.ERROR)
logging.getLogger("loud.part")

def test_sets(): os.environ["NUMBA_CPU_NAME"] = "x86-64-v4"
def test_after_sets(): assert "NUMBA_CPU_NAME" not in os.environ

def test_deletes(): del os.environ["KEPT"]
def test_after_deletes(): assert os.environ["KEPT"] == "1"

def test_changes(): os.environ["KEPT"] = "2"
def test_after_changes(): assert os.environ["KEPT"] == "1"

def test_moves(tmp_path): os.chdir(tmp_path)
def test_after_moves(): assert os.getcwd() == HERE

def test_moves_into_nowhere(tmp_path): os.chdir(tmp_path); tmp_path.rmdir()
def test_after_moves_into_nowhere(): assert os.getcwd() == HERE

def test_imports_from(): sys.path.insert(0, "/elsewhere")
def test_after_imports_from(): assert "/elsewhere" not in sys.path

def test_silences(): logging.getLogger("library").setLevel(logging.CRITICAL)
def test_after_silences(): assert logging.getLogger("library").level == logging.ERROR

def test_silences_new(): logging.getLogger("tailstack.new").setLevel(logging.CRITICAL)
def test_after_silences_new(): assert logging.getLogger("tailstack.new").level == logging.NOTSET

def test_silences_root(): logging.getLogger().setLevel(logging.CRITICAL)
def test_after_silences_root(): assert logging.getLogger().level == logging.WARNING

def test_imports_a_library(tmp_path, monkeypatch):
    logging.getLogger("loud").setLevel(logging.NOTSET)
    (tmp_path / "loud.py").write_text("import logging; logging.getLogger('loud.part').setLevel(logging.INFO)")
    monkeypatch.syspath_prepend(str(tmp_path))
    import loud
def test_after_imports_a_library(): assert logging.getLogger("loud.part").level == logging.INFO

def test_imports_ours_and_silences(tmp_path, monkeypatch):
    (tmp_path / "tailstack.py").write_text("import logging; logging.getLogger('library').setLevel(logging.INFO)")
    monkeypatch.syspath_prepend(str(tmp_path))
    import tailstack
def test_after_imports_ours_and_silences(): assert logging.getLogger("library").level == logging.ERROR

def test_disables(): logging.disable(logging.ERROR)
def test_after_disables(): assert logging.root.manager.disable == logging.NOTSET

def test_escapes_a_fixture(monkeypatch):
    # nothing is recorded for an absent name, so nothing is undone
    monkeypatch.delenv("ABSENT", raising=False)
    os.environ["ABSENT"] = "1"
def test_after_escapes_a_fixture(): assert "ABSENT" not in os.environ

def test_innocent(monkeypatch, tmp_path, caplog):
    monkeypatch.setenv("KEPT", "3")
    monkeypatch.setenv("MADE", "1")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    caplog.set_level(logging.DEBUG, logger="library")
def test_after_innocent(): assert os.environ["KEPT"] == "1"
"""


def test_a_test_that_leaves_the_process_changed_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "test_leaks.py").write_text(TESTS, encoding="utf-8")
    monkeypatch.delenv("NUMBA_CPU_NAME", raising=False)
    said = run_tests(tmp_path, "-rA", code=1, said={"KEPT": "1"})
    failed = set(re.findall(r"^(?:ERROR|FAILED) test_leaks\.py::test_(\w+)", said, re.MULTILINE))
    names = set(re.findall(r"^def test_(\w+)", TESTS, re.MULTILINE))
    assert failed == {name for name in names if not name.startswith("after_")} - {"innocent", "imports_a_library"}, said
    assert "os.environ 'NUMBA_CPU_NAME' was None, is 'x86-64-v4'" in said
    assert "os.environ 'KEPT' was '1', is None" in said
    assert "log level of 'library' was 40, is 50" in said


SHARING = """
import os
import pytest

@pytest.fixture(scope="module")
def shared():
    with open(os.environ["STARTED"], "a") as started:
        print(os.path.basename(__file__), os.getpid(), file=started)

@pytest.mark.parametrize("number", range(8))
def test_shares(shared, number): pass
"""


@pytest.mark.long
def test_what_a_file_of_tests_starts_is_started_once(tmp_path: Path) -> None:
    """With the very arguments of ./run test.  pytest 9.2 once made xdist's groups do nothing, and nobody noticed that
    every service of the tests was started up to four times.  Files that ask one browser have one process."""
    for name, asks in (
        ("one", ""),
        ("other", ""),
        ("seen", "from browsing import used"),
        ("shown", "from browsing import look"),
    ):
        (tmp_path / f"test_{name}.py").write_text(f'"""\n{asks}\n"""{SHARING}', encoding="utf-8")
    assert "32 passed" in run_tests(tmp_path, *SIDE_BY_SIDE, said={"STARTED": str(tmp_path / "started")})
    started = dict(line.split() for line in (tmp_path / "started").read_text().splitlines())
    assert sorted(started) == ["test_one.py", "test_other.py", "test_seen.py", "test_shown.py"]
    assert started["test_seen.py"] == started["test_shown.py"]


PARENT = """
import signal, subprocess, sys
from family import die_with_parent
child = subprocess.Popen([sys.executable, "-c", "import signal; signal.pause()"], preexec_fn=die_with_parent)
print(child.pid, flush=True)
signal.pause()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="what a parent's end does to its children is Linux's own")
def test_what_a_killed_test_started_does_not_run_on() -> None:
    """A child of an interrupted test once computed for half an hour, with 5 GB."""
    with started(sys.executable, "-c", PARENT, cwd=CONFTEST.parent) as parent:
        child = psutil.Process(int(read_until("\n", parent.stdout)))
        parent.kill()  # it alone: what it started has to end by itself
        psutil.wait_procs([child], timeout=LIMIT_SECONDS)
        running = child.is_running() and child.status() != psutil.STATUS_ZOMBIE
    assert not running


BACKGROUND = """
import signal, subprocess, sys
from family import die_with_parent
assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
asked = "import signal; print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)"
subprocess.run([sys.executable, "-c", asked], preexec_fn=die_with_parent, check=True)
"""


def test_what_a_test_starts_can_be_interrupted_in_the_background_too() -> None:
    """A shell without job control starts what ends in & with SIGINT ignored, and its children inherit that."""
    background = ["sh", "-c", "trap '' INT; exec \"$@\"", "sh", sys.executable, "-c", BACKGROUND]
    done = run_process(*background, cwd=CONFTEST.parent, env=None)
    assert done.stdout == "True\n", done.stderr


def test_what_a_failed_test_started_ends_with_it() -> None:
    """With what that started itself."""
    idle = "[sys.executable, '-c', 'import signal; signal.pause()']"
    family = f"import signal, subprocess, sys; child = subprocess.Popen({idle})"
    with pytest.raises(ZeroDivisionError):  # noqa: PT012, SIM117
        with started(sys.executable, "-c", family + "; print(child.pid, flush=True); signal.pause()") as process:
            members = [psutil.Process(int(read_until("\n", process.stdout))), psutil.Process(process.pid)]
            1 / 0  # noqa: B018
    psutil.wait_procs(members, timeout=LIMIT_SECONDS)
    assert not any(one.is_running() and one.status() != psutil.STATUS_ZOMBIE for one in members)


def test_every_process_that_a_test_does_not_wait_for_ends_with_it() -> None:
    careless = [
        f"{path.name}:{node.lineno}"
        for path in {*CONFTEST.parent.rglob("*.py")} - {CONFTEST.with_name("tiers.py")}  # which is no test, and waits
        if "Popen(" in (text := path.read_text(encoding="utf-8"))
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "Popen"
        if "preexec_fn" not in {keyword.arg for keyword in node.keywords}
    ]
    assert careless == [], "add preexec_fn=die_with_parent (tests/family.py)"


CLOCKS = re.compile(r"\b(monotonic|perf_counter|process_time|thread_time|time_ns|children_seconds)\(|\btime\.time\(")


def test_no_assertion_is_on_a_clock() -> None:
    """What costs much is a row of ./run bench.  Where clocks are named in ruff.toml, this holds too."""
    found = [
        f"{path.name}:{node.lineno}"
        for path in sorted(CONFTEST.parent.rglob("test_*.py"))
        if CLOCKS.search(text := path.read_text(encoding="utf-8"))  # to parse them all takes seconds
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Assert) and CLOCKS.search(ast.unparse(node))
    ]
    assert found == []


def test_few_files_may_use_clocks() -> None:
    text = (CONFTEST.parent / "ruff.toml").read_text(encoding="utf-8")
    named = re.findall(r'^"(.+)" = \["TID251"\]', text, re.MULTILINE)
    assert len([name for name in named if name.endswith(".py")]) <= 7
    assert not [name for name in named if Path(name).name.startswith("test_")]

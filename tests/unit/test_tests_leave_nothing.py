"""A test that leaves the process changed fails, and the next test does not meet the change.

What a file of tests starts for all of them is started once, and nothing that a test starts outlives it.
"""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from family import die_with_parent, ended
from tiers import SIDE_BY_SIDE
from waiting import LIMIT_SECONDS

CONFTEST = Path(__file__).parents[1] / "conftest.py"

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


def test_a_test_that_leaves_the_process_changed_fails(tmp_path: Path) -> None:
    (tmp_path / "conftest.py").write_text(CONFTEST.read_text(encoding="utf-8"), encoding="utf-8")
    (tmp_path / "test_leaks.py").write_text(TESTS, encoding="utf-8")
    given = {name: value for name, value in os.environ.items() if not name.startswith(("NUMBA_", "PYTEST_"))}
    given |= {"KEPT": "1", "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    command = [sys.executable, "-m", "pytest", "-rA", "-p", "no:cacheprovider", "--rootdir", str(tmp_path), "."]
    done = subprocess.run(
        command, cwd=tmp_path, env=given, capture_output=True, text=True, timeout=LIMIT_SECONDS, check=False
    )
    failed = set(re.findall(r"^(?:ERROR|FAILED) test_leaks\.py::test_(\w+)", done.stdout, re.MULTILINE))
    names = set(re.findall(r"^def test_(\w+)", TESTS, re.MULTILINE))
    assert failed == {name for name in names if not name.startswith("after_")} - {"innocent", "imports_a_library"}, (
        done.stdout
    )
    assert "os.environ 'NUMBA_CPU_NAME' was None, is 'x86-64-v4'" in done.stdout
    assert "os.environ 'KEPT' was '1', is None" in done.stdout
    assert "log level of 'library' was 40, is 50" in done.stdout


SHARING = """
import os
import pytest

@pytest.fixture(scope="module")
def shared():
    with open(os.environ["STARTED"], "a") as started:
        print(os.path.basename(__file__), file=started)

@pytest.mark.parametrize("number", range(8))
def test_shares(shared, number): pass
"""


@pytest.mark.long
def test_what_a_file_of_tests_starts_is_started_once(tmp_path: Path) -> None:
    """With the very arguments of ./run test.  pytest 9.2 once made xdist's groups do nothing, and nobody noticed that
    every service of the tests was started up to four times."""
    for name in ("test_one.py", "test_other.py"):
        (tmp_path / name).write_text(SHARING, encoding="utf-8")
    given = {name: value for name, value in os.environ.items() if not name.startswith(("NUMBA_", "PYTEST_"))}
    given |= {"STARTED": str(tmp_path / "started"), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    command = [sys.executable, "-m", "pytest", "-p", "xdist", "--rootdir", str(tmp_path), *SIDE_BY_SIDE, "."]
    done = subprocess.run(
        command, cwd=tmp_path, env=given, capture_output=True, text=True, timeout=LIMIT_SECONDS, check=False
    )
    assert "16 passed" in done.stdout, done.stdout
    assert sorted((tmp_path / "started").read_text().split()) == ["test_one.py", "test_other.py"]


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
    started = subprocess.Popen(
        [sys.executable, "-c", PARENT], cwd=CONFTEST.parent, stdout=subprocess.PIPE, preexec_fn=die_with_parent
    )
    with ended(started) as parent:
        assert parent.stdout is not None
        child = psutil.Process(int(parent.stdout.readline()))
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
    done = subprocess.run(
        background, cwd=CONFTEST.parent, capture_output=True, text=True, timeout=LIMIT_SECONDS, check=False
    )
    assert done.stdout == "True\n", done.stderr


def test_what_a_failed_test_started_ends_with_it() -> None:
    """With what that started itself."""
    idle = "[sys.executable, '-c', 'import signal; signal.pause()']"
    family = f"import signal, subprocess, sys; child = subprocess.Popen({idle})"
    with pytest.raises(ZeroDivisionError):  # noqa: PT012, SIM117
        with ended(
            subprocess.Popen(
                [sys.executable, "-c", family + "; print(child.pid, flush=True); signal.pause()"],
                stdout=subprocess.PIPE,
                text=True,
                preexec_fn=die_with_parent,
            )
        ) as process:
            assert process.stdout is not None
            members = [psutil.Process(int(process.stdout.readline())), psutil.Process(process.pid)]
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

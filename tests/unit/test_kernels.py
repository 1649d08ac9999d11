"""Compiled kernels are those of the sources, versions and processor at hand: real processes, two checkouts, one store.

A checkout here is a copy of the package with two small modules put in: ``tail/caller.py`` compiles a kernel that calls
one of ``tail/callee.py`` and multiplies by a constant of ``geometry/factor.py``, which holds no kernel at all.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from family import die_with_parent, ended
from tailstack.kernels import processor, sources, store
from waiting import LIMIT_SECONDS

PACKAGE = sources.ROOT
CALLEE = """
from ..kernels.store import kernel

@kernel()
def add(x):
    return x + 1.0
"""
CALLER = """
from ..geometry.factor import FACTOR
from ..kernels.store import kernel
from .callee import add

@kernel()
def answer(x):
    return FACTOR * add(x)
"""
ASK = """
import json
from tailstack.kernels import store
{before}
from tailstack.tail.caller import answer
number = answer(1.0)
print(json.dumps({{"number": number, "loaded": store.TRAFFIC.loaded, "compiled": store.TRAFFIC.compiled}}))
"""


@dataclass
class Checkout:
    """A copy of the sources, and the folder that its processes keep kernels in."""

    root: Path
    store: Path

    def write(self, file: str, text: str) -> None:
        (self.root / "tailstack" / file).write_text(text, encoding="utf-8")

    def install(self) -> Path:
        """Make what was compiled so far the kernels that came with the installation."""
        package = self.root / "tailstack_kernels"
        return self.store.rename(package)

    def run(self, program: str, **variables: str) -> subprocess.CompletedProcess[str]:
        given = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_CACHE")}
        given |= {"PYTHONPATH": str(self.root), "NUMBA_CACHE_DIR": str(self.store), **variables}
        given["PYTHONDONTWRITEBYTECODE"] = "1"  # Python takes a change within a second and of one length for none
        command = [sys.executable, "-c", program]
        return subprocess.run(
            command, cwd=self.root, env=given, capture_output=True, text=True, timeout=LIMIT_SECONDS, check=False
        )

    def ask(self, before: str = "", **variables: str) -> dict[str, Any]:
        """The number that the kernel comes to, and how many kernels were loaded and compiled for it."""
        done = self.run(ASK.format(before=before), **variables)
        assert done.returncode == 0, done.stderr
        said: dict[str, Any] = json.loads(done.stdout)
        return said | ({"stderr": done.stderr} if done.stderr else {})


def checkout(place: Path, store: Path) -> Checkout:
    made = Checkout(place, store)
    reached = {*sources.reach("__init__.py"), *sources.reach("kernels/store.py")}
    for name in {*reached, *(f"{name}i" for name in reached if (PACKAGE / f"{name}i").exists())}:
        (place / "tailstack" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(PACKAGE / name, place / "tailstack" / name)
    for folder in ("tail", "geometry", "results"):
        (place / "tailstack" / folder).mkdir(exist_ok=True)
        made.write(f"{folder}/__init__.py", "")
    made.write("tail/callee.py", CALLEE)
    made.write("tail/caller.py", CALLER)
    made.write("geometry/factor.py", "FACTOR = 10.0\n")
    return made


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the kernels of a checkout were compiled into."""
    place = tmp_path_factory.mktemp("compiled")
    made = checkout(place / "checkout", place / "store")
    assert made.ask() == {"number": 20.0, "loaded": 0, "compiled": 2}
    return made.store


@pytest.fixture
def first(tmp_path: Path, compiled: Path) -> Checkout:
    """A checkout whose kernels are compiled."""
    shutil.copytree(compiled, tmp_path / "store")
    return checkout(tmp_path / "first", tmp_path / "store")


@pytest.mark.long
def test_a_change_of_what_a_kernel_calls_in_another_file_shows_at_once(first: Checkout, tmp_path: Path) -> None:
    second = checkout(tmp_path / "second", first.store)
    second.write("tail/callee.py", CALLEE.replace("1.0", "2.0"))
    assert second.ask() == {"number": 30.0, "loaded": 0, "compiled": 2}
    assert first.ask() == {"number": 20.0, "loaded": 1, "compiled": 0}  # neither drives the other out


def test_a_change_of_a_constant_in_a_file_without_kernels_shows_at_once(first: Checkout) -> None:
    first.write("geometry/factor.py", "FACTOR = 11.0\n")
    assert first.ask() == {"number": 22.0, "loaded": 1, "compiled": 1}  # what does not reach it is as it was


def test_a_change_of_what_no_kernel_reaches_compiles_nothing(first: Checkout) -> None:
    first.write("version.py", '__version__ = "9.9"\n')
    assert first.ask() == {"number": 20.0, "loaded": 1, "compiled": 0}


@pytest.mark.long
def test_kernels_of_other_versions_of_the_compiler_are_not_used(first: Checkout) -> None:
    for library in ("numba", "llvmlite"):
        assert f"{library} {version(library)}" in store.BUILT_WITH
    assert f"numpy {version('numpy').rpartition('.')[0]}" in store.BUILT_WITH  # numba looks at no more of it
    before = "store.BUILT_WITH = store.BUILT_WITH.replace('llvmlite ', 'llvmlite 9')"
    assert first.ask(before) == {"number": 20.0, "loaded": 0, "compiled": 2}


@pytest.mark.long
def test_kernels_of_another_processor_are_not_used(first: Checkout) -> None:
    other = {"NUMBA_CPU_NAME": "x86-64-v2", "NUMBA_CPU_FEATURES": ""}
    assert first.ask(**other) == {"number": 20.0, "loaded": 0, "compiled": 2}
    assert first.ask(**other) == {"number": 20.0, "loaded": 1, "compiled": 0}


@pytest.mark.long
def test_a_damaged_file_is_compiled_again(first: Checkout) -> None:
    (damaged,) = first.store.glob("tail.caller.answer-*")
    whole = damaged.read_bytes()
    for content in (whole[:-1], whole[:100], b"", whole[:-9] + bytes([whole[-9] ^ 1]) + whole[-8:]):
        damaged.write_bytes(content)
        assert first.ask() == {"number": 20.0, "loaded": 1, "compiled": 1}
    assert json.loads(damaged.read_bytes().splitlines()[0]) == json.loads(whole.splitlines()[0])


@pytest.mark.long
def test_a_process_whose_sources_were_replaced_does_not_mix_them(first: Checkout) -> None:
    """It has the old callee, and would compile the new caller with it."""
    change = "path = store.sources.ROOT / '{}'; path.write_text(path.read_text().replace('{}', '{}'))"
    begin = "import tailstack.tail.callee\n"
    done = first.run(ASK.format(before=begin + change.format("geometry/factor.py", "10.0", "12.0")))
    assert "SourcesChangedError" in done.stderr
    assert "geometry/factor.py was changed while this process was running" in done.stderr
    assert "start the process again" in done.stderr
    done = first.run(ASK.format(before=begin + change.format("tail/callee.py", "1.0", "5.0")))
    assert "tail/callee.py was changed while this process was running" in done.stderr
    assert first.ask() == {"number": 72.0, "loaded": 0, "compiled": 2}


@pytest.mark.long
def test_what_was_imported_before_a_change_is_kept_under_its_own_name(first: Checkout) -> None:
    """A process compiles late what it imported early: the old code must not be filed under the new sources."""
    first.write("tail/callee.py", CALLEE.replace("1.0", "3.0"))
    program = """
import tailstack.tail.caller as caller
from tailstack.kernels import store
path = store.sources.ROOT / "tail/callee.py"
path.write_text(path.read_text().replace("3.0", "7.0"))
print(caller.answer(1.0))
"""
    done = first.run(program)
    assert done.stdout == "40.0\n", done.stderr
    assert first.ask() == {"number": 80.0, "loaded": 0, "compiled": 2}


def test_without_a_place_to_keep_kernels_the_number_comes_and_the_reason_is_said(first: Checkout) -> None:
    shutil.rmtree(first.store)
    first.store.touch()
    said = first.ask()
    assert said["number"] == 20.0
    assert said["stderr"].count("cannot be written") == 1
    assert "NUMBA_CACHE_DIR" in said["stderr"]


@pytest.mark.long
def test_kernels_that_came_with_the_installation_are_used_and_only_read(first: Checkout) -> None:
    installed = first.install()
    installed.chmod(0o500)
    for file in installed.iterdir():
        os.utime(file, (0, 0))
    assert first.ask() == {"number": 20.0, "loaded": 1, "compiled": 0}
    assert not first.store.exists()
    assert {file.stat().st_mtime for file in installed.iterdir()} == {0}
    first.write("geometry/factor.py", "FACTOR = 13.0\n")
    assert first.ask() == {"number": 26.0, "loaded": 1, "compiled": 1}
    assert len(list(first.store.iterdir())) == 1


LEVEL = {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": ""}
WHY = "print(store.why_not_installed(), file=__import__('sys').stderr)"


@pytest.mark.long
@pytest.mark.skipif("x86-64-v3" not in processor.levels_here(), reason="kernels of a level cannot be run here")
def test_kernels_of_a_level_are_used_by_every_processor_that_has_it(tmp_path: Path) -> None:
    """And numba goes on compiling for this processor."""
    made = checkout(tmp_path / "one", tmp_path / "store")
    assert made.ask(**LEVEL) == {"number": 20.0, "loaded": 0, "compiled": 2}
    made.install()
    program = "import numba, llvmlite.binding as llvm; from tailstack.tail.caller import answer; answer(1.0)\n"
    ours = "print(store.target()[1] == llvm.get_host_cpu_name(), numba.config.CPU_NAME)"
    assert made.run(program + "from tailstack.kernels import store; " + ours).stdout == "True None\n"
    assert made.ask(WHY) == {"number": 20.0, "loaded": 1, "compiled": 0, "stderr": "\n"}
    assert not made.store.exists()
    assert made.ask("store.level_targets = lambda: []\n" + WHY) == {
        "number": 20.0, "loaded": 0, "compiled": 2,
        "stderr": f"those installed were built for x86-64-v3, here is {store.target()[1]}\n",
    }  # fmt: skip
    other = "store.BUILT_WITH = store.BUILT_WITH.replace('numba ', 'numba 9')"
    said = made.ask(other + "\n" + WHY)
    assert (said["loaded"], said["compiled"]) == (0, 2)
    ours = f"numba {version('numba')}"
    assert said["stderr"] == f"those installed were built with {ours}, here is {ours.replace('numba ', 'numba 9')}\n"
    made.write("geometry/factor.py", "FACTOR = 11.0\n")
    said = made.ask(WHY)
    assert (said["number"], said["compiled"]) == (22.0, 1)
    assert said["stderr"] == "those installed were built from other sources\n"


@pytest.mark.long
def test_a_constant_that_a_library_computed_is_part_of_the_name(first: Checkout) -> None:
    """numpy or scipy of tomorrow may come to another digit, with the same sources."""
    table = "import os\nimport numpy as np\nFACTOR = np.float64(os.environ.get('DIGIT', '10.0'))\n"
    first.write("geometry/factor.py", table)
    assert first.ask() == {"number": 20.0, "loaded": 1, "compiled": 1}
    assert first.ask(DIGIT="10.5") == {"number": 21.0, "loaded": 1, "compiled": 1}
    assert first.ask() == {"number": 20.0, "loaded": 1, "compiled": 0}


@pytest.mark.long
def test_what_a_file_holds_does_not_depend_on_the_folder_of_the_sources(first: Checkout, tmp_path: Path) -> None:
    second = checkout(tmp_path / "elsewhere", tmp_path / "other")
    assert second.ask(PYTHONHASHSEED="7") == {"number": 20.0, "loaded": 0, "compiled": 2}
    files = {path.name: path.read_bytes() for path in first.store.iterdir()}
    assert files == {path.name: path.read_bytes() for path in second.store.iterdir()}


def test_whoever_is_without_a_home_computes_and_leaves_nothing_behind(first: Checkout) -> None:
    """Such a user has no entry among the users either; "~" is then no folder."""
    before = "import os; os.path.expanduser = lambda path: path\n"
    program = before + ASK.format(before="")
    given = {"HOME": "", "XDG_CACHE_HOME": "relative", "NUMBA_CACHE_DIR": ""}
    if os.geteuid() == 0:  # who may write anywhere: the folder alone
        done = first.run(before + "from tailstack.kernels import store; print(store.writable_directory())", **given)
        assert done.stdout == "/nonexistent/tailstack/kernels\n"
    else:
        done = first.run(program, **given)
        assert json.loads(done.stdout)["number"] == 20.0
        assert done.stderr.count("cannot be written") == 1
    assert not (first.root / "~").exists()
    assert not (first.root / "relative").exists()


@pytest.mark.long
def test_files_that_nobody_loaded_for_a_month_go(first: Checkout) -> None:
    (old,) = first.store.glob("tail.caller.answer-*")
    (other,) = first.store.glob("tail.callee.add-*")
    long_ago = old.stat().st_mtime - 31 * 86_400
    os.utime(old, (long_ago, long_ago))
    os.utime(other, (long_ago, long_ago))
    first.write("geometry/factor.py", "FACTOR = 14.0\n")
    assert first.ask()["number"] == 28.0
    assert not old.exists()
    assert other.stat().st_mtime > long_ago + 86_400  # loaded just now, and so in use


@pytest.mark.long
def test_two_kernels_cannot_have_one_name(first: Checkout) -> None:
    first.write("tail/caller.py", CALLER + "\n\n@kernel()\ndef answer(x):\n    return x\n")
    assert "there is another kernel called tail.caller.answer" in first.run(ASK.format(before="")).stderr
    closing = "\n\ndef make(y):\n    @kernel()\n    def inner(x):\n        return x + y\n    return inner\nmake(1.0)\n"
    first.write("tail/caller.py", CALLER + closing)
    assert "closes over values" in first.run(ASK.format(before="")).stderr


@pytest.mark.long
def test_processes_that_compile_at_once_leave_whole_files(tmp_path: Path) -> None:
    """independent: what each wrote is read by numba's own loader in a later process."""
    made = checkout(tmp_path / "one", tmp_path / "store")
    program = ASK.format(before="") + "answer(1); answer(1.0 + 0j); print(answer(2), answer(2.0), answer(1j))"
    given = {**os.environ, "PYTHONPATH": str(made.root), "NUMBA_CACHE_DIR": str(made.store)}
    command = [sys.executable, "-c", program]
    with ExitStack() as stack:
        started = [
            subprocess.Popen(command, env=given, stdout=subprocess.PIPE, text=True, preexec_fn=die_with_parent)
            for _ in range(3)
        ]
        for process in started:
            stack.enter_context(ended(process))
        said = {process.communicate(timeout=LIMIT_SECONDS)[0].splitlines()[-1] for process in started}
    assert said == {"30.0 30.0 (10+10j)"}
    done = made.run(program + "; print(store.TRAFFIC.compiled)")
    assert done.stdout.splitlines()[-1] == "30.0 30.0 (10+10j)\n0".splitlines()[-1], done.stderr
    assert not list(made.store.glob(".*"))
    assert len(list(made.store.iterdir())) == 6

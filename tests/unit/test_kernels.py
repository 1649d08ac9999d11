"""Compiled kernels are those of the sources, versions and processor at hand: real processes, two checkouts, one store.

A checkout here is a copy of the package with two small modules put in: ``tail/caller.py`` compiles a kernel that calls
one of ``tail/callee.py`` and multiplies by a constant of ``geometry/factor.py``, which holds no kernel at all.  Which
sources a kernel reaches is held to Python's own parser, the table of kernels compiled ahead to what computations call.
"""

from __future__ import annotations

import ast
import importlib
import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from contextlib import ExitStack
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from family import run_process, started
from tailstack.kernels import calls, process, processor, sources, store
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
        return run_process(sys.executable, "-c", program, cwd=self.root, env=given)

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
def test_kernels_of_another_compiler_or_processor_are_not_used(first: Checkout) -> None:
    other = {"NUMBA_CPU_NAME": "x86-64-v2", "NUMBA_CPU_FEATURES": ""}
    assert first.ask(**other) == {"number": 20.0, "loaded": 0, "compiled": 2}
    assert first.ask(**other) == {"number": 20.0, "loaded": 1, "compiled": 0}
    for library in ("numba", "llvmlite"):
        assert f"{library} {version(library)}" in store.BUILT_WITH
    assert f"numpy {version('numpy').rpartition('.')[0]}" in store.BUILT_WITH  # numba looks at no more of it
    before = "store.BUILT_WITH = store.BUILT_WITH.replace('llvmlite ', 'llvmlite 9')"
    assert first.ask(before) == {"number": 20.0, "loaded": 0, "compiled": 2}


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
    with ExitStack() as stack:
        processes = [stack.enter_context(started(sys.executable, "-c", program, env=given)) for _ in range(3)]
        said = {process.communicate(timeout=LIMIT_SECONDS)[0].splitlines()[-1] for process in processes}
    assert said == {"30.0 30.0 (10+10j)"}
    done = made.run(program + "; print(store.TRAFFIC.compiled)")
    assert done.stdout.splitlines()[-2:] == ["30.0 30.0 (10+10j)", "0"], done.stderr
    assert not list(made.store.glob(".*"))
    assert len(list(made.store.iterdir())) == 6


def module_of(file: str) -> list[str]:
    parts = ["tailstack", *file.removesuffix(".py").split("/")]
    return parts[:-1] if parts[-1] == "__init__" else parts


def files_imported(file: str) -> set[str]:
    """independent: every import statement outside of functions, by the syntax tree; a name may be a module."""
    found: set[str] = set()
    waiting: list[ast.AST] = [ast.parse((PACKAGE / file).read_text(encoding="utf-8"))]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.ImportFrom):
            here = module_of(file) if file.endswith("__init__.py") else module_of(file)[:-1]
            base = here[: len(here) - node.level + 1] if node.level else []
            module = [*base, *(node.module.split(".") if node.module else [])]
            found |= {".".join([*module, alias.name]) for alias in node.names} | {".".join(module)}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda) and not _for_types_only(node):
            waiting += ast.iter_child_nodes(node)
    files = {file for file in sources.SOURCES if ".".join(module_of(file)) in found}
    return files - {file}


def _for_types_only(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def test_what_nothing_uses_of_numpy_is_loaded_when_it_is_asked_for() -> None:
    parts = {"numpy.f2py": "numpy.f2py.crackfortran", "numpy.testing": "numpy.testing._private.utils"}
    assert set(parts) == set(process.LATE)
    program = f"""
import sys
from tailstack.kernels.process import load_late
{{load}}
import numpy as np, scipy.special
print([part in sys.modules for part in {list(parts.values())}])
np.testing.assert_equal(np.f2py.__name__, "numpy.f2py")
print([part in sys.modules for part in {list(parts.values())}])
"""
    done = run_process(sys.executable, "-c", program.format(load="load_late()"))
    assert done.stdout.split("\n")[:2] == ["[False, False]", "[True, True]"], done.stderr
    done = run_process(sys.executable, "-c", program.format(load=""))  # so SciPy does ask for them
    assert done.stdout.split("\n")[:2] == ["[True, True]", "[True, True]"], done.stderr


def test_every_source_is_there_and_every_import_is_seen() -> None:
    there = {path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py") if "__pycache__" not in path.parts}
    assert set(sources.SOURCES) == there
    for file in sorted(sources.SOURCES):
        assert files_imported(file) <= sources.imports_of(file)


def test_every_kernel_is_kept_by_its_sources() -> None:
    """numba's own cache is nowhere in use, and numba still asks ours."""
    for file, source in sources.SOURCES.items():
        assert b"cache=True" not in source.content, file
        assert b"enable_caching" not in source.content, file
    makers = {sources.COMPILER, "montecarlo/lanes.py"}
    files = [name for name in sources.SOURCES if makers & sources.imports_of(name)]
    decorated = re.compile(rb"^@(kernel|lane_jit|lane_entry)\b", re.MULTILINE)
    assert {file for file, source in sources.SOURCES.items() if decorated.search(source.content)} <= set(files)
    for file in files:
        importlib.import_module(".".join(module_of(file)))
    assert len(store.KERNELS) > 50
    assert {name.rpartition(".")[0].replace(".", "/") + ".py" for name in store.KERNELS} <= set(files)
    assert all(isinstance(one._cache, store.KernelStore) for one in store.KERNELS.values())


def test_a_kernel_that_was_called_came_from_the_store_or_went_there() -> None:
    import numpy as np

    from tailstack.kernels.numerics import eigen_symmetric

    eigen_symmetric(np.eye(3))
    assert store.TRAFFIC.loaded + store.TRAFFIC.compiled > 0
    kept = [one for one in store.stored_kernels(store.writable_directory()) if one.current]
    assert "kernels.numerics.eigen_symmetric" in {one.name for one in kept}
    assert all(one.sound for one in kept)
    assert not any(" at 0x" in one.signature for one in kept)  # an address names nothing in another process


ROOT = Path(__file__).parents[2]
BUILD = ROOT / "solver" / "kernels_wheel" / "build.py"
PROGRAM = """
import json, sys
from contextlib import suppress
from pathlib import Path
import numpy as np
from numba.core import event
from numba.core.sigutils import normalize_signature
from tailstack import allocate, load_design, optimise, score, score_batch, verify
from tailstack.errors import TailstackError
from tailstack.kernels import store
from tailstack.optimisation.allocation import allocate as bound_allocation
from tailstack.optimisation.prices import reciprocal
from tailstack_service.operations.example import EXAMPLE_DESIGN

depth, called, load = [0], [], store.KernelStore.load_overload

class Depth(event.Listener):
    def on_start(self, _):
        depth[0] += 1

    def on_end(self, _):
        depth[0] -= 1

def note(store, sig, context):
    if depth[0] == 0:  # by Python, not by a kernel that is being compiled
        called.append((store._name, str(normalize_signature(sig)[0])))
    return load(store, sig, context)

event.register("numba:compile", Depth())
store.KernelStore.load_overload = note
connector = EXAMPLE_DESIGN["interfaces"]["structure_connector"]
flat = {
    **EXAMPLE_DESIGN,
    "fiducials": {"points": EXAMPLE_DESIGN["fiducials"]["points"]},
    "interfaces": {"structure_connector": {**connector, "tolerances": {"rx": connector["tolerances"]["rx"]}}},
    "views": [{**view, "fiducial_noise_px": 0.0, "target_noise_px": 0.0} for view in EXAMPLE_DESIGN["views"]],
}
designs = [load_design(source) for source in (*sorted(Path(sys.argv[1]).glob("*.yaml")), flat)]
seen = {}
for design in designs:
    score(design, fifty_shots=True)
seen["score"], called[:] = list(called), []
for design in designs:
    with suppress(TailstackError):  # noise that follows from quanta and contrast is no number to vary
        score_batch(design, {"/views/0/fiducial_noise_px": [0.2, 0.3], "/fiducials/points/0/position_mm/0": [0.0, 0.1]})
seen["batch"], called[:] = list(called), []
for design in designs[:-1]:
    verify(design, trials=1000, threads=1)
    with suppress(TailstackError):  # not every design can be drawn by directions
        verify(design, trials=1000, threads=1, method="radial")
    with suppress(TailstackError):
        score(design, second_order=True)
seen["verify"], called[:] = list(called), []
for name in ("demo", "tube_carrier"):
    optimise(load_design(Path(sys.argv[1]) / f"{name}.yaml"), starts=2, threads=1)
allocate(load_design(Path(sys.argv[1]) / "demo.yaml"))
bound_allocation(0.01 * np.eye(3), np.eye(3), [reciprocal()] * 3, np.ones(3), 1.0, lower=0.1, upper=1.0)
seen["optimise"] = list(called)
print(json.dumps(seen))
"""


def run(*command: str, **variables: str) -> subprocess.CompletedProcess[str]:
    given = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path), **variables}
    return run_process(sys.executable, *command, env=given, timeout=5 * LIMIT_SECONDS)


def test_named_tuples_of_the_table_have_as_many_fields_as_their_classes() -> None:
    """One that grew and was forgotten here is compiled in vain by every process, and looked for under another name."""
    wrong = replace(calls.EVERY[0], arguments="f1 montecarlo.kernel.Results(f1 f1)")
    with pytest.raises(ValueError, match=r"montecarlo\.kernel\.Results has 3 fields, here 2"):
        _ = wrong.signature
    assert all(call.signature for call in calls.EVERY)


@pytest.mark.long
def test_the_table_names_what_computations_call() -> None:
    """independent: numba's own requests to the store, while designs are scored, verified and optimised."""
    made = run("-c", "from tailstack.kernels import calls\nfor call in calls.EVERY: call.compile()")
    assert made.returncode == 0, made.stderr  # what is being compiled asks for others beside
    done = run("-c", PROGRAM, str(ROOT / "examples"))
    assert done.returncode == 0, done.stderr
    for computation, called in json.loads(done.stdout).items():
        table = {(call.kernel, str(call.signature)) for call in calls.CALLS[computation]}
        others = {(call.kernel, str(call.signature)) for call in calls.EVERY} - table
        assert {tuple(call) for call in called} - others == table, computation


def test_every_file_that_a_kernel_reaches_is_in_the_name_of_its_machine_code(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each source in turn is given a comment, as the other tests of sources do with files on the disk."""
    caches = (sources.imports_of, sources.reach, sources.digest_of)
    stores = [(call.dispatcher._cache, call.signature) for call in calls.EVERY]

    def names() -> list[str]:
        return [kept._file_name(kept._key(signature, store.target())) for kept, signature in stores]

    before, original = names(), dict(sources.SOURCES)
    reached = [set(sources.reach(store._file)) for store, _ in stores]
    try:
        for changed in sorted(set().union(*reached)):
            altered = sources.SourceFile(original[changed].content + b"# changed\n", original[changed].modified_ns)
            monkeypatch.setattr(sources, "SOURCES", {**original, changed: altered})
            for cached in caches:
                cached.cache_clear()
            assert [a != b for a, b in zip(before, names(), strict=True)] == [changed in files for files in reached]
    finally:
        monkeypatch.undo()
        for cached in caches:
            cached.cache_clear()


# The second has an expression of whole arrays, whose function numba calls by an address
FEW = "tail.lattice.balls,tail.lattice.reach_of"


@pytest.mark.long
def test_the_wheel_of_kernels_has_the_same_bytes_when_it_is_built_again(tmp_path: Path) -> None:
    wheels = []
    for seed in ("1", "2"):
        done = run(str(BUILD), "-o", str(tmp_path / seed), "--only", FEW, PYTHONHASHSEED=seed)
        assert done.returncode == 0, done.stderr
        wheels.append(next((tmp_path / seed).glob("*.whl")))
    assert wheels[0].name == wheels[1].name
    assert wheels[0].read_bytes() == wheels[1].read_bytes()
    with zipfile.ZipFile(wheels[0]) as wheel:
        assert wheel.testzip() is None
        files = [name for name in wheel.namelist() if name.endswith(store.SUFFIX)]
        assert len(files) == 2 * max(1, len(processor.levels_here()))
        assert not any(str(ROOT).encode() in wheel.read(name) for name in files)
        metadata = wheel.read(f"tailstack_kernels-{wheels[0].name.split('-')[1]}.dist-info/METADATA").decode()
    assert "Requires-Dist: numba ==" in metadata
    assert "Requires-Dist: llvmlite ==" in metadata

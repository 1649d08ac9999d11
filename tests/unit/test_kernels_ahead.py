"""The table of kernels that are compiled ahead, against what computations call; the wheel of kernels, built twice."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tailstack.kernels import calls, processor, sources, store
from waiting import LIMIT_SECONDS

ROOT = Path(__file__).parents[2]
BUILD = ROOT / "solver" / "kernels_wheel" / "build.py"
PROGRAM = """
import json, sys
from contextlib import suppress
from pathlib import Path
from numba.core import event
from numba.core.sigutils import normalize_signature
from tailstack import load_design, optimise, score, score_batch, verify
from tailstack.errors import TailstackError
from tailstack.kernels import store
from tailstack_service.operations.example import variants

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
examples = sorted(Path(sys.argv[1]).glob("*.yaml"))
designs = [load_design(source) for source in (*examples, *variants())]
seen = {}
for design in designs:
    score(design)
seen["score"], called[:] = list(called), []
for design in designs:
    score_batch(design, {"/views/0/fiducial_noise_px": [0.2, 0.3], "/fiducials/points/0/position_mm/0": [0.0, 0.1]})
seen["batch"], called[:] = list(called), []
for design in designs[: len(examples)]:
    verify(design, trials=1000, threads=1)
    with suppress(TailstackError):  # not every design can be drawn by directions
        verify(design, trials=1000, threads=1, method="radial")
    with suppress(TailstackError):
        score(design, second_order=True)
seen["verify"], called[:] = list(called), []
for name in ("demo", "tube_carrier"):
    optimise(load_design(Path(sys.argv[1]) / f"{name}.yaml"), starts=2, threads=1)
seen["optimise"] = list(called)
print(json.dumps(seen))
"""


def run(*command: str, **variables: str) -> subprocess.CompletedProcess[str]:
    given = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path), **variables}
    return subprocess.run(
        [sys.executable, *command], env=given, capture_output=True, text=True, timeout=5 * LIMIT_SECONDS, check=False
    )


@pytest.mark.long
def test_the_table_names_what_computations_call() -> None:
    """independent: numba's own requests to the store, while designs are scored, verified and optimised."""
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

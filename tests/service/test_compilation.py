"""Kernels that are missing: compiled in processes beside, counted aloud, kept where that is possible."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from service_scenes import ROOT

from family import run_process
from tailstack.kernels import processor, store
from waiting import LIMIT_SECONDS

# Some that take a moment, as if a verb needed no others; the last two are of one file, which no other imports
FEW = ("tail.lattice.balls", "tail.gaussian.brought_near", "tail.per_unit.position_of", "tail.per_unit.average_at")
COUNT = len(FEW)

BEGIN = f"""
import json, sys
import numpy as np
from tailstack_service.console import compilation, progress
from tailstack.kernels import calls, store
from tailstack.kernels.process import prepare_with
progress.QUIET_SECONDS = 0.01
calls.calls_for = lambda _: tuple(call for call in calls.EVERY if call.kernel in {FEW})
"""
PROGRAM = f"""{BEGIN}
prepare_with(lambda: compilation.compile_for(["score"]))
from tailstack.tail.gaussian import brought_near
from tailstack.tail.lattice import balls
from tailstack.tail.per_unit import average_at, position_of
balls(1.0, np.array([0.5])); brought_near(np.ones(3), np.zeros(3))
average_at(np.ones(3), 1, 0.5); position_of(np.ones(3), 1, 0.5)
print(json.dumps([store.TRAFFIC.compiled, store.TRAFFIC.loaded, store.TRAFFIC.installed]))
"""
WARM_UP = f"""{BEGIN}
from tailstack_service.cli.main import main
main(["warm-up", "--for", "score"])
"""


def run(place: Path, **variables: str) -> tuple[str, str]:
    given = {name: value for name, value in os.environ.items() if name not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
    given |= {"HOME": str(place), "PYTHONPATH": os.pathsep.join(path for path in sys.path if path), **variables}
    done = run_process(sys.executable, "-c", PROGRAM, env=given)
    return done.stdout, done.stderr


@pytest.mark.long
def test_what_a_command_needs_is_compiled_once_and_counted(tmp_path: Path) -> None:
    out, err = run(tmp_path)
    assert json.loads(out) == [0, COUNT, 0], err  # none here: other processes did it
    assert re.fullmatch(
        r"(compiling kernels, once on this machine: 0 s\n)?"  # before the first is begun
        r"(compiling kernels, once on this machine: \d+ s(, \d+ %, about \d+ s left)?, [0-4] of 4\n)+",
        err,
    ), err
    stored = {path.name.rpartition("-")[0] for path in (tmp_path / ".cache/tailstack/kernels").glob("*.kernel")}
    assert stored >= {*FEW}
    out, err = run(tmp_path)
    assert (json.loads(out), err) == ([0, COUNT, 0], "")


@pytest.mark.long
def test_without_a_place_to_keep_them_they_are_compiled_beside_all_the_same(tmp_path: Path) -> None:
    (tmp_path / "home").touch()  # no folder can be made in it
    out, err = run(tmp_path / "home", TMPDIR=str(tmp_path))
    assert json.loads(out) == [0, COUNT, 0], err
    assert err.count("cannot be written") == 1
    assert "set NUMBA_CACHE_DIR" in err
    assert [path.name for path in tmp_path.iterdir()] == ["home"]  # what was lent is gone


def test_an_unknown_verb_is_refused_with_those_that_there_are(refused: Any) -> None:
    assert "there is no verb 'scre'" in refused("warm-up", "--for", "scre")


# --- both wheels in an environment of their own, without a network: nothing is compiled --------------


BUILD = ROOT / "solver" / "kernels_wheel" / "build.py"


@dataclass(frozen=True)
class Environment:
    """Where both wheels are installed."""

    place: Path
    python: str
    packages: Path

    def run(self, program: str) -> subprocess.CompletedProcess[str]:
        left_out = ("TAILSTACK_", "NUMBA_", "PYTHON", "XDG_")
        given = {name: value for name, value in os.environ.items() if not name.startswith(left_out)}
        given |= {"HOME": str(self.place / "home"), "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
        return run_process(self.python, "-c", program, cwd=self.place, env=given, timeout=3 * LIMIT_SECONDS)


def quietly(*command: str, **variables: str) -> str:
    done = run_process(*command, cwd=ROOT, env={**os.environ, **variables}, timeout=5 * LIMIT_SECONDS)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of tailstack as a release has it, and that of the few kernels for the highest level here."""
    if not processor.levels_here():
        pytest.skip("no kernels are distributed for this processor")
    place = tmp_path_factory.mktemp("wheels")
    quietly(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(place), TAILSTACK_RELEASE="1")
    path = os.pathsep.join(path for path in sys.path if path)
    quietly(
        sys.executable, str(BUILD), "-o", str(place), "--only", ",".join(FEW), "--levels", processor.levels_here()[0],
        "--store", str(store.writable_directory()), PYTHONPATH=path,
    )  # fmt: skip
    return place


def packages_of(environment: Path) -> Path:
    return next(environment.glob("lib/python*/site-packages"))


@pytest.fixture(scope="module")
def environment(wheels: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where both wheels are installed, as pip installs them."""
    place = tmp_path_factory.mktemp("installed") / "environment"
    quietly(sys.executable, "-m", "venv", "--without-pip", str(place))
    (packages_of(place) / "libraries.pth").write_text(sysconfig.get_path("purelib"), encoding="utf-8")
    quietly(
        sys.executable, "-m", "pip", "--python", str(place / "bin" / "python"), "install", "--no-deps", "--no-index",
        "--ignore-installed", *map(str, wheels.glob("*.whl")),
    )  # fmt: skip
    return place


@pytest.fixture
def installed(environment: Path, tmp_path: Path) -> Environment:
    """A copy of it, which a test may change."""
    copy = shutil.copytree(environment, tmp_path / "environment", symlinks=True)
    return Environment(tmp_path, str(copy / "bin" / "python"), packages_of(copy))


@pytest.mark.long
def test_what_is_installed_is_loaded_and_nothing_is_compiled(installed: Environment) -> None:
    done = installed.run(PROGRAM)
    assert (done.returncode, json.loads(done.stdout), done.stderr) == (0, [0, COUNT, COUNT], "")
    assert not (installed.place / "home").exists()  # nothing had to be kept
    says = installed.run(WARM_UP).stdout
    assert says == f"{COUNT} kernels: {COUNT} installed, for {processor.levels_here()[0]}; none compiled now\n"


@pytest.mark.long
@pytest.mark.parametrize(
    ("at_start", "words"),
    [
        ("import numba; numba.__version__ = '9.0'", r"built with numba [\d.]+, here is numba 9\.0"),
        ("import os; os.environ['NUMBA_CPU_NAME'] = 'x86-64-v2'", r"built for x86-64-v\d, here is x86-64-v2"),
    ],
    ids=["another numba", "a processor without a level"],
)
def test_kernels_that_do_not_fit_are_compiled_and_it_is_said_why(
    installed: Environment, at_start: str, words: str
) -> None:
    (installed.packages / "zz_at_start.pth").write_text(at_start + "\n", encoding="utf-8")  # of every Python there
    done = installed.run(PROGRAM)
    assert done.returncode == 0, done.stderr
    said = " ".join(done.stderr.split())
    assert json.loads(done.stdout) == [0, COUNT, 0]  # compiled by a process of its own, for the user's cache
    assert re.match(rf"kernels are compiled: those installed were {words} compiling kernels, once ", said), said
    assert list((installed.place / "home" / ".cache" / "tailstack" / "kernels").glob("tail.lattice.balls-*"))


@pytest.mark.long
def test_of_an_altered_source_only_its_own_kernels_are_compiled(installed: Environment) -> None:
    with open(installed.packages / "tailstack" / "tail" / "per_unit.py", "a") as source:
        source.write("# altered\n")
    done = installed.run(PROGRAM)
    assert done.returncode == 0, done.stderr
    assert done.stderr.startswith("kernels are compiled: those installed were built from other sources\ncompiling ")
    kept = installed.place / "home" / ".cache" / "tailstack" / "kernels"
    assert {path.name.rpartition(".")[0].rpartition(".")[0] for path in kept.iterdir()} == {"tail.per_unit"}
    # by a process of its own, and loaded from the user's cache: the two of that file
    assert json.loads(done.stdout) == [0, COUNT, COUNT - 2], sorted(path.name for path in kept.iterdir())
    says = installed.run(WARM_UP).stdout
    assert f"{COUNT - 2} installed" in says
    assert "2 in " in says
    assert "(those installed were built from other sources)" in says


@pytest.mark.long
def test_the_wheel_of_a_release_asks_for_kernels_and_that_of_a_checkout_does_not(
    installed: Environment, tmp_path: Path
) -> None:
    metadata = next(installed.packages.glob("tailstack-*.dist-info/METADATA")).read_text(encoding="utf-8")
    version = next(line.split()[1] for line in metadata.splitlines() if line.startswith("Version: "))
    assert re.search(rf"^Requires-Dist: tailstack-kernels ?=={re.escape(version)}\.\*$", metadata, re.MULTILINE)
    quietly(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path), TAILSTACK_RELEASE="")
    assert "tailstack-kernels" not in quietly("unzip", "-p", str(next(tmp_path.glob("*.whl"))), "*/METADATA")


@pytest.mark.long
def test_an_installer_that_may_not_take_the_kernels_takes_the_empty_wheel(tmp_path: Path) -> None:
    """independent: pip's own resolver, between the two wheels of a version and one of a numba that is not ours."""
    from kernels_wheel import build

    build.write_wheel(tmp_path, "1.0.post1", ["py3-none-any"], {}, ["numba ==1.0"])
    build.write_wheel(tmp_path, "1.0", ["py3-none-any"], {}, [])
    for numba in ("1.0", "2.0"):
        about = f"numba-{numba}.dist-info"
        with zipfile.ZipFile(tmp_path / f"numba-{numba}-py3-none-any.whl", "w") as wheel:
            wheel.writestr(f"{about}/METADATA", f"Metadata-Version: 2.1\nName: numba\nVersion: {numba}\n")
            wheel.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
            wheel.writestr(f"{about}/RECORD", "")
    chosen = {}
    for numba in ("1.0", "2.0"):
        report = quietly(
            sys.executable, "-m", "pip", "install", "--dry-run", "--ignore-installed", "--no-index", "--quiet",
            "--report", "-", "--find-links", str(tmp_path), "tailstack-kernels==1.0.*", f"numba=={numba}",
        )  # fmt: skip
        packages = {one["metadata"]["name"]: one["metadata"]["version"] for one in json.loads(report)["install"]}
        chosen[numba] = packages["tailstack-kernels"]
    assert chosen == {"1.0": "1.0.post1", "2.0": "1.0"}

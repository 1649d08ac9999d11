"""Whole commands, start of the interpreter included, in processes of their own."""

from __future__ import annotations

import importlib.util
import os
import random
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

from bench import ROOT, Figure, Findings, interleave, watch_load
from tailstack.design import design_to_data, load_design
from tailstack.design.write import data_to_yaml
from tailstack.kernels.processor import levels_here
from tailstack.kernels.store import writable_directory

DEMO = ROOT / "examples" / "demo.yaml"
DESIGNS = 10
COMMAND = [sys.executable, "-m", "tailstack_service.cli.main"]
IMPORTS = [sys.executable, "-c", "import numpy, scipy.linalg, numba"]


def command_job(command: list[str], codes: tuple[int, ...] = (0,)) -> Callable[[], int]:
    """One call of a command, which ends with one of these codes."""

    def run() -> int:
        done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
        if done.returncode not in codes:
            raise RuntimeError(f"{command}: exit code {done.returncode}\n{done.stderr}")
        return 1

    return run


def gate() -> Findings:
    """Ten designs that differ: as in a pipeline, which draws trials where it must, and to first order."""
    with tempfile.TemporaryDirectory(prefix="tailstack-bench-") as folder:
        files = _write_designs(Path(folder))
        jobs = {
            "imports": command_job(IMPORTS),
            "gate": command_job([*COMMAND, "gate", *files], (0, 1)),
            "gate --mode analytic": command_job([*COMMAND, "gate", *files, "--mode", "analytic"], (0, 1)),
            "gate --help": command_job([*COMMAND, "gate", "--help"]),
        }
        for job in jobs.values():
            job()  # the first may compile
        rounds = interleave(jobs, 5)
    figures = [Figure(f"{name}, CPU", median(rounds.cpu[name]), "s") for name in jobs]
    figures.append(
        Figure("gate --mode analytic against the imports", rounds.ratio("gate --mode analytic", "imports"), "×")
    )
    return Findings([rounds.ratio("gate", "imports")], rounds.foreign, figures)


FIRST_READ = [sys.executable, "-c", "import pydantic, yaml"]
COMPILERS = [sys.executable, "-c", "import numba, scipy.linalg"]
# What reading and checking a design cannot do without: a model of pydantic's, and numpy
NEEDED = [sys.executable, "-c", "import numpy, yaml, pydantic\nclass Model(pydantic.BaseModel): value: int"]


def start() -> Findings:
    """Commands on the demo design against importing what they are built on, CPU of whole processes."""
    jobs = {
        "import pydantic, yaml": command_job(FIRST_READ),
        "import numpy, yaml, and one model of pydantic's": command_job(NEEDED),
        "validate": command_job([*COMMAND, "validate", str(DEMO)]),
        "import numba, scipy.linalg": command_job(COMPILERS),
        "score": command_job([*COMMAND, "score", str(DEMO)], (0, 1)),
        "version": command_job([*COMMAND, "version"]),
    }
    for job in jobs.values():
        job()  # the first may compile
    rounds = interleave(jobs, 9)
    figures = [Figure(f"{name}, CPU", median(rounds.cpu[name]), "s") for name in jobs]
    figures.append(Figure("validate against the least it needs", rounds.ratio("validate", list(jobs)[1]), "×"))
    ratios = [rounds.ratio("validate", "import pydantic, yaml"), rounds.ratio("score", "import numba, scipy.linalg")]
    return Findings(ratios, rounds.foreign, figures)


def _write_designs(folder: Path) -> list[str]:
    draw, files = random.Random(1), []
    for index in range(DESIGNS):
        data = design_to_data(load_design(DEMO))
        for point in data["fiducials"]["points"]:
            point["position_mm"] = [round(value + draw.uniform(-0.5, 0.5), 3) for value in point["position_mm"]]
        files.append(folder / f"design {index}.yaml")
        files[-1].write_text(data_to_yaml(data), encoding="utf-8")
    return [str(file) for file in files]


def first_score() -> Findings:
    """Both wheels in an environment of their own, which sees the libraries of this one; then score, and score again."""
    with tempfile.TemporaryDirectory(prefix="tailstack-bench-") as folder:
        place = Path(folder)
        _quietly([sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder])
        _quietly([sys.executable, "solver/kernels_wheel/build.py", "-o", folder, "--only", "score",
                  "--levels", ",".join(levels_here()[:1]), "--store", str(writable_directory())])  # fmt: skip
        _quietly([sys.executable, "-m", "venv", "--without-pip", folder + "/environment"])
        python = Path(folder, "environment", *Path(sys.executable).parts[-2:])  # bin or Scripts, and what it is called
        installed = _quietly([str(python), "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]).strip()
        Path(installed, "libraries.pth").write_text(sysconfig.get_path("purelib"), encoding="utf-8")
        wheels = map(str, place.glob("*.whl"))
        _quietly([sys.executable, "-m", "pip", "--python", str(python), "install", "--no-deps", "--no-index",
                  "--ignore-installed", *wheels])  # fmt: skip
        shutil.copy(DEMO, place / "design.yaml")
        ours = ("TAILSTACK_", "NUMBA_")
        environment = {key: value for key, value in os.environ.items() if not key.startswith(ours)}
        environment |= {"HOME": folder, "XDG_CACHE_HOME": folder + "/cache"}
        took = []
        with watch_load() as load:
            for _ in range(4):
                began = time.perf_counter()
                done = subprocess.run(
                    [str(python), "-m", "tailstack_service.cli.main", "score", "design.yaml"], cwd=folder,
                    env=environment, capture_output=True, text=True, check=False, timeout=600,
                )  # fmt: skip
                if done.returncode not in (0, 1):  # 1: a requirement of the design is not met
                    raise RuntimeError(f"score: exit code {done.returncode}\n{done.stderr}")
                took.append(time.perf_counter() - began)
    again = median(took[1:])
    figures = [Figure("first score, whole command, wall", took[0], "s"), Figure("second, wall", again, "s")]
    return Findings([took[0] / again], load.foreign, figures)


def _quietly(command: list[str]) -> str:
    return subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True, timeout=900).stdout


def report() -> Findings:
    """The report of the demo with score and check, in each format."""
    forms = [form for form in ("html", "pdf", "xlsx") if form != "pdf" or importlib.util.find_spec("weasyprint")]
    with tempfile.TemporaryDirectory(prefix="tailstack-bench-") as folder:
        write = [*COMMAND, "report", str(DEMO), "-o", folder]
        jobs = {form: command_job([*write, "--format", form], (0, 1, 4)) for form in forms}
        for job in jobs.values():
            job()  # the first may compile
        jobs["html, --verify"] = command_job([*COMMAND, "report", "--verify", f"{folder}/demo.html"])
        rounds = interleave(jobs, 3)
        sizes = [
            Figure(f"its size, {form}", (Path(folder) / f"demo.{form}").stat().st_size / 1e6, "MB") for form in forms
        ]
    figures = [
        Figure(f"report of the demo, {name}, whole command, CPU", median(rounds.cpu[name]), "s") for name in jobs
    ]
    return Findings([], rounds.foreign, figures + sizes)

"""What a gate costs: the whole command, start of the interpreter included, in processes of its own."""

from __future__ import annotations

import os
import random
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

from bench import Row
from tailstack.design import design_to_data, load_design
from tailstack.design.write import data_to_yaml

DEMO = Path(__file__).resolve().parents[1] / "examples" / "demo.yaml"
DESIGNS = 10
ROUNDS = 9
MUST_SECONDS = 2.0


def gate() -> list[Row]:
    """Ten designs that differ: to first order, as before a commit, and as in a pipeline, which draws where it must."""
    rows = []
    with tempfile.TemporaryDirectory(prefix="tailstack-bench-") as folder:
        files = _designs(Path(folder))
        for mode, must in (("analytic", MUST_SECONDS), ("auto", None)):
            took = [_seconds(["gate", *files, "--mode", mode]) for _ in range(ROUNDS + 1)][1:]  # the first may compile
            what = f"gate --mode {mode} of {DESIGNS} designs, whole command"
            rows.append(Row(f"{what}, CPU", median(cpu for cpu, _ in took), "s", must, None, "<"))
            rows.append(Row(f"{what}, wall", median(wall for _, wall in took), "s"))
    return [*rows, Row("gate --help, CPU", median(_seconds(["gate", "--help"])[0] for _ in range(ROUNDS)), "s", 0.5,
                       None, "<")]  # fmt: skip


def _designs(folder: Path) -> list[str]:
    draw, files = random.Random(1), []
    for index in range(DESIGNS):
        data = design_to_data(load_design(DEMO))
        for point in data["fiducials"]["points"]:
            point["position_mm"] = [round(value + draw.uniform(-0.5, 0.5), 3) for value in point["position_mm"]]
        files.append(folder / f"design {index}.yaml")
        files[-1].write_text(data_to_yaml(data), encoding="utf-8")
    return [str(file) for file in files]


def _seconds(arguments: list[str]) -> tuple[float, float]:
    """CPU and wall seconds of a command."""
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "tailstack_service.cli.main", *arguments], env=os.environ, capture_output=True,
        text=True, timeout=600, check=False,
    )  # fmt: skip
    wall = time.perf_counter() - begun
    assert done.returncode in (0, 1), done.stderr
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall

"""What a report costs: the whole command, start of the interpreter included, in processes of its own."""

from __future__ import annotations

import importlib.util
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

from bench import Row

DEMO = Path(__file__).resolve().parents[1] / "examples" / "demo.yaml"
ROUNDS = 5
MUST = {"html": 3.0, "pdf": 5.0, "xlsx": 3.0}  # CPU seconds: wall time on a machine that does nothing else is less
MOST_MB = 4.0


def report() -> list[Row]:
    """The report of the demo design with score and check, in each format; formats in turn in each round."""
    forms = [form for form in MUST if form != "pdf" or importlib.util.find_spec("weasyprint") is not None]
    spent: dict[str, list[float]] = {form: [] for form in forms}
    sizes: dict[str, float] = {}
    with tempfile.TemporaryDirectory(prefix="tailstack-bench-") as folder:
        for round_number in range(ROUNDS + 1):
            for form in forms:
                took = _cpu_seconds(["report", str(DEMO), "--format", form, "-o", folder])
                if round_number:  # the first one may compile
                    spent[form].append(took)
                sizes[form] = (Path(folder) / f"demo.{form}").stat().st_size / 1e6
        spent["verify"] = [_cpu_seconds(["report", "--verify", str(Path(folder) / "demo.html")]) for _ in range(ROUNDS)]
    rows = [
        Row(f"report of the demo design as {form.upper()}, whole command, CPU", median(spent[form]), "s", MUST[form],
            None, "<")
        for form in forms
    ]  # fmt: skip
    rows += [Row(f"report of the demo design as {form.upper()}, size", sizes[form], "MB", MOST_MB, 1.0, "<")
             for form in forms]  # fmt: skip
    return [*rows, Row("report --verify of the HTML, whole command, CPU", median(spent["verify"]), "s")]


def _cpu_seconds(arguments: list[str]) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-m", "tailstack_service.cli.main", *arguments], env=os.environ, capture_output=True,
        text=True, timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode in (0, 1, 4), done.stderr
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

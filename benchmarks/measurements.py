"""The table of targets in its order: what is measured by which function, how far it must and should go.

``./run bench`` runs it.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
from functools import partial
from pathlib import Path

import bench
import commands
import engine
import optimiser
import scores
import service
from bench import Measurement, Target

MEASUREMENTS: dict[str, Measurement] = {
    "trials": Measurement(engine.trials, (
        Target("exact nonlinear trials, one core: share of the bound of this machine", 60, 85, "%"),
        Target("the same against batched numpy.linalg.svd", 150, 300),
    )),
    **{estimator.value.replace("_", "-"): Measurement(partial(engine.least_squares, estimator), (
        Target(f"exact trials by {estimator}, one core, against a batched NumPy Gauss-Newton", must, None),
        Target("largest relative difference between the two", 1e-9, None, "", "<"),
    )) for estimator, must in engine.LEAST_SQUARES.items()},
    "agreement": Measurement(engine.agreement, (
        Target("largest relative difference from SVD on unflagged trials", 1e-9, 5e-12, "", "<"),
    ), timed=False),
    "threads": Measurement(engine.threads, (Target("two threads against one", 1.7, 1.9),)),
    "precision": Measurement(engine.precision, (
        Target("P95 ± 1 % with its interval: plain Monte Carlo against radial conditional", 8, 40),
    )),
    "first-order": Measurement(scores.first_order, (
        Target("first-order covariance + exact P95, one target: against a trial of batched SVD", 1, 0.1, "×", "<"),
        Target("score() of the demo with budget and losses: against a trial of batched SVD", 60, 25, "×", "<"),
    )),
    "losses": Measurement(scores.losses, (
        Target("score with the worst losses of one and two, 12 fiducials: against a score without", 3, 2, "×", "<"),
        Target("score with the worst loss of one, 64 fiducials: against a score without", 2, 1.5, "×", "<"),
    )),
    "allocations": Measurement(scores.allocations, (
        Target("the cheapest half-widths at a fixed layout, slowest of six designs: against a score", 6, 3, "×", "<"),
    )),
    "designs": Measurement(scores.designs, (
        Target("designs of a table, normal laws: designs a second against the loop before", 700, 1500),
        Target("the same, the demo's own laws: designs a second against the loop before", 40, 100),
    )),
    "workspace": Measurement(scores.workspace, (
        Target("poses of an arm in study workspace, normal laws: against rows of a table", 2, 1, "×", "<"),
        Target("the same, the demo's own laws", 2, 1, "×", "<"),
    )),
    "memory": Measurement(engine.memory, (
        Target("memory of a run of 10^7 trials", 300, 150, "MB", "<"),
    ), timed=False),
    "designs-memory": Measurement(scores.designs_memory, (
        Target("memory of a million scored designs, streamed", 300, 150, "MB", "<"),
    ), timed=False),
    "people-tables": Measurement(scores.people_tables, (
        Target("a million rows of people's tables, cells as texts: against csv.reader", 5, 3, "×", "<"),
        Target("the same, three cells of each as numbers: against csv.reader and float()", 5, 3, "×", "<"),
        Target("memory of the first beyond the file", 10, 3, "MB", "<"),
    )),
    "fiducials": Measurement(engine.fiducials, (
        Target("N = 100 fiducials against N = 12, cost per trial", 6, 4, "×", "<"),
    )),
    "optimiser": Measurement(optimiser.optimiser, (
        Target("optimise 12 fiducials + 6 budgets, 16 starts: above any peer's cost in that time", 0.2, 0, "%", "<"),
    )),
    "post": Measurement(service.post, (
        Target("POST of a score, p50 on one connection, against the same score() in process", 2, 1.3, "×", "<"),
    )),
    "drag": Measurement(service.drag, (
        Target("a move of a bead on the page, p95, against its request alone", 2, 1.3, "×", "<"),
        Target("frames of a drag, a move each 50 ms, with numbers at most 0.15 s late", 80, 95, "%"),
    )),
    "api-processes": Measurement(service.api_processes, (
        Target("requests a second, two API processes against one, on two cores", 1.5, 1.8),
    )),
    "unit": Measurement(service.unit, (
        Target("a durable unit beyond its computing, against one fsync of a 4 kB file there", 10, 3, "×", "<"),
    )),
    "first-score": Measurement(commands.first_score, (
        Target("first score after pip install of the built wheels, against the second", 3, 1.5, "×", "<"),
    )),
    "start": Measurement(commands.start, (
        Target('validate, whole command, against `python -c "import pydantic, yaml"`', 3, None, "×", "<"),
        Target('a warm score, whole command, against `python -c "import numba, scipy.linalg"`', 2, 1.6, "×", "<"),
    )),
    "gate": Measurement(commands.gate, (
        Target("gate of ten designs, whole command, against importing numpy, scipy.linalg, numba", 4, 2, "×", "<"),
    )),
    "growth": Measurement(scores.growth, (
        Target("exponent of the time of a score, linear or less: 1 to 200 targets", 1.1, None, "", "<"),
        Target("exponent of the time of a score, linear or less: 8 to 100 fiducials", 1.1, None, "", "<"),
        Target("exponent of the time of a score, linear or less: 2 to 16 views", 1.1, None, "", "<"),
    )),
    "report": Measurement(commands.report),
}  # fmt: skip


def main() -> int:
    width = max(map(len, MEASUREMENTS))
    described = "\n".join(
        f"  {name:{width}}  {what}"
        for name, measurement in MEASUREMENTS.items()
        for what in [target.what for target in measurement.targets] or ["figures for people"]
    )
    parser = argparse.ArgumentParser(
        prog="./run bench", description=bench.__doc__, epilog=f"rows by name:\n{described}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("names", nargs="*", metavar="NAME", help="what to measure, default all")
    parser.add_argument("--strict", action="store_true", help="exit 1 when a must is missed in a row without the mark")
    parser.add_argument("--save", type=Path, metavar="FILE", help="write what was measured there, as JSON")
    arguments = parser.parse_args()
    unknown = [name for name in arguments.names if name not in MEASUREMENTS]
    if unknown:
        parser.error(f"nothing is called {', '.join(unknown)}; choose from {', '.join(MEASUREMENTS)}")
    print(f"tailstack benchmarks · Python {platform.python_version()} · {os.cpu_count()} cores · {platform.machine()}")
    print(f"{'what':78} {'measured':>12} {'must':>8} {'aim':>8} {'foreign':>7}  verdict")
    named: list[tuple[str, bench.Row]] = []
    for name, measurement in MEASUREMENTS.items():
        if arguments.names and name not in arguments.names:
            continue
        findings = measurement.measure()
        for row in measurement.rows(findings):
            named.append((name, row))
            print(bench.write_row(row))
        for figure in findings.figures:
            print(f"    {figure.what:74} {figure.value:10.4g} {figure.unit}".rstrip())
        if not measurement.targets:
            print(f"    {'foreign load of these':74} {100 * findings.foreign:10.0f} %")
        sys.stdout.flush()
    rows = [row for _, row in named]
    missed = [row for row in rows if row.missed]
    print(f"{len(missed)} of {sum(row.target.must is not None for row in rows)} musts missed, "
          f"{sum(row.loaded for row in missed)} of them under foreign load; "
          f"{sum(row.value is None for row in rows)} rows not built")  # fmt: skip
    if arguments.save:
        arguments.save.write_text(bench.write_history(named), encoding="utf-8")
    return 1 if arguments.strict and bench.must_fail(rows) else 0


if __name__ == "__main__":
    sys.exit(main())

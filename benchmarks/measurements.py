"""The table of targets in its order: what is measured by which function, how far it must and should go."""

from __future__ import annotations

from functools import partial

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
    "designs": Measurement(scores.designs, (
        Target("designs of a table, normal laws: designs a second against the loop before", 700, 1500),
        Target("the same, the demo's own laws: designs a second against the loop before", 40, 100),
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

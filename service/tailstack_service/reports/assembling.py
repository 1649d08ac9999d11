"""A report from its parts: what was computed, what is drawn of it, and how to compute it again."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from typing import Any

import numpy as np

from tailstack.contributors import declared_law
from tailstack.design import Design, design_to_data
from tailstack.errors import Problem
from tailstack.montecarlo import run_indices
from tailstack.montecarlo.estimators import interval_ranks
from tailstack.results import Optimisation, Score, Verification
from tailstack.runs import Prepared, prepare
from tailstack.scoring import score as score_design
from tailstack.system import Array
from tailstack.tail.declared import law_exceedance

from ..problems import RequestError
from .chapters.optimisation import optimise_command
from .headline import headline_of
from .records import Convergence, ConvergencePoint, ErrorDistribution, Report, Reproduction

PARTS = ("score", "verification", "optimisation")
BINS = 36
DRAWN = 2**15  # trials that the pictures are drawn from: the first of the check's own
PER_CALL = 2**13
PICTURED = 3  # targets, largest P95 first: a region may have hundreds


@dataclass(frozen=True, slots=True)
class ReportOptions:
    """What a report holds and how its numbers are drawn.  Raises RequestError for what does not go together."""

    parts: tuple[str, ...] = ("score", "verification")
    trials: int | None = None
    precision: float | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        for index, part in enumerate(self.parts):
            if part not in PARTS:
                detail = f"a report has the parts {', '.join(PARTS)}; got {part!r}"
                raise RequestError(Problem(f"/parts/{index}", "unknown-value", detail))
        if self.trials is not None and self.precision is not None:
            detail = "both trials and precision were given"
            raise RequestError(Problem("/precision", "trials-and-precision", detail, "give one of them"))


def compute_report(design: Design, options: ReportOptions, *, starts: int | None = None) -> Report:
    """The report of a design, computed here and now.  Raises TailstackError."""
    verification = optimisation = None
    if "verification" in options.parts:
        from tailstack.verifying import verify

        verification = verify(design, trials=options.trials, precision=options.precision, seed=options.seed)
    if "optimisation" in options.parts:
        from tailstack.optimisation import optimise

        optimisation = optimise(design, starts=starts)
    return assemble(design, options, verification, optimisation)


def assemble(
    design: Design, options: ReportOptions, verification: Verification | None, optimisation: Optimisation | None
) -> Report:
    """The report of what was computed; a pure function.  Raises DesignError, IllPosedError."""
    scored = score_design(design)
    ready = prepare(design)
    distributions, convergence = _drawn(ready, scored, verification, options)
    return Report(
        schema="tailstack/report/1",
        title=design.name,
        headline=headline_of(scored, verification, optimisation),
        score=scored,
        verification=verification,
        optimisation=optimisation,
        distributions=distributions,
        convergence=convergence,
        design=design_to_data(design),
        reproduction=_reproduction(options, verification, optimisation),
        provenance=scored.provenance if verification is None else verification.provenance,
    )


def _drawn(
    ready: Prepared, scored: Score, verification: Verification | None, options: ReportOptions
) -> tuple[tuple[ErrorDistribution, ...], tuple[Convergence, ...]]:
    """What the pictures of the largest targets show: shares by bins, and how P95 settled."""
    worst = sorted(scored.targets, key=lambda target: target.p95_mm, reverse=True)[:PICTURED]
    distributions, convergence = [], []
    for target in worst:
        norms = None if verification is None else _norms(ready, target.name, verification.trials, options.seed)
        p95 = target.p95_mm if norms is None else float(np.quantile(norms, 0.95))
        edges = np.linspace(0.0, 1.45 * max(p95, target.p95_mm, 1e-9), BINS + 1)
        law, _ = declared_law(ready.models[target.name], "tcp", ready.worst[target.name, "tcp"].mean_mm)
        beyond = [1.0, *(law_exceedance(law, float(edge)) for edge in edges[1:])]
        shares = tuple(max(near - far, 0.0) for near, far in pairwise(beyond))
        counted = None if norms is None else tuple(float(n) for n in np.histogram(norms, edges)[0] / len(norms))
        distributions.append(
            ErrorDistribution(
                target.name,
                tuple(float(edge) for edge in edges),
                counted,
                shares,
                None if norms is None else len(norms),
            )
        )
        if norms is not None and verification is not None:
            confidence = next(entry.confidence for entry in verification.targets if entry.name == target.name)
            convergence.append(Convergence(target.name, confidence, _settling(norms, confidence)))
    return tuple(distributions), tuple(convergence)


def _norms(ready: Prepared, name: str, trials: int, seed: int) -> Array:
    """(n,) mm: the first trials of the check itself at a target, at most DRAWN of them."""
    plan = ready.plans[ready.vertices[name, "tcp"]]
    place = [target.name for target in ready.system.targets].index(name)
    count = min(trials, DRAWN)
    parts = [
        run_indices(plan, seed, first, min(PER_CALL, count - first)).errors[place, 0]
        for first in range(0, count, PER_CALL)
    ]
    return np.asarray(np.linalg.norm(np.concatenate(parts, axis=1), axis=0))


def _settling(norms: Array, confidence: float) -> tuple[ConvergencePoint, ...]:
    """P95 after 128, 256, ... trials.  Each interval holds by itself; they are not corrected for being many."""
    points = []
    for power in range(7, 40):
        count = 2**power
        if count > len(norms):
            break
        ordered = np.sort(norms[:count])
        below, above = interval_ranks(count, 0.95, confidence)
        interval = (float(ordered[below - 1]), float(ordered[min(above, count) - 1]))
        points.append(ConvergencePoint(count, float(ordered[ceil(0.95 * count) - 1]), interval))
    return tuple(points)


def _reproduction(
    options: ReportOptions, verification: Verification | None, optimisation: Optimisation | None
) -> Reproduction:
    drawn = ""
    if verification is not None:
        drawn = f" --seed {options.seed}"
        drawn += f" --trials {options.trials}" if options.trials is not None else ""
        drawn += f" --precision {verification.precision_requested:g}" if verification.precision_requested else ""
    parts = "" if options.parts == ("score", "verification") else f" --parts {','.join(options.parts)}"
    commands = [
        f"tailstack report design.yaml{parts}{drawn} --format json -o out",
        "tailstack score design.yaml --json",
    ]
    if verification is not None:
        commands.append(f"tailstack verify design.yaml{drawn} --json")
    if optimisation is not None:
        commands.append(optimise_command(optimisation))
    return Reproduction(
        commands=tuple(commands),
        seed=None if verification is None else options.seed,
        statement="design.yaml is the field design of this record: the last section of this report, the sheet Design "
        "of the spreadsheet. The same version of tailstack gives the same digits, whatever the number of threads, "
        "workers or machines.",
    )


def options_of(request: dict[str, Any]) -> ReportOptions:
    """The options of a job's request.  Raises RequestError."""
    parts = tuple(request.get("parts") or ("score", "verification"))
    return ReportOptions(parts, request.get("trials"), request.get("precision"), request.get("seed", 0))

"""The Monte Carlo check: the full nonlinear chain, quantiles with intervals, and the verdict they support."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from math import ceil
from typing import Literal

import numpy as np
from scipy.stats import beta

from .contributors import WorstCase, declared_law, worst_case
from .design import Design
from .errors import DesignError, Problem
from .montecarlo import ChainPlan, compile_plan, run_indices
from .montecarlo.estimators import (
    Goal,
    cvar_estimate,
    exceedance_estimate,
    interval_ranks,
    quantile_estimate,
    simulate_to_precision,
)
from .montecarlo.radial import LinearChain, gains_in_plan_order, radial
from .montecarlo.simulate import Samples, simulate
from .propagation.linear import LinearModel, linearise
from .results import (
    Check,
    Exceedance,
    Finding,
    Interval,
    MetricEstimate,
    Reprojection,
    TargetEstimate,
    Validity,
    Verification,
)
from .scoring import FRAMES, NOT_INCLUDED, P95, checked_system, provenance, tightest_limit, trust_of, vector3
from .system import Requirement, System
from .tail.declared import law_exceedance, law_quantile
from .verdict import check_per_unit, check_pooled, conclude

PRECISION = 0.005  # relative half-width of the interval of P95, when nothing else is asked for
MAX_TRIALS = 2**22
RADIAL_COMPANION_TRIALS = 2**15  # plain trials beside a radial run: moments, CVaR, worst
UNITS, SHOTS = 2048, 512  # nested sampling of a per-unit requirement
UNITS_PER_BATCH = 32
GAP = 0.03  # first order further than this from the check is remarked
Progress = Callable[[int, int], None]
Method = Literal["plain", "radial"]
Key = tuple[str, str]  # target, error
Vertex = tuple[tuple[str, float], ...]


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """What a check needs of the linear model: at which vertex to simulate, and what to compare with."""

    system: System
    models: dict[str, LinearModel]
    worst: dict[Key, WorstCase]
    vertices: dict[Key, Vertex]
    plans: dict[Vertex, ChainPlan]


@dataclass(frozen=True, slots=True)
class Quantile:
    value_mm: float
    interval_mm: Interval


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """Finished sampling: a plain run for each distinct vertex, and how the quantiles were estimated."""

    samples: dict[Vertex, Samples]
    confidence_level: float  # used for each interval, so that all looks together hold with the stated one
    stopping: str
    precision_reached: float
    radial: dict[tuple[str, str, float], Quantile]


def verify(
    design: Design | System,
    *,
    trials: int | None = None,
    precision: float | None = None,
    seed: int = 0,
    method: Method = "plain",
    threads: int | None = None,
    max_trials: int = MAX_TRIALS,
    progress: Progress | None = None,
) -> Verification:
    """Check a design by Monte Carlo on the full nonlinear chain.

    ``trials`` draws exactly so many; otherwise trials are drawn until every interval's relative half-width is
    at most ``precision`` (default 0.005) *and* every requirement is decided, up to ``max_trials``.  ``method="radial"``
    takes the quantiles from radial conditional sampling (far fewer evaluations; refused where a ray crosses
    twice).  Same seed, same digits, whatever ``threads``.  Bounded components stand at the vertex that the linear
    model finds worst.  Raises DesignError, IllPosedError, OutOfRangeError.
    """
    if trials is not None and precision is not None:
        raise DesignError(
            Problem("", "trials-and-precision", "both trials and precision were given", "give one of them")
        )
    system, findings, _ = checked_system(design)
    ready = prepare(system)
    trust = trust_of(system, ready.models)
    if method == "radial":
        run = _run_radial(ready, seed, threads, progress)
    elif trials is not None:
        run = _run_fixed(ready, trials, seed, threads, progress)
    else:
        run = _run_adaptive(ready, precision or PRECISION, seed, threads, max_trials, progress)
    checks = _checks(ready, run, seed)
    targets = tuple(_target(ready, run, target.name) for target in system.targets)
    worst = max(targets, key=lambda target: target.p95_mm)
    return Verification(
        schema="tailstack/verification/1",
        seed=seed,
        trials=max(sample.trials for sample in run.samples.values()),
        method=method,
        engine="structured resection, eight lanes (numba); trials without a proven solution redone by SVD",
        precision_requested=None if trials is not None or method == "radial" else precision or PRECISION,
        precision_reached=run.precision_reached,
        stopping=run.stopping,
        targets=targets,
        reprojection=_reprojection(run),
        first_order_ratio=worst.first_order_ratio,
        verdict=conclude(checks, findings + _remarks(targets, trust), "Monte Carlo"),
        provenance=provenance(system, tuple(n for n in NOT_INCLUDED if "second order" not in n)),
    )


def prepare(system: System) -> Prepared:
    """Linear model, worst vertex and compiled plan for every target and error."""
    models = {target.name: linearise(system, target) for target in system.targets}
    worst = {(name, error): worst_case(model, error, P95) for name, model in models.items() for error in FRAMES}
    vertices: dict[Key, Vertex] = {}
    for (name, error), case in worst.items():
        # Where the error is blind to a component, the vertex of the TCP error serves: one run instead of two.
        ends = worst[name, "tcp"].vertex(models[name]) | case.vertex(models[name])
        vertices[name, error] = tuple(sorted(ends.items()))
    plans = {vertex: compile_plan(system, vertex=dict(vertex)) for vertex in set(vertices.values())}
    return Prepared(system, models, worst, vertices, plans)


def _goals(ready: Prepared, vertex: Vertex) -> list[Goal]:
    """Quantiles that must be precise in the run at this vertex: P95 and every requirement's own."""
    wanted = {(name, error, P95) for (name, error), at in ready.vertices.items() if at == vertex and error == "tcp"}
    for requirement in ready.system.requirements:
        for name in requirement.targets:
            if ready.vertices[name, requirement.error] == vertex:
                wanted.add((name, requirement.error, requirement.quantile))
    return [Goal(*goal) for goal in sorted(wanted)]


def _confidence(system: System) -> float:
    return max((r.confidence for r in system.requirements), default=0.95)


def _lowest(system: System) -> float:
    return min([P95, *(r.quantile for r in system.requirements)])


def _run_fixed(ready: Prepared, trials: int, seed: int, threads: int | None, progress: Progress | None) -> Run:
    level = _confidence(ready.system)
    samples = {
        vertex: simulate(
            plan, trials=trials, seed=seed, quantile=_lowest(ready.system), threads=threads, reprojection=True,
            progress=progress,
        )
        for vertex, plan in ready.plans.items()
    }  # fmt: skip
    reached = 0.0
    for vertex, sample in samples.items():
        for goal in _goals(ready, vertex):
            found = quantile_estimate(sample, goal.target, goal.error, goal.quantile, level)
            reached = max(reached, found.relative_half_width)
    return Run(samples, level, f"Stopped after the {trials} trials asked for.", reached, {})


def _run_adaptive(
    ready: Prepared, precision: float, seed: int, threads: int | None, max_trials: int, progress: Progress | None
) -> Run:
    confidence = _confidence(ready.system)
    samples: dict[Vertex, Samples] = {}
    stopping, reached, level = "", 0.0, confidence
    for vertex, plan in ready.plans.items():
        goals = _goals(ready, vertex) or [Goal(0, "tcp", P95)]
        run = simulate_to_precision(
            plan,
            precision=precision,
            seed=seed,
            goals=goals,
            confidence=confidence,
            max_trials=max_trials,
            threads=threads,
            reprojection=True,
            progress=progress,
            settled=partial(_decided, ready, vertex),
        )
        samples[vertex] = run.samples
        level = min(level, run.level) if level != confidence else run.level
        stopping, reached = run.stopping, max(reached, run.precision_reached)
    return Run(samples, level, stopping, reached, {})


def _decided(ready: Prepared, vertex: Vertex, samples: Samples, level: float) -> bool:
    """No pooled requirement of this run is still open."""
    for requirement in ready.system.requirements:
        for name in requirement.targets:
            if requirement.risk == "pooled" and ready.vertices[name, requirement.error] == vertex:
                found = quantile_estimate(samples, name, requirement.error, requirement.quantile, level)
                if check_pooled(requirement, name, found.value_mm, found.interval_mm).status == "inconclusive":
                    return False
    return True


def _run_radial(ready: Prepared, seed: int, threads: int | None, progress: Progress | None) -> Run:
    plain = _run_fixed(ready, RADIAL_COMPANION_TRIALS, seed, threads, progress)
    confidence = _confidence(ready.system)
    wanted = {(name, error, P95) for name, error in ready.vertices}
    wanted |= {(n, r.error, r.quantile) for r in ready.system.requirements for n in r.targets}
    found: dict[tuple[str, str, float], Quantile] = {}
    evaluations, reached = 0, 0.0
    names = [target.name for target in ready.system.targets]
    for name, error, quantile in sorted(wanted):
        model, case = ready.models[name], ready.worst[name, error]
        plan = ready.plans[ready.vertices[name, error]]
        law, _ = declared_law(model, error, case.mean_mm)
        first = law_quantile(law, quantile)
        linear = LinearChain(
            mean=case.mean_mm,
            gain=gains_in_plan_order(plan, model.blocks, names.index(name), error),
            exceedance=partial(law_exceedance, law),
            quantile_mm=first.quantile_mm,
            density_per_mm=first.density,
        )
        estimate = radial(
            plan, linear, target=names.index(name), error=error, quantile=quantile, seed=seed, confidence=confidence
        )
        found[name, error, quantile] = Quantile(estimate.value_mm, estimate.interval_mm)
        low, high = estimate.interval_mm
        reached = max(reached, (high - low) / (2 * estimate.value_mm))
        evaluations += estimate.evaluations
    stopping = (
        f"Quantiles by radial conditional sampling with {evaluations} evaluations of the chain; moments, CVaR, worst "
        f"case and exceedance from {RADIAL_COMPANION_TRIALS} plain trials."
    )
    return replace(plain, stopping=stopping, precision_reached=reached, radial=found)


def _quantile(ready: Prepared, run: Run, name: str, error: str, quantile: float) -> Quantile:
    if (name, error, quantile) in run.radial:
        return run.radial[name, error, quantile]
    sample = run.samples[ready.vertices[name, error]]
    found = quantile_estimate(sample, name, error, quantile, run.confidence_level)
    return Quantile(found.value_mm, found.interval_mm)


def _metric(ready: Prepared, run: Run, name: str, error: str) -> MetricEstimate:
    samples = run.samples[ready.vertices[name, error]]
    sample = samples.of(name, error)
    found = _quantile(ready, run, name, error, P95)
    law, _ = declared_law(ready.models[name], error, ready.worst[name, error].mean_mm)
    limit = tightest_limit(ready.system, name, error)
    beyond = None
    if limit is not None:
        above = exceedance_estimate(samples, name, error, limit, _confidence(ready.system))
        beyond = Exceedance(limit, above.probability, above.interval)
    return MetricEstimate(
        bias_mm=vector3(sample.mean),
        std_mm=vector3(np.sqrt(np.diag(sample.covariance))),
        mean_norm_mm=sample.mean_norm,
        p95_mm=found.value_mm,
        p95_interval_mm=found.interval_mm,
        cvar95_mm=cvar_estimate(samples, name, error, P95).value_mm,
        worst_mm=sample.worst,
        exceedance=beyond,
        first_order_ratio=law_quantile(law, P95).quantile_mm / found.value_mm if found.value_mm > 0 else 1.0,
    )


def _target(ready: Prepared, run: Run, name: str) -> TargetEstimate:
    metric = _metric(ready, run, name, "tcp")
    samples = run.samples[ready.vertices[name, "tcp"]]
    return TargetEstimate(
        name=name,
        frame=FRAMES["tcp"],
        **{field: getattr(metric, field) for field in MetricEstimate.__dataclass_fields__},
        confidence=_confidence(ready.system),
        flagged_trials=samples.redone,
        first_order_p95_mm=metric.first_order_ratio * metric.p95_mm,
        localisation=_metric(ready, run, name, "localisation"),
    )


def _reprojection(run: Run) -> Reprojection:
    rms = next(iter(run.samples.values())).reprojection
    values = np.zeros(1) if rms is None else rms.rms_px
    return Reprojection(len(values), float(values.mean()), float(np.quantile(values, P95)))


def _checks(ready: Prepared, run: Run, seed: int) -> tuple[Check, ...]:
    checks = []
    for requirement in ready.system.requirements:
        for name in requirement.targets:
            found = _quantile(ready, run, name, requirement.error, requirement.quantile)
            if requirement.risk == "pooled":
                checks.append(check_pooled(requirement, name, found.value_mm, found.interval_mm))
            else:
                checks.append(_check_units(ready, requirement, name, seed))
    return tuple(checks)


def _check_units(ready: Prepared, requirement: Requirement, name: str, seed: int) -> Check:
    """Nested sampling: ``UNITS`` installed units, ``SHOTS`` shots of each.

    Yield with its Clopper-Pearson interval; value: the 95th percentile over units of the unit's own quantile, by
    order statistics.  A unit's quantile is itself estimated from its shots: a unit on the limit counts as met half
    of the time, which pulls the yield towards one half by much less than the interval's width.
    """
    vertex: Mapping[str, float] = dict(ready.vertices[name, requirement.error])
    plan = compile_plan(ready.system, vertex=vertex, shots_per_unit=SHOTS)
    place = [target.name for target in ready.system.targets].index(name)
    metric = list(FRAMES).index(requirement.error)
    rank = ceil(SHOTS * requirement.quantile) - 1
    own = []
    for first in range(0, UNITS, UNITS_PER_BATCH):
        errors = run_indices(plan, seed, first * SHOTS, UNITS_PER_BATCH * SHOTS).errors[place, metric]
        norms = np.linalg.norm(errors, axis=0).reshape(UNITS_PER_BATCH, SHOTS)
        own.append(np.partition(norms, rank, axis=1)[:, rank])
    ordered = np.sort(np.concatenate(own))
    met = int((ordered <= requirement.limit_mm).sum())
    alpha = 1 - requirement.confidence
    low = float(beta.ppf(alpha / 2, met, UNITS - met + 1)) if met > 0 else 0.0
    high = float(beta.ppf(1 - alpha / 2, met + 1, UNITS - met)) if met < UNITS else 1.0
    below, above = interval_ranks(UNITS, P95, requirement.confidence)
    return check_per_unit(
        requirement,
        name,
        float(ordered[ceil(UNITS * P95) - 1]),
        (float(ordered[below - 1]), float(ordered[above - 1])),
        met / UNITS,
        (low, high),
    )


def _remarks(targets: tuple[TargetEstimate, ...], trust: Validity) -> tuple[Finding, ...]:
    """Where first order and the check disagree, and which way."""
    remarks = []
    for target in targets:
        low, high = (target.first_order_p95_mm / end for end in reversed(target.p95_interval_mm))
        if high < 1 - GAP or low > 1 + GAP:
            way = "optimistic" if high < 1 else "pessimistic"
            remarks.append(
                Finding(
                    rule="first-order-gap",
                    severity="warning",
                    message=f"target {target.name}: first order is {way} here: its P95 is "
                    f"{target.first_order_ratio:.3g} of the verified one (nu = {trust.nu:.2g})",
                    value=target.first_order_ratio,
                    limit=1.0,
                )
            )
    return tuple(remarks)

"""The Monte Carlo check: the full nonlinear chain, quantiles with intervals, and the verdict they support."""

from __future__ import annotations

from math import ceil, inf

import numpy as np

from .arrays import Array
from .contributors import declared_law
from .design import Design
from .montecarlo.estimators import (
    between_ranks,
    cvar_estimate,
    enclosing_ranks,
    exceedance_estimate,
    quantile_estimate,
)
from .precision import PRECISION
from .results import (
    Check,
    Exceedance,
    Finding,
    MetricEstimate,
    Reprojection,
    TargetEstimate,
    Validity,
    Verification,
)
from .runs import (
    MAX_TRIALS,
    UNITS,
    Method,
    Prepared,
    Progress,
    Quantile,
    Run,
    Sampling,
    Source,
    confidence_at_each,
    confidence_of,
    largest,
    prepare,
    run_all,
)
from .scoring import FRAMES, NOT_INCLUDED, P95, provenance, tightest_limit, vector3
from .system import Requirement, System
from .tail.declared import law_quantile
from .verdict import conclude, judge

NOT_IN_A_CHECK = tuple(words for words in NOT_INCLUDED if "second order" not in words)
GAP = 0.03  # first order further than this from the check is remarked


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
    twice) to ``precision``, if given, and the rest from ``trials`` plain ones.  Same seed, same digits, whatever
    ``threads``.  Bounded components stand at the vertex that the linear model finds worst; where it cannot tell several
    apart, all of them are run and the largest of what they give is told.

    Raises DesignError, IllPosedError, OutOfRangeError.
    """
    sampling = Sampling(trials, precision, seed, method, max_trials)
    return verify_prepared(prepare(design), sampling, threads=threads, progress=progress)


def verify_prepared(
    ready: Prepared, sampling: Sampling, *, threads: int | None = None, progress: Progress | None = None,
    source: Source | None = None,
) -> Verification:  # fmt: skip
    """``verify`` of a design that was prepared, with parts from a source if there is one: the answer is the same.

    Raises OutOfRangeError, and Pending with everything that the source does not hold and this look needs.
    """
    run, own = run_all(ready, sampling, threads, progress, source)
    checks = _checks(ready, run, own)
    targets = tuple(_target(ready, run, target.name) for target in ready.system.targets)
    worst = max(targets, key=lambda target: target.p95_mm)
    plain = sampling.trials is None and sampling.method == "plain" and not sampling.sequential
    radial_precision = sampling.precision if sampling.method == "radial" else None
    return Verification(
        schema="tailstack/verification/1",
        seed=sampling.seed,
        trials=max(sample.trials for sample in run.samples.values()),
        method=sampling.method,
        engine="structured resection, eight lanes (numba); trials without a proven solution redone by SVD",
        precision_requested=sampling.precision or PRECISION if plain else radial_precision,
        max_trials=sampling.max_trials if plain else None,
        precision_reached=run.precision_reached,
        stopping=run.stopping + _vertices_told(ready),
        targets=targets,
        reprojection=_reprojection(run),
        first_order_ratio=worst.first_order_ratio,
        verdict=conclude(checks, ready.findings + _remarks(targets, ready.trust), "Monte Carlo"),
        provenance=provenance(ready.system, NOT_IN_A_CHECK),
    )


def _quantile(ready: Prepared, run: Run, name: str, error: str, quantile: float) -> Quantile:
    if (name, error, quantile) in run.quantiles:
        return run.quantiles[name, error, quantile]
    at_each = (
        quantile_estimate(run.samples[vertex], name, error, quantile, run.confidence_level)
        for vertex in ready.vertices[name, error]
    )
    return largest(Quantile(found.value_mm, found.interval_mm) for found in at_each)


def _vertices_told(ready: Prepared) -> str:
    """A sentence where an error was sampled at several vertices."""
    if all(len(several) == 1 for several in ready.vertices.values()):
        return ""
    return (
        f" First order cannot tell which of several vertices of the bounded components is worst, so {len(ready.plans)} "
        "were run; of each number the largest is told."
    )


def _metric(ready: Prepared, run: Run, name: str, error: str) -> MetricEstimate:
    """Bias, spread and mean norm at the vertex with the largest P95; of the tail's numbers each one's largest."""
    runs = [run.samples[vertex] for vertex in ready.vertices[name, error]]
    worst = max(runs, key=lambda samples: between_ranks(samples, name, error, P95, None, None)[0])
    sample = worst.of(name, error)
    found = _quantile(ready, run, name, error, P95)
    law, _ = declared_law(ready.models[name], error, ready.worst[name, error].mean_mm)
    limit = tightest_limit(ready.system, name, error)
    beyond = None
    if limit is not None:
        level = confidence_at_each(ready)
        above = [exceedance_estimate(samples, name, error, limit, level) for samples in runs]
        low, high = zip(*(one.interval for one in above), strict=True)
        beyond = Exceedance(limit, max(one.probability for one in above), (max(low), max(high)))
    return MetricEstimate(
        bias_mm=vector3(sample.mean),
        std_mm=vector3(np.sqrt(np.diag(sample.covariance))),
        mean_norm_mm=sample.mean_norm,
        p95_mm=found.value_mm,
        p95_interval_mm=found.interval_mm,
        cvar95_mm=max(cvar_estimate(samples, name, error, P95).value_mm for samples in runs),
        worst_mm=max(samples.of(name, error).worst for samples in runs),
        exceedance=beyond,
        first_order_ratio=law_quantile(law, P95).quantile_mm / found.value_mm if found.value_mm > 0 else 1.0,
    )


def _target(ready: Prepared, run: Run, name: str) -> TargetEstimate:
    metric = _metric(ready, run, name, "tcp")
    return TargetEstimate(
        name=name,
        frame=FRAMES["tcp"],
        **{field: getattr(metric, field) for field in MetricEstimate.__dataclass_fields__},
        confidence=confidence_of(ready.system),
        flagged_trials=max(run.samples[vertex].redone for vertex in ready.vertices[name, "tcp"]),
        first_order_p95_mm=metric.first_order_ratio * metric.p95_mm,
        localisation=_metric(ready, run, name, "localisation"),
    )


def _reprojection(run: Run) -> Reprojection:
    rms = next(iter(run.samples.values())).reprojection
    values = np.zeros(1) if rms is None else rms.rms_px
    return Reprojection(len(values), float(values.mean()), float(np.quantile(values, P95)))


def _checks(ready: Prepared, run: Run, own: dict[tuple[Requirement, str], list[Array]]) -> tuple[Check, ...]:
    checks = []
    for requirement in ready.system.requirements:
        for name in requirement.targets:
            if requirement.risk == "pooled":
                found = _quantile(ready, run, name, requirement.error, requirement.quantile)
                checks.append(judge(requirement, name, found.value_mm, found.interval_mm))
            else:
                checks.append(_check_units(requirement, name, own[requirement, name]))
    return tuple(checks)


def _check_units(requirement: Requirement, name: str, own: list[Array]) -> Check:
    """Nested sampling at each vertex: ``UNITS`` installed units, ``SHOTS`` shots of each; the worst vertex is told.

    The quantile over units of the unit's own quantile, by order statistics, at the fraction of units that must keep
    the limit.  Its interval is within the limit just where the lower Clopper-Pearson limit of the yield is what is
    required, and beyond it just where the upper one is not: both count the units within the limit against the same
    binomial law.  A unit's quantile is itself estimated from its shots: a unit on the limit counts as met half of the
    time, which pulls the yield towards one half by much less than the interval's width.
    """
    fraction = requirement.units_fraction
    assert fraction is not None  # or the requirement would be pooled
    low, high = enclosing_ranks(UNITS, fraction, 1 - (1 - requirement.confidence) / len(own))
    at_each = [np.sort(units) for units in own]

    def largest(rank: int) -> float:
        return max(float(ordered[rank - 1]) for ordered in at_each)

    interval = (0.0 if low is None else largest(low), inf if high is None else largest(high))
    met = min(int((ordered <= requirement.limit_mm).sum()) for ordered in at_each)
    return judge(requirement, name, largest(ceil(UNITS * fraction)), interval, met / UNITS)


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

"""The Monte Carlo check: the full nonlinear chain, quantiles with intervals, and the verdict they support."""

from __future__ import annotations

from math import ceil

import numpy as np
from scipy.special import betaincinv  # scipy.stats takes most of a second to import

from .contributors import declared_law
from .design import Design
from .montecarlo.estimators import cvar_estimate, exceedance_estimate, interval_ranks, quantile_estimate
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
    confidence_of,
    prepare,
    run_all,
)
from .scoring import FRAMES, NOT_INCLUDED, P95, provenance, tightest_limit, vector3
from .system import Array, Requirement, System
from .tail.declared import law_quantile
from .verdict import check_per_unit, check_pooled, conclude

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
    twice).  Same seed, same digits, whatever ``threads``.  Bounded components stand at the vertex that the linear
    model finds worst.  Raises DesignError, IllPosedError, OutOfRangeError.
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
    return Verification(
        schema="tailstack/verification/1",
        seed=sampling.seed,
        trials=max(sample.trials for sample in run.samples.values()),
        method=sampling.method,
        engine="structured resection, eight lanes (numba); trials without a proven solution redone by SVD",
        precision_requested=sampling.precision or PRECISION if plain else None,
        max_trials=sampling.max_trials if plain else None,
        precision_reached=run.precision_reached,
        stopping=run.stopping,
        targets=targets,
        reprojection=_reprojection(run),
        first_order_ratio=worst.first_order_ratio,
        verdict=conclude(checks, ready.findings + _remarks(targets, ready.trust), "Monte Carlo"),
        provenance=provenance(ready.system, NOT_IN_A_CHECK),
    )


def _quantile(ready: Prepared, run: Run, name: str, error: str, quantile: float) -> Quantile:
    if (name, error, quantile) in run.quantiles:
        return run.quantiles[name, error, quantile]
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
        above = exceedance_estimate(samples, name, error, limit, confidence_of(ready.system))
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
        confidence=confidence_of(ready.system),
        flagged_trials=samples.redone,
        first_order_p95_mm=metric.first_order_ratio * metric.p95_mm,
        localisation=_metric(ready, run, name, "localisation"),
    )


def _reprojection(run: Run) -> Reprojection:
    rms = next(iter(run.samples.values())).reprojection
    values = np.zeros(1) if rms is None else rms.rms_px
    return Reprojection(len(values), float(values.mean()), float(np.quantile(values, P95)))


def _checks(ready: Prepared, run: Run, own: dict[tuple[Requirement, str], Array]) -> tuple[Check, ...]:
    checks = []
    for requirement in ready.system.requirements:
        for name in requirement.targets:
            if requirement.risk == "pooled":
                found = _quantile(ready, run, name, requirement.error, requirement.quantile)
                checks.append(check_pooled(requirement, name, found.value_mm, found.interval_mm))
            else:
                checks.append(_check_units(requirement, name, own[requirement, name]))
    return tuple(checks)


def _check_units(requirement: Requirement, name: str, own: Array) -> Check:
    """Nested sampling: ``UNITS`` installed units, ``SHOTS`` shots of each.

    Yield with its Clopper-Pearson interval; value: the 95th percentile over units of the unit's own quantile, by
    order statistics.  A unit's quantile is itself estimated from its shots: a unit on the limit counts as met half
    of the time, which pulls the yield towards one half by much less than the interval's width.
    """
    ordered = np.sort(own)
    met = int((ordered <= requirement.limit_mm).sum())
    alpha = 1 - requirement.confidence
    low = float(betaincinv(met, UNITS - met + 1, alpha / 2)) if met > 0 else 0.0
    high = float(betaincinv(met + 1, UNITS - met, 1 - alpha / 2)) if met < UNITS else 1.0
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

"""What a check samples, in the process itself or put together from parts that were sampled elsewhere.

The control of a check (when to look, when to stop) is deterministic: asked again with more parts at hand it comes to
the same questions.  A source that lacks a part raises Pending with all that can be sampled side by side.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from math import ceil

import numpy as np

from .contributors import declared_law, mean_at
from .cores import usable_cores
from .montecarlo import compile_plan, run_indices
from .montecarlo.estimators import Goal, planned_looks, quantile_estimate, simulate_to_precision
from .montecarlo.radial import RANDOMISATIONS, RAYS, LinearChain, RadialEstimate, gains_in_plan_order, radial
from .montecarlo.simulate import Samples, simulate
from .precision import PRECISION
from .sampling import (
    MAX_TRIALS,
    SHOTS,
    UNITS,
    Method,
    Prepared,
    Progress,
    Quantile,
    RadialWanted,
    Run,
    Sampling,
    Source,
    UnitsWanted,
    Vertex,
    confidence_at_each,
    confidence_of,
    cvar_decided,
    goals_of,
    largest,
    limits_of,
    lowest_quantile,
    prepare,
    questions_of,
    together,
)
from .scoring import FRAMES, P95
from .sequential_runs import run_sequential
from .system import Array, Requirement
from .tail.declared import law_exceedance, law_quantile
from .verdict import decide

__all__ = [
    "MAX_TRIALS",
    "SHOTS",
    "UNITS",
    "UNITS_PER_BATCH",
    "Method",
    "Prepared",
    "Progress",
    "Quantile",
    "RadialWanted",
    "Run",
    "Sampling",
    "Source",
    "UnitsWanted",
    "confidence_at_each",
    "confidence_of",
    "largest",
    "limits_of",
    "prepare",
    "radial_estimate",
    "run_all",
    "unit_quantiles",
]

MOST_DEVIATES = 2**23  # of all rays of a radial estimate: 64 MB
RADIAL_COMPANION_TRIALS = 2**15  # plain trials beside a radial run: moments, CVaR, worst
UNITS_PER_BATCH = 32


def run_all(
    ready: Prepared, sampling: Sampling, threads: int | None, progress: Progress | None, source: Source | None
) -> tuple[Run, dict[tuple[Requirement, str], list[Array]]]:
    """Everything that is sampled: trials, and the units' own quantiles by requirement and target."""
    run: list[Run] = []
    own: dict[tuple[Requirement, str], list[Array]] = {}

    def trials() -> None:
        if sampling.method == "radial":
            run.append(_run_radial(ready, sampling, threads, progress, source))
        elif sampling.trials is not None:
            run.append(_run_fixed(ready, sampling.trials, sampling.seed, threads, progress, source))
        elif sampling.sequential:
            run.append(run_sequential(ready, sampling, threads, progress, source))
        else:
            run.append(_run_adaptive(ready, sampling, threads, progress, source))

    def units() -> None:
        own.update(_unit_quantiles(ready, sampling.seed, threads, source))

    together([trials, units])
    return run[0], own


def _draw(
    ready: Prepared, trials: int, seed: int, threads: int | None, progress: Progress | None, source: Source | None
) -> dict[Vertex, Samples]:
    runs = [
        partial(
            simulate, plan, trials=trials, seed=seed, quantile=lowest_quantile(ready.system), threads=threads,
            reprojection=True, progress=progress, limits=limits_of(ready.system),
            source=None if source is None else source.shards,
        )
        for plan in ready.plans.values()
    ]  # fmt: skip
    return dict(zip(ready.plans, together(runs), strict=True))


def _run_fixed(
    ready: Prepared, trials: int, seed: int, threads: int | None, progress: Progress | None, source: Source | None
) -> Run:
    level = confidence_at_each(ready)
    samples = _draw(ready, trials, seed, threads, progress, source)
    reached = 0.0
    for vertex, sample in samples.items():
        for goal in goals_of(ready, vertex):
            found = quantile_estimate(sample, goal.target, goal.error, goal.quantile, level)
            reached = max(reached, found.relative_half_width)
    return Run(samples, level, f"Stopped after the {trials} trials asked for.", reached, {})


def _run_adaptive(
    ready: Prepared, sampling: Sampling, threads: int | None, progress: Progress | None, source: Source | None
) -> Run:
    confidence = confidence_at_each(ready)
    runs = [
        partial(
            simulate_to_precision, plan, precision=sampling.precision or PRECISION, seed=sampling.seed,
            goals=goals_of(ready, vertex) or [Goal(0, "tcp", P95)], confidence=confidence,
            max_trials=sampling.max_trials, threads=threads, reprojection=True, progress=progress,
            settled=partial(_decided, ready, vertex, sampling), quantile=lowest_quantile(ready.system),
            limits=limits_of(ready.system),
            source=None if source is None else source.shards,
        )
        for vertex, plan in ready.plans.items()
    ]  # fmt: skip
    samples: dict[Vertex, Samples] = {}
    stopping, reached, level = "", 0.0, confidence
    for vertex, run in zip(ready.plans, together(runs), strict=True):
        samples[vertex] = run.samples
        level = min(level, run.level) if level != confidence else run.level
        stopping, reached = run.stopping, max(reached, run.precision_reached)
    return Run(samples, level, stopping, reached, {})


def _decided(ready: Prepared, vertex: Vertex, sampling: Sampling, samples: Samples, level: float) -> bool:
    """No pooled requirement and no question of this run is still open, and as many are drawn as were asked for."""
    if samples.trials < sampling.at_least:
        return False
    for asked in questions_of(ready, vertex, sampling):
        found = quantile_estimate(samples, asked.target, asked.error, asked.quantile, level)
        if decide(found.interval_mm, asked.limit_mm) == "inconclusive":
            return False
    return cvar_decided(ready, vertex, sampling, samples, len(planned_looks(sampling.max_trials)))


def _run_radial(
    ready: Prepared, sampling: Sampling, threads: int | None, progress: Progress | None, source: Source | None
) -> Run:
    quantiles = {(name, error, P95) for name, error in ready.vertices}
    quantiles |= {(n, r.error, r.quantile) for r in ready.system.requirements for n in r.targets}
    wanted = [
        RadialWanted(name, error, quantile, sampling.seed, vertex, sampling.precision)
        for name, error, quantile in sorted(quantiles)
        for vertex in ready.vertices[name, error]
    ]
    trials = RADIAL_COMPANION_TRIALS if sampling.trials is None else sampling.trials
    samples: dict[Vertex, Samples] = {}
    estimates: list[RadialEstimate] = []
    together([
        lambda: samples.update(_draw(ready, trials, sampling.seed, threads, progress, source)),
        lambda: estimates.extend(together(
            [partial(radial_estimate, ready, one) if source is None else partial(source.radial, one) for one in wanted]
        )),
    ])  # fmt: skip
    at_each: dict[tuple[str, str, float], list[Quantile]] = {}
    for one, estimate in zip(wanted, estimates, strict=True):
        key = one.target, one.error, one.quantile
        at_each.setdefault(key, []).append(Quantile(estimate.value_mm, estimate.interval_mm))
    found = {key: largest(several) for key, several in at_each.items()}
    reached = max((one.interval_mm[1] - one.interval_mm[0]) / (2 * one.value_mm) for one in found.values())
    short = ""
    if sampling.precision is not None and reached > sampling.precision:
        short = f", as many as are drawn, short of the ±{100 * sampling.precision:g} % requested"
    stopping = (
        f"Quantiles by radial conditional sampling with {sum(found.evaluations for found in estimates)} evaluations of "
        f"the chain{short}; moments, CVaR, worst case and exceedance from {trials} plain trials."
    )
    return Run(samples, confidence_at_each(ready), stopping, reached, found)


def radial_estimate(ready: Prepared, wanted: RadialWanted) -> RadialEstimate:
    """One quantile by radial conditional sampling, with the linear model as its control.  Raises OutOfRangeError."""
    name, error = wanted.target, wanted.error
    place = [target.name for target in ready.system.targets].index(name)
    model = ready.models[name]
    mean = mean_at(model, error, dict(wanted.vertex))
    plan = ready.plans[wanted.vertex]
    law, _ = declared_law(model, error, mean)
    first = law_quantile(law, wanted.quantile)
    linear = LinearChain(
        mean=mean,
        gain=gains_in_plan_order(plan, model.blocks, place, error),
        exceedance=partial(law_exceedance, law),
        quantile_mm=first.quantile_mm,
        density_per_mm=first.density,
    )
    rays, most = RAYS, MOST_DEVIATES // (RANDOMISATIONS * plan.dimension)
    while True:
        found = radial(
            plan, linear, target=place, error=error, quantile=wanted.quantile, seed=wanted.seed,
            confidence=confidence_at_each(ready), rays=rays,
        )  # fmt: skip
        half_width = (found.interval_mm[1] - found.interval_mm[0]) / (2 * found.value_mm)
        if wanted.precision is None or half_width <= wanted.precision or 4 * rays > most:
            return found
        rays *= 4


def _unit_quantiles(
    ready: Prepared, seed: int, threads: int | None, source: Source | None
) -> dict[tuple[Requirement, str], list[Array]]:
    """(UNITS,) mm at each vertex, by requirement and target, where the requirement is on each unit."""
    wanted = []
    for requirement in ready.system.requirements:
        for name in requirement.targets if requirement.risk == "per_unit" else ():
            place = [target.name for target in ready.system.targets].index(name)
            for vertex in ready.vertices[name, requirement.error]:
                plan = compile_plan(ready.system, vertex=dict(vertex), shots_per_unit=SHOTS)
                one = UnitsWanted(plan, seed, place, requirement.error, requirement.quantile)
                wanted.append(((requirement, name), one))
    ask = partial(_units_here, threads=threads) if source is None else source.unit_quantiles
    own: dict[tuple[Requirement, str], list[Array]] = {}
    for (key, _), found in zip(wanted, together([partial(ask, one) for _, one in wanted]), strict=True):
        own.setdefault(key, []).append(found)
    return own


def _units_here(wanted: UnitsWanted, *, threads: int | None) -> Array:
    batches = range(0, UNITS, UNITS_PER_BATCH)
    with ThreadPoolExecutor(usable_cores() if threads is None else threads) as pool:
        return np.concatenate(list(pool.map(lambda first: unit_quantiles(wanted, first, UNITS_PER_BATCH), batches)))


def unit_quantiles(wanted: UnitsWanted, first: int, count: int) -> Array:
    """(count,) mm: the quantile over its shots of each of the units ``first`` ... ``first + count - 1``."""
    metric, rank = list(FRAMES).index(wanted.error), ceil(SHOTS * wanted.quantile) - 1
    errors = run_indices(wanted.plan, wanted.seed, first * SHOTS, count * SHOTS).errors[wanted.target, metric]
    norms = np.linalg.norm(errors, axis=0).reshape(count, SHOTS)
    return np.asarray(np.partition(norms, rank, axis=1)[:, rank])

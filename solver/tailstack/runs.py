"""What a check samples, in the process itself or put together from parts that were sampled elsewhere.

The control of a check (when to look, when to stop) is deterministic: asked again with more parts at hand it comes to
the same questions.  A source that lacks a part raises Pending with all that can be sampled side by side.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from math import ceil, inf
from typing import Literal, Protocol, TypeVar

import numpy as np

from .contributors import WorstCase, declared_law, worst_case
from .cores import usable_cores
from .design import Design
from .errors import DesignError, OutOfRangeError, Problem
from .montecarlo import ChainPlan, compile_plan, run_indices
from .montecarlo.estimators import (
    Goal,
    cvar_estimate,
    planned_looks,
    quantile_estimate,
    simulate_to_precision,
)
from .montecarlo.radial import LinearChain, RadialEstimate, gains_in_plan_order, radial
from .montecarlo.sequential import (
    CvarQuestion,
    Question,
    cvar_interval,
    repeated_interval,
    repeated_ranks,
    simulate_to_decision,
)
from .montecarlo.shards import Pending, Shard, Wanted
from .montecarlo.simulate import Samples, simulate
from .precision import FINEST_PRECISION, PRECISION
from .propagation.linear import LinearModel, linearise
from .results import Finding, Interval, Validity
from .scoring import FRAMES, P95, checked_system, tightest_limit, trust_of
from .system import Array, Requirement, System
from .tail.declared import law_exceedance, law_quantile
from .verdict import decide

MAX_TRIALS = 2**22
RADIAL_COMPANION_TRIALS = 2**15  # plain trials beside a radial run: moments, CVaR, worst
UNITS, SHOTS = 2048, 512  # nested sampling of a per-unit requirement
UNITS_PER_BATCH = 32
Progress = Callable[[int, int], None]
Method = Literal["plain", "radial"]
Key = tuple[str, str]  # target, error
Vertex = tuple[tuple[str, float], ...]
T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class UnitsWanted:
    """The quantile over ``SHOTS`` shots of each installed unit, of one error at one target, for ``UNITS`` units."""

    plan: ChainPlan  # with SHOTS shots per unit
    seed: int
    target: int
    error: str
    quantile: float


@dataclass(frozen=True, slots=True)
class RadialWanted:
    """A quantile by radial conditional sampling."""

    target: str
    error: str
    quantile: float
    seed: int


class Source(Protocol):
    """Where sampled parts come from that were computed elsewhere.  Each may raise Pending for what is not there yet;
    ``verify`` is then asked again once it is."""

    def shards(self, wanted: Wanted) -> Iterable[Shard]: ...
    def unit_quantiles(self, wanted: UnitsWanted) -> Array: ...  # (UNITS,) mm
    def radial(self, wanted: RadialWanted) -> RadialEstimate: ...


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """What a check needs of the linear model: at which vertex to simulate, and what to compare with."""

    system: System
    findings: tuple[Finding, ...]
    trust: Validity
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
    quantiles: dict[tuple[str, str, float], Quantile]  # that were found otherwise than from ``confidence_level``


@dataclass(frozen=True, slots=True)
class Sampling:
    """How a design is to be checked: see ``verify``.  Raises DesignError for trials and precision at once,
    OutOfRangeError for a precision that no affordable number of trials reaches."""

    trials: int | None = None
    precision: float | None = None
    seed: int = 0
    method: Method = "plain"
    max_trials: int = MAX_TRIALS
    sequential: bool = False  # only until every requirement and question is decided, not to a precision
    questions: tuple[Question, ...] = ()  # to be decided besides the requirements; not asked where trials are given
    cvar: tuple[CvarQuestion, ...] = ()
    at_least: int = 0  # trials before which a check that draws to a precision does not stop

    def __post_init__(self) -> None:
        if self.trials is not None and self.precision is not None:
            raise DesignError(
                Problem("", "trials-and-precision", "both trials and precision were given", "give one of them")
            )
        if self.precision is not None and not FINEST_PRECISION <= self.precision < 1:
            detail = f"precision must be at least {FINEST_PRECISION:g} and below 1; got {self.precision:g}"
            raise OutOfRangeError(Problem("/precision", "out-of-range", detail, "a finer one takes billions of trials"))


def prepare(design: Design | System) -> Prepared:
    """Linear model, worst vertex and compiled plan for every target and error.  Raises DesignError, IllPosedError."""
    system, findings, _ = checked_system(design)
    models = {target.name: linearise(system, target) for target in system.targets}
    worst = {(name, error): worst_case(model, error, P95) for name, model in models.items() for error in FRAMES}
    vertices: dict[Key, Vertex] = {}
    for (name, error), case in worst.items():
        # Where the error is blind to a component, the vertex of the TCP error serves: one run instead of two.
        ends = worst[name, "tcp"].vertex(models[name]) | case.vertex(models[name])
        vertices[name, error] = tuple(sorted(ends.items()))
    plans = {vertex: compile_plan(system, vertex=dict(vertex)) for vertex in dict.fromkeys(vertices.values())}
    return Prepared(system, findings, trust_of(system, models), models, worst, vertices, plans)


def _together(asked: Iterable[Callable[[], T]]) -> list[T]:
    """Everything that is asked for; where one has to wait the others are asked too, so that all wait together."""
    found: list[T] = []
    missing: list[Pending] = []
    for ask in asked:
        try:
            found.append(ask())
        except Pending as pending:
            missing.append(pending)
    if missing:
        wanted = [part for pending in missing for part in pending.wanted]
        raise Pending(wanted, sum(pending.remaining for pending in missing))
    return found


def run_all(
    ready: Prepared, sampling: Sampling, threads: int | None, progress: Progress | None, source: Source | None
) -> tuple[Run, dict[tuple[Requirement, str], Array]]:
    """Everything that is sampled: trials, and the units' own quantiles by requirement and target."""
    run: list[Run] = []
    own: dict[tuple[Requirement, str], Array] = {}

    def trials() -> None:
        if sampling.method == "radial":
            run.append(_run_radial(ready, sampling.seed, threads, progress, source))
        elif sampling.trials is not None:
            run.append(_run_fixed(ready, sampling.trials, sampling.seed, threads, progress, source))
        elif sampling.sequential:
            run.append(_run_sequential(ready, sampling, threads, progress, source))
        else:
            run.append(_run_adaptive(ready, sampling, threads, progress, source))

    def units() -> None:
        own.update(_unit_quantiles(ready, sampling.seed, threads, source))

    _together([trials, units])
    return run[0], own


def _goals(ready: Prepared, vertex: Vertex) -> list[Goal]:
    """Quantiles that must be precise in the run at this vertex: P95 and every requirement's own."""
    wanted = {(name, error, P95) for (name, error), at in ready.vertices.items() if at == vertex and error == "tcp"}
    for requirement in ready.system.requirements:
        for name in requirement.targets:
            if ready.vertices[name, requirement.error] == vertex:
                wanted.add((name, requirement.error, requirement.quantile))
    return [Goal(*goal) for goal in sorted(wanted)]


def confidence_of(system: System) -> float:
    return max((r.confidence for r in system.requirements), default=0.95)


def _lowest(system: System) -> float:
    return min([P95, *(r.quantile for r in system.requirements)])


def limits_of(system: System) -> tuple[float, ...]:
    """Of every metric, in the order of ``Samples.errors``: the limit that exceedance is reported for."""
    limits = [tightest_limit(system, target.name, error) for target in system.targets for error in FRAMES]
    return tuple(inf if limit is None else limit for limit in limits)


def _run_fixed(
    ready: Prepared, trials: int, seed: int, threads: int | None, progress: Progress | None, source: Source | None
) -> Run:
    level = confidence_of(ready.system)
    runs = [
        partial(
            simulate, plan, trials=trials, seed=seed, quantile=_lowest(ready.system), threads=threads,
            reprojection=True, progress=progress, limits=limits_of(ready.system),
            source=None if source is None else source.shards,
        )
        for plan in ready.plans.values()
    ]  # fmt: skip
    samples = dict(zip(ready.plans, _together(runs), strict=True))
    reached = 0.0
    for vertex, sample in samples.items():
        for goal in _goals(ready, vertex):
            found = quantile_estimate(sample, goal.target, goal.error, goal.quantile, level)
            reached = max(reached, found.relative_half_width)
    return Run(samples, level, f"Stopped after the {trials} trials asked for.", reached, {})


def _run_adaptive(
    ready: Prepared, sampling: Sampling, threads: int | None, progress: Progress | None, source: Source | None
) -> Run:
    confidence = confidence_of(ready.system)
    runs = [
        partial(
            simulate_to_precision, plan, precision=sampling.precision or PRECISION, seed=sampling.seed,
            goals=_goals(ready, vertex) or [Goal(0, "tcp", P95)], confidence=confidence,
            max_trials=sampling.max_trials, threads=threads, reprojection=True, progress=progress,
            settled=partial(_decided, ready, vertex, sampling), quantile=_lowest(ready.system),
            limits=limits_of(ready.system),
            source=None if source is None else source.shards,
        )
        for vertex, plan in ready.plans.items()
    ]  # fmt: skip
    samples: dict[Vertex, Samples] = {}
    stopping, reached, level = "", 0.0, confidence
    for vertex, run in zip(ready.plans, _together(runs), strict=True):
        samples[vertex] = run.samples
        level = min(level, run.level) if level != confidence else run.level
        stopping, reached = run.stopping, max(reached, run.precision_reached)
    return Run(samples, level, stopping, reached, {})


def _decided(ready: Prepared, vertex: Vertex, sampling: Sampling, samples: Samples, level: float) -> bool:
    """No pooled requirement and no question of this run is still open, and as many are drawn as were asked for."""
    if samples.trials < sampling.at_least:
        return False
    for asked in _questions(ready, vertex, sampling):
        found = quantile_estimate(samples, asked.target, asked.error, asked.quantile, level)
        if decide(found.interval_mm, asked.limit_mm) == "inconclusive":
            return False
    return _cvar_decided(ready, vertex, sampling, samples, len(planned_looks(sampling.max_trials)))


def _questions(ready: Prepared, vertex: Vertex, sampling: Sampling) -> tuple[Question, ...]:
    """What the run at this vertex has to decide: pooled requirements, and what was asked besides."""
    required = (
        Question(name, requirement.error, requirement.quantile, requirement.limit_mm)
        for requirement in ready.system.requirements
        for name in requirement.targets
        if requirement.risk == "pooled"
    )
    everything = dict.fromkeys((*required, *sampling.questions))
    return tuple(asked for asked in everything if ready.vertices[asked.target, asked.error] == vertex)


def _cvar_decided(ready: Prepared, vertex: Vertex, sampling: Sampling, samples: Samples, looks: int) -> bool:
    for asked in sampling.cvar:
        if ready.vertices[asked.target, "tcp"] != vertex:
            continue
        p95 = quantile_estimate(samples, asked.target, "tcp", P95).value_mm
        mean = cvar_estimate(samples, asked.target, "tcp", P95).value_mm
        worst = samples.of(asked.target, "tcp").worst
        interval = cvar_interval(p95, mean, worst, samples.trials, asked.confidence, looks)
        if decide(interval, asked.limit_mm) == "inconclusive":
            return False
    return True


def _run_sequential(
    ready: Prepared, sampling: Sampling, threads: int | None, progress: Progress | None, source: Source | None
) -> Run:
    confidence = confidence_of(ready.system)
    runs = [
        partial(
            simulate_to_decision, plan, seed=sampling.seed, questions=_questions(ready, vertex, sampling),
            confidence=confidence, max_trials=sampling.max_trials, quantile=_lowest(ready.system),
            settled=partial(_cvar_decided, ready, vertex, sampling), threads=threads, progress=progress,
            limits=limits_of(ready.system), source=None if source is None else source.shards,
        )
        for vertex, plan in ready.plans.items()
    ]  # fmt: skip
    found = dict(zip(ready.plans, _together(runs), strict=True))
    wanted = {(name, error, P95) for name, error in ready.vertices}
    wanted |= {(n, r.error, r.quantile) for r in ready.system.requirements for n in r.targets}
    quantiles: dict[tuple[str, str, float], Quantile] = {}
    for name, error, quantile in sorted(wanted):
        run = found[ready.vertices[name, error]]
        ranks = repeated_ranks(run.looks, quantile, confidence)[run.looks.index(run.samples.trials)]
        one = repeated_interval(run.samples, name, error, quantile, ranks)
        quantiles[name, error, quantile] = Quantile(one.value_mm, one.interval_mm)
    reached = max(
        (one.interval_mm[1] - one.interval_mm[0]) / (2 * one.value_mm) if one.value_mm > 0 else 0.0
        for key, one in quantiles.items()
        if key[1:] == ("tcp", P95)
    )
    longest = max((run for run in found.values()), key=lambda run: run.samples.trials)
    reason = "every limit is decided" if all(run.decided for run in found.values()) else "the cap was reached"
    stopping = (
        f"Stopped after {longest.samples.trials} trials because {reason}: a sequential test with up to "
        f"{len(longest.looks)} looks, each limit of a quantile decided wrongly with a probability of at most "
        f"{(1 - confidence) / 2:.3g} on either side, over all looks."
    )
    samples = {vertex: run.samples for vertex, run in found.items()}
    return Run(samples, confidence, stopping, reached, quantiles)


def _run_radial(
    ready: Prepared, seed: int, threads: int | None, progress: Progress | None, source: Source | None
) -> Run:
    quantiles = {(name, error, P95) for name, error in ready.vertices}
    quantiles |= {(n, r.error, r.quantile) for r in ready.system.requirements for n in r.targets}
    wanted = [RadialWanted(*which, seed) for which in sorted(quantiles)]
    plain: list[Run] = []
    estimates: list[RadialEstimate] = []
    _together([
        lambda: plain.append(_run_fixed(ready, RADIAL_COMPANION_TRIALS, seed, threads, progress, source)),
        lambda: estimates.extend(_together(
            [partial(radial_estimate, ready, one) if source is None else partial(source.radial, one) for one in wanted]
        )),
    ])  # fmt: skip
    found = {
        (one.target, one.error, one.quantile): Quantile(estimate.value_mm, estimate.interval_mm)
        for one, estimate in zip(wanted, estimates, strict=True)
    }
    reached = max((found.interval_mm[1] - found.interval_mm[0]) / (2 * found.value_mm) for found in estimates)
    stopping = (
        f"Quantiles by radial conditional sampling with {sum(found.evaluations for found in estimates)} evaluations of "
        f"the chain; moments, CVaR, worst case and exceedance from {RADIAL_COMPANION_TRIALS} plain trials."
    )
    return replace(plain[0], stopping=stopping, precision_reached=reached, quantiles=found)


def radial_estimate(ready: Prepared, wanted: RadialWanted) -> RadialEstimate:
    """One quantile by radial conditional sampling, with the linear model as its control.  Raises OutOfRangeError."""
    name, error = wanted.target, wanted.error
    place = [target.name for target in ready.system.targets].index(name)
    model, case = ready.models[name], ready.worst[name, error]
    plan = ready.plans[ready.vertices[name, error]]
    law, _ = declared_law(model, error, case.mean_mm)
    first = law_quantile(law, wanted.quantile)
    linear = LinearChain(
        mean=case.mean_mm,
        gain=gains_in_plan_order(plan, model.blocks, place, error),
        exceedance=partial(law_exceedance, law),
        quantile_mm=first.quantile_mm,
        density_per_mm=first.density,
    )
    return radial(
        plan, linear, target=place, error=error, quantile=wanted.quantile, seed=wanted.seed,
        confidence=confidence_of(ready.system),
    )  # fmt: skip


def _unit_quantiles(
    ready: Prepared, seed: int, threads: int | None, source: Source | None
) -> dict[tuple[Requirement, str], Array]:
    """(UNITS,) mm, by requirement and target, where the requirement is on each unit."""
    wanted = {}
    for requirement in ready.system.requirements:
        for name in requirement.targets if requirement.risk == "per_unit" else ():
            plan = compile_plan(
                ready.system, vertex=dict(ready.vertices[name, requirement.error]), shots_per_unit=SHOTS
            )
            place = [target.name for target in ready.system.targets].index(name)
            wanted[requirement, name] = UnitsWanted(plan, seed, place, requirement.error, requirement.quantile)
    ask = partial(_units_here, threads=threads) if source is None else source.unit_quantiles
    return dict(zip(wanted, _together([partial(ask, one) for one in wanted.values()]), strict=True))


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

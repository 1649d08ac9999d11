"""The Monte Carlo check: the full nonlinear chain, quantiles with intervals, and the verdict they support.

The control of a check (when to look, when to stop) is deterministic: asked again with more parts at hand it comes to
the same questions.  A source that lacks a part raises Pending with all that can be sampled side by side.

Where a verdict is all that is wanted, trials are drawn until every limit is decided.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from math import ceil, inf
from typing import Literal, Protocol, TypeVar

import numpy as np

from .arrays import Array
from .contributors import WorstCase, declared_law, mean_at, worst_case, worst_vertices
from .cores import usable_cores
from .design import Design
from .errors import DesignError, OutOfRangeError, Problem
from .montecarlo import ChainPlan, compile_plan, run_indices
from .montecarlo.estimators import (
    Goal,
    between_ranks,
    cvar_estimate,
    enclosing_ranks,
    exceedance_estimate,
    planned_looks,
    quantile_estimate,
    simulate_to_precision,
)
from .montecarlo.radial import RANDOMISATIONS, RAYS, LinearChain, RadialEstimate, gains_in_plan_order, radial
from .montecarlo.sequential import (
    CvarQuestion,
    Question,
    cvar_interval,
    repeated_interval,
    repeated_ranks,
    simulate_to_decision,
)
from .montecarlo.simulate import Pending, Samples, Shard, TrialsTask, simulate
from .precision import FINEST_PRECISION, PRECISION
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
from .verdict import conclude, decide, judge

MOST_DEVIATES = 2**23  # of all rays of a radial estimate: 64 MB
RADIAL_COMPANION_TRIALS = 2**15  # plain trials beside a radial run: moments, CVaR, worst
UNITS_PER_BATCH = 32


def run_all(
    ready: PreparedDesign, sampling: Sampling, threads: int | None, progress: Progress | None, source: Sampler | None
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

    gather([trials, units])
    return run[0], own


def _draw(
    ready: PreparedDesign,
    trials: int,
    seed: int,
    threads: int | None,
    progress: Progress | None,
    source: Sampler | None,
) -> dict[Vertex, Samples]:
    runs = [
        partial(
            simulate, plan, trials=trials, seed=seed, quantile=lowest_quantile(ready.system), threads=threads,
            reprojection=True, progress=progress, limits=limits_of(ready.system),
            source=None if source is None else source.shards,
        )
        for plan in ready.plans.values()
    ]  # fmt: skip
    return dict(zip(ready.plans, gather(runs), strict=True))


def _run_fixed(
    ready: PreparedDesign,
    trials: int,
    seed: int,
    threads: int | None,
    progress: Progress | None,
    source: Sampler | None,
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
    ready: PreparedDesign, sampling: Sampling, threads: int | None, progress: Progress | None, source: Sampler | None
) -> Run:
    confidence = confidence_at_each(ready)
    runs = [
        partial(
            simulate_to_precision, plan, precision=sampling.precision or PRECISION, seed=sampling.seed,
            goals=goals_of(ready, vertex) or [Goal(0, "tcp", P95)], confidence=confidence,
            max_trials=sampling.max_trials, threads=threads, reprojection=True, progress=progress,
            settled=partial(_is_decided, ready, vertex, sampling), quantile=lowest_quantile(ready.system),
            limits=limits_of(ready.system),
            source=None if source is None else source.shards,
        )
        for vertex, plan in ready.plans.items()
    ]  # fmt: skip
    samples: dict[Vertex, Samples] = {}
    stopping, reached, level = "", 0.0, confidence
    for vertex, run in zip(ready.plans, gather(runs), strict=True):
        samples[vertex] = run.samples
        level = min(level, run.level) if level != confidence else run.level
        stopping, reached = run.stopping, max(reached, run.precision_reached)
    return Run(samples, level, stopping, reached, {})


def _is_decided(ready: PreparedDesign, vertex: Vertex, sampling: Sampling, samples: Samples, level: float) -> bool:
    """No pooled requirement and no question of this run is still open, and as many are drawn as were asked for."""
    if samples.trials < sampling.at_least:
        return False
    for asked in questions_of(ready, vertex, sampling):
        found = quantile_estimate(samples, asked.target, asked.error, asked.quantile, level)
        if decide(found.interval_mm, asked.limit_mm) == "inconclusive":
            return False
    return cvar_decided(ready, vertex, sampling, samples, len(planned_looks(sampling.max_trials)))


def _run_radial(
    ready: PreparedDesign, sampling: Sampling, threads: int | None, progress: Progress | None, source: Sampler | None
) -> Run:
    quantiles = {(name, error, P95) for name, error in ready.vertices}
    quantiles |= {(n, r.error, r.quantile) for r in ready.system.requirements for n in r.targets}
    wanted = [
        RadialTask(name, error, quantile, sampling.seed, vertex, sampling.precision)
        for name, error, quantile in sorted(quantiles)
        for vertex in ready.vertices[name, error]
    ]
    trials = RADIAL_COMPANION_TRIALS if sampling.trials is None else sampling.trials
    samples: dict[Vertex, Samples] = {}
    estimates: list[RadialEstimate] = []
    gather([
        lambda: samples.update(_draw(ready, trials, sampling.seed, threads, progress, source)),
        lambda: estimates.extend(gather(
            [partial(radial_estimate, ready, one) if source is None else partial(source.radial, one) for one in wanted]
        )),
    ])  # fmt: skip
    at_each: dict[tuple[str, str, float], list[Quantile]] = {}
    for one, estimate in zip(wanted, estimates, strict=True):
        key = one.target, one.error, one.quantile
        at_each.setdefault(key, []).append(Quantile(estimate.value_mm, estimate.interval_mm))
    found = {key: take_largest(several) for key, several in at_each.items()}
    reached = max((one.interval_mm[1] - one.interval_mm[0]) / (2 * one.value_mm) for one in found.values())
    short = ""
    if sampling.precision is not None and reached > sampling.precision:
        short = f", as many as are drawn, short of the ±{100 * sampling.precision:g} % requested"
    stopping = (
        f"Quantiles by radial conditional sampling with {sum(found.evaluations for found in estimates)} evaluations of "
        f"the chain{short}; moments, CVaR, worst case and exceedance from {trials} plain trials."
    )
    return Run(samples, confidence_at_each(ready), stopping, reached, found)


def radial_estimate(ready: PreparedDesign, wanted: RadialTask) -> RadialEstimate:
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
    ready: PreparedDesign, seed: int, threads: int | None, source: Sampler | None
) -> dict[tuple[Requirement, str], list[Array]]:
    """(UNITS,) mm at each vertex, by requirement and target, where the requirement is on each unit."""
    wanted = []
    for requirement in ready.system.requirements:
        for name in requirement.targets if requirement.risk == "per_unit" else ():
            place = [target.name for target in ready.system.targets].index(name)
            for vertex in ready.vertices[name, requirement.error]:
                plan = compile_plan(ready.system, vertex=dict(vertex), shots_per_unit=SHOTS)
                one = UnitsTask(plan, seed, place, requirement.error, requirement.quantile)
                wanted.append(((requirement, name), one))
    ask = partial(_units_here, threads=threads) if source is None else source.unit_quantiles
    own: dict[tuple[Requirement, str], list[Array]] = {}
    for (key, _), found in zip(wanted, gather([partial(ask, one) for _, one in wanted]), strict=True):
        own.setdefault(key, []).append(found)
    return own


def _units_here(wanted: UnitsTask, *, threads: int | None) -> Array:
    batches = range(0, UNITS, UNITS_PER_BATCH)
    with ThreadPoolExecutor(usable_cores() if threads is None else threads) as pool:
        return np.concatenate(list(pool.map(lambda first: unit_quantiles(wanted, first, UNITS_PER_BATCH), batches)))


def unit_quantiles(wanted: UnitsTask, first: int, count: int) -> Array:
    """(count,) mm: the quantile over its shots of each of the units ``first`` ... ``first + count - 1``."""
    metric, rank = list(FRAMES).index(wanted.error), ceil(SHOTS * wanted.quantile) - 1
    errors = run_indices(wanted.plan, wanted.seed, first * SHOTS, count * SHOTS).errors[wanted.target, metric]
    norms = np.linalg.norm(errors, axis=0).reshape(count, SHOTS)
    return np.asarray(np.partition(norms, rank, axis=1)[:, rank])


def run_sequential(
    ready: PreparedDesign, sampling: Sampling, threads: int | None, progress: Progress | None, source: Sampler | None
) -> Run:
    confidence = confidence_at_each(ready)
    runs = [
        partial(
            simulate_to_decision, plan, seed=sampling.seed, questions=questions_of(ready, vertex, sampling),
            confidence=confidence, max_trials=sampling.max_trials, quantile=lowest_quantile(ready.system),
            settled=partial(cvar_decided, ready, vertex, sampling), threads=threads, progress=progress,
            limits=limits_of(ready.system), source=None if source is None else source.shards,
        )
        for vertex, plan in ready.plans.items()
    ]  # fmt: skip
    found = dict(zip(ready.plans, gather(runs), strict=True))
    wanted = {(name, error, P95) for name, error in ready.vertices}
    wanted |= {(n, r.error, r.quantile) for r in ready.system.requirements for n in r.targets}
    quantiles: dict[tuple[str, str, float], Quantile] = {}
    for name, error, quantile in sorted(wanted):
        at_each = []
        for vertex in ready.vertices[name, error]:
            run = found[vertex]
            ranks = repeated_ranks(run.looks, quantile, confidence)[run.looks.index(run.samples.trials)]
            one = repeated_interval(run.samples, name, error, quantile, ranks)
            at_each.append(Quantile(one.value_mm, one.interval_mm))
        quantiles[name, error, quantile] = take_largest(at_each)
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
        f"{(1 - confidence_of(ready.system)) / 2:.3g} on either side, over all looks."
    )
    samples = {vertex: run.samples for vertex, run in found.items()}
    return Run(samples, confidence, stopping, reached, quantiles)


MAX_TRIALS = 2**22
UNITS, SHOTS = 2048, 512  # nested sampling of a per-unit requirement
Progress = Callable[[int, int], None]
Method = Literal["plain", "radial"]
Key = tuple[str, str]  # target, error
Vertex = tuple[tuple[str, float], ...]
T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class UnitsTask:
    """The quantile over ``SHOTS`` shots of each installed unit, of one error at one target, for ``UNITS`` units."""

    plan: ChainPlan  # with SHOTS shots per unit
    seed: int
    target: int
    error: str
    quantile: float


@dataclass(frozen=True, slots=True)
class RadialTask:
    """A quantile by radial conditional sampling at one vertex."""

    target: str
    error: str
    quantile: float
    seed: int
    vertex: Vertex = ()
    precision: float | None = None  # relative half-width of its interval; None: that of the fewest rays


class Sampler(Protocol):
    """Where sampled parts come from that were computed elsewhere.  Each may raise Pending for what is not there yet;
    ``verify`` is then asked again once it is."""

    def shards(self, wanted: TrialsTask) -> Iterable[Shard]: ...
    def unit_quantiles(self, wanted: UnitsTask) -> Array: ...  # (UNITS,) mm
    def radial(self, wanted: RadialTask) -> RadialEstimate: ...


@dataclass(frozen=True, slots=True, eq=False)
class PreparedDesign:
    """What a check needs of the linear model: at which vertices to simulate, and what to compare with.

    Where first order cannot tell some vertices of the bounded components from the worst one (opposite ones without a
    bias), an error is sampled at each of them, the worst by first order first, and the worst of what is found is told.
    """

    system: System
    findings: tuple[Finding, ...]
    trust: Validity
    models: dict[str, LinearModel]
    worst: dict[Key, WorstCase]
    vertices: dict[Key, tuple[Vertex, ...]]
    plans: dict[Vertex, ChainPlan]


@dataclass(frozen=True, slots=True)
class Quantile:
    value_mm: float
    interval_mm: Interval


def take_largest(found: Iterable[Quantile]) -> Quantile:
    """The largest of a quantile at several vertices, with its interval: each end is the largest of theirs."""
    value, low, high = zip(*((one.value_mm, *one.interval_mm) for one in found), strict=True)
    return Quantile(max(value), (max(low), max(high)))


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


def prepare(design: Design | System) -> PreparedDesign:
    """Linear model, worst vertex and compiled plan for every target and error.  Raises DesignError, IllPosedError."""
    system, findings, _ = checked_system(design)
    models = {target.name: linearise(system, target) for target in system.targets}
    worst = {(name, error): worst_case(model, error, P95) for name, model in models.items() for error in FRAMES}
    vertices: dict[Key, tuple[Vertex, ...]] = {}
    for name, model in models.items():
        for error in FRAMES:
            asked = {r.quantile for r in system.requirements if r.error == error and name in r.targets}
            ends = [end for quantile in (P95, *sorted(asked - {P95})) for end in worst_vertices(model, error, quantile)]
            # Where the error is blind to a component, the TCP error's worst vertex serves: one run instead of two.
            elsewhere = worst[name, "tcp"].vertex(model)
            vertices[name, error] = tuple(dict.fromkeys(tuple(sorted((elsewhere | end).items())) for end in ends))
    every = dict.fromkeys(vertex for several in vertices.values() for vertex in several)
    plans = {vertex: compile_plan(system, vertex=dict(vertex)) for vertex in every}
    return PreparedDesign(system, findings, trust_of(system, models), models, worst, vertices, plans)


def gather(asked: Iterable[Callable[[], T]]) -> list[T]:
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


def goals_of(ready: PreparedDesign, vertex: Vertex) -> list[Goal]:
    """Quantiles that must be precise in the run at this vertex: P95 and every requirement's own."""
    wanted = {(name, error, P95) for (name, error), at in ready.vertices.items() if vertex in at and error == "tcp"}
    for requirement in ready.system.requirements:
        for name in requirement.targets:
            if vertex in ready.vertices[name, requirement.error]:
                wanted.add((name, requirement.error, requirement.quantile))
    return [Goal(*goal) for goal in sorted(wanted)]


def confidence_of(system: System) -> float:
    return max((r.confidence for r in system.requirements), default=0.95)


def confidence_at_each(ready: PreparedDesign) -> float:
    """Confidence of an interval at one vertex with which the largest over all vertices of an error has its own."""
    return 1 - (1 - confidence_of(ready.system)) / max(len(several) for several in ready.vertices.values())


def lowest_quantile(system: System) -> float:
    return min([P95, *(r.quantile for r in system.requirements)])


def limits_of(system: System) -> tuple[float, ...]:
    """Of every metric, in the order of ``Samples.errors``: the limit that exceedance is reported for."""
    limits = [tightest_limit(system, target.name, error) for target in system.targets for error in FRAMES]
    return tuple(inf if limit is None else limit for limit in limits)


def questions_of(ready: PreparedDesign, vertex: Vertex, sampling: Sampling) -> tuple[Question, ...]:
    """What the run at this vertex has to decide: pooled requirements, and what was asked besides."""
    required = (
        Question(name, requirement.error, requirement.quantile, requirement.limit_mm)
        for requirement in ready.system.requirements
        for name in requirement.targets
        if requirement.risk == "pooled"
    )
    everything = dict.fromkeys((*required, *sampling.questions))
    return tuple(asked for asked in everything if vertex in ready.vertices[asked.target, asked.error])


def cvar_decided(ready: PreparedDesign, vertex: Vertex, sampling: Sampling, samples: Samples, looks: int) -> bool:
    for asked in sampling.cvar:
        if vertex not in ready.vertices[asked.target, "tcp"]:
            continue
        p95 = quantile_estimate(samples, asked.target, "tcp", P95).value_mm
        mean = cvar_estimate(samples, asked.target, "tcp", P95).value_mm
        worst = samples.of(asked.target, "tcp").worst
        interval = cvar_interval(p95, mean, worst, samples.trials, asked.confidence, looks)
        if decide(interval, asked.limit_mm) == "inconclusive":
            return False
    return True


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
    ready: PreparedDesign, sampling: Sampling, *, threads: int | None = None, progress: Progress | None = None,
    source: Sampler | None = None,
) -> Verification:  # fmt: skip
    """``verify`` of a design that was prepared, with parts from a source if there is one: the answer is the same.

    Raises OutOfRangeError, and Pending with everything that the source does not hold and this look needs.
    """
    run, own = run_all(ready, sampling, threads, progress, source)
    checks = _judge_requirements(ready, run, own)
    targets = tuple(_estimate_target(ready, run, target.name) for target in ready.system.targets)
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
        stopping=run.stopping + _explain_vertices(ready),
        targets=targets,
        reprojection=_reprojection(run),
        first_order_ratio=worst.first_order_ratio,
        verdict=conclude(checks, ready.findings + _remark_gaps(targets, ready.trust), "Monte Carlo"),
        provenance=provenance(ready.system, NOT_IN_A_CHECK),
    )


def _estimate_quantile(ready: PreparedDesign, run: Run, name: str, error: str, quantile: float) -> Quantile:
    if (name, error, quantile) in run.quantiles:
        return run.quantiles[name, error, quantile]
    at_each = (
        quantile_estimate(run.samples[vertex], name, error, quantile, run.confidence_level)
        for vertex in ready.vertices[name, error]
    )
    return take_largest(Quantile(found.value_mm, found.interval_mm) for found in at_each)


def _explain_vertices(ready: PreparedDesign) -> str:
    """A sentence where an error was sampled at several vertices."""
    if all(len(several) == 1 for several in ready.vertices.values()):
        return ""
    return (
        f" First order cannot tell which of several vertices of the bounded components is worst, so {len(ready.plans)} "
        "were run; of each number the largest is told."
    )


def _estimate_metric(ready: PreparedDesign, run: Run, name: str, error: str) -> MetricEstimate:
    """Bias, spread and mean norm at the vertex with the largest P95; of the tail's numbers each one's largest."""
    runs = [run.samples[vertex] for vertex in ready.vertices[name, error]]
    worst = max(runs, key=lambda samples: between_ranks(samples, name, error, P95, None, None)[0])
    sample = worst.of(name, error)
    found = _estimate_quantile(ready, run, name, error, P95)
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


def _estimate_target(ready: PreparedDesign, run: Run, name: str) -> TargetEstimate:
    metric = _estimate_metric(ready, run, name, "tcp")
    return TargetEstimate(
        name=name,
        frame=FRAMES["tcp"],
        **{field: getattr(metric, field) for field in MetricEstimate.__dataclass_fields__},
        confidence=confidence_of(ready.system),
        flagged_trials=max(run.samples[vertex].redone for vertex in ready.vertices[name, "tcp"]),
        first_order_p95_mm=metric.first_order_ratio * metric.p95_mm,
        localisation=_estimate_metric(ready, run, name, "localisation"),
    )


def _reprojection(run: Run) -> Reprojection:
    rms = next(iter(run.samples.values())).reprojection
    values = np.zeros(1) if rms is None else rms.rms_px
    return Reprojection(len(values), float(values.mean()), float(np.quantile(values, P95)))


def _judge_requirements(
    ready: PreparedDesign, run: Run, own: dict[tuple[Requirement, str], list[Array]]
) -> tuple[Check, ...]:
    checks = []
    for requirement in ready.system.requirements:
        for name in requirement.targets:
            if requirement.risk == "pooled":
                found = _estimate_quantile(ready, run, name, requirement.error, requirement.quantile)
                checks.append(judge(requirement, name, found.value_mm, found.interval_mm))
            else:
                checks.append(_judge_units(requirement, name, own[requirement, name]))
    return tuple(checks)


def _judge_units(requirement: Requirement, name: str, own: list[Array]) -> Check:
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


def _remark_gaps(targets: tuple[TargetEstimate, ...], trust: Validity) -> tuple[Finding, ...]:
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

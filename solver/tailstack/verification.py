"""The Monte Carlo check: the full nonlinear chain, quantiles with intervals, and the verdict they support.

The control of a check (when to look, when to stop) is deterministic: asked again with more parts at hand it comes to
the same questions.  Parts come from a :class:`Sampler`: drawn here, or put together from what was drawn elsewhere.  One
that lacks a part raises Pending with all that can be sampled side by side.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from math import ceil, inf, sqrt
from typing import Any, Literal, Protocol, TypeVar

import numpy as np

from .contributors import WorstCase, declared_law, mean_at, value_of, worst_case, worst_vertices
from .design import Design
from .errors import DesignError, OutOfRangeError, Problem
from .estimation.missed import probability_unanswered
from .geometry.arrays import Array
from .kernels.process import usable_cores
from .laws import Drawn
from .losses import LossSearch
from .measures import MEASURE, Metric
from .montecarlo import FINEST_PRECISION, MAX_TRIALS, MOST_TRIALS, PRECISION
from .montecarlo.chain import measure_trials, norms_of, run_indices
from .montecarlo.estimators import (
    QuantileEstimate,
    TrialsOfError,
    between_ranks,
    cvar_estimate,
    cvar_interval,
    enclosing_ranks,
    exceedance_estimate,
    interval_so_far,
    no_bound,
    quantile_estimate,
)
from .montecarlo.plan import ChainPlan, compile_plan
from .montecarlo.radial import RANDOMISATIONS, RAYS, LinearChain, RadialEstimate, gains_in_plan_order, radial
from .montecarlo.shards import Pending, Shard, TrialsTask, draw_shards
from .montecarlo.simulate import Progress, Run, Samples, Simulation
from .montecarlo.stopping import (
    CvarQuestion,
    Goal,
    LimitQuestion,
    precision_looks,
    simulate_to_decision,
    simulate_to_precision,
)
from .propagation.linear import ErrorModel, LinearModel, chain_of, linearise_all, models_of
from .results import (
    Check,
    DrawnLosses,
    Exceedance,
    Finding,
    MeasureResult,
    MetricEstimate,
    Reprojection,
    Severity,
    TargetEstimate,
    Validity,
    Verification,
)
from .results.digits import RESOLUTION_MM
from .results.quality import ppk_of
from .results.verdicts import BREACHES_MM, P95, UNBOUNDED, Breach
from .scoring import basis_of, checked_system, provenance, tightest_limit, trust_of, vector3
from .system import Requirement, System
from .tail.declared import MixedLaw, law_exceedance, law_quantile
from .verdict import conclude, decide, judge

UNITS = 2048  # of nested sampling of a per-unit requirement
FEWEST_SHOTS, MOST_SHOTS = 2**9, 2**15  # of each of them
NOISE_DOUBT = 1.1  # by how many times more than estimated a unit's quantile may scatter: three standard errors
BEYOND, FEWEST_BEYOND = 10, 2.5  # of a unit's shots, drawn beyond its quantile (it is told to 1 %), and at least (3 %)
TRIALS_PER_BATCH = 2**14  # of units, or those of one
MOST_DEVIATES = 2**23  # of all rays of a radial estimate: 64 MB
RADIAL_COMPANION_TRIALS = 2**15  # plain trials beside a radial run: moments, CVaR, worst
LANES = "structured resection, eight lanes (numba); trials without a proven solution redone by SVD"
LEAST_SQUARES_LANES = "Gauss-Newton for {}, eight lanes (numba); trials that did not converge are recomputed by QR"
GAP = 0.03  # first order further than this from the check is remarked

Method = Literal["plain", "radial"]
Key = tuple[str, str]  # target, error
Wanted = tuple[str, str, float]  # target, or the site of a measure that joins several; error; quantile
Vertex = tuple[tuple[str, float], ...]
T = TypeVar("T")


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
    ready: PreparedDesign,
    sampling: Sampling,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
    sampler: Sampler | None = None,
) -> Verification:
    """``verify`` of a design that was prepared, with parts from a sampler if one is given: the answer is the same.

    Raises OutOfRangeError, and Pending with everything that the sampler does not hold and this look needs.
    """
    work = Work(ready, sampling, LocalSampler(ready, threads) if sampler is None else sampler, threads, progress)
    both: list[Callable[[], Any]] = [partial(_sample, work), partial(_sample_units, work)]
    samples, own = gather(both)
    return _record(ready, sampling, samples, own)


# --- what is to be sampled -----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Sampling:
    """How a design is to be checked: see ``verify``.  Raises DesignError for trials and precision at once,
    OutOfRangeError for a precision that no affordable number of trials reaches, and for such a number."""

    trials: int | None = None
    precision: float | None = None
    seed: int = 0
    method: Method = "plain"
    max_trials: int = MAX_TRIALS
    sequential: bool = False  # only until every requirement and question is decided, not to a precision
    questions: tuple[LimitQuestion, ...] = ()  # to be decided beside the requirements; not asked where trials are given
    cvar: tuple[CvarQuestion, ...] = ()
    at_least: int = 0  # trials before which a check that draws to a precision does not stop
    units: int = UNITS  # drawn for a per-unit requirement, a power of two

    def __post_init__(self) -> None:
        if self.trials is not None and self.precision is not None:
            detail = "both trials and precision were given"
            raise DesignError(Problem("", "trials-and-precision", detail, "give one of them"))
        if self.precision is not None and not FINEST_PRECISION <= self.precision < 1:
            detail = f"precision must be at least {FINEST_PRECISION:g} and below 1; got {self.precision:g}"
            raise OutOfRangeError(Problem("/precision", "out-of-range", detail, "a finer one takes billions of trials"))
        for field, most in (("trials", self.trials or 0), ("max_trials", self.max_trials)):
            if most > MOST_TRIALS:
                detail = f"{field} must be at most {MOST_TRIALS}; got {most}"
                raise OutOfRangeError(Problem(f"/{field}", "out-of-range", detail, "ask for fewer, or for a precision"))


@dataclass(frozen=True, slots=True, eq=False)
class PreparedDesign:
    """What a check needs of the linear model: at which vertices to simulate, and what to compare with.

    Where first order cannot tell some vertices of the bounded components from the worst one (opposite ones without a
    bias), an error is sampled at each of them, the worst by first order first, and the worst of what is found is told.
    """

    system: System
    findings: tuple[Finding, ...]
    trust: Validity
    models: dict[str, LinearModel]  # by target
    every: dict[Key, ErrorModel]  # of every measure wherever it is read
    worst: dict[Key, WorstCase]
    vertices: dict[Key, tuple[Vertex, ...]]
    plans: dict[Vertex, ChainPlan]
    search: LossSearch | None  # where the design says how often fiducials are missed

    def law(self, name: str, error: str) -> MixedLaw:
        """What first order says of an error at a target over all shots, those with fiducials missed among them."""
        if self.search is not None and not MEASURE[error].paired:
            return self.search.law_of_simulation(name, error, P95)
        law = declared_law(self.every[name, error], error, self.worst[name, error].mean_mm)
        return MixedLaw((law,), np.ones(1))

    @property
    def first_order_mm(self) -> dict[str, float]:
        """By target, the P95 of the TCP error with which that of a simulation is compared."""
        return {target.name: self.law(target.name, "tcp").quantile(P95) for target in self.system.targets}

    @property
    def confidence(self) -> float:
        """The largest of the requirements'."""
        return max((requirement.confidence for requirement in self.system.requirements), default=0.95)

    @property
    def confidence_at_each(self) -> float:
        """Confidence of an interval at one vertex with which the largest over all vertices of an error has its own."""
        return 1 - (1 - self.confidence) / max(len(several) for several in self.vertices.values())

    @property
    def lowest_quantile(self) -> float:
        wanted = [P95, *(requirement.quantile for requirement in self.system.requirements)]
        for metric in self.system.derived_metrics:
            if metric.site.corridor_mm is not None:  # breaches are counted from the tail: with room, so that it serves
                wanted.append(1 - 1.5 * self.law(*metric.key).exceedance(metric.site.corridor_mm))
        return max(min(wanted), 0.0)

    @property
    def limits(self) -> tuple[float, ...]:
        """Of every metric, in the order of ``Samples.errors``: the limit that exceedance is reported for; inf: none."""
        limits = [tightest_limit(self.system, *metric.key) for metric in self.system.metrics]
        return tuple(inf if limit is None else limit for limit in limits)

    @property
    def quantiles(self) -> list[tuple[str, str, float]]:
        """(target, error, quantile) of everything that is told or limited."""
        wanted = {(name, error, P95) for name, error in self.vertices}
        wanted |= {(n, r.error, r.quantile) for r in self.system.requirements if r.is_quantile for n in r.targets}
        return sorted(wanted)


def prepare(design: Design | System, *, sampled: bool = True) -> PreparedDesign:
    """Linear model, worst vertex and compiled plan for every target and error; no plans if nothing is to be sampled.

    Raises DesignError, IllPosedError, and OutOfRangeError for a design that cannot be simulated.
    """
    system, findings, _ = checked_system(design)
    chain = chain_of(system)
    models = linearise_all(chain)
    every = models_of(system, models)
    worst = {(name, error): worst_case(model, error, P95) for (name, error), model in every.items()}
    vertices: dict[Key, tuple[Vertex, ...]] = {}
    for (name, error), model in every.items():
        limited = {r.quantile for r in system.requirements if r.error == error and name in r.targets}
        quantiles = (P95, *sorted(limited - {P95}))
        ends = [end for quantile in quantiles for end in worst_vertices(model, error, quantile)]
        for item in system.requirements:
            own = value_of(item) if item.error == error and name in item.targets else None
            ends += [] if own is None else worst_vertices(model, error, item.quantile, own)
        # Where the error is blind to a component, the TCP error's worst vertex serves: one run instead of two.
        elsewhere = worst.get((name, "tcp"), next(iter(worst.values()))).vertex(model)
        vertices[name, error] = tuple(dict.fromkeys(tuple(sorted((elsewhere | end).items())) for end in ends))
    wanted = dict.fromkeys(vertex for several in vertices.values() for vertex in several)
    plans = {vertex: compile_plan(system, vertex=dict(vertex)) for vertex in wanted if sampled}
    search = LossSearch(chain, models) if system.loss_probability else None
    return PreparedDesign(system, findings, trust_of(system, models), models, every, worst, vertices, plans, search)


@dataclass(frozen=True, slots=True, eq=False)
class UnitsTask:
    """Quantiles over the shots of each installed unit, or of each mounting, of errors at targets."""

    plan: ChainPlan  # with ``shots_for`` each quantile per unit, at the level
    seed: int
    wanted: tuple[Wanted, ...]
    units: int = UNITS
    level: Drawn = Drawn.UNIT  # what is read by itself
    told: Callable[[int], None] | None = None  # called after every part with its trials


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
    """Where the parts of a check come from.  Each may raise Pending for what is not there yet; ``verify_prepared`` is
    then called again once it is."""

    def shards(self, task: TrialsTask) -> Iterable[Shard]: ...
    def unit_quantiles(self, task: UnitsTask) -> Array: ...  # (task.units, W, 2) mm
    def radial(self, task: RadialTask) -> RadialEstimate: ...


@dataclass(frozen=True, slots=True)
class LocalSampler:
    """Every part drawn here and now."""

    ready: PreparedDesign
    threads: int | None

    @property
    def workers(self) -> int:
        return usable_cores() if self.threads is None else self.threads

    def shards(self, task: TrialsTask) -> Iterable[Shard]:
        return draw_shards(task, self.workers)

    def unit_quantiles(self, task: UnitsTask) -> Array:
        shots = task.plan.shots_per_unit
        count = max(TRIALS_PER_BATCH // shots, 1)
        parts = []
        with ThreadPoolExecutor(self.workers) as pool:
            for part in pool.map(lambda first: unit_quantiles(task, first, count), range(0, task.units, count)):
                parts.append(part)
                if task.told:
                    task.told(count * shots)
        return np.concatenate(parts)

    def radial(self, task: RadialTask) -> RadialEstimate:
        return radial_estimate(self.ready, task)


def shots_for(quantile: float) -> int:
    """How many shots of each unit tell where that quantile of it lies: a power of two, at most ``MOST_SHOTS``."""
    shots = FEWEST_SHOTS
    while shots * (1 - quantile) < BEYOND and shots < MOST_SHOTS:
        shots *= 2
    return shots


def unit_quantiles(task: UnitsTask, first: int, count: int) -> Array:
    """(count, W, 2) mm: each wanted quantile over its shots of each of the units ``first`` ... ``first + count - 1``,
    and by how much those of the two halves of its shots differ."""
    drawn = task.plan.shots_per_unit
    outcome = run_indices(task.plan, task.seed, first * drawn, count * drawn)
    errors = measure_trials(task.plan, task.seed, first * drawn, outcome.errors)
    every = {each.key: (errors[k], each.site) for k, each in enumerate(task.plan.system.metrics)}

    def read(target: str, error: str, quantile: float) -> Array:
        found, site = every[target, error]
        norms = norms_of(found, site.is_one_sided).reshape(count, drawn)
        halves = norms[:, : drawn // 2], norms[:, drawn // 2 :]
        ranks = ((shots, ceil(shots.shape[1] * quantile) - 1) for shots in (norms, *halves))
        whole, first_half, second_half = (np.partition(shots, rank, axis=1)[:, rank] for shots, rank in ranks)
        with np.errstate(invalid="ignore"):  # both may be without an answer
            return np.column_stack([whole, first_half - second_half])

    return np.stack([read(*wanted) for wanted in task.wanted], axis=1)


def radial_estimate(ready: PreparedDesign, task: RadialTask) -> RadialEstimate:
    """One quantile by radial conditional sampling, with the linear model as its control.  Raises OutOfRangeError."""
    system, plan, key = ready.system, ready.plans[task.vertex], (task.target, task.error)
    names, model = [target.name for target in system.targets], ready.every[key]
    metric = next(k for k, each in enumerate(system.metrics) if each.key == key)
    if MEASURE[task.error].paired or MEASURE[task.error].side:
        number = "one side of a number" if MEASURE[task.error].side else "the length of the longer of two vectors"
        detail = f"{MEASURE[task.error].words} is {number}, which no ray shows"
        raise OutOfRangeError(Problem("", "radial-pair", detail, "use plain sampling for this design"))
    if system.metrics[metric].site.other_shot:
        detail = f"{MEASURE[task.error].words} is of two shots, and rays are of one"
        raise OutOfRangeError(Problem("", "radial-pair", detail, "use plain sampling for this design"))
    targets = [names.index(name) for name in system.metrics[metric].site.weights]
    mean = mean_at(model, task.error, dict(task.vertex))
    law = declared_law(model, task.error, mean)
    first = law_quantile(law, task.quantile)
    linear = LinearChain(
        mean=mean,
        gain=gains_in_plan_order(plan, model.blocks, targets, task.error),
        exceedance=partial(law_exceedance, law),
        quantile_mm=first.quantile_mm,
        density_per_mm=first.density,
    )
    rays, most = RAYS, MOST_DEVIATES // (RANDOMISATIONS * plan.dimension)
    while True:
        estimate = radial(
            plan,
            linear,
            metric=metric,
            quantile=task.quantile,
            seed=task.seed,
            confidence=ready.confidence_at_each,
            rays=rays,
        )
        if task.precision is None or estimate.quantile.relative_half_width <= task.precision or 4 * rays > most:
            return estimate
        rays *= 4


# --- sampling ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class SampledDesign:
    """Finished sampling: a plain run for each distinct vertex, and how the quantiles were estimated."""

    samples: dict[Vertex, Samples]
    confidence_level: float  # used for each interval, so that all looks together hold with the stated one
    stopping: str
    precision_reached: float
    quantiles: Quantiles  # that were found otherwise than from ``confidence_level``
    look_level: float | None = None  # of the interval that a requirement is judged by; None: ``confidence_level``


Quantiles = dict[tuple[str, str, float], QuantileEstimate]  # by target, error and quantile
UnitQuantiles = dict[tuple[Requirement, str], list[Array]]  # (units, 2) mm at each vertex, by requirement and target


@dataclass(frozen=True, slots=True, eq=False)
class Work:
    """A check under way."""

    ready: PreparedDesign
    sampling: Sampling
    sampler: Sampler
    threads: int | None
    progress: Progress | None

    def simulation(self, vertex: Vertex) -> Simulation:
        """The plain trials at one vertex."""
        return Simulation(
            plan=self.ready.plans[vertex],
            seed=self.sampling.seed,
            quantile=self.ready.lowest_quantile,
            limits=self.ready.limits,
            reprojection=True,
            threads=self.threads,
            progress=self.progress,
            sampler=self.sampler.shards,
        )

    def simulate(self, trials: int) -> dict[Vertex, Samples]:
        """So many plain trials at every vertex."""
        runs = [partial(Run(self.simulation(vertex)).grow, trials) for vertex in self.ready.plans]
        return dict(zip(self.ready.plans, gather(runs), strict=True))


def gather(calls: Iterable[Callable[[], T]]) -> list[T]:
    """What every call returns; where one has to wait the others are made too, so that all wait together."""
    results: list[T] = []
    missing: list[Pending] = []
    for call in calls:
        try:
            results.append(call())
        except Pending as pending:
            missing.append(pending)
    if missing:
        wanted = [part for pending in missing for part in pending.wanted]
        raise Pending(wanted, sum(pending.remaining for pending in missing))
    return results


def _sample(work: Work) -> SampledDesign:
    if work.sampling.method == "radial":
        return _sample_radially(work)
    if work.sampling.trials is not None:
        return _sample_trials(work, work.sampling.trials)
    return _sample_to_decision(work) if work.sampling.sequential else _sample_to_precision(work)


def _sample_trials(work: Work, trials: int) -> SampledDesign:
    ready, level = work.ready, work.ready.confidence_at_each
    samples = work.simulate(trials)
    reached = max(
        quantile_estimate(sample, goal.target, goal.error, goal.quantile, level).relative_half_width
        for vertex, sample in samples.items()
        for goal in _goals(ready, vertex)
    )
    return SampledDesign(samples, level, f"Stopped after the {trials} trials asked for.", reached, {})


def _sample_to_precision(work: Work) -> SampledDesign:
    ready, sampling, confidence = work.ready, work.sampling, work.ready.confidence_at_each

    def is_settled(vertex: Vertex, samples: Samples, level: float) -> bool:
        """No pooled requirement and no question is open any more, and as many are drawn as were asked for."""
        if samples.trials < sampling.at_least:
            return False
        for q in _questions(ready, vertex, sampling):
            interval = quantile_estimate(samples, q.target, q.error, q.quantile, level).interval_mm
            if decide(interval, q.limit_mm) == "inconclusive":
                return False
        return _decides_means(ready, vertex, sampling, samples, len(precision_looks(sampling.max_trials)))

    runs = gather(
        partial(
            simulate_to_precision,
            work.simulation(vertex),
            precision=sampling.precision or PRECISION,
            goals=_goals(ready, vertex) or [Goal(0, "tcp", P95)],
            confidence=confidence,
            max_trials=sampling.max_trials,
            settled=partial(is_settled, vertex),
        )
        for vertex in ready.plans
    )
    reached = max(run.precision_reached for run in runs)
    samples = {vertex: run.samples for vertex, run in zip(ready.plans, runs, strict=True)}
    return SampledDesign(samples, runs[0].level, runs[-1].stopping, reached, {})


def _sample_to_decision(work: Work) -> SampledDesign:
    ready, sampling, confidence = work.ready, work.sampling, work.ready.confidence_at_each
    runs = gather(
        partial(
            simulate_to_decision,
            work.simulation(vertex),
            _questions(ready, vertex, sampling),
            confidence=confidence,
            max_trials=sampling.max_trials,
            settled=partial(_decides_means, ready, vertex, sampling),
        )
        for vertex in ready.plans
    )
    by_vertex = dict(zip(ready.plans, runs, strict=True))
    quantiles: Quantiles = {}
    for name, error, quantile in ready.quantiles:
        at = (by_vertex[vertex] for vertex in ready.vertices[name, error])
        each = (interval_so_far(run.samples, name, error, quantile, run.level) for run in at)
        quantiles[name, error, quantile] = take_largest(each)
    reached = max(found.relative_half_width for key, found in quantiles.items() if key[1:] == ("tcp", P95))
    longest = max(runs, key=lambda run: run.samples.trials)
    reason = "every limit is decided" if all(run.decided for run in runs) else "the cap was reached"
    stopping = (
        f"Stopped after {longest.samples.trials} trials because {reason}: a sequential test with up to "
        f"{len(longest.looks)} looks, each limit of a quantile decided wrongly with a probability of at most "
        f"{(1 - ready.confidence) / 2:.3g} on either side, over all looks."
    )
    samples = {vertex: run.samples for vertex, run in by_vertex.items()}
    return SampledDesign(samples, confidence, stopping, reached, quantiles, runs[0].level)


def _sample_radially(work: Work) -> SampledDesign:
    ready, sampling = work.ready, work.sampling
    tasks = [
        RadialTask(name, error, quantile, sampling.seed, vertex, sampling.precision)
        for name, error, quantile in ready.quantiles
        for vertex in ready.vertices[name, error]
    ]
    trials = RADIAL_COMPANION_TRIALS if sampling.trials is None else sampling.trials
    radially = [partial(work.sampler.radial, task) for task in tasks]
    both: list[Callable[[], Any]] = [partial(work.simulate, trials), partial(gather, radially)]
    samples, estimates = gather(both)
    at_each: dict[tuple[str, str, float], list[QuantileEstimate]] = {}
    for task, estimate in zip(tasks, estimates, strict=True):
        at_each.setdefault((task.target, task.error, task.quantile), []).append(estimate.quantile)
    quantiles = {key: take_largest(several) for key, several in at_each.items()}
    reached = max(found.relative_half_width for found in quantiles.values())
    short = ""
    if sampling.precision is not None and reached > sampling.precision:
        short = f", as many as are drawn, short of the ±{100 * sampling.precision:g} % requested"
    stopping = (
        f"Quantiles by radial conditional sampling with {sum(estimate.evaluations for estimate in estimates)} "
        f"evaluations of the chain{short}; moments, CVaR, worst case and exceedance from {trials} plain trials."
    )
    return SampledDesign(samples, ready.confidence_at_each, stopping, reached, quantiles)


def _sample_units(work: Work) -> UnitQuantiles:
    """Where a requirement is on each unit, or on each mounting: whatever is of the same shots is read off them."""
    ready, units, seed = work.ready, work.sampling.units, work.sampling.seed
    at_each = [
        ((requirement, name), (vertex, level, shots_for(requirement.quantile)))
        for requirement in ready.system.requirements
        if (level := requirement.level)
        for name in requirement.targets
        for vertex in ready.vertices[name, requirement.error]
    ]
    wanted: dict[tuple[Vertex, Drawn, int], dict[Wanted, None]] = {}
    for (requirement, name), shots in at_each:
        wanted.setdefault(shots, {})[name, requirement.error, requirement.quantile] = None
    done = 0

    def tell(trials: int) -> None:
        nonlocal done
        done += trials
        if work.progress:
            work.progress(done, sum(units * shots for _, _, shots in wanted))

    plans = [
        compile_plan(ready.system, vertex=dict(vertex), shots_per_unit=shots, held=level)
        for vertex, level, shots in wanted
    ]
    tasks = [
        UnitsTask(plan, seed, tuple(each), units, level, tell)
        for plan, ((_, level, _), each) in zip(plans, wanted.items(), strict=True)
    ]
    found = dict(zip(wanted, gather(partial(work.sampler.unit_quantiles, task) for task in tasks), strict=True))
    own: UnitQuantiles = {}
    for (requirement, name), shots in at_each:
        place = list(wanted[shots]).index((name, requirement.error, requirement.quantile))
        own.setdefault((requirement, name), []).append(found[shots][:, place])
    return own


def _goals(ready: PreparedDesign, vertex: Vertex) -> list[Goal]:
    """Quantiles that must be precise in the run at this vertex: P95 and that of every requirement on all shots."""
    wanted = {(name, error, P95) for (name, error), at in ready.vertices.items() if vertex in at and error == "tcp"}
    for requirement in ready.system.requirements:
        for name in requirement.targets if requirement.is_quantile and not requirement.level else ():
            if vertex in ready.vertices[name, requirement.error]:
                wanted.add((name, requirement.error, requirement.quantile))
    return [Goal(*goal) for goal in sorted(wanted)]


def _questions(ready: PreparedDesign, vertex: Vertex, sampling: Sampling) -> tuple[LimitQuestion, ...]:
    """What the run at this vertex has to decide: pooled requirements, and what was asked besides."""
    required = (
        LimitQuestion(name, requirement.error, requirement.quantile, requirement.limit)
        for requirement in ready.system.requirements
        for name in requirement.targets
        if requirement.risk == "pooled" and requirement.row.by_quantile
    )
    every = dict.fromkeys((*required, *sampling.questions))
    return tuple(question for question in every if vertex in ready.vertices[question.target, question.error])


def _decides_means(ready: PreparedDesign, vertex: Vertex, sampling: Sampling, samples: Samples, looks: int) -> bool:
    """Whether no requirement on what no quantile decides is open, and no question about a mean."""
    level = 1 - (1 - ready.confidence_at_each) / looks
    for item in ready.system.requirements:
        for name in () if item.row.by_quantile else item.targets:
            if vertex in ready.vertices[name, item.error]:
                found = estimate_statistic(item, TrialsOfError(samples, name, item.error, level))
                if _stays_open(found, item.limit):
                    return False
    for question in sampling.cvar:
        if vertex not in ready.vertices[question.target, "tcp"]:
            continue
        p95 = quantile_estimate(samples, question.target, "tcp", P95).value_mm
        mean = cvar_estimate(samples, question.target, "tcp", P95)
        worst = samples.of(question.target, "tcp").worst
        drawn = samples.trials, question.confidence, looks, samples.has_open_means
        interval = cvar_interval(p95, mean, worst, *drawn)
        if _stays_open(QuantileEstimate(mean, interval), question.limit_mm):
            return False
    return True


def _stays_open(found: QuantileEstimate, limit: float) -> bool:
    """Whether more trials may decide what these do not: a mean without an upper end can only be seen to fail."""
    may_end = found.interval_mm[1] < inf or found.value_mm > limit
    return decide(found.interval_mm, limit) == "inconclusive" and may_end


def estimate_statistic(requirement: Requirement, trials: TrialsOfError) -> QuantileEstimate:
    """What trials say of a requirement on what is no quantile."""
    assert requirement.row.of_trials is not None
    return QuantileEstimate(*requirement.row.of_trials(trials, requirement.quantile, requirement.limit))


def take_largest(quantiles: Iterable[QuantileEstimate]) -> QuantileEstimate:
    """The largest of a quantile at several vertices, with its interval: each end is the largest of theirs."""
    value, low, high = zip(*((quantile.value_mm, *quantile.interval_mm) for quantile in quantiles), strict=True)
    return QuantileEstimate(max(value), (max(low), max(high)))


# --- what was found ------------------------------------------------------------------------------------------------


def _record(ready: PreparedDesign, sampling: Sampling, sampled: SampledDesign, own: UnitQuantiles) -> Verification:
    _refuse_without_bound(ready, sampled, own)
    checks = _judge_requirements(ready, sampled, own)
    drawn = _count_losses(ready, sampled)
    targets = tuple(_estimate_target(ready, sampled, target.name) for target in ready.system.targets)
    worst = max(targets, key=lambda target: target.p95_mm)
    plain = sampling.trials is None and sampling.method == "plain" and not sampling.sequential
    basis = basis_of("Monte Carlo", ready.system)
    radial_precision = sampling.precision if sampling.method == "radial" else None
    first, traits = next(iter(sampled.samples.values())).reprojection_px, ready.system.estimator.traits
    off_px = np.zeros(1) if first is None else first
    return Verification(
        schema="tailstack/verification/1",
        seed=sampling.seed,
        trials=max(sample.trials for sample in sampled.samples.values()),
        method=sampling.method,
        engine=LEAST_SQUARES_LANES.format(traits.seeks) if traits.unknowns else LANES,
        precision_requested=sampling.precision or PRECISION if plain else radial_precision,
        max_trials=sampling.max_trials if plain else None,
        precision_reached=sampled.precision_reached,
        stopping=sampled.stopping + _explain_vertices(ready) + _say_units(ready, sampling.units),
        targets=targets,
        reprojection=Reprojection(len(off_px), float(off_px.mean()), float(np.quantile(off_px, P95))),
        first_order_ratio=worst.first_order_ratio,
        verdict=conclude(checks, ready.findings + _remark_losses(drawn) + _remark_gaps(targets), basis),
        provenance=provenance(ready.system, simulated=True, missed=drawn is not None),
        losses=drawn,
        measures=tuple(_estimate_measure(ready, sampled, each) for each in ready.system.derived_metrics),
    )


def _refuse_without_bound(ready: PreparedDesign, sampled: SampledDesign, own: UnitQuantiles) -> None:
    """Where so many shots have no answer that a number of the record would be infinite.  Raises IllPosedError."""
    samples = max(sampled.samples.values(), key=lambda each: each.unanswered / each.trials)
    if not samples.unanswered:
        return
    for name, error, quantile in ready.quantiles:
        estimate = _estimate_quantile(ready, sampled, name, error, quantile)
        if estimate.interval_mm[1] == inf:
            what = f"that {100 * quantile:g} % of shots keep for sure"
            raise no_bound(samples.unanswered, samples.trials, what)
    for (requirement, _), at_each in own.items():
        fraction = requirement.units_fraction or P95
        if any(np.quantile(units[:, 0], fraction, method="higher") == inf for units in at_each):
            keepers = (requirement.level or Drawn.UNIT).plural
            raise no_bound(samples.unanswered, samples.trials, f"that {keepers} keep in {requirement.name}")


def _count_losses(ready: PreparedDesign, sampled: SampledDesign) -> DrawnLosses | None:
    if not ready.system.loss_probability:
        return None
    # the same shots miss the same fiducials at every vertex
    longest = max(sampled.samples.values(), key=lambda each: each.trials)
    probability = probability_unanswered(ready.system)
    return DrawnLosses(longest.trials, longest.missed, longest.unanswered, probability, longest.has_open_means)


def _remark_losses(drawn: DrawnLosses | None) -> tuple[Finding, ...]:
    """What shots with fiducials missed are in the numbers of a check."""
    if drawn is None:
        return ()
    share = drawn.trials_with_losses / drawn.trials
    message = (
        f"in {share:.2%} of the shots drawn a fiducial or more is missed, as often as the design says; quantiles, "
        "exceedance and verdict are of all shots"
    )
    if drawn.trials_without_answer:
        message += (
            f". {drawn.trials_without_answer} of {drawn.trials} miss so many that what is left has no answer: they "
            "count as beyond every limit, and bias, spread, mean, the mean of the worst 5 % and the largest error are "
            "of the others"
        )
    severity: Severity = "warning" if drawn.trials_without_answer else "note"
    unanswered = drawn.trials_without_answer / drawn.trials
    return (Finding("missed-fiducials", severity, message, "/fiducials/loss_probability", unanswered),)


def _estimate_quantile(
    ready: PreparedDesign, sampled: SampledDesign, name: str, error: str, quantile: float
) -> QuantileEstimate:
    if (name, error, quantile) in sampled.quantiles:
        return sampled.quantiles[name, error, quantile]
    runs = (sampled.samples[vertex] for vertex in ready.vertices[name, error])
    return take_largest(quantile_estimate(run, name, error, quantile, sampled.confidence_level) for run in runs)


def _explain_vertices(ready: PreparedDesign) -> str:
    """A sentence where an error was sampled at several vertices."""
    if all(len(several) == 1 for several in ready.vertices.values()):
        return ""
    return (
        f" First order cannot tell which of several vertices of the bounded components is worst, so {len(ready.plans)} "
        "were run; of each number the largest is told."
    )


def _say_units(ready: PreparedDesign, units: int) -> str:
    """How many units or mountings were drawn for limits on each, and shots of it."""
    limits = [(each.level.plural, shots_for(each.quantile)) for each in ready.system.requirements if each.level]
    return "".join(
        f" Besides, {units:,} {plural} of {shots:,} shots each were drawn." for plural, shots in dict.fromkeys(limits)
    )


def _estimate_metric(ready: PreparedDesign, sampled: SampledDesign, name: str, error: str) -> MetricEstimate:
    """Bias, spread and mean norm at the vertex with the largest P95; of the tail's numbers each one's largest."""
    runs = [sampled.samples[vertex] for vertex in ready.vertices[name, error]]
    worst = max(runs, key=lambda samples: between_ranks(samples, name, error, P95, None, None).value_mm)
    sample = worst.of(name, error)
    quantile = _estimate_quantile(ready, sampled, name, error, P95)
    limit = tightest_limit(ready.system, name, error)
    beyond = None
    if limit is not None:
        level = ready.confidence_at_each
        above = [exceedance_estimate(samples, name, error, limit, level) for samples in runs]
        low, high = zip(*(exceedance.interval for exceedance in above), strict=True)
        beyond = Exceedance(limit, max(exceedance.probability for exceedance in above), (max(low), max(high)))
    first_mm = ready.law(name, error).quantile(P95)
    if first_mm == inf:
        raise no_bound(worst.unanswered, worst.trials, "by estimate")
    nothing = max(first_mm, quantile.value_mm) < RESOLUTION_MM or not quantile.value_mm
    return MetricEstimate(
        bias_mm=vector3(sample.mean),
        std_mm=vector3(np.sqrt(np.diag(sample.covariance))),
        mean_norm_mm=sample.mean_norm,
        p95_mm=quantile.value_mm,
        p95_interval_mm=quantile.interval_mm,
        cvar95_mm=max(cvar_estimate(samples, name, error, P95) for samples in runs),
        worst_mm=max(samples.of(name, error).worst for samples in runs),
        exceedance=beyond,
        first_order_ratio=1.0 if nothing else first_mm / quantile.value_mm,
    )


def _estimate_target(ready: PreparedDesign, sampled: SampledDesign, name: str) -> TargetEstimate:
    metric = _estimate_metric(ready, sampled, name, "tcp")
    return TargetEstimate(
        name=name,
        frame=MEASURE["tcp"].frame,
        **{field: getattr(metric, field) for field in MetricEstimate.__dataclass_fields__},
        confidence=ready.confidence,
        flagged_trials=max(sampled.samples[vertex].redone for vertex in ready.vertices[name, "tcp"]),
        first_order_p95_mm=metric.first_order_ratio * metric.p95_mm,
        localisation=_estimate_metric(ready, sampled, name, "localisation"),
    )


def _estimate_measure(ready: PreparedDesign, sampled: SampledDesign, metric: Metric) -> MeasureResult:
    found = _estimate_metric(ready, sampled, *metric.key)
    return MeasureResult(
        measure=metric.measure.name,
        site=metric.site.name,
        words=metric.measure.words,
        unit=metric.measure.unit,
        known=found.bias_mm[0] if metric.site.is_one_sided else float(np.linalg.norm(found.bias_mm)),
        mean=found.mean_norm_mm,
        p95=found.p95_mm,
        p95_interval=found.p95_interval_mm,
        cvar95=found.cvar95_mm,
        limit=None if found.exceedance is None else found.exceedance.limit_mm,
        exceedance_probability=None if found.exceedance is None else found.exceedance.probability,
        breaches=() if metric.site.corridor_mm is None else _count_breaches(ready, sampled, metric),
        ppk=ppk_of(found.exceedance.limit_mm, found.bias_mm[0], found.std_mm[0], metric.site.is_one_sided)
        if metric.site.is_scalar and found.exceedance is not None
        else None,
    )


def _count_breaches(ready: PreparedDesign, sampled: SampledDesign, metric: Metric) -> tuple[Breach, ...]:
    """At the vertex that has most of them."""
    found, corridor_mm = [], metric.site.corridor_mm or 0.0
    for beyond_mm in BREACHES_MM:
        each = [
            exceedance_estimate(sampled.samples[vertex], *metric.key, corridor_mm + beyond_mm)
            for vertex in ready.vertices[metric.key]
        ]
        most = max(each, key=lambda exceedance: exceedance.probability)
        found.append(Breach(beyond_mm, most.probability, most.interval))
    return tuple(found)


def _judge_requirements(ready: PreparedDesign, sampled: SampledDesign, own: UnitQuantiles) -> tuple[Check, ...]:
    checks, missed = [], bool(ready.system.loss_probability)
    for requirement in ready.system.requirements:
        for name in requirement.targets:
            if not requirement.is_quantile:
                level = sampled.look_level or sampled.confidence_level
                each = (sampled.samples[vertex] for vertex in ready.vertices[name, requirement.error])
                trials = (TrialsOfError(samples, name, requirement.error, level) for samples in each)
                largest = take_largest(estimate_statistic(requirement, of) for of in trials)
                why = UNBOUNDED if largest.interval_mm[1] == inf else ""
                value, interval = largest
                checks.append(judge(requirement, name, value, interval, missed=missed, open_because=why))
            elif requirement.risk == "pooled":
                estimate = _estimate_quantile(ready, sampled, name, requirement.error, requirement.quantile)
                checks.append(judge(requirement, name, estimate.value_mm, estimate.interval_mm, missed=missed))
            else:
                surely = _keeps_surely(ready, sampled, requirement, name)
                checks.append(_judge_units(requirement, name, own[requirement, name], missed, surely))
    return tuple(checks)


def _keeps_surely(ready: PreparedDesign, sampled: SampledDesign, requirement: Requirement, name: str) -> bool:
    """Whether so few of all shots are beyond the limit that hardly a unit can have more of them than it may.

    If more than a share 1 - f of units had more than 1 - p of their shots beyond it, more than (1 - f) (1 - p) of all
    shots were (Markov).
    """
    allowed = (1 - (requirement.units_fraction or 1.0)) * (1 - requirement.quantile)
    for vertex in ready.vertices[name, requirement.error]:
        samples = sampled.samples[vertex]
        if samples.of(name, requirement.error).tail[0] > requirement.limit:  # of the largest that are kept
            return False
        found = exceedance_estimate(samples, name, requirement.error, requirement.limit, requirement.confidence)
        if found.interval[1] > allowed:
            return False
    return True


def _judge_units(requirement: Requirement, name: str, own: list[Array], missed: bool, surely: bool) -> Check:
    """Nested sampling at each vertex of installed units, or of mountings, each of its own shots; the worst is told.

    The quantile over units of the unit's own quantile, by order statistics, at the fraction of units that must keep
    the limit.  Its interval is that of a binomial law of units (Clopper and Pearson's of the yield, read backwards).
    A unit's quantile is itself estimated from its shots, which spreads units: the value and the yield are of quantiles
    narrowed by that (``_narrow``), the interval is that of both, wide and narrow.  A quantile that so few shots do not
    reach is open, unless all shots together decide it (``surely``).
    """
    fraction = requirement.units_fraction
    assert fraction is not None  # or the requirement would be pooled
    drawn = len(own[0])
    low, high = enclosing_ranks(drawn, fraction, 1 - (1 - requirement.confidence) / len(own))
    narrow = [_narrow(units) for units in own]
    # Where most units have to keep it, estimates that scatter make it larger than it is, else smaller.
    towards = -0.5 if fraction >= 0.5 else 0.5  # of a standard error of a unit's, which one rank of its shots comes to
    wide = [np.sort(units[:, 0]) for units in own]
    widths = wide, [_narrow(units, NOISE_DOUBT) + towards * sqrt(_noise_of(units)) for units in own]

    def largest(at_each: list[Array], rank: int) -> float:
        return max(float(ordered[rank - 1]) for ordered in at_each)

    lowest = 0.0 if low is None else min(largest(each, low) for each in widths)
    ends = (lowest, inf if high is None else max(largest(each, high) for each in widths))
    why = ""
    shots = shots_for(requirement.quantile)
    if shots * (1 - requirement.quantile) < FEWEST_BEYOND:
        level = requirement.level or Drawn.UNIT
        ends = (lowest, max(requirement.limit, lowest) if surely else inf)
        if not surely:
            why = (
                f"{shots} shots are drawn of each {level}, too few for its P{100 * requirement.quantile:.6g}; limit a "
                "lower quantile, or all shots together (risk: pooled)"
            )
    met = min(int((ordered <= requirement.limit).sum()) for ordered in narrow)
    value = max(lowest, min(largest(narrow, ceil(drawn * fraction)), ends[1]))
    return judge(requirement, name, value, ends, met / drawn, missed=missed, open_because=why)


def _narrow(units: Array, times: float = 1.0) -> Array:
    """(U,) ascending, of quantiles (U, 2) as ``unit_quantiles`` has them: as far from their mean as those of the units
    themselves are.

    An estimate from all shots of a unit has a quarter of the variance by which those of its halves differ; that is
    taken out of the variance over units (a constrained empirical Bayes estimate: Louis 1984), so many times.
    """
    values = np.sort(units[:, 0])
    noise = times * _noise_of(units)
    if not noise:
        return values
    middle = float(np.mean(values))
    return middle + sqrt(max(1 - noise / float(np.var(values)), 0.0)) * (values - middle)


def _noise_of(units: Array) -> float:
    """Mean variance, mm^2, of the quantiles as estimates; 0 where some unit has none."""
    return float(np.mean(units[:, 1] ** 2)) / 4 if np.isfinite(units).all() else 0.0


def _remark_gaps(targets: tuple[TargetEstimate, ...]) -> tuple[Finding, ...]:
    """Where first order and the check disagree, and which way."""
    remarks = []
    for target in targets:
        low, high = (target.first_order_p95_mm / end for end in reversed(target.p95_interval_mm))
        if high < 1 - GAP or low > 1 + GAP:
            way = "too small" if high < 1 else "too large"
            message = (
                f"target {target.name}: the estimate of `tailstack score` is {way} here: its P95 is "
                f"{target.first_order_ratio:.3g} times the simulated one"
            )
            remarks.append(Finding("first-order-gap", "warning", message, value=target.first_order_ratio, limit=1.0))
    return tuple(remarks)

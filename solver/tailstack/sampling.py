"""What is asked of a check, what it needs of the design, and where sampled parts come from."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import inf
from typing import Literal, Protocol, TypeVar

from .contributors import WorstCase, worst_case, worst_vertices
from .design import Design
from .errors import DesignError, OutOfRangeError, Problem
from .montecarlo import ChainPlan, compile_plan
from .montecarlo.estimators import Goal, cvar_estimate, quantile_estimate
from .montecarlo.radial import RadialEstimate
from .montecarlo.sequential import CvarQuestion, Question, cvar_interval
from .montecarlo.shards import Pending, Shard, Wanted
from .montecarlo.simulate import Samples
from .precision import FINEST_PRECISION
from .propagation.linear import LinearModel, linearise
from .results import Finding, Interval, Validity
from .scoring import FRAMES, P95, checked_system, tightest_limit, trust_of
from .system import Array, System
from .verdict import decide

MAX_TRIALS = 2**22
UNITS, SHOTS = 2048, 512  # nested sampling of a per-unit requirement
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
    """A quantile by radial conditional sampling at one vertex."""

    target: str
    error: str
    quantile: float
    seed: int
    vertex: Vertex = ()
    precision: float | None = None  # relative half-width of its interval; None: that of the fewest rays


class Source(Protocol):
    """Where sampled parts come from that were computed elsewhere.  Each may raise Pending for what is not there yet;
    ``verify`` is then asked again once it is."""

    def shards(self, wanted: Wanted) -> Iterable[Shard]: ...
    def unit_quantiles(self, wanted: UnitsWanted) -> Array: ...  # (UNITS,) mm
    def radial(self, wanted: RadialWanted) -> RadialEstimate: ...


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
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


def largest(found: Iterable[Quantile]) -> Quantile:
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


def prepare(design: Design | System) -> Prepared:
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
    return Prepared(system, findings, trust_of(system, models), models, worst, vertices, plans)


def together(asked: Iterable[Callable[[], T]]) -> list[T]:
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


def goals_of(ready: Prepared, vertex: Vertex) -> list[Goal]:
    """Quantiles that must be precise in the run at this vertex: P95 and every requirement's own."""
    wanted = {(name, error, P95) for (name, error), at in ready.vertices.items() if vertex in at and error == "tcp"}
    for requirement in ready.system.requirements:
        for name in requirement.targets:
            if vertex in ready.vertices[name, requirement.error]:
                wanted.add((name, requirement.error, requirement.quantile))
    return [Goal(*goal) for goal in sorted(wanted)]


def confidence_of(system: System) -> float:
    return max((r.confidence for r in system.requirements), default=0.95)


def confidence_at_each(ready: Prepared) -> float:
    """Confidence of an interval at one vertex with which the largest over all vertices of an error has its own."""
    return 1 - (1 - confidence_of(ready.system)) / max(len(several) for several in ready.vertices.values())


def lowest_quantile(system: System) -> float:
    return min([P95, *(r.quantile for r in system.requirements)])


def limits_of(system: System) -> tuple[float, ...]:
    """Of every metric, in the order of ``Samples.errors``: the limit that exceedance is reported for."""
    limits = [tightest_limit(system, target.name, error) for target in system.targets for error in FRAMES]
    return tuple(inf if limit is None else limit for limit in limits)


def questions_of(ready: Prepared, vertex: Vertex, sampling: Sampling) -> tuple[Question, ...]:
    """What the run at this vertex has to decide: pooled requirements, and what was asked besides."""
    required = (
        Question(name, requirement.error, requirement.quantile, requirement.limit_mm)
        for requirement in ready.system.requirements
        for name in requirement.targets
        if requirement.risk == "pooled"
    )
    everything = dict.fromkeys((*required, *sampling.questions))
    return tuple(asked for asked in everything if vertex in ready.vertices[asked.target, asked.error])


def cvar_decided(ready: Prepared, vertex: Vertex, sampling: Sampling, samples: Samples, looks: int) -> bool:
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

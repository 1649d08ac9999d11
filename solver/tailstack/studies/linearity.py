"""Where first order holds for a design: a grid of noise, rotation, spread and count against Monte Carlo.

At a point of the grid the design is changed; its first order is compared with Monte Carlo on the same deviates.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from itertools import product
from math import exp, log, prod, radians, sqrt
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from ..contributors import error_law
from ..design import Design
from ..errors import OutOfRangeError, Problem, StudyError, TailstackError
from ..geometry.arrays import Array
from ..kernels.process import usable_cores
from ..measures import POINT_ERRORS, PointError
from ..montecarlo.chain import draw, evaluate
from ..montecarlo.plan import ChainPlan, bounded_names, compile_plan
from ..montecarlo.radial import gains_in_plan_order
from ..propagation.linear import linearise
from ..propagation.validity import validity
from ..results import Interval, Provenance
from ..results.record import Published
from ..results.verdicts import P95
from ..scoring import checked_system, provenance, score
from ..system import ROTATIONS, DirectEffect, Law, Sources, System
from ..tail.declared import law_quantile

Within = Literal["1 %", "5 %", "20 %", "beyond"]
LEVELS: tuple[tuple[Within, float], ...] = (("1 %", 0.01), ("5 %", 0.05), ("20 %", 0.2))
SECTIONS = 16  # of the trials, for intervals
LEAST_TRIALS = SECTIONS * 8 * 64  # a section of the first look then has three trials beyond its own P95


@dataclass(frozen=True, slots=True)
class LinearityPoint:
    """One point of the grid."""

    noise_px: float
    """Noise of every image coordinate, fiducials and targets, px."""
    rotation_deg: float
    """Standard deviation of each random rotation of the structure's mount, deg."""
    spread: float
    """Factor on the layout about its centroid."""
    fiducials: int
    """Number of fiducials."""
    status: Literal["ok", "refused"]
    """refused: this point could not be computed."""
    reason: str | None
    """Why it was refused; otherwise null."""
    nu: float | None
    """Validity number; null where it was refused."""
    promise: str | None
    """What the validity statement says: good to 1 % ...; null where it was refused."""
    promised_percent: float | None
    """Relative error of P95 that it promises, %; null where it says that first order is not valid."""
    first_order_p95_mm: float | None
    """First-order P95, mm; null where it was refused."""
    monte_carlo_p95_mm: float | None
    """Sampled P95, mm; null where it was refused."""
    ratio: float | None
    """First order over Monte Carlo; null where it was refused."""
    ratio_interval: Interval | None
    """Confidence interval of that ratio; null where it was refused."""
    within: Within | None
    """How far first order is from Monte Carlo, by the ratio; null where it was refused."""
    sure: bool | None
    """Whether the whole interval says the same; null where it was refused."""
    trials: int | None
    """Trials drawn: an eighth of them where first order is plainly beyond all levels; null where it was refused."""
    errs: Literal["optimistic", "pessimistic", "none seen"] | None
    """On which side first order errs, by the whole interval; null where it was refused."""


@dataclass(frozen=True, slots=True, repr=False)
class StudyLinearity(Published):
    """Where first order is good, and where it is optimistic."""

    schema: Literal["tailstack/study-linearity/1"]
    target: str
    """Name of the target."""
    error: PointError
    """Error that is studied: tcp (at the tool) or localisation (of the target)."""
    quantile: float
    """Quantile of the error's norm, 0.95 for P95."""
    seed: int
    """Seed of the trials."""
    trials: int
    """Trials of each point, at most."""
    confidence: float
    """Confidence of each interval by itself, 0 to 1."""
    interval_method: str
    """How intervals are made, in words."""
    noises_px: tuple[float, ...]
    """Noises of the grid, px."""
    rotations_deg: tuple[float, ...]
    """Standard deviations of the rotations of the grid, deg."""
    spreads: tuple[float, ...]
    """Factors on the layout of the grid."""
    counts: tuple[int, ...]
    """Numbers of fiducials of the grid."""
    points: tuple[LinearityPoint, ...]
    """Every combination: count, spread, noise, rotation; the last runs fastest."""
    sentences: tuple[str, ...]
    """What can be said of the grid."""
    varied: str
    """What was changed in the design, in words."""
    provenance: Provenance


NOISES_PX = (0.3, 1.0, 3.0, 10.0)
ROTATIONS_DEG = (0.0, 1.0, 5.0)
SPREADS = (1.0, 0.5, 0.2)
DEFAULT_TRIALS = 2**14
MOST_POINTS = 5_000
WORST = ", and bounded components stand where they are worst to first order"

Progress = Callable[[int, int], None]


def default_counts(fiducials: int) -> tuple[int, ...]:
    """All fiducials, two thirds of them, and the fewest that can be: each once."""
    wanted = (fiducials, round(2 * fiducials / 3), 7, FEWEST_FIDUCIALS)
    return tuple(sorted({count for count in wanted if FEWEST_FIDUCIALS <= count <= fiducials}, reverse=True)[:3])


class Grid(NamedTuple):
    """What is varied: every combination of these."""

    noises_px: Sequence[float]
    rotations_deg: Sequence[float]
    spreads: Sequence[float]
    counts: Sequence[int]


def study_linearity(
    design: Design | System,
    *,
    noises_px: Sequence[float] = NOISES_PX,
    rotations_deg: Sequence[float] = ROTATIONS_DEG,
    spreads: Sequence[float] = SPREADS,
    counts: Sequence[int] | None = None,
    target: str | None = None,
    error: PointError = "tcp",
    trials: int = DEFAULT_TRIALS,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> StudyLinearity:
    """First-order and Monte Carlo P95 of a design over a grid; what the grid leaves alone stays.

    Every combination is a point: noises_px of every image coordinate, in place of the design's; rotations_deg, standard
    deviations of three rotations of the structure's mount; spreads, factors on the layout about its centroid; counts of
    fiducials kept, far apart, by default all, two thirds of them, the fewest.  target: by default the one with the
    largest first-order P95.  trials of each point, one seed for all; same seed, same digits, whatever ``threads``.
    Raises DesignError, IllPosedError where the design itself is refused, StudyError for an axis or a target that cannot
    be.
    """
    system, _, _ = checked_system(design)
    counts = default_counts(len(system.fiducials_mm)) if counts is None else counts
    grid = Grid(tuple(noises_px), tuple(rotations_deg), tuple(spreads), tuple(counts))
    _refuse(system, grid, target, trials)
    names = [entry.name for entry in system.targets]
    if target is None:
        target = max(score(system, losses=False).targets, key=lambda entry: entry.p95_mm).name
    chosen = names.index(target)
    places = list_places(grid)
    bounded = bounded_names(apply_place(system, places[0]))
    points: list[LinearityPoint] = []
    with ThreadPoolExecutor(usable_cores() if threads is None else threads) as pool:
        for point in pool.map(lambda place: examine_place(system, chosen, error, place, trials, seed), places):
            points.append(point)
            if progress is not None:
                progress(len(points), len(places))
    return StudyLinearity(
        schema="tailstack/study-linearity/1",
        target=target,
        error=error,
        quantile=P95,
        seed=seed,
        trials=trials // SECTIONS * SECTIONS,
        confidence=CONFIDENCE,
        interval_method=f"both quantiles from the same deviates; Student's interval of the logarithms of {SECTIONS} "
        f"sections' ratios; {100 * CONFIDENCE:g} % each by itself, so some {round(100 * (1 - CONFIDENCE))} of 100 miss",
        **grid._asdict(),
        points=tuple(points),
        sentences=write_sentences(points),
        varied="noise: of every image coordinate, in place of the design's; rotation: standard deviation of three "
        f"normal rotations of {system.structure_connector.label}, in place of its own; "
        "spread: factor on the layout about its centroid; fiducials: so many are kept, far apart. Everything else is "
        f"as designed{WORST if bounded else ''}. P95 is pooled over installations and shots.",
        provenance=provenance(system, simulated=True),
    )


def _refuse(system: System, grid: Grid, target: str | None, trials: int) -> None:
    """Raises StudyError with everything about a grid, a target and a number of trials that cannot be."""
    problems = []
    fiducials = len(system.fiducials_mm)
    axes: tuple[tuple[str, Sequence[float], float, float, Sequence[float]], ...] = (
        ("noise", grid.noises_px, 1e-3, 100.0, NOISES_PX),
        ("rotation", grid.rotations_deg, 0.0, 30.0, ROTATIONS_DEG),
        ("spread", grid.spreads, 1e-2, 10.0, SPREADS),
        ("count", grid.counts, FEWEST_FIDUCIALS, fiducials, default_counts(fiducials)),
    )
    for name, values, low, high, usual in axes:
        example = f"--{name} {','.join(f'{value:g}' for value in usual)}"
        for value in values:
            if not low <= value <= high:
                design = " for this design" if name == "count" else ""
                detail = f"{name} must lie between {low:g} and {high:g}{design}; got {value:g}"
                problems.append(Problem("", "out-of-range", detail, example))
        if not values or len(set(values)) < len(values):
            detail = f"{name} takes at least one value, and each of them once"
            problems.append(Problem("", "axis", detail, example))
    size = prod(len(values) for _, values, *_ in axes)
    if size > MOST_POINTS:
        detail = f"a map has at most {MOST_POINTS:,} points; these axes make {size:,}"
        problems.append(Problem("", "too-many", detail, "give fewer values to an axis"))
    if trials < LEAST_TRIALS:
        detail = f"at least {LEAST_TRIALS} trials are needed for intervals; got {trials}"
        problems.append(Problem("", "trials", detail, f"--trials {DEFAULT_TRIALS}"))
    if target is not None and target not in [entry.name for entry in system.targets]:
        listed = ", ".join(entry.name for entry in system.targets[:20])
        detail = f"no target is called {target!r}; there are {listed}"
        problems.append(Problem("", "unknown-target", detail, f"--target {system.targets[0].name}"))
    if problems:
        raise StudyError(problems)


def is_beyond(point: LinearityPoint, limit: float) -> bool | None:
    """Whether first order is further than ``limit`` from Monte Carlo; None where the interval leaves it open."""
    low, high = point.ratio_interval or (1.0, 1.0)
    if 1 - limit <= low and high <= 1 + limit:
        return False
    return True if high < 1 - limit or low > 1 + limit else None


def _count_points(count: int) -> str:
    return f"{count} point{'' if count == 1 else 's'}"


def write_sentences(points: Sequence[LinearityPoint]) -> tuple[str, ...]:
    """What the map says, in words; nothing that an interval leaves open."""
    done = [point for point in points if point.ratio is not None]
    if not done:
        return ("No point could be evaluated.",)
    shares = []
    for name, limit in LEVELS:
        beyond = [is_beyond(point, limit) for point in done]
        shares.append(f"within {name} at {beyond.count(False)} ({beyond.count(None)} open)")
    sentences = [
        f"Of {_count_points(len(done))} the estimate is, with the whole interval, {', '.join(shares)}. Open: the "
        "interval reaches across the limit."
    ]
    name, limit = LEVELS[1]
    far = [point for point in done if is_beyond(point, limit)]
    if far:
        hopeful = sum(point.errs == "optimistic" for point in far)
        sentences.append(
            f"Where it is surely further off than {name}, it is too small at {_count_points(hopeful)} and too large at "
            f"{len(far) - hopeful}."
        )
    else:
        sentences.append(f"Nowhere on this grid is it surely further off than {name}.")
    return tuple(sentences)


CONFIDENCE = 0.95
GLANCE = 8  # one trial in so many is looked at first
FEWEST_FIDUCIALS = 6


@dataclass(frozen=True, slots=True)
class GridPoint:
    """A point of the grid."""

    noise_px: float
    rotation_deg: float
    spread: float
    fiducials: int


def order_far_apart(points: Array) -> NDArray[np.int64]:
    """An order of points (N, 3) in which every beginning is spread out: the farthest from the centroid, then always the
    one farthest from those before it."""
    from_centre = np.linalg.norm(points - points.mean(axis=0), axis=1)
    order = [int(from_centre.argmax())]
    nearest = np.linalg.norm(points - points[order[0]], axis=1)
    while len(order) < len(points):
        order.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, np.linalg.norm(points - points[order[-1]], axis=1))
    return np.array(order)


def _turn(mount: DirectEffect, rotation_deg: float) -> DirectEffect:
    """The mount with its translations as they are and three independent normal rotations of this standard deviation.

    A source that both turns and shifts, as a locator does, keeps its shift at the pivot.
    """
    old = mount.sources
    remaining = [j for j in range(old.count) if old.direction[3:, j].any()]
    shifts = old.direction[:, remaining]
    shifts[:3] = 0.0
    turns = 3 if rotation_deg > 0 else 0
    sources = Sources(
        names=ROTATIONS[:turns] + tuple(old.names[j] for j in remaining),
        laws=(Law.NORMAL,) * turns + tuple(old.laws[j] for j in remaining),
        half_width=np.concatenate([np.full(turns, radians(rotation_deg)), old.half_width[remaining]]),
        coverage_factor=np.concatenate([np.ones(turns), old.coverage_factor[remaining]]),
        units=("rad",) * turns + tuple(old.units[j] for j in remaining),
        direction=np.hstack([np.eye(6)[:, :turns], shifts]),
    )
    return replace(mount, sources=sources)


def apply_place(system: System, place: GridPoint) -> System:
    """The system at a point of the grid, one target left in it."""
    selected = np.sort(order_far_apart(system.fiducials_mm)[: place.fiducials])
    centre = system.fiducials_mm.mean(axis=0)
    spread = centre + place.spread * (system.fiducials_mm[selected] - centre)
    noise = place.noise_px
    return replace(
        system,
        views=tuple(replace(view, fiducial_noise_px=noise, target_noise_px=noise) for view in system.views),
        fiducials_mm=spread,
        fiducial_labels=tuple(system.fiducial_labels[k] for k in selected),
        manufacturing_half_width_mm=system.manufacturing_half_width_mm[selected],
        structure_connector=_turn(system.structure_connector, place.rotation_deg),
        requirements=(),
    )


@dataclass(frozen=True, slots=True)
class QuantileRatio:
    """A P95 by Monte Carlo, and the linear model's over it."""

    p95_mm: float
    ratio: float
    interval: Interval
    trials: int


def compare_quantiles(
    plan: ChainPlan, gains: Array, mean: Array, first_order_mm: float, error: PointError, trials: int, seed: int
) -> QuantileRatio:
    """First order over Monte Carlo at P95, the linear model run on the same deviates.

    gains (3, d) per standardised deviate, mean (3,) mm.  The ratio is that of the two sampled quantiles, which share
    nearly all of their scatter; Monte Carlo's P95 is the exact first-order one over it.  The interval is Student's, of
    the logarithms of the ratios of ``SECTIONS`` equal sections.  Where an eighth of the trials shows that first order
    is beyond all levels, it is left at them: most of those trials need a full SVD each.
    """
    for count in (trials // GLANCE, trials):
        full, linear = _sample_norms(plan, gains, mean, error, count // SECTIONS, seed)
        ratio = float(np.quantile(linear, P95) / np.quantile(full, P95))
        logs = np.log(np.quantile(linear, P95, axis=1) / np.quantile(full, P95, axis=1))
        half = float(stdtrit(SECTIONS - 1, 0.5 + CONFIDENCE / 2) * logs.std(ddof=1)) / sqrt(SECTIONS)
        interval = (exp(log(ratio) - half), exp(log(ratio) + half))
        if count == trials or classify(ratio, interval) == ("beyond", True):
            break
    return QuantileRatio(first_order_mm / ratio, ratio, interval, full.size)


def _sample_norms(
    plan: ChainPlan, gains: Array, mean: Array, error: PointError, each: int, seed: int
) -> tuple[Array, Array]:
    """(SECTIONS, each) norms, mm, of the chain and of the linear model."""
    full, linear = np.empty((SECTIONS, each)), np.empty((SECTIONS, each))
    for section in range(SECTIONS):
        z = draw(plan, seed, np.arange(section * each, (section + 1) * each))
        full[section] = np.linalg.norm(evaluate(plan, z)[:, 0, POINT_ERRORS.index(error)], axis=1)
        # Not a matrix product: its last digits depend on how many threads the BLAS takes.
        linear[section] = np.linalg.norm(mean + np.einsum("nd,kd->nk", z, gains), axis=1)
    return full, linear


def classify(ratio: float, interval: Interval) -> tuple[Within, bool]:
    """How far first order is from Monte Carlo, and whether the whole interval says so."""
    low, high = interval
    ends = (abs(low - 1), abs(high - 1))
    nearest, farthest = 0.0 if low <= 1 <= high else min(ends), max(ends)
    inner = 0.0
    for name, limit in LEVELS:
        if abs(ratio - 1) <= limit:
            return name, inner <= nearest and farthest <= limit
        inner = limit
    return "beyond", nearest > inner


def examine_place(
    system: System, target: int, error: PointError, place: GridPoint, trials: int, seed: int
) -> LinearityPoint:
    """A point of the grid; one whose geometry does not determine the target is refused with the reason."""
    try:
        return _examine_place(system, target, error, place, trials, seed)
    except TailstackError as refusal:
        first = refusal.problems[0]
        nothing: dict[str, Any] = dict.fromkeys(
            name
            for name in LinearityPoint.__dataclass_fields__
            if name not in (*GridPoint.__dataclass_fields__, "status", "reason")
        )
        return LinearityPoint(**asdict(place), status="refused", reason=first.detail, **nothing)


def _examine_place(
    system: System, target: int, error: PointError, place: GridPoint, trials: int, seed: int
) -> LinearityPoint:
    if place.fiducials < FEWEST_FIDUCIALS:
        raise OutOfRangeError(Problem("", "too-few", f"{place.fiducials} fiducials do not determine a view; 6 may"))
    here = replace(apply_place(system, place), targets=(system.targets[target],))
    checked_system(here)
    model = linearise(here, here.targets[0])
    law = error_law(model, error, P95)
    first = law_quantile(law.law, P95).quantile_mm
    if not first > 0:
        raise OutOfRangeError(Problem("", "no-spread", "nothing moves the error here: there is no P95 to compare"))
    plan = compile_plan(here, vertex=law.worst.vertex(model))
    gains = gains_in_plan_order(plan, model.blocks, (0,), error)
    comparison = compare_quantiles(plan, gains, law.law.mean, first, error, trials, seed)
    trust = validity(model.nonlinearity, here, model.turns)
    within, sure = classify(comparison.ratio, comparison.interval)
    low, high = comparison.interval
    return LinearityPoint(
        **asdict(place),
        status="ok",
        reason=None,
        nu=model.nu,
        promise=trust.status,
        promised_percent=trust.expected_error_percent,
        first_order_p95_mm=first,
        monte_carlo_p95_mm=comparison.p95_mm,
        ratio=comparison.ratio,
        ratio_interval=comparison.interval,
        within=within,
        sure=sure,
        trials=comparison.trials,
        errs="optimistic" if high < 1 else "pessimistic" if low > 1 else "none seen",
    )


def list_places(grid: Grid) -> tuple[GridPoint, ...]:
    """Its points: count, spread, noise, rotation; the last runs fastest."""
    axes = (grid.counts, grid.spreads, grid.noises_px, grid.rotations_deg)
    return tuple(GridPoint(noise, rotation, spread, count) for count, spread, noise, rotation in product(*axes))

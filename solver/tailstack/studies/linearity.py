"""Where first order holds for a design: a grid of noise, rotation, spread and count against Monte Carlo."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

from ..cores import usable_cores
from ..design import Design
from ..errors import Problem
from ..scoring import P95, checked_system, provenance, score
from ..system import Law, System
from ..verifying import NOT_IN_A_CHECK
from .linearity_point import CONFIDENCE, FEWEST_FIDUCIALS, Error, examined, places
from .linearity_records import LEAST_TRIALS, LEVELS, SECTIONS, Calibration, LinearityPoint, StudyLinearity
from .refusals import StudyError

NOISES_PX = (0.3, 1.0, 3.0, 10.0)
ROTATIONS_DEG = (0.0, 1.0, 5.0)
SPREADS = (1.0, 0.5, 0.2)
DEFAULT_TRIALS = 2**14
MOST_POINTS = 5_000
BEYOND = LEVELS[-1][1]
NOT_VALID = "not valid"
WORST = ", and bounded components stand where they are worst to first order"

Progress = Callable[[int, int], None]


def default_counts(fiducials: int) -> tuple[int, ...]:
    """All fiducials, two thirds of them, and the fewest that can be: each once."""
    wanted = (fiducials, round(2 * fiducials / 3), 7, FEWEST_FIDUCIALS)
    return tuple(sorted({count for count in wanted if FEWEST_FIDUCIALS <= count <= fiducials}, reverse=True)[:3])


def study_linearity(
    design: Design | System,
    *,
    noises_px: Sequence[float] = NOISES_PX,
    rotations_deg: Sequence[float] = ROTATIONS_DEG,
    spreads: Sequence[float] = SPREADS,
    counts: Sequence[int] | None = None,
    target: str | None = None,
    error: Error = "tcp",
    trials: int = DEFAULT_TRIALS,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> StudyLinearity:
    """First order, second order and Monte Carlo P95 of a design over a grid.

    noises_px: of every image coordinate, in place of the design's; rotations_deg: standard deviations of three normal
    rotations of the structure's mount, in place of its own; spreads: factors on the layout about its centroid; counts:
    fiducials kept, spread out.  Everything else stays.  target: by default the one with the largest first-order P95.
    trials of each point, one seed for all; same seed, same digits, whatever ``threads``.  Raises DesignError,
    IllPosedError where the design itself is refused, StudyError for an axis or a target that cannot be.
    """
    system, _, _ = checked_system(design)
    counts = default_counts(len(system.fiducials_mm)) if counts is None else counts
    _refuse(system, noises_px, rotations_deg, spreads, counts, target, trials)
    names = [one.name for one in system.targets]
    if target is None:
        target = max(score(system).targets, key=lambda one: one.p95_mm).name
    chosen = names.index(target)
    grid = places(noises_px, rotations_deg, spreads, counts)
    points: list[LinearityPoint] = []
    with ThreadPoolExecutor(usable_cores() if threads is None else threads) as pool:
        for point in pool.map(lambda place: examined(system, chosen, error, place, trials, seed), grid):
            points.append(point)
            if progress is not None:
                progress(len(points), len(grid))
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
        noises_px=tuple(noises_px),
        rotations_deg=tuple(rotations_deg),
        spreads=tuple(spreads),
        counts=tuple(counts),
        points=tuple(points),
        calibration=calibration(points),
        sentences=sentences(points),
        varied="noise: of every image coordinate, in place of the design's; rotation: standard deviation of three "
        f"normal rotations of {system.interface_1.label or 'the structure on its connector'}, in place of its own; "
        "spread: factor on the layout about its centroid; fiducials: so many are kept, far apart. Everything else is "
        f"as designed{WORST if _any_bounded(system) else ''}. P95 is pooled over installations and shots.",
        provenance=provenance(system, NOT_IN_A_CHECK),
    )


def _any_bounded(system: System) -> bool:
    """Of what stays as designed; rotations of the first mount do not."""
    first = system.interface_1.sources
    laws = [law for law, direction in zip(first.laws, first.direction.T, strict=True) if direction[3:].any()]
    kept = (system.interface_2.sources, system.hand_eye.sources, system.execution)
    return Law.BOUNDED in [*laws, *(law for sources in kept for law in sources.laws)]


def _refuse(
    system: System, noises: Sequence[float], rotations: Sequence[float], spreads: Sequence[float],
    counts: Sequence[int], target: str | None, trials: int,
) -> None:  # fmt: skip
    problems = []
    fiducials = len(system.fiducials_mm)
    axes: tuple[tuple[str, Sequence[float], float, float, Sequence[float]], ...] = (
        ("noise", noises, 1e-3, 100.0, NOISES_PX), ("rotation", rotations, 0.0, 30.0, ROTATIONS_DEG),
        ("spread", spreads, 1e-2, 10.0, SPREADS),
        ("count", counts, FEWEST_FIDUCIALS, fiducials, default_counts(fiducials)),
    )  # fmt: skip
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
    size = len(noises) * len(rotations) * len(spreads) * len(counts)
    if size > MOST_POINTS:
        detail = f"a map has at most {MOST_POINTS:,} points; these axes make {size:,}"
        problems.append(Problem("", "too-many", detail, "give fewer values to an axis"))
    if trials < LEAST_TRIALS:
        detail = f"at least {LEAST_TRIALS} trials are needed for intervals; got {trials}"
        problems.append(Problem("", "trials", detail, f"--trials {DEFAULT_TRIALS}"))
    if target is not None and target not in [one.name for one in system.targets]:
        listed = ", ".join(one.name for one in system.targets[:20])
        detail = f"no target is called {target!r}; there are {listed}"
        problems.append(Problem("", "unknown-target", detail, f"--target {system.targets[0].name}"))
    if problems:
        raise StudyError(problems)


def beyond(point: LinearityPoint, limit: float) -> bool | None:
    """Whether first order is further than ``limit`` from Monte Carlo; None where the interval leaves it open."""
    low, high = point.ratio_interval or (1.0, 1.0)
    if 1 - limit <= low and high <= 1 + limit:
        return False
    return True if high < 1 - limit or low > 1 + limit else None


def calibration(points: Sequence[LinearityPoint]) -> tuple[Calibration, ...]:
    """What the validity statement promised at these points, and what came of it."""
    lines = []
    done = [point for point in points if point.ratio is not None]
    for promise in ("good to 1 %", "good to 5 %", "good to 20 %", NOT_VALID):
        chosen = [point for point in done if point.promise == promise]
        if not chosen:
            continue
        limits = [BEYOND if one.promised_percent is None else one.promised_percent / 100 for one in chosen]
        found = [beyond(point, limit) for point, limit in zip(chosen, limits, strict=True)]
        warned = promise == NOT_VALID
        ratios = [point.ratio for point in chosen if point.ratio is not None]
        kept, broken = found.count(warned), 0 if warned else found.count(True)
        lines.append(Calibration(promise, len(chosen), kept, broken, found.count(None), min(ratios), max(ratios)))
    return tuple(lines)


def _points(count: int) -> str:
    return f"{count} point{'' if count == 1 else 's'}"


def sentences(points: Sequence[LinearityPoint]) -> tuple[str, ...]:
    """What the map says, in words; nothing that an interval leaves open."""
    done = [point for point in points if point.ratio is not None]
    if not done:
        return ("No point could be evaluated.",)
    shares = []
    for name, limit in LEVELS:
        found = [beyond(point, limit) for point in done]
        shares.append(f"within {name} at {found.count(False)} ({found.count(None)} open)")
    said = [
        f"Of {_points(len(done))} first order is, with the whole interval, {', '.join(shares)}. Open: the interval "
        "reaches across the limit."
    ]
    name, limit = LEVELS[1]
    far = [point for point in done if beyond(point, limit)]
    if far:
        hopeful = sum(point.errs == "optimistic" for point in far)
        gentle = min(point.nu or 0.0 for point in far)
        said.append(
            f"Surely beyond {name} it is optimistic at {_points(hopeful)}, pessimistic at {len(far) - hopeful}; the "
            f"smallest nu among them is {gentle:.2g}."
        )
    else:
        said.append(f"Nowhere on this grid is it surely further than {name} from Monte Carlo.")
    corrected = [_nearer(point) for point in done if point.second_order_ratio is not None]
    if corrected:
        said.append(
            f"Second order is offered at {_points(len(corrected))}: nearer to Monte Carlo than first order at "
            f"{corrected.count(True)}, farther at {corrected.count(False)}, open at {corrected.count(None)}. Elsewhere "
            "it is refused."
        )
    return tuple(said)


def _nearer(point: LinearityPoint) -> bool | None:
    """Whether second order is nearer to Monte Carlo than first order; None where the interval leaves it open.

    Monte Carlo's P95 lies on the side of one of the two, seen from the middle between them, and they differ by more
    than it is known to.
    """
    ratio, second = point.ratio or 1.0, point.second_order_ratio or 1.0
    low, high = point.ratio_interval or (1.0, 1.0)
    middle = (1 + second / ratio) / 2  # over first order
    if low * middle <= 1 <= high * middle or abs(second - ratio) <= (high - low) / 2:
        return None
    return abs(second - 1) < abs(ratio - 1)

"""Where first order holds for a design: a grid of noise, rotation, spread and count against Monte Carlo."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

from ..cores import usable_cores
from ..design import Design
from ..errors import Problem
from ..scoring import P95, checked_system, provenance, score
from ..system import System
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
        "sections' ratios",
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
        "as designed.",
        provenance=provenance(system, NOT_IN_A_CHECK),
    )


def _refuse(
    system: System, noises: Sequence[float], rotations: Sequence[float], spreads: Sequence[float],
    counts: Sequence[int], target: str | None, trials: int,
) -> None:  # fmt: skip
    problems = []
    axes: tuple[tuple[str, Sequence[float], float, float], ...] = (
        ("noise", noises, 1e-3, 100.0), ("rotation", rotations, 0.0, 30.0), ("spread", spreads, 1e-2, 10.0),
        ("count", counts, FEWEST_FIDUCIALS, len(system.fiducials_mm)),
    )  # fmt: skip
    for name, values, low, high in axes:
        for value in values:
            if not low <= value <= high:
                detail = f"{name} must lie between {low:g} and {high:g} for this design; got {value:g}"
                problems.append(Problem("", "out-of-range", detail))
        if not values or len(set(values)) < len(values):
            problems.append(Problem("", "axis", f"{name} takes at least one value, and each of them once"))
    size = len(noises) * len(rotations) * len(spreads) * len(counts)
    if size > MOST_POINTS:
        problems.append(Problem("", "too-many", f"a map has at most {MOST_POINTS:,} points; these axes make {size:,}"))
    if trials < LEAST_TRIALS:
        problems.append(Problem("", "trials", f"at least {LEAST_TRIALS} trials are needed for intervals; got {trials}"))
    if target is not None and target not in [one.name for one in system.targets]:
        listed = ", ".join(one.name for one in system.targets[:20])
        problems.append(Problem("", "unknown-target", f"no target is called {target!r}; there are {listed}"))
    if problems:
        raise StudyError(problems)


def calibration(points: Sequence[LinearityPoint]) -> tuple[Calibration, ...]:
    """What the validity statement promised at these points, and what came of it."""
    lines = []
    done = [point for point in points if point.ratio is not None and point.ratio_interval is not None]
    for promise in ("good to 1 %", "good to 5 %", "good to 20 %", NOT_VALID):
        chosen = [
            (point, point.ratio or 0.0, point.ratio_interval or (0.0, 0.0))
            for point in done
            if point.promise == promise
        ]
        if not chosen:
            continue
        if promise == NOT_VALID:
            kept = sum(abs(ratio - 1) > BEYOND for _, ratio, _ in chosen)
            broken = 0
        else:
            limits = [(point.promised_percent or 0.0) / 100 for point, _, _ in chosen]
            kept = sum(abs(ratio - 1) <= limit for (_, ratio, _), limit in zip(chosen, limits, strict=True))
            broken = sum(
                low > 1 + limit or high < 1 - limit for (_, _, (low, high)), limit in zip(chosen, limits, strict=True)
            )
        ratios = [ratio for _, ratio, _ in chosen]
        lines.append(Calibration(promise, len(chosen), kept, broken, min(ratios), max(ratios)))
    return tuple(lines)


def sentences(points: Sequence[LinearityPoint]) -> tuple[str, ...]:
    """What the map says, in words."""
    done = [point for point in points if point.ratio is not None]
    if not done:
        return ("No point could be evaluated.",)
    shares = []
    for name, limit in LEVELS:
        count = sum(abs((point.ratio or 0.0) - 1) <= limit for point in done)
        shares.append(f"{name} at {count}")
    found = [f"Of {len(done)} points first order is within {', within '.join(shares)}."]
    far = [point for point in done if point.ratio is not None and abs(point.ratio - 1) > LEVELS[1][1]]
    hopeful = [point for point in far if point.errs == "optimistic"]
    if far:
        gentle = min(point.nu or 0.0 for point in far)
        found.append(
            f"Beyond 5 % it is optimistic at {len(hopeful)} points, pessimistic at "
            f"{sum(point.errs == 'pessimistic' for point in far)}; the smallest nu among them is {gentle:.2g}."
        )
    else:
        found.append("It is nowhere further than 5 % from Monte Carlo on this grid.")
    corrected = [point for point in done if point.second_order_ratio is not None]
    if corrected:
        nearer, farther = 0, 0
        for point in corrected:
            low, high = point.ratio_interval or (1.0, 1.0)
            ours, theirs = point.ratio or 1.0, point.second_order_ratio or 1.0
            if abs(theirs - ours) > (high - low) / 2:  # more than Monte Carlo leaves open
                nearer += abs(theirs - 1) < abs(ours - 1)
                farther += abs(theirs - 1) > abs(ours - 1)
        found.append(
            f"Second order is offered at {len(corrected)} points: nearer to Monte Carlo than first order at {nearer}, "
            f"farther at {farther}, no different within the intervals at {len(corrected) - nearer - farther}. "
            "Elsewhere it is refused."
        )
    return tuple(found)

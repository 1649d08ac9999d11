"""What one more bead, a larger structure, another angle between views or known intrinsics would buy at best.

One thing is changed at a time; of each the best layout that a search finds, and what no layout undercuts, proven to
first order (``docs/certificate.md``).  What a change buys at most is the difference between the best layout found as
designed and that bound.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from ..design import Design, compile_design
from ..design.loading import locate_refusals
from ..errors import TailstackError
from ..measures import PointError
from ..results import ERRORS, Provenance
from ..results.digits import at_most, in_percent, number
from ..results.record import Published
from ..scoring import provenance
from ..system import ESTIMATORS, Estimator, System

HARDLY = 0.01  # a difference of P95 that nobody need care about
Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class PlacementCase:
    """One thing changed, and how good a layout could be then."""

    changed: Literal["nothing", "fiducials", "envelope", "angle", "estimator"]
    """What is otherwise than designed."""
    case: str
    """That in words."""
    value: float | None
    """Number of fiducials, factor on the width of the envelope, or angle between both beams, deg; null of an estimator
    and of nothing."""
    target: str | None
    """Target at which both P95 are: where that of the best layout is largest; null without either."""
    best_found_mm: float | None
    """P95 of the best layout found, by first order, mm; null where none was."""
    lower_bound_mm: float | None
    """P95 that no layout undercuts, proven to first order, mm; null without a bound."""
    reason: str
    """Why no layout was found, or why nothing is proven; empty where neither is lacking."""


@dataclass(frozen=True, slots=True, repr=False)
class StudyPlacement(Published):
    """What another number of fiducials, envelope, angle or estimator buys at best."""

    schema: Literal["tailstack/study-placement/1"]
    error: PointError
    """Error that is studied: tcp (at the tool) or localisation (of the target)."""
    starts: int
    """Layouts that each search began with."""
    seed: int
    """Seed of these."""
    fiducials: int
    """Number of fiducials as designed."""
    angle_deg: float | None
    """Angle between the lines of both beams as designed, deg; null where no view is turned."""
    estimator: str
    """Estimator as designed."""
    any_structure_mm: float | None
    """P95 at the first target below that no structure undercuts with these views, however large and of however many
    fiducials, mm: the views known exactly.  Null without a bound."""
    cases: tuple[PlacementCase, ...]
    """Nothing changed, then each change by itself."""
    left_out: tuple[str, ...]
    """What some of the bounds do not count, and which can only add to them."""
    conclusions: tuple[str, ...]
    """What it comes to for a designer; what may buy most comes first."""
    provenance: Provenance


def study_placement(
    design: Design,
    *,
    error: PointError = "tcp",
    starts: int = 4,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> StudyPlacement:
    """Find the best layout, and bound every layout, as designed and with each change.

    Half-widths, pivots and views are as designed; free is where fiducials are, by the design's ``optimise`` section.
    ``progress(done, total)`` is called after each case.  Raises DesignError, also where no fiducial is free.
    """
    # Late: a report of the record is made where the optimiser is not installed
    from ..optimisation.changes import Alternative, find_best, find_pair, floor_of, list_changes

    left_out: list[str] = []

    def try_change(change: Alternative) -> PlacementCase:
        try:
            best = find_best(change.make(), starts=starts, seed=seed, threads=threads)
        except TailstackError as refusal:
            why = refusal.problems[0].detail
            return PlacementCase(change.kind, change.words, change.value, None, None, None, why)
        bound, why = best.bound, best.reason
        left_out.extend(bound.left_out)
        if bound.lower_bound_mm is None:
            why = "; ".join(filter(None, (why, bound.statement.rstrip("."))))
        found = None if best.reason else bound.quantile_mm
        return PlacementCase(change.kind, change.words, change.value, bound.target, found, bound.lower_bound_mm, why)

    with locate_refusals(design):
        changes = list_changes(design, error)
        problem = changes[0].make()
    cases: list[PlacementCase] = []
    for change in changes:
        cases.append(try_change(change))
        if progress is not None:
            progress(len(cases), len(changes))
    system, pair, target = problem.system, find_pair(design, problem), cases[0].target
    floor_mm = None if target is None or cases[0].lower_bound_mm is None else floor_of(problem, target)
    return StudyPlacement(
        schema="tailstack/study-placement/1",
        error=error,
        starts=starts,
        seed=seed,
        fiducials=len(system.fiducial_labels),
        angle_deg=None if pair is None else min(pair.angle_deg, 180 - pair.angle_deg),
        estimator=str(system.estimator),
        any_structure_mm=floor_mm,
        cases=tuple(cases),
        left_out=tuple(dict.fromkeys(left_out)),
        conclusions=tuple(_conclude(cases, system, error, floor_mm)),
        provenance=provenance(compile_design(design)),
    )


def cases_of(study: StudyPlacement, changed: str) -> list[tuple[float | str, PlacementCase]]:
    """The cases of one question, with where they stand on its axis, that as designed among them; ascending."""
    designed: dict[str, float | str | None] = {
        "fiducials": study.fiducials,
        "envelope": 1.0,
        "angle": study.angle_deg,
        "estimator": study.estimator,
    }
    own = [case for case in study.cases if case.changed == changed]
    if not own:
        return []
    here = designed[changed]
    assert here is not None  # there are cases of that question
    if changed == "estimator":
        named = {str(here): study.cases[0]} | {case.case: case for case in own}
        return [(str(name), named[str(name)]) for name in ESTIMATORS if str(name) in named]
    pairs = [(here, study.cases[0]), *((case.value or 0.0, case) for case in own)]
    return sorted(pairs, key=lambda pair: float(pair[0]))


# --- what it says ---------------------------------------------------------------------------------


def _conclude(
    cases: Sequence[PlacementCase], system: System, error: PointError, floor_mm: float | None
) -> Iterator[str]:
    base, present = cases[0], len(system.fiducial_labels)
    if base.best_found_mm is None:
        yield f"As designed no layout was found: {base.reason}."
    else:
        asked = {
            "one more": [c for c in cases if c.changed == "fiducials" and (c.value or 0) > present][:1],
            "larger": [c for c in cases if c.changed == "envelope" and (c.value or 0) > 1],
            "angle": [c for c in cases if c.changed == "angle"],
            "knowing": [c for c in cases if c.changed == "estimator" and _knows_more(c.case, system)],
        }
        told = [say_worth(base.best_found_mm, _most(group)) for group in asked.values() if group]
        yield from (sentence for _, sentence in sorted(told, key=lambda pair: -pair[0]))
        least = "" if base.lower_bound_mm is None else f", and none has less than {at_most(base.lower_bound_mm)} mm"
        yield (
            f"As designed the best layout found has P95 of {ERRORS[error]} of {number(base.best_found_mm)} mm at "
            f"{base.target}{least}."
        )
    if floor_mm is not None:
        yield (
            f"However large a structure, of however many fiducials, and whatever the estimator: with these views and "
            f"tolerances P95 is not below {at_most(floor_mm)} mm. Proven to first order."
        )


def _knows_more(name: str, system: System) -> bool:
    return Estimator(name).believes_intrinsics and not system.estimator.believes_intrinsics


def _most(group: Sequence[PlacementCase]) -> PlacementCase:
    """The case that may buy most, proven ones first."""
    return min(group, key=lambda case: (case.lower_bound_mm is None, case.lower_bound_mm or 0.0))


def say_worth(before_mm: float, case: PlacementCase) -> tuple[float, str]:
    """What a change may save at most, mm, and that in words."""
    what = f"{case.case[0].upper()}{case.case[1:]}"
    if case.lower_bound_mm is None:
        return 0.0, f"{what}: nothing is proven ({case.reason})."
    most_mm = before_mm - case.lower_bound_mm
    if most_mm <= 0:
        return 0.0, f"{what}: worse than the best layout found as designed, whatever the layout. Proven to first order."
    found = "" if case.best_found_mm is None else f"; the best found has {number(case.best_found_mm)} mm"
    share = in_percent(most_mm / before_mm, 1)
    worth = "next to nothing, at most" if most_mm < HARDLY * before_mm else "at most"
    return most_mm, (
        f"{what}: buys {worth} {number(most_mm, 2)} mm ({share}). No such layout has P95 below "
        f"{at_most(case.lower_bound_mm)} mm{found}."
    )

"""Which view buys most: P95 over the direction of each aimed view's beam, and over that of a view more.

A view turns as a C-arm does, with its image: about ``isocentre_mm``, by an angle towards a direction across the beam.
Every direction is a design of its own, scored as any other to first order under its declared laws.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import acos, ceil, cos, degrees, hypot, inf, radians
from typing import Any, Literal

import numpy as np

from ..design import Design, compile_design
from ..design.document import DistanceView, PresetView
from ..design.write import turn_entry
from ..errors import Problem, StudyError, TailstackError, describe_refusal
from ..geometry.arrays import Array
from ..geometry.camera import list_turns, principal_ray
from ..geometry.rotation import unit
from ..measures import PointError
from ..results import ERRORS, Provenance, Vector3
from ..results.record import Published
from ..scoring import provenance, score_errors

CONE_DEG, STEP_DEG = 30.0, 10.0
HEMISPHERE_DEG, COARSE_DEG = 90.0, 15.0  # of a view more
MOST_STEPS = 15  # from the middle of a map to its edge: 709 directions
HARDLY = 0.01  # a difference of P95 that nobody need care about
ORDINALS = {3: "third", 4: "fourth", 5: "fifth", 6: "sixth"}
Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class BeamDirection:
    """A direction that a view may have, and what comes of it."""

    right_deg: float
    """Towards the right of the image as it is designed, deg: with up_deg the angle of the turn and where it goes."""
    up_deg: float
    """Towards the top of the image as it is designed, deg."""
    beam_direction: Vector3
    """Of the turned view, from the source to the detector, in con; as a design takes it."""
    up_direction: Vector3
    """Of the turned view, in con; as a design takes it."""
    p95_mm: float | None
    """P95 of the error, at the target where it is largest, mm; null where the direction is not allowed."""
    target: str | None
    """That target; null where the direction is not allowed."""
    reason: str | None
    """Why the direction is not allowed: what it hides, mostly; null where it is."""


@dataclass(frozen=True, slots=True)
class BeamAngle:
    """The angle between the beams of two views."""

    view: str
    """Name of the other view."""
    angle_deg: float
    """Between the lines of both beams, whichever way they run, deg: 0 to 90."""


@dataclass(frozen=True, slots=True)
class ViewMap:
    """P95 over the direction of one view's beam, everything else as designed."""

    view: str
    """Name of the view that turns; of a view more, of the one that it is a copy of."""
    reason: str | None
    """Why the view is left as it is; null where it turns."""
    cone_deg: float
    """How far it turns from where it is designed, deg."""
    step_deg: float
    """Step of the map, deg."""
    directions: tuple[BeamDirection, ...]
    """All directions of the map, those that turn least first."""
    best: BeamDirection | None
    """The allowed direction with the smallest P95; null where none is allowed."""
    turn_deg: float | None
    """Angle between the designed beam and the best one, deg."""
    angles: tuple[BeamAngle, ...]
    """Between the best beam and those of the other views."""
    sentence: str
    """What the map says."""


@dataclass(frozen=True, slots=True, repr=False)
class StudyViews(Published):
    """Which view buys most."""

    schema: Literal["tailstack/study-views/1"]
    error: PointError
    """Error that is studied: tcp (at the tool) or localisation (of the target)."""
    cone_deg: float
    """How far each view was turned, deg."""
    step_deg: float
    """Step of these maps, deg."""
    p95_mm: float
    """P95 of the error as designed, by first order, at the target where it is largest, mm."""
    target: str
    """That target."""
    views: tuple[ViewMap, ...]
    """Every view of the design, turned by itself."""
    further: ViewMap | None
    """A view more, a copy of the first aimed one with a beam of its own; null where no view is aimed."""
    conclusions: tuple[str, ...]
    """What it comes to for a designer; what buys most comes first."""
    provenance: Provenance


def study_views(
    design: Design,
    *,
    cone_deg: float = CONE_DEG,
    step_deg: float = STEP_DEG,
    error: PointError = "tcp",
    progress: Progress | None = None,
) -> StudyViews:
    """Turn each view that is aimed (by a preset or by distances), and add one, over maps of directions.

    A direction that hides a fiducial or a target, or that is refused for another reason, is a row with the reason.
    cone_deg, step_deg: of the maps of turned views; that of a view more goes over half of all directions, coarsely.
    ``progress(done, total)`` is called after each direction.  Raises DesignError, IllPosedError where the design
    itself cannot be scored, StudyError for a map of too many directions or of none but the present one.
    """
    refuse_steps(cone_deg, step_deg)
    system = compile_design(design)
    rays = {view.name: principal_ray(view.projection) for view in system.views}
    written: list[dict[str, Any]] = list(design.source.data["views"])
    aimed = [k for k, view in enumerate(design.document.views) if isinstance(view, PresetView | DistanceView)]
    near, far = list_turns(cone_deg, step_deg), list_turns(HEMISPHERE_DEG, COARSE_DEG)
    count = iter(range(1, len(aimed) * len(near) + len(far) + 1))
    largest = _score(design, error)
    unused = next(name for k in range(1, len(rays) + 2) if (name := f"further {k}") not in rays)

    def scan(place: int, turns: list[tuple[float, float]], further: bool) -> Iterator[BeamDirection]:
        view: Any = design.document.views[place]
        for right_deg, up_deg in turns:
            turned = turn_entry(written[place], view, right_deg, up_deg)
            beam, up = tuple(turned["beam_direction"]), tuple(turned["up_direction"])
            p95_mm, target, reason = None, None, None
            try:
                if further:
                    changed = design.with_value("/views", [*written, turned | {"name": unused}])
                else:
                    changed = design.with_value(f"/views/{place}", turned) if right_deg or up_deg else design
                p95_mm, target = _score(changed, error)
            except TailstackError as refusal:
                reason = describe_refusal(refusal)
            if progress is not None:
                progress(next(count), len(aimed) * len(near) + len(far))
            yield BeamDirection(right_deg, up_deg, beam, up, p95_mm, target, reason)

    maps = []
    for place, name in enumerate(rays):
        if place in aimed:
            others = {other: ray for other, ray in rays.items() if other != name}
            maps.append(_read_map(name, cone_deg, step_deg, tuple(scan(place, near, False)), others, largest, None))
        else:
            why = "it is given by a matrix or by intrinsics and a pose, which say nothing of how it is aimed"
            maps.append(ViewMap(name, why, 0.0, 0.0, (), None, None, (), f"{name} is left as it is: {why}."))
    further = None
    if aimed:
        like, ordinal = list(rays)[aimed[0]], ORDINALS.get(len(rays) + 1, "further")
        directions = tuple(scan(aimed[0], far, True))
        further = _read_map(like, HEMISPHERE_DEG, COARSE_DEG, directions, rays, largest, ordinal)
    return StudyViews(
        schema="tailstack/study-views/1",
        error=error,
        cone_deg=cone_deg,
        step_deg=step_deg,
        p95_mm=largest[0],
        target=largest[1],
        views=tuple(maps),
        further=further,
        conclusions=_conclude(maps, further, largest, error),
        provenance=provenance(system),
    )


def refuse_steps(cone_deg: float, step_deg: float) -> None:
    """Raises StudyError for a map of too many directions, or of none but the present one."""
    if step_deg > cone_deg:
        detail = f"a step of {step_deg:g} deg leaves no direction within {cone_deg:g} deg but the present one"
        raise StudyError(Problem("/step_deg", "too-coarse", detail, f"step_deg {cone_deg / 3:.3g}"))
    if cone_deg / step_deg > MOST_STEPS:
        detail = f"a map has at most {MOST_STEPS} steps from its middle to its edge; got {cone_deg / step_deg:.4g}"
        least = ceil(10 * cone_deg / MOST_STEPS) / 10
        raise StudyError(Problem("/step_deg", "too-many", detail, f"step_deg {least:g} or more"))


def _score(design: Design, error: PointError) -> tuple[float, str]:
    """P95, mm, at the target where it is largest, and that target."""
    each = score_errors(design).targets
    metrics = [(item if error == "tcp" else item.localisation).p95_mm for item in each]
    worst = max(range(len(each)), key=metrics.__getitem__)
    return metrics[worst], each[worst].name


def maps_of(study: StudyViews) -> list[tuple[str, ViewMap]]:
    """The maps that have directions, each with what it is called: those of views that turn, and of one more."""
    turned = [(f"{view_map.view}, turned", view_map) for view_map in study.views if view_map.directions]
    return [*turned, *([(f"one more like {study.further.view}", study.further)] if study.further else [])]


# --- what a map says ------------------------------------------------------------------------------


def _read_map(
    view: str,
    cone_deg: float,
    step_deg: float,
    directions: tuple[BeamDirection, ...],
    others: dict[str, Array],
    designed: tuple[float, str],
    ordinal: str | None,  # of a view more
) -> ViewMap:
    allowed = [(direction.p95_mm, direction) for direction in directions if direction.p95_mm is not None]
    what = view if ordinal is None else f"a {ordinal} view like {view}"
    if not allowed:
        sentence = f"No direction of {what} is allowed: {directions[0].reason}."
        return ViewMap(view, None, cone_deg, step_deg, directions, None, None, (), sentence)
    p95_mm, best = min(allowed, key=lambda pair: round(pair[0], 9))  # mirror images are alike: the smaller turn
    turn_deg = hypot(best.right_deg, best.up_deg)
    angles = tuple(
        BeamAngle(name, degrees(acos(min(abs(float(unit(np.array(best.beam_direction)) @ ray)), 1.0))))
        for name, ray in others.items()
    )
    numbers = f"P95 from {designed[0]:.3f} to {p95_mm:.3f} mm"
    beam = f"beam_direction {list(best.beam_direction)}"
    gain = 1 - p95_mm / designed[0]
    from_others = ", ".join(f"{angle.angle_deg:.0f} deg from {angle.view}" for angle in angles)
    if gain < HARDLY:
        how, where = ("Turning", f" within {cone_deg:g} deg") if ordinal is None else ("Adding", "")
        sentence = f"{how} {what} buys next to nothing: no direction{where} lowers P95 by as much as 1 %."
    elif ordinal is not None:
        sentence = f"A {ordinal} view like {view}, with {beam} ({from_others}), lowers {numbers}."
    else:
        start = next(each.beam_direction for each in directions if each.right_deg == each.up_deg == 0)
        across = np.array(best.beam_direction) - cos(radians(turn_deg)) * np.array(start)
        sentence = f"Turning {view} by {turn_deg:.0f} deg towards {_name(across)} ({beam}) lowers {numbers}"
        sentence += ", at the edge of the map." if turn_deg + step_deg > cone_deg else "."
    hidden = len(directions) - len(allowed)
    if hidden:
        sentence += f" {hidden} of {len(directions)} directions are not allowed, mostly because they hide something."
    return ViewMap(view, None, cone_deg, step_deg, directions, best, turn_deg, angles, sentence)


def _name(direction: Array) -> str:
    """+x and the like along an axis of con, otherwise the unit vector."""
    along = unit(direction)
    largest = int(np.abs(along).argmax())
    if abs(along[largest]) > 1 - 1e-6:
        return f"{'+' if along[largest] > 0 else '-'}{'xyz'[largest]}"
    return "(" + ", ".join(f"{value:.2f}" for value in along + 0.0) + ")"


def _conclude(
    maps: list[ViewMap], further: ViewMap | None, designed: tuple[float, str], error: PointError
) -> tuple[str, ...]:
    every = [*maps, *([further] if further else [])]
    ranked = sorted(every, key=lambda view_map: (view_map.best and view_map.best.p95_mm) or inf)
    start = f"As designed, P95 of {ERRORS[error]} is {designed[0]:.3f} mm at {designed[1]}, where it is largest."
    return (*(view_map.sentence for view_map in ranked), start)

"""How views that are free are aimed: a search of its own around the optimiser, to which the views are fixed.

Every aim of a grid is scored with everything else as it stands; the best of them and the present one are optimised;
from the better one a compass search goes on with optimised objectives, its steps halved where none is better.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from itertools import product
from math import acos, degrees, hypot, inf
from typing import Any

import numpy as np

from ..design import Design, check_design
from ..design.document import PresetView
from ..design.optimise_document import AddedView, FreeView
from ..design.presets import PRESETS
from ..design.write import turn_entry
from ..errors import NotConvergedError, TailstackError
from ..geometry.camera import list_turns, turn_view
from ..geometry.rotation import unit
from ..results import AimedView, ViewSearch
from ..scoring import vector3
from .exact_law import p95_of
from .problem import QuantileConstraint
from .request import read_request
from .search import SAME, Control

MOST_SOLVED = 25  # aims at which everything else is optimised
GRID, LARGEST_STEP_DEG = 3, 15.0  # steps from the middle of the cone to its edge, more in a wide one: 29 to 113 turns
FIRST, LAST = 1 / 2, 1 / 8  # steps of the compass, in those of the grid

Solve = Callable[[Design], float]  # the objective of a design whose views are fixed; raises what refuses it


@dataclass(frozen=True, slots=True)
class Aim:
    """How one view is aimed, against how it stands in the document."""

    right_deg: float
    up_deg: float
    source_isocentre_mm: float


Aims = tuple[Aim, ...]  # of every free view


def aim_views(
    design: Design, solve: Solve, control: Control, added: AddedView | None = None
) -> tuple[Design, ViewSearch]:
    """The design with its free views aimed best among what is tried, and the record of that.

    added: what one of them was written into the design by; it is no view that could stay as it is.
    Raises what ``solve`` raises at the aim with the best score where no aim that is solved gives a design.
    """
    search = AimSearch(design, solve, control)
    present = tuple(present_distance(design, free.view) for free in search.free)
    start = tuple(
        Aim(0.0, 0.0, distance if limits is None else min(max(distance, limits[0]), limits[1]))
        for distance, limits in zip(present, (free.source_isocentre_mm for free in search.free), strict=True)
    )
    leader = search.scan(start)
    best = leader if search.solve_at(start) > search.solve_at(leader) else start
    if search.solve_at(best) == inf:
        raise search.refusals[leader]
    best = search.refine(best)
    each = zip(search.free, best, present, strict=True)
    views = tuple(_compare(design, free.view, aim, distance) for free, aim, distance in each)
    may_stay = added is None and present == tuple(aim.source_isocentre_mm for aim in start)
    as_aimed = search.solve_at(start) if may_stay else inf
    return search.aim(best), _record(search, views, as_aimed, search.solve_at(best), added)


@dataclass(slots=True)
class AimSearch:
    """What has been tried."""

    design: Design
    solve: Solve
    control: Control
    scored: int = 0
    solved: dict[Aims, float] = field(default_factory=dict)  # infinite where refused
    refusals: dict[Aims, TailstackError] = field(default_factory=dict)
    demands: tuple[QuantileConstraint, ...] = ()  # with all fiducials
    free: list[FreeView] = field(default_factory=list)

    def __post_init__(self) -> None:
        request = read_request(self.design)
        self.demands = tuple(demand for demand in request.problem.demands if not demand.lost)
        self.free = request.section.free_views

    def aim(self, aims: Aims) -> Design:
        """The design with its views so aimed.  Raises DesignError."""
        written: list[dict[str, Any]] = [dict(view) for view in self.design.source.data["views"]]
        for free, aim in zip(self.free, aims, strict=True):
            place, view = find_view(self.design, free.view)
            if aim.right_deg or aim.up_deg:
                written[place] = turn_entry(written[place], view, aim.right_deg, aim.up_deg)
            if aim.source_isocentre_mm != present_distance(self.design, free.view):
                written[place]["source_isocentre_mm"] = aim.source_isocentre_mm
        return self.design.with_value("/views", written)

    def scan(self, start: Aims) -> Aims:
        """The aim with the smallest P95 over its limit, one view after another, everything else as it stands."""
        best, least = start, self._score(start)
        for place, free in enumerate(self.free):
            step = _step_deg(free)
            turns = list_turns(free.cone_deg, step) if step else [(0.0, 0.0)]
            limits = free.source_isocentre_mm or ()
            distances = sorted({start[place].source_isocentre_mm, *limits})
            around = best
            for turn, distance in product(turns, distances):
                aims = (*around[:place], Aim(*turn, distance), *around[place + 1 :])
                if self.control.stops():
                    return best
                if (ratio := self._score(aims)) < least * (1 - 1e-9):  # mirror images are alike: the smaller turn
                    best, least = aims, ratio
        return best

    def _score(self, aims: Aims) -> float:
        self.scored += 1
        try:
            system, _, _ = check_design(self.aim(aims))
            values = p95_of(system, self.demands)
        except TailstackError:
            return inf
        return max(value / each.requirement.limit for value, each in zip(values, self.demands, strict=True))

    def solve_at(self, aims: Aims) -> float:
        """The objective with everything else optimised; infinite where that is refused."""
        if aims not in self.solved:
            value = inf
            try:
                value = self.solve(self.aim(aims))
            except TailstackError as refusal:
                if isinstance(refusal, NotConvergedError) and self.control.stops():
                    raise
                self.refusals[aims] = refusal
            self.solved[aims] = value
            least = min(self.solved.values())
            self.control.report("view", len(self.solved), MOST_SOLVED, least if least < inf else None)
        return self.solved[aims]

    def refine(self, best: Aims) -> Aims:
        """From an aim to the first better one of its neighbours, until none is with the smallest steps."""
        steps = FIRST
        while steps >= LAST:
            better = None
            for near in self._neighbours(best, steps):
                if near not in self.solved and (len(self.solved) >= MOST_SOLVED or self.control.stops()):
                    return best
                if self.solve_at(near) < self.solve_at(best) * (1 - SAME):
                    better = near
                    break
            best, steps = (best, steps / 2) if better is None else (better, steps)
        return best

    def _neighbours(self, aims: Aims, steps: float) -> Iterator[Aims]:
        for place, (free, aim) in enumerate(zip(self.free, aims, strict=True)):
            turn = steps * _step_deg(free)
            low, high = free.source_isocentre_mm or (aim.source_isocentre_mm,) * 2
            move = steps * (high - low) / 2
            for name, step in (("right_deg", turn), ("up_deg", turn), ("source_isocentre_mm", move)):
                for sign in (1, -1):
                    near = replace(aim, **{name: round(getattr(aim, name) + sign * step, 6)})
                    distance = min(max(near.source_isocentre_mm, low), high)
                    near = replace(near, source_isocentre_mm=distance)
                    if near != aim and hypot(near.right_deg, near.up_deg) <= free.cone_deg + 1e-6:
                        yield (*aims[:place], near, *aims[place + 1 :])


def _step_deg(free: FreeView) -> float:
    """Of the grid in the cone of a view."""
    return min(free.cone_deg / GRID, LARGEST_STEP_DEG)


def find_view(design: Design, name: str) -> tuple[int, Any]:
    return next((place, view) for place, view in enumerate(design.document.views) if view.name == name)


def present_distance(design: Design, name: str) -> float:
    view = find_view(design, name)[1]
    if isinstance(view, PresetView) and view.source_isocentre_mm is None:
        return float(PRESETS[view.preset].source_isocentre_mm or 0.0)  # loading has made sure that it is stated
    return float(view.source_isocentre_mm)


def leave_views(record: ViewSearch) -> ViewSearch:
    """The record of a search where the views stay as they were after all."""
    assert record.objective_as_aimed is not None  # they may
    views = tuple(
        replace(
            view,
            turn_deg=0.0,
            beam_direction=view.beam_direction_before,
            source_isocentre_mm=view.source_isocentre_before_mm,
        )
        for view in record.views
    )
    named = ", ".join(view.view for view in views)
    return replace(
        record,
        views=views,
        objective=record.objective_as_aimed,
        sentence=f"{named} left as aimed: with the margin of the check none of the {record.solved} ways to aim that "
        "were optimised is better.",
    )


def _compare(design: Design, name: str, aim: Aim, before_mm: float) -> AimedView:
    view = find_view(design, name)[1]
    beam, up = np.array(view.beam, dtype=float), np.array(view.up_direction)
    turned = np.array(turn_view(beam, up, aim.right_deg, aim.up_deg)[0]) if aim.right_deg or aim.up_deg else beam
    angle = degrees(acos(min(float(unit(beam) @ unit(turned)), 1.0)))
    return AimedView(name, angle, vector3(beam), vector3(turned), before_mm, aim.source_isocentre_mm)


def _record(
    search: AimSearch, views: tuple[AimedView, ...], as_aimed: float, objective: float, added: AddedView | None
) -> ViewSearch:
    sentences = []
    for view in views:
        what = [f"turned by {view.turn_deg:.1f} deg"] if view.turn_deg else []
        if added is not None and view.view == added.add:
            what = [f"{view.turn_deg:.1f} deg from {added.like}"]
        if view.source_isocentre_mm != view.source_isocentre_before_mm:
            what.append(f"its source at {view.source_isocentre_mm:g} instead of {view.source_isocentre_before_mm:g} mm")
        sentences.append(f"{view.view} is {' and '.join(what) or 'left as it was'}")
    before = f", {as_aimed:.5g} as they were aimed" if as_aimed < inf else ""
    return ViewSearch(
        views=views,
        scored=search.scored,
        solved=len(search.solved),
        refused=sum(value == inf for value in search.solved.values()),
        objective_as_aimed=as_aimed if as_aimed < inf else None,
        objective=objective,
        sentence=f"{'; '.join(sentences)}. The objective, by the closed form, is {objective:.5g}{before}. This is the "
        f"best of {len(search.solved)} ways to aim that were optimised, after {search.scored} that were scored; "
        + ("the search was stopped on request, and " if search.control.stops() else "")
        + "it is not proven that there is no better one.",
    )

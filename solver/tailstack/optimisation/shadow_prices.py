"""What one unit of each limit and bound is worth, from the multipliers of an optimum.

By the envelope theorem ``d log f / d theta`` is the partial derivative of the Lagrangian of ``log f``, f the objective:
a limit L enters as ``-2 log L`` with multiplier lambda, so its price is ``-2 lambda f / L``; a bound h of a half-width
through its logarithm, ``-mu f / h``; a spacing d as ``-2 / d`` where it binds; a face of the box at distance ``half``
from the centre per scaled unit.  Where a quantile is least the programme minimises ``s = 2 log``, so every price is
half of that.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from math import floor, inf, log10, radians

import numpy as np

from ..measures import MEASURE
from ..results import ShadowPrice
from .prices import part_that_holds, slope_of
from .problem import for_people, in_words, label_of, unit_of
from .program import Point, Program
from .regions import BoxRegion

BETWEEN = 1e-6  # multiplier of a bound that does not press
PRICED = 1e-2  # per cent of the objective for one step: smaller shadow prices only fill the page


@dataclass(frozen=True, slots=True)
class Pressure:
    """A limit or bound that holds an optimum where it is, and what a unit more of it changes."""

    name: str
    unit: str  # of 0.01 deg, say
    per_unit: float  # of the objective
    phrase: str  # a step of it, in words, with a place for its size
    room: float  # of what a step is a part, in the unit without its factor
    step: float = 1.0  # units that are told where a derivative is good for so many
    less: bool = False  # whether the words are of a step down
    own: bool = False  # whether they are of what holds nothing, and has a price of its own

    def say_step(self, whole: float, of: str) -> str:
        """What a step changes, as far as a derivative is good for, in a sentence; ``of`` what, which is ``whole``."""
        share, size = abs(self.per_unit) * self.step / whole, self.step * float(self.unit.rpartition(" ")[0] or 1)
        told = part_that_holds(share, size / self.room)
        effect = "costs" if self.own else "saves" if (self.per_unit < 0) != self.less else "adds"
        words = self.phrase.replace("{step}", f"{size * told:g}")
        return f"{words} {effect} {100 * share * told:.3g} %" + ("" if self.own else f" of {of}")


def price_bounds(
    program: Program, point: Point, objective: float, whole: float | None = None
) -> tuple[ShadowPrice, ...]:
    """Derivatives of the objective (cost; or the quantile, where that is least) by every limit that binds.

    Percentages are of ``whole`` when something was bought besides (grades).
    """
    whole, of, per = objective if whole is None else whole, "cost", objective
    if program.problem.objective == "quantile":
        of, per = "the error", objective / 2
    every = chain(_limits(program, point, per), _widths(program, point, per), list_rules(program, point, per))
    told = (each for each in every if 100 * abs(each.per_unit) * each.step > PRICED * whole)
    return tuple(ShadowPrice(each.name, each.unit, each.per_unit, each.say_step(whole, of)) for each in told)


def _limits(program: Program, point: Point, per: float) -> Iterator[Pressure]:
    problem, rows = program.problem, point.row_multipliers
    for requirement in problem.requirements if problem.objective != "quantile" else ():
        own = [term.demand.requirement.name == requirement.name for term in program.terms]
        limit, unit = requirement.limit, MEASURE[requirement.error].unit
        name = "limit" if len(problem.requirements) == 1 else f"limit of {requirement.name}"
        phrase = f"the {name} ({limit:g} {unit})" if " of " in name else f"the limit of {limit:g} {unit}"
        pressed = float(rows[: len(own)][own].sum())
        more = f"{{step}} {unit} more on {phrase}"
        yield Pressure(name, unit, -2 * pressed * per / limit, more, limit, _step_of(limit))
    if (most := problem.cost_limit) is not None:
        per_unit = -_sum_rows(program, point, "cost") * per / most
        yield Pressure("cost_limit", "cost", per_unit, "{step} more on the cost limit", most, _step_of(most))


def _step_of(limit: float) -> float:
    """Small enough for a derivative to mean something."""
    return 10.0 ** floor(log10(limit / 10))


def _sum_rows(program: Program, point: Point, kind: str) -> float:
    return float(sum(m for m, row in zip(point.row_multipliers, program.rows, strict=True) if row.kind == kind))


def _widths(program: Program, point: Point, per: float) -> Iterator[Pressure]:
    problem, first = program.problem, program.widths_at.start
    for k, free in enumerate(problem.half_widths if problem.objective != "scaling" else ()):
        multiplier, words = float(point.bound_multipliers[first + k]), in_words(problem, k)
        step, unit = (radians(0.01), "0.01 deg") if unit_of(problem, k) == "rad" else (0.01, "0.01 mm")
        here, native = float(np.exp(point.x[first + k])), unit.rpartition(" ")[2]
        if problem.objective == "cost" and abs(multiplier) < BETWEEN:
            tighter, room = f"{words} tighter by {{step}} {native}", for_people(problem, k, here)[0]
            yield Pressure(f"{words} half-width", unit, slope_of(free.price, here) * step, tighter, room, own=True)
        bound, which = (free.maximum, "largest") if multiplier > 0 else (free.minimum, "smallest")
        more, room = f"{{step}} {native} more on the {which} half-width of {words}", for_people(problem, k, bound)[0]
        yield Pressure(f"{words} {which} half-width", unit, -multiplier * per / bound * step, more, room)


def list_rules(program: Program, point: Point, per: float) -> Iterator[Pressure]:
    """Of the rules of a layout: distances, how far fiducials may move, and faces of boxes, those of one region
    together; ``per``: the objective for a change of 1 of what the programme minimises."""
    problem = program.problem
    for kind, (name, unit, size) in problem.distances.items():
        if size > 0:
            phrase = f"{{step}} {unit} less {name.rsplit('_', 1)[0].replace('_', ' ')}"
            yield Pressure(name, unit, _sum_rows(program, point, kind) * -2 / size * per, phrase, size, less=True)
    if problem.stay is not None and (most := problem.stay.at_most_mm) < inf:
        per_mm = _sum_rows(program, point, "stay") * 2 / most * per
        yield Pressure("at_most_mm", "mm", per_mm, "moving by {step} mm more", most)
    pressed: dict[tuple[str, int, str], tuple[float, float]] = {}
    for called, row, first in _list_boxes(program):
        for k in range(3):
            half, multiplier = float(program.half[row, k]), float(point.bound_multipliers[first + k])
            if half > 0 and multiplier:
                key = called, k, "upper" if multiplier > 0 else "lower"
                pressed[key] = pressed.get(key, (0.0, 0.0))[0] + abs(multiplier) / half, 2 * half
    for (called, k, side), (total, room) in sorted(pressed.items()):
        name = f"{side} {'xyz'[k]} {called}"
        yield Pressure(name, "mm", -total * per, f"moving the {name} out by {{step}} mm", room)


def _list_boxes(program: Program) -> Iterator[tuple[str, int, int]]:
    """What a face is called of each box in which a fiducial or a pivot is free, its row in ``half``, and its first
    variable."""
    places = program.problem.places
    several = len({place.pointer for place in places}) > 1
    for g, place in enumerate(places):
        if isinstance(place.region, BoxRegion):
            yield "face of the box" + (f" at {place.pointer}" if several else ""), g, 3 * g
    for p, free in enumerate(program.problem.pivots):
        called = f"bound of the pivot of {label_of(program.problem, free.contributor)}"
        yield called, len(places) + p, program.pivots_at.start + 3 * p

"""What one unit of each limit and bound is worth, from the multipliers."""

from __future__ import annotations

from collections.abc import Callable
from math import floor, log10, radians

import numpy as np

from ..results import ShadowPrice
from .prices import slope_of
from .problem import in_words, label_of, unit_of
from .program import Point, Program
from .regions import Box

Add = Callable[..., None]
BETWEEN = 1e-6  # multiplier of a bound that does not press
PRICED = 1e-2  # per cent of the objective for one step: smaller shadow prices only fill the page


def shadow_prices(
    program: Program, point: Point, objective: float, whole: float | None = None
) -> tuple[ShadowPrice, ...]:
    """Derivatives of the objective (cost; or the quantile in mm, where that is least) by every limit that binds.

    By the envelope theorem ``d log f / d theta`` is the partial derivative of the Lagrangian of ``log f``: a limit L
    enters as ``-2 log L`` with multiplier lambda, so its price is ``-2 lambda f / L`` per mm; a bound h of a
    half-width through its logarithm, ``-mu f / h``; a spacing d as ``-2 / d`` where it binds; a face of the box at
    distance ``half`` from the centre per scaled unit.  Where the quantile is least the programme minimises
    ``s = 2 log``, so every price is half of that.
    Percentages are of ``whole`` when something was bought besides (grades).
    """
    problem = program.problem
    whole = objective if whole is None else whole
    quantile_least = problem.objective == "quantile"
    per = 0.5 if quantile_least else 1.0
    what = "the quantile" if quantile_least else "cost"
    prices: list[ShadowPrice] = []

    def add(name: str, unit: str, per_unit: float, phrase: str, step: float = 1.0, verb: str | None = None) -> None:
        share = 100 * abs(per_unit) * step / whole
        if share > PRICED:
            effect = ("saves " if per_unit < 0 else "adds ") if verb is None else verb
            prices.append(ShadowPrice(name, unit, float(per_unit), f"{phrase} {effect}{share:.3g} % of {what}"))

    rows = point.row_multipliers
    for requirement in problem.requirements:
        pressed = sum(
            float(rows[t]) for t, term in enumerate(program.terms) if term.demand.requirement.name == requirement.name
        )
        if not quantile_least:
            limit = requirement.limit_mm
            step = 10.0 ** floor(log10(limit / 10))  # small enough for a derivative to mean something
            name = "limit" if len(problem.requirements) == 1 else f"limit of {requirement.name}"
            phrase = f"{step:g} mm more on the {name} ({limit:g} mm)" if " of " in name else (
                f"{step:g} mm more on the limit of {limit:g} mm"
            )  # fmt: skip
            add(name, "mm", -2 * pressed * objective / limit, phrase, step)
    for row, multiplier in zip(program.rows, rows, strict=True):
        if row.kind == "cost" and problem.cost_limit is not None:
            step = 10.0 ** floor(log10(problem.cost_limit / 10))
            per_unit = -per * float(multiplier) / problem.cost_limit * objective
            add("cost_limit", "cost", per_unit, f"{step:g} more on the cost limit", step)
    _widths(program, point, objective * per, add)
    _spacings(program, point, objective * per, add)
    _places(program, point, objective * per, add)
    _mechanics(program, point, objective * per, add)
    return tuple(prices)


def _widths(program: Program, point: Point, objective: float, add: Add) -> None:
    problem = program.problem
    if problem.objective == "scaling":
        return
    for k, free in enumerate(problem.half_widths):
        multiplier = float(point.bound_multipliers[program.widths_at.start + k])
        step, unit = (radians(0.01), "0.01 deg") if unit_of(problem, k) == "rad" else (0.01, "0.01 mm")
        if problem.objective == "cost" and abs(multiplier) < BETWEEN:
            own = slope_of(free.price, float(np.exp(point.x[program.widths_at.start + k]))) * step
            words = in_words(problem, k)
            add(f"{words} half-width", unit, own, f"{unit} on {words} is worth", verb="")
        bound, which = (free.maximum, "largest") if multiplier > 0 else (free.minimum, "smallest")
        add(
            f"{in_words(problem, k)} {which} half-width", unit, -multiplier * objective / bound * step,
            f"{unit} more on the {which} half-width of {in_words(problem, k)}",
        )  # fmt: skip


def _spacings(program: Program, point: Point, objective: float, add: Add) -> None:
    problem, rows = program.problem, point.row_multipliers
    for kind, (name, unit, size) in {
        "spacing": ("min_spacing_mm", "mm", problem.min_spacing_mm),
        "projected_spacing": ("min_projected_spacing_px", "px", problem.min_projected_spacing_px),
        "target_clearance": ("target_clearance_px", "px", problem.target_clearance_px),
    }.items():
        total = sum(float(m) for m, row in zip(rows, program.rows, strict=True) if row.kind == kind)
        if size > 0:
            phrase = f"1 {unit} more {name.rsplit('_', 1)[0].replace('_', ' ')}"
            add(name, unit, total * -2 / size * objective, phrase)


def _places(program: Program, point: Point, objective: float, add: Add) -> None:
    """Faces of the boxes, those of one region together."""
    problem = program.problem
    pressed: dict[tuple[str, int, str], float] = {}
    for g, place in enumerate(problem.places):
        if not isinstance(place.region, Box):
            continue
        for k in range(3):
            half = float(program.half[g, k])
            multiplier = float(point.bound_multipliers[3 * g + k])
            if half > 0 and multiplier:
                key = (place.pointer, k, "upper" if multiplier > 0 else "lower")
                pressed[key] = pressed.get(key, 0.0) + abs(multiplier) / half
    several = len({place.pointer for place in problem.places}) > 1
    for (pointer, k, word), total in sorted(pressed.items()):
        face = f"{word} {'xyz'[k]} face of the box" + (f" at {pointer}" if several else "")
        add(face, "mm", -total * objective, f"moving the {face} out by 1 mm")


def _mechanics(program: Program, point: Point, objective: float, add: Add) -> None:
    problem = program.problem
    for p, free in enumerate(problem.pivots):
        for k in range(3):
            half = float(program.half[len(program.movable) + p, k])
            multiplier = float(point.bound_multipliers[program.pivots_at.start + 3 * p + k])
            if half > 0 and multiplier:
                word = "upper" if multiplier > 0 else "lower"
                name = f"{word} {'xyz'[k]} bound of the pivot of {label_of(problem, free.contributor)}"
                per_mm = -abs(multiplier) / half * objective
                add(name, "mm", per_mm, f"moving the {name} out by 1 mm")
    for i, spacing in enumerate(problem.spacings):
        multiplier = float(point.bound_multipliers[program.spacings_at.start + i])
        if multiplier:
            bound, word = (spacing.maximum, "largest") if multiplier > 0 else (spacing.minimum, "smallest")
            name = f"{word} locator spacing of {label_of(problem, spacing.contributor)}"
            add(name, "factor", -multiplier / bound * objective, f"0.1 more on the {name}", 0.1)

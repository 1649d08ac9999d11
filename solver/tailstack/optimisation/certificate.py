"""What an optimum is worth, from its multipliers.

The optimality residual is recomputed here, not taken from the solver; what binds is named; one unit of each limit and
bound has its price.
"""

from __future__ import annotations

from collections.abc import Callable
from math import floor, log10, radians

import numpy as np

from ..arrays import Array
from ..results import ShadowPrice
from .prices import slope_of
from .problem import PlacementProblem, for_people, in_words, label_of, unit_of
from .program import Parameters, Point, Program, Row
from .regions import Box

ACTIVE = 1e-6  # slack, in the scaled units of the programme, up to which a constraint binds
TOUCHING = 1e-4  # of a rule of the layout: half of that in a distance
SAMPLED_ACTIVE = 1e-3  # of a quantile that is sampled


def kkt_residual(program: Program, point: Point, parameters: Parameters) -> float:
    """Largest violation of the first-order conditions at a point, each in the programme's scaled units.

    Stationarity ``|grad f + J' lambda + mu|`` over the variables that are not held, divided by the largest
    multiplier when that exceeds one; complementarity ``|multiplier| * slack``; feasibility.  Recomputed here
    from the returned multipliers, not taken from the solver; with ``parameters`` corrected to the exact law at this
    point, the conditions are those of the exact law.
    """
    p = parameters.vector(program, "main")
    lower, upper = program.bounds("main")
    x, rows, bounds = point.x, point.row_multipliers, point.bound_multipliers
    gradient = program.gradient(x, p)[1].full().ravel()
    g, jacobian = program.jacobian(x, p)
    values = g.full().ravel()
    moving = upper > lower
    stationarity = (gradient + jacobian.full().T @ rows + bounds)[moving]
    scale = max(1.0, float(np.abs(rows).max(initial=0.0)), float(np.abs(bounds[moving]).max(initial=0.0)))
    row_lower = np.array([row.lower for row in program.rows])
    row_upper = np.array([row.upper for row in program.rows])
    pieces = [
        np.abs(stationarity) / scale,
        _complementarity(rows, values, row_lower, row_upper) / scale,
        _complementarity(bounds[moving], x[moving], lower[moving], upper[moving]) / scale,
        np.maximum(row_lower - values, 0),
        np.maximum(values - row_upper, 0),
    ]
    return float(max(piece.max(initial=0.0) for piece in pieces))


def _complementarity(multiplier: Array, value: Array, lower: Array, upper: Array) -> Array:
    """|multiplier| times the distance to the bound its sign speaks of (negative: the lower one)."""
    distance = np.where(multiplier > 0, upper - value, value - lower)
    # A multiplier on a side without a bound violates the conditions by itself.
    distance = np.where(np.isfinite(distance), np.maximum(distance, 0), 1.0)
    return np.asarray(np.abs(multiplier) * distance)


def binding(program: Program, point: Point, parameters: Parameters) -> tuple[str, ...]:
    """The constraints that hold with equality, in the user's words."""
    values = program.constraints(point.x, parameters.vector(program, "main"))[1].full().ravel()
    found: list[str] = []
    touched: dict[str, list[str]] = {}
    labels = program.problem.system.fiducial_labels
    for t, (row, value) in enumerate(zip(program.rows, values, strict=True)):
        if row.lower == row.upper:  # on a surface by definition
            continue
        if row.kind in ("quantile", "cost"):
            sampled = row.kind == "quantile" and program.terms[t].demand.per_unit
            if value >= row.upper - (SAMPLED_ACTIVE if sampled else 10 * ACTIVE):
                found.append(_upper_text(program, t, row))
        elif value <= row.lower + TOUCHING:
            face = row.text.partition(" at the ")[2] if row.kind == "region" else ""
            if face:
                touched.setdefault(f"at the {face}", []).append(labels[row.fiducials[0]])
            else:
                found.append(row.text + _minimum(program.problem, row.kind))
    found += [f"{', '.join(names)} {face}" for face, names in touched.items()]
    return (*found, *_faces(program, point), *_bounds_on_widths(program, point), *_bounds_on_mechanics(program, point))


def _upper_text(program: Program, t: int, row: Row) -> str:
    if row.kind == "cost":
        return f"the cost limit of {program.problem.cost_limit:g}"
    requirement = program.terms[t].demand.requirement
    if program.problem.objective == "quantile":
        return f"{row.text}: the largest part of its limit ({requirement.name})"
    return f"{row.text}, limit {requirement.limit_mm:g} mm ({requirement.name})"


def _minimum(problem: PlacementProblem, kind: str) -> str:
    return {
        "spacing": f" at {problem.min_spacing_mm:g} mm",
        "projected_spacing": f" at {problem.min_projected_spacing_px:g} px",
        "target_clearance": f" at {problem.target_clearance_px:g} px",
        "field": f" (margin {problem.image_margin_px:g} px)",
    }.get(kind, "")


def _at_bound(program: Program, point: Point, index: int) -> int:
    """-1 at the lower bound, +1 at the upper one, 0 between them or where there is no room."""
    lower, upper = program.bounds("main")
    if upper[index] - lower[index] <= 0:
        return 0
    x = point.x[index]
    return 1 if x >= upper[index] - ACTIVE else -1 if x <= lower[index] + ACTIVE else 0


def _faces(program: Program, point: Point) -> list[str]:
    """Fiducials on the faces of their boxes, those on the same faces together."""
    problem = program.problem
    found: dict[str, list[str]] = {}
    for g, place in enumerate(problem.places):
        if not isinstance(place.region, Box):
            continue
        sides = [(k, _at_bound(program, point, 3 * g + k)) for k in range(3)]
        faces = [
            f"{'xyz'[k]} = {(place.region.high_mm if side > 0 else place.region.low_mm)[k]:g} mm"
            for k, side in sides
            if side
        ]
        if faces:
            label = problem.system.fiducial_labels[place.fiducials[0]]
            found.setdefault(", ".join(faces), []).append(label)
    return [f"{', '.join(labels)} on the box at {faces}" for faces, labels in found.items()]


def _bounds_on_widths(program: Program, point: Point) -> list[str]:
    problem = program.problem
    if problem.objective == "scaling":
        side = _at_bound(program, point, program.widths_at.start)
        return ["the common factor at a bound of some half-width"] if side else []
    found = []
    for k, free in enumerate(problem.half_widths):
        side = _at_bound(program, point, program.widths_at.start + k)
        if side:
            value, unit = for_people(problem, k, free.maximum if side > 0 else free.minimum)
            which = "largest" if side > 0 else "smallest"
            found.append(f"{in_words(problem, k)} at its {which} half-width, {value:.4g} {unit}")
    return found


def _bounds_on_mechanics(program: Program, point: Point) -> list[str]:
    problem, found = program.problem, []
    for p, free in enumerate(problem.pivots):
        for k in range(3):
            side = _at_bound(program, point, program.pivots_at.start + 3 * p + k)
            if side:
                bound = (free.high_mm if side > 0 else free.low_mm)[k]
                found.append(f"pivot of {label_of(problem, free.contributor)} at {'xyz'[k]} = {bound:g} mm")
    for i, spacing in enumerate(problem.spacings):
        side = _at_bound(program, point, program.spacings_at.start + i)
        if side:
            bound = spacing.maximum if side > 0 else spacing.minimum
            found.append(f"locators of {label_of(problem, spacing.contributor)} at {bound:g} times their spacing")
    return found


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
    _price_widths(program, point, objective * per, add)
    _spacings(program, point, objective * per, add)
    _places(program, point, objective * per, add)
    _price_mechanics(program, point, objective * per, add)
    return tuple(prices)


def _price_widths(program: Program, point: Point, objective: float, add: Add) -> None:
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


def _price_mechanics(program: Program, point: Point, objective: float, add: Add) -> None:
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

"""What an optimum is worth: optimality residual recomputed from the multipliers, shadow prices, what binds."""

from __future__ import annotations

from math import degrees, floor, log10, radians

import numpy as np

from ..results import ShadowPrice
from ..system import Array
from .problem import in_words
from .program import Parameters, Point, Program

ACTIVE = 1e-6  # slack, in the scaled units of the programme, up to which a constraint binds
PRICED = 1e-2  # per cent of the cost for one step: smaller shadow prices only fill the page


def kkt_residual(program: Program, point: Point, parameters: Parameters) -> float:
    """Largest violation of the first-order conditions at a point, each in the programme's scaled units.

    Stationarity ``|grad f + J' lambda + mu|`` over the variables that are not held, divided by the largest
    multiplier when that exceeds one; complementarity ``|multiplier| * slack``; feasibility.  Recomputed here
    from the returned multipliers, not taken from the solver.
    """
    least = not program.problem.half_widths
    p = parameters.vector(least)
    lower, upper = program.bounds(least)
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
    problem = program.problem
    least = not problem.half_widths
    values = program.constraints(point.x, parameters.vector(least))[1].full().ravel()
    found = []
    for row, value in zip(program.rows, values, strict=True):
        if row.kind == "quantile":
            if not least and value >= row.upper - ACTIVE:
                found.append(f"{row.text}, limit {problem.requirement.limit_mm:g} mm ({problem.requirement.name})")
        elif value <= row.lower + ACTIVE:
            found.append(row.text + _minimum(program, row.kind))
    count = 3 * len(program.free)
    for row_index, i in enumerate(program.free):
        faces = []
        for k in range(3):
            coordinate = point.x[3 * row_index + k]
            if program.half[k] > 0 and abs(coordinate) >= 1 - ACTIVE:
                side = 1 if coordinate > 0 else 0
                faces.append(f"{'xyz'[k]} = {problem.box_mm[side, k]:g} mm")
        if faces:
            found.append(f"{problem.system.fiducial_labels[i]} on the box at {', '.join(faces)}")
    for k, free in enumerate(problem.half_widths):
        value = point.x[count + k]
        if value >= np.log(free.maximum) - ACTIVE:
            found.append(f"{in_words(problem, k)} at its largest half-width, {degrees(free.maximum):.4g} deg")
        elif value <= np.log(free.minimum) + ACTIVE:
            found.append(f"{in_words(problem, k)} at its smallest half-width, {degrees(free.minimum):.4g} deg")
    return tuple(found)


def _minimum(program: Program, kind: str) -> str:
    problem = program.problem
    return {
        "spacing": f" at {problem.min_spacing_mm:g} mm",
        "projected_spacing": f" at {problem.min_projected_spacing_px:g} px",
        "target_clearance": f" at {problem.target_clearance_px:g} px",
        "field": f" (margin {problem.image_margin_px:g} px)",
    }.get(kind, "")


def shadow_prices(program: Program, point: Point, cost: float) -> tuple[ShadowPrice, ...]:
    """What one unit of each limit is worth, from the multipliers of ``log cost``.

    By the envelope theorem ``d log cost / d theta`` is the partial derivative of the Lagrangian: a limit L enters as
    ``-2 log L`` with multiplier lambda, so its price is ``-2 lambda cost / L`` per mm; a bound h of a half-width enters
    through its logarithm, ``-mu cost / h``; a spacing d through ``-2 / d`` where it binds; a face of the box at
    distance ``half`` from the centre per scaled unit.
    """
    problem = program.problem
    if not problem.half_widths:
        return ()
    prices: list[ShadowPrice] = []

    def add(name: str, unit: str, per_unit: float, phrase: str, step: float = 1.0) -> None:
        share = 100 * abs(per_unit) * step / cost
        if share > PRICED:
            effect = "saves" if per_unit < 0 else "adds"
            prices.append(ShadowPrice(name, unit, float(per_unit), f"{phrase} {effect} {share:.3g} % of cost"))

    limit = problem.requirement.limit_mm
    rows = point.row_multipliers
    quantile = sum(m for m, row in zip(rows, program.rows, strict=True) if row.kind == "quantile")
    per_mm = -2 * float(quantile) * cost / limit
    step = 10.0 ** floor(log10(limit / 10))  # a step small enough for a derivative to mean something
    add("limit", "mm", per_mm, f"{step:g} mm more on the limit of {limit:g} mm", step)
    count = 3 * len(program.free)
    for k, free in enumerate(problem.half_widths):
        multiplier = float(point.bound_multipliers[count + k])
        bound, which = (free.maximum, "largest") if multiplier > 0 else (free.minimum, "smallest")
        per_step = -multiplier * cost / bound * radians(0.01)
        add(
            f"{in_words(problem, k)} {which} half-width", "0.01 deg", per_step,
            f"0.01 deg more on the {which} half-width of {in_words(problem, k)}",
        )  # fmt: skip
    spacings = {
        "spacing": ("min_spacing_mm", "mm", problem.min_spacing_mm),
        "projected_spacing": ("min_projected_spacing_px", "px", problem.min_projected_spacing_px),
        "target_clearance": ("target_clearance_px", "px", problem.target_clearance_px),
    }
    for kind, (name, unit, size) in spacings.items():
        total = sum(float(m) for m, row in zip(rows, program.rows, strict=True) if row.kind == kind)
        if size > 0:
            add(name, unit, total * -2 / size * cost, f"1 {unit} more {name.rsplit('_', 1)[0].replace('_', ' ')}")
    faces = point.bound_multipliers[:count].reshape(-1, 3)
    for k in range(3):
        for side, word in ((-1, "lower"), (1, "upper")):
            pressed = float(np.maximum(side * faces[:, k], 0).sum())
            if program.half[k] > 0:
                face = f"{word} {'xyz'[k]} face of the box"
                add(face, "mm", -pressed / float(program.half[k]) * cost, f"moving the {face} out by 1 mm")
    return tuple(prices)

"""What an optimum is worth: optimality residual recomputed from the multipliers, and what binds."""

from __future__ import annotations

import numpy as np

from ..system import Array
from .problem import PlacementProblem, for_people, in_words, label_of
from .program import Parameters, Point, Program
from .regions import Box
from .rules import Row

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
    return (*found, *_faces(program, point), *_widths(program, point), *_mechanics(program, point))


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


def _widths(program: Program, point: Point) -> list[str]:
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


def _mechanics(program: Program, point: Point) -> list[str]:
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

"""Why nothing meets the limits: the smallest quantile attainable, what stands in the way, what would cure it."""

from __future__ import annotations

from dataclasses import replace
from math import ceil, log10
from typing import Any

import casadi as ca
import numpy as np

from ..errors import InfeasibleError, NotConvergedError, Problem
from ..propagation.linear import LinearModel
from ..system import Array
from .problem import Demand, PlacementProblem, label_of, least_half_widths
from .program import QUIET, Parameters, Point, Program
from .promise import Promise, exact_quantile, promise
from .rules import Row

LEADING = 3  # contributors named
NOISE = ("fiducial_noise:", "target_noise:")
SATISFIED = 1e-4  # slack of a rule, in scaled units, that is rounding
RELIEF = 0.1  # per cent of the quantile for 1 mm or 1 px: less is no cure


def explain_infeasible(program: Program, point: Point, parameters: Parameters | None = None) -> InfeasibleError:
    """The answer "there is none": at the choice of the smallest quantile, every free half-width at its smallest."""
    problem = program.problem
    choice = replace(program.split(point.x), half_width=least_half_widths(problem, program.present_width))
    held = [promise(problem, term, choice) for term in program.terms]
    k = int(np.argmax([item.exact_mm / item.limit_mm for item in held]))
    worst, term = held[k], program.terms[k]
    requirement = term.demand.requirement
    tight = ", every free half-width at its smallest" if problem.half_widths else ""
    aim = f"the limit of {requirement.limit_mm:g} mm"
    if parameters is not None and parameters.log_limits[k] < np.log(requirement.limit_mm * (1 - 1e-4)):
        aim += f" (with the margin the Monte Carlo check needs: {np.exp(parameters.log_limits[k]):.4g} mm)"
    shares = _shares(worst, requirement.error)
    cures = [*_cures(problem, term.demand, worst.model), *_room(program, point)]
    digits = 3 - ceil(log10(worst.exact_mm))
    enough = ceil(worst.exact_mm * 10**digits) / 10**digits
    return InfeasibleError(
        Problem(
            "/optimise",
            "limit-out-of-reach",
            f"the smallest {term.demand.text.replace(' at target', ' found within the given freedom, at target')}, is "
            f"{worst.exact_mm:.4g} mm{tight}; {aim} lies below it. Share of the mean square there: {shares}",
            f"raise the limit above {enough:g} mm" + "".join(f"; or {cure}" for cure in cures),
        )
    )


def _shares(worst: Promise, error: str) -> str:
    """What makes up the mean square, largest first."""
    shares: dict[str, float] = {}
    for block in worst.model.blocks:
        scaled = worst.model.gain(block, error) * block.std
        shares[block.contributor] = shares.get(block.contributor, 0.0) + float((scaled**2).sum())
    if float(worst.mean_mm @ worst.mean_mm) > 0:
        shares["bias and bounded components"] = float(worst.mean_mm @ worst.mean_mm)
    whole = sum(shares.values())
    leading = sorted(shares.items(), key=lambda item: -item[1])[:LEADING]
    return ", ".join(f"{name} {100 * value / whole:.0f} %" for name, value in leading if value > 0.01 * whole)


def _cures(problem: PlacementProblem, demand: Demand, model: LinearModel) -> list[str]:
    """By how much one contributor at a time would have to shrink; all of them together where none is enough."""
    limit = demand.requirement.limit_mm
    names = {block.contributor: _noise_or_itself(block.contributor) for block in model.blocks}
    weight: dict[str, float] = {}
    for block in model.blocks:
        size = float(((model.gain(block, demand.requirement.error) * block.half_width) ** 2).sum())
        weight[names[block.contributor]] = weight.get(names[block.contributor], 0.0) + size
    found = []
    for name in sorted(weight, key=lambda name: -weight[name])[:LEADING]:
        factor = _factor(model, demand, {block for block, group in names.items() if group == name}, limit)
        if factor is not None:
            found.append(f"bring {_in_words(problem, name)} to {factor:.2g} of what it is there")
    if not found:
        factor = _factor(model, demand, set(names), limit)
        if factor is None:
            found.append("remove the known bias: it alone is over the limit")
        else:
            found.append(f"bring every random contributor to {factor:.2g} of what it is there: none alone is enough")
    return found


def _noise_or_itself(contributor: str) -> str:
    return "image noise" if contributor.startswith(NOISE) else contributor


def _in_words(problem: PlacementProblem, name: str) -> str:
    if name in ("interface_1", "interface_2"):
        return f"every tolerance of {label_of(problem, name)} ({name})"
    return {"image noise": "the image noise"}.get(name, f"{name}")


def _factor(model: LinearModel, demand: Demand, contributors: set[str], limit_mm: float) -> float | None:
    """Largest factor on these contributors with which the quantile is within the limit, rounded down; or None."""

    def quantile(factor: float) -> float:
        blocks = tuple(
            block._replace(half_width=block.half_width * factor, std=block.std * factor)
            if block.contributor in contributors
            else block
            for block in model.blocks
        )
        return exact_quantile(replace(model, blocks=blocks), demand).value_mm

    low, high = 0.01, 1.0
    if quantile(low) > limit_mm:
        return None
    for _ in range(12):
        middle = (low + high) / 2
        low, high = (middle, high) if quantile(middle) <= limit_mm else (low, middle)
    digits = 1 - ceil(log10(low))
    return float(np.floor(low * 10 ** (digits + 1)) / 10 ** (digits + 1))


def _room(program: Program, point: Point) -> list[str]:
    """Which rule of the layout stands in the way most, from the multipliers of the smallest quantile."""
    problem = program.problem
    relief: dict[str, float] = {}

    def add(what: str, per_cent: float) -> None:
        relief[what] = relief.get(what, 0.0) + per_cent

    for g, place in enumerate(problem.places):
        for k in range(3):
            half, multiplier = float(program.half[g, k]), float(point.bound_multipliers[3 * g + k])
            if half > 0:
                face = f"moving the {'upper' if multiplier > 0 else 'lower'} {'xyz'[k]} face of {place.pointer} out"
                add(f"{face} by 1 mm", 50 * abs(multiplier) / half)
    sizes = {"spacing": ("min_spacing_mm", problem.min_spacing_mm, "mm"),
             "projected_spacing": ("min_projected_spacing_px", problem.min_projected_spacing_px, "px"),
             "target_clearance": ("target_clearance_px", problem.target_clearance_px, "px")}  # fmt: skip
    for row, multiplier in zip(program.rows, point.row_multipliers, strict=True):
        if row.kind in sizes:
            field, size, unit = sizes[row.kind]
            add(f"taking 1 {unit} off {field}", 100 * abs(float(multiplier)) / size)
    best = sorted(relief.items(), key=lambda item: -item[1])[:2]
    return [f"{what} lowers it by {value:.2g} %" for what, value in best if value > RELIEF]


def refuse_geometry(program: Program, points: list[tuple[Point, Parameters]]) -> InfeasibleError | NotConvergedError:
    """Not even the rules of the layout could be met: which would have to give way, by elastic relaxation.

    Every rule (all rows of a kind) gets one slack >= 0, the sum of slacks is minimised (an exact penalty): rules that
    keep a slack are the ones that stand in each other's way, and its size says by how much.
    """
    rows = program.rows
    kinds = sorted({row.kind for row in rows} - {"quantile", "cost"})
    best, violated = _relaxed(program, points, kinds)
    if max(best) <= SATISFIED:
        detail = "the rules of the layout can be met, but no start converged: no answer could be found"
        return NotConvergedError(Problem("/optimise", "none-converged", detail, "try more starts or another seed"))
    named = []
    for kind, slack in zip(kinds, best, strict=True):
        if slack > SATISFIED:
            worst = max((value, row.text) for value, row in violated if row.kind == kind)[1]
            named.append(f"{_in_its_unit(program.problem, kind, slack)} (worst: {worst})")
    return InfeasibleError(
        Problem(
            "/optimise",
            "layout-out-of-reach",
            "no start met all rules of the layout at once; the smallest relaxation found: " + "; ".join(named),
            "relax it as said, give the fiducials more room, or use fewer",
        )
    )


def _relaxed(
    program: Program, points: list[tuple[Point, Parameters]], kinds: list[str]
) -> tuple[Array, list[tuple[float, Row]]]:
    """(slack of each rule, rows with their violation) where the sum of slacks is least."""
    nlp, rows = program.expressions, program.rows
    geometric = [k for k, row in enumerate(rows) if row.kind in kinds]
    slack = ca.SX.sym("slack", len(kinds))
    kept: list[Any] = []
    for k in geometric:
        given = slack[kinds.index(rows[k].kind)]
        kept += [nlp["g"][k] + given] if rows[k].lower < rows[k].upper else [nlp["g"][k] + given, given - nlp["g"][k]]
    count = nlp["x"].numel()
    solver = ca.nlpsol(
        "elastic", "ipopt",
        {"x": ca.vertcat(nlp["x"], slack), "p": nlp["p"], "f": ca.sum1(slack), "g": ca.vertcat(*kept)},
        QUIET | {"ipopt.max_iter": 500, "ipopt.tol": 1e-6},
    )  # fmt: skip
    lower, upper = program.bounds("main")
    best: tuple[float, Array, Array, Parameters] | None = None
    for point, parameters in points:
        result = solver(
            x0=np.concatenate([np.clip(point.x, lower, upper), np.ones(len(kinds))]),
            p=parameters.vector(program, "main"),
            lbx=np.concatenate([lower, np.zeros(len(kinds))]),
            ubx=np.concatenate([upper, np.full(len(kinds), np.inf)]),
            lbg=0.0,
            ubg=np.inf,
        )
        x = result["x"].full().ravel()
        if best is None or float(result["f"]) < best[0]:
            best = (float(result["f"]), x[count:], x[:count], parameters)
    assert best is not None  # there is always a start
    values = program.constraints(best[2], best[3].vector(program, "main"))[1].full().ravel()
    return best[1], [(float(max(rows[k].lower - values[k], values[k] - rows[k].upper)), rows[k]) for k in geometric]


def _in_its_unit(problem: PlacementProblem, kind: str, slack: float) -> str:
    """A rule as relaxed."""
    sizes = {"spacing": ("min_spacing_mm", problem.min_spacing_mm),
             "projected_spacing": ("min_projected_spacing_px", problem.min_projected_spacing_px),
             "target_clearance": ("target_clearance_px", problem.target_clearance_px)}  # fmt: skip
    if kind in sizes:
        field, size = sizes[kind]
        return f"{field} {size * max(1 - slack, 0.0) ** 0.5:.4g} instead of {size:g}"
    name = {"field": "the field of view", "region": "the regions", "keep_out": "the keep-out zones"}[kind]
    return f"{name} exceeded by {100 * slack:.2g} % of their size"

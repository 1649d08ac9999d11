"""Why nothing meets the limit: the smallest quantile attainable, and what makes it up."""

from __future__ import annotations

from math import ceil, log10

import numpy as np

from ..errors import InfeasibleError, Problem
from .program import Parameters, Point, Program
from .promise import promise


def explain_infeasible(program: Program, point: Point, aim_mm: float) -> InfeasibleError:
    """The answer "there is none": at the layout of the smallest quantile, every free half-width at its smallest."""
    problem = program.problem
    requirement = problem.requirement
    fiducials, _, _ = program.split(point.x)
    half_width = problem.lower
    held = [promise(problem, term, fiducials, half_width) for term in program.terms]
    k = int(np.argmax([item.exact_mm for item in held]))
    least, model = held[k].exact_mm, held[k].model
    shares: dict[str, float] = {}
    for block in model.blocks:
        scaled = model.gain(block, requirement.error) * block.std
        shares[block.contributor] = shares.get(block.contributor, 0.0) + float((scaled**2).sum())
    term = program.terms[k]
    offset = held[k].mean_mm
    if float(offset @ offset) > 0:
        shares["bias and bounded components"] = float(offset @ offset)
    whole = sum(shares.values())
    leading = sorted(shares.items(), key=lambda item: -item[1])[:3]
    parts = ", ".join(f"{name} {100 * value / whole:.0f} %" for name, value in leading if value > 0.01 * whole)
    quantile = f"P{100 * requirement.quantile:g}"
    tight = ", every free half-width at its smallest" if problem.half_widths else ""
    aim = f"the limit of {requirement.limit_mm:g} mm"
    if aim_mm < requirement.limit_mm * (1 - 1e-9):
        aim += f" (with the margin the Monte Carlo check needs: {aim_mm:.4g} mm)"
    digits = 3 - ceil(log10(least))
    return InfeasibleError(
        Problem(
            "/optimise",
            "limit-out-of-reach",
            f"the smallest {quantile} found within the given freedom is {least:.4g} mm, at target "
            f"{term.target.name!r}{tight}; {aim} lies below it. Share of the mean square there: {parts}",
            f"raise the limit above {ceil(least * 10**digits) / 10**digits:g} mm, reduce what leads that list, or give "
            "the fiducials more room",
        )
    )


def refuse_geometry(program: Program, points: list[Point], parameters: Parameters) -> InfeasibleError:
    """Not even the constraints on the layout could be met: name the one violated most."""
    lower = np.array([row.lower for row in program.rows])
    upper = np.array([row.upper for row in program.rows])
    worst: list[tuple[float, str]] = []
    for point in points:
        values = program.constraints(point.x, parameters.vector(True))[1].full().ravel()
        violation = np.maximum(np.maximum(lower - values, values - upper), 0)
        violation[: len(program.terms)] = 0
        k = int(np.argmax(np.nan_to_num(violation)))
        worst.append((float(violation[k]), program.rows[k].text))
    violation_least, text = min(worst)
    return InfeasibleError(
        Problem(
            "/optimise",
            "layout-out-of-reach",
            f"no start met all spacing and field-of-view constraints; the nearest one still fails the "
            f"{text} (by {100 * violation_least:.2g} % in scaled units)",
            "give the fiducials more room, or relax min_spacing_mm, min_projected_spacing_px or image_margin_px",
        )
    )

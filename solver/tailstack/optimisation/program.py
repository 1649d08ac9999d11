"""The nonlinear programme: one CasADi expression, built once, solved from many starts by IPOPT.

Variables: free positions scaled to [-1, 1] in the box, logarithms of the free half-widths, and a slack s.
``log q_t^2 - 2 log limit_t <= s`` at every target, so that one programme serves two questions: with
``s = 0`` and the logarithm of the cost as objective, the optimum; with the half-widths at their smallest
and s as objective, the smallest quantile attainable.  Logarithms make both scale free.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ..system import Array
from .problem import PlacementProblem
from .symbols import elements, plain
from .terms import Estimator, TargetTerms, image_covariance, moments

QUIET: dict[str, Any] = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.linear_solver": "mumps",
    "ipopt.bound_relax_factor": 0.0,
    "show_eval_warnings": False,
}
EXPLORE = QUIET | {"ipopt.tol": 1e-5, "ipopt.max_iter": 250}
# Started at a point that another solve of nearly the same programme ended at.
POLISH = QUIET | {
    "ipopt.tol": 1e-9,
    "ipopt.max_iter": 150,
    # Where the layout hardly matters, the last digits of flat directions are not worth a hundred iterations.
    "ipopt.acceptable_tol": 1e-7,
    "ipopt.acceptable_iter": 6,
    "ipopt.warm_start_init_point": "yes",
    "ipopt.mu_init": 1e-5,
    "ipopt.warm_start_bound_push": 1e-7,
    "ipopt.warm_start_bound_frac": 1e-7,
    "ipopt.warm_start_slack_bound_push": 1e-7,
    "ipopt.warm_start_slack_bound_frac": 1e-7,
    "ipopt.warm_start_mult_bound_push": 1e-7,
}
SLACK = 50.0  # |log| of how far the quantile may be from the limit in the question without a limit
SOLVED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")


@dataclass(frozen=True, slots=True)
class Row:
    """One constraint ``lower <= g <= upper`` and what it is about, in the user's words."""

    kind: str  # quantile, spacing, projected_spacing, target_clearance, field, front
    text: str
    lower: float
    upper: float


@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """Where a solve ended: variables, multipliers of rows and of bounds (CasADi's signs), and how."""

    x: Array
    row_multipliers: Array
    bound_multipliers: Array
    objective: float  # log of the cost, or s
    solved: bool
    iterations: int


@dataclass(frozen=True, slots=True, eq=False)
class Parameters:
    """What may change between solves of one programme."""

    log_limits: Array  # (T,) log of the limit set at each target, mm
    signs: Array  # (T, B) ends of the fixed bounded sources
    free_signs: Array  # (T, K) ends of the free bounded half-widths

    def vector(self, least_quantile: bool) -> Array:
        return np.concatenate(
            [self.log_limits, self.signs.ravel(), self.free_signs.ravel(), [1.0 if least_quantile else 0.0]]
        )


@dataclass(frozen=True, slots=True, eq=False)
class Program:
    """The compiled programme.  ``coordinates = centre + half * x`` for the free fiducials."""

    problem: PlacementProblem
    terms: tuple[TargetTerms, ...]
    rows: tuple[Row, ...]
    free: NDArray[np.int64]  # (F,) indices of the free fiducials
    centre: Array  # (3,) mm
    half: Array  # (3,) mm
    explore: tuple[Any, ...]  # one solver per thread, sharing the derivatives
    polish: Any
    constraints: Any  # (x, p) -> (f, g)
    jacobian: Any
    gradient: Any

    def split(self, x: Array) -> tuple[Array, Array, float]:
        """All fiducials (N, 3) mm, free half-widths (K,), slack."""
        positions = self.problem.system.fiducials_mm.copy()
        count = 3 * len(self.free)
        positions[self.free] = self.centre + self.half * x[:count].reshape(-1, 3)
        return positions, np.exp(x[count:-1]), float(x[-1])

    def join(self, fiducials_mm: Array, half_width: Array, slack: float = 0.0) -> Array:
        """The variables of a choice; a box axis without extent holds its variable at 0."""
        scale = np.where(self.half > 0, self.half, 1.0)
        free = (fiducials_mm[self.free] - self.centre) / scale * (self.half > 0)
        return np.concatenate([np.clip(free, -1, 1).ravel(), np.log(half_width), [slack]])

    def bounds(self, least_quantile: bool) -> tuple[Array, Array]:
        """Bounds of the variables for either question."""
        extent = np.tile((self.half > 0).astype(float), len(self.free))
        low, high = np.log(self.problem.lower), np.log(self.problem.upper)
        if least_quantile:
            return np.concatenate([-extent, low, [-SLACK]]), np.concatenate([extent, low, [SLACK]])
        return np.concatenate([-extent, low, [0.0]]), np.concatenate([extent, high, [0.0]])


def build_program(
    problem: PlacementProblem, estimator: Estimator, terms: tuple[TargetTerms, ...], threads: int = 1
) -> Program:
    """Build expressions, exact derivatives, a solver for each thread and one that polishes, which share them."""
    free = np.array(problem.free_fiducials, dtype=np.int64)
    low, high = problem.box_mm
    centre, half = (low + high) / 2, (high - low) / 2
    widths_count = len(problem.half_widths)
    x = ca.SX.sym("x", 3 * len(free))
    u = ca.SX.sym("u", widths_count)
    s = ca.SX.sym("s")
    bounded = terms[0].bounded.shape[1]
    limits = ca.SX.sym("limits", len(terms))
    signs = ca.SX.sym("signs", len(terms), bounded)
    free_signs = ca.SX.sym("free_signs", len(terms), widths_count)
    least = ca.SX.sym("least")

    points = plain(problem.system.fiducials_mm)
    for position, i in enumerate(free):
        for k in range(3):
            points[i, k] = float(centre[k]) + float(half[k]) * x[3 * position + k]
    half_width = elements(ca.exp(u))
    rows: list[Row] = []
    g: list[Any] = []
    for t, term in enumerate(terms):
        image = image_covariance(estimator, term, points)
        law = moments(problem, term, image, half_width, elements(signs[t, :].T), elements(free_signs[t, :].T))
        g.append(ca.log(law.squared_quantile(problem.requirement.quantile, ca.sqrt)) - 2 * limits[t] - s)
        quantile = f"P{100 * problem.requirement.quantile:g}"
        rows.append(Row("quantile", f"{quantile} at target {term.target.name!r}", -np.inf, 0.0))
    for row, expression in _geometry(problem, estimator, terms, points):
        rows.append(row)
        g.append(expression)

    cost = ca.log(ca.dot(ca.DM(problem.weights), ca.exp(-u))) if widths_count else ca.SX(0)
    variables = ca.vertcat(x, u, s)
    # Row by row, as Parameters.vector lays them out.
    parameters = ca.vertcat(limits, ca.vec(signs.T), ca.vec(free_signs.T), least)
    objective, constraints = ca.cse([least * s + (1 - least) * cost, ca.vertcat(*g)])
    nlp = {"x": variables, "p": parameters, "f": objective, "g": constraints}
    explore = ca.nlpsol("explore", "ipopt", nlp, EXPLORE)
    shared = {
        "grad_f": explore.get_function("nlp_grad_f"),
        "jac_g": explore.get_function("nlp_jac_g"),
        "hess_lag": explore.get_function("nlp_hess_l"),
    }
    return Program(
        problem=problem,
        terms=terms,
        rows=tuple(rows),
        free=free,
        centre=centre,
        half=half,
        explore=(explore, *(ca.nlpsol("explore", "ipopt", nlp, EXPLORE | shared) for _ in range(threads - 1))),
        polish=ca.nlpsol("polish", "ipopt", nlp, POLISH | shared),
        constraints=ca.Function("constraints", [variables, parameters], [objective, constraints]),
        jacobian=shared["jac_g"],
        gradient=shared["grad_f"],
    )


def _geometry(
    problem: PlacementProblem, estimator: Estimator, terms: tuple[TargetTerms, ...], points: Any
) -> list[tuple[Row, Any]]:
    """Spacing, projected spacing, clearance of the targets' images, field of view; each about 1 in size."""
    found: list[tuple[Row, Any]] = []
    labels = problem.system.fiducial_labels
    free = set(problem.free_fiducials)
    pairs = [(i, j) for i, j in combinations(range(len(labels)), 2) if i in free or j in free]
    if problem.min_spacing_mm > 0:
        for i, j in pairs:
            gap = points[i] - points[j]
            text = f"spacing of {labels[i]} and {labels[j]}"
            found.append((Row("spacing", text, 0.0, np.inf), (gap @ gap) / problem.min_spacing_mm**2 - 1))
    told = points @ plain(estimator.told).T + plain(estimator.told_shift_mm)
    for view, projection in zip(problem.system.views, estimator.projections, strict=True):
        homogeneous = told @ plain(projection[:, :3]).T + plain(projection[:, 3])
        image = homogeneous[:, :2] / homogeneous[:, 2:]
        if problem.min_projected_spacing_px > 0:
            for i, j in pairs:
                gap = image[i] - image[j]
                text = f"images of {labels[i]} and {labels[j]} in {view.name}"
                scaled = (gap @ gap) / problem.min_projected_spacing_px**2 - 1
                found.append((Row("projected_spacing", text, 0.0, np.inf), scaled))
        if problem.target_clearance_px > 0:
            for term in terms:
                centre = projection[:, :3] @ term.reconstructed_mm + projection[:, 3]
                for i in sorted(free):
                    gap = image[i] - plain(centre[:2] / centre[2])
                    text = f"image of {labels[i]} and of target {term.target.name!r} in {view.name}"
                    scaled = (gap @ gap) / problem.target_clearance_px**2 - 1
                    found.append((Row("target_clearance", text, 0.0, np.inf), scaled))
        found += _field(problem, estimator, view, projection, homogeneous)
    return found


def _field(problem: PlacementProblem, estimator: Estimator, view: Any, projection: Array, homogeneous: Any) -> Any:
    """Inside the image with its margin, multiplied by the depth: linear in the position.

    A side that the whole box keeps (its corners do, and the constraint is linear) gives no rows.
    """
    if view.image_size_px is None:
        return []
    corners = box_corners(problem.box_mm) @ estimator.told.T + estimator.told_shift_mm
    seen = corners @ projection[:, :3].T + projection[:, 3]
    scale = float(np.abs(seen[:, 2]).mean()) * max(view.image_size_px)
    found = []
    for axis, sign, name in ((0, 1, "left"), (0, -1, "right"), (1, 1, "top"), (1, -1, "bottom")):
        edge = problem.image_margin_px if sign > 0 else view.image_size_px[axis] - 1 - problem.image_margin_px
        if (sign * (seen[:, axis] - edge * seen[:, 2]) >= 0).all():
            continue
        for i in problem.free_fiducials:
            text = f"{problem.system.fiducial_labels[i]} at the {name} edge of {view.name}"
            inside = sign * (homogeneous[i, axis] - float(edge) * homogeneous[i, 2]) / scale
            found.append((Row("field", text, 0.0, np.inf), inside))
    return found


def box_corners(box_mm: Array) -> Array:
    """(8, 3) corners of a (2, 3) box."""
    return np.array([[box_mm[i, 0], box_mm[j, 1], box_mm[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])


def solve(
    program: Program,
    start: Array,
    parameters: Parameters,
    *,
    least_quantile: bool = False,
    warm: Point | None = None,
    lane: int = 0,
) -> Point:
    """One solve from ``start``, or polishing from a point that an earlier solve ended at.

    Solves of different lanes may run at the same time; those of one lane, and polishing, may not.
    """
    lower, upper = program.bounds(least_quantile)
    given: dict[str, Any] = {
        "x0": np.clip(start if warm is None else warm.x, lower, upper),
        "p": parameters.vector(least_quantile),
        "lbx": lower,
        "ubx": upper,
        "lbg": [row.lower for row in program.rows],
        "ubg": [row.upper for row in program.rows],
    }
    solver = program.explore[lane]
    if warm is not None:
        solver = program.polish
        given |= {"lam_x0": warm.bound_multipliers, "lam_g0": warm.row_multipliers}
    result = solver(**given)
    stats = solver.stats()
    x = result["x"].full().ravel()
    return Point(
        x=np.clip(x, lower, upper),
        row_multipliers=result["lam_g"].full().ravel(),
        bound_multipliers=result["lam_x"].full().ravel(),
        objective=float(result["f"]),
        solved=stats["return_status"] in SOLVED and bool(np.isfinite(x).all()),
        iterations=int(stats["iter_count"]),
    )

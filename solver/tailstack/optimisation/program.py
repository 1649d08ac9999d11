"""The nonlinear programme: one CasADi expression, built once, solved from many starts by IPOPT.

Variables: free positions scaled to [-1, 1] in the bounding box of their region, logarithms of the free half-widths
(of one common factor when scaling), free pivots scaled likewise, and a slack s.
``log r_t^2 + correction_t - 2 log limit_t <= s`` for every quantile, so that one programme serves two questions: with
``s = 0`` and the logarithm of the cost as objective, the optimum; with s as objective, the smallest quantile
attainable.  Logarithms make both scale free.

The rules that a layout keeps are named rows of the programme: spacing, clearance, field of view, regions of copies.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from hashlib import sha256
from itertools import combinations, product
from threading import local
from typing import Any, Literal, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from ..geometry.camera import image_of, needed_gap
from ..system import ArrayLike, Requirement, View
from .curvature import Curvature
from .exact_law import Correction, count_seen, error_moments, squared_quantile
from .prices import log_smooth_cost, smooth_cost
from .problem import ROUNDED, Choice, FreeFiducial, PlacementProblem, present_choice, width_bounds
from .regions import (
    GRID_MM,
    BoxRegion,
    bounding_box,
    clearest_piece,
    contains,
    corners,
    inside_rows,
    move,
    outside_pieces,
    sample,
)
from .solver import make_solver
from .surface import NearSurface
from .symbols import elements, plain
from .terms import DemandTerms, blind_half_widths, estimator_affine, image_parts_at, lay

QUIET: dict[str, Any] = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.linear_solver": "mumps",
    # Rows and variables are about 1 in size: to permute and scale the matrix anew in each step is a quarter of a solve.
    "ipopt.mumps_permuting_scaling": 0,
    "ipopt.mumps_scaling": 0,
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
    "ipopt.mu_strategy": "adaptive",  # takes the barrier from the point, which a fixed start would leave again
    "ipopt.warm_start_bound_push": 1e-7,
    "ipopt.warm_start_bound_frac": 1e-7,
    "ipopt.warm_start_slack_bound_push": 1e-7,
    "ipopt.warm_start_slack_bound_frac": 1e-7,
    "ipopt.warm_start_mult_bound_push": 1e-7,
}
# Of more positions the exact Hessian takes longer than what it saves; curvature is learnt on the way.
EXACT_HESSIAN = 20
LEARNT: dict[str, Any] = {
    "ipopt.hessian_approximation": "limited-memory",
    "ipopt.limited_memory_max_history": 20,
    "ipopt.max_iter": 600,
}
SLACK = 50.0  # |log| of how far the quantile may be from the limit in the question without a limit
SOLVED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")

Question = Literal["main", "least"]  # the problem's own, or the smallest quantile with the half-widths at their least


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

    log_limits: Array  # (T,) log of the limit of each quantile, mm
    signs: Array  # (T, B) ends of the bounded sources
    corrections: tuple[Correction, ...]  # T
    pieces: Array  # (Z,) which piece of the outside each (keep-out zone, fiducial) uses
    # (S,) what the spline over a surface lacks at each fiducial that is kept near one
    off_surface: Array = field(default_factory=partial(np.zeros, 0))

    def vector(self, program: Program, question: Question) -> Array:
        corrected = [np.append(part.offset, part.slopes) for part in self.corrections]
        least = question == "least" or program.problem.objective == "quantile"
        chosen = [np.eye(count)[int(piece)] for count, piece in zip(program.piece_counts, self.pieces, strict=True)]
        last = [1.0 if least else 0.0]
        return np.concatenate([self.log_limits, self.signs.ravel(), *corrected, *chosen, last, self.off_surface])


@dataclass(frozen=True, slots=True, eq=False)
class Program:
    """The compiled programme.  ``coordinates = centre + half * x`` for the free fiducials and pivots."""

    problem: PlacementProblem
    terms: tuple[DemandTerms, ...]
    rows: tuple[ConstraintRow, ...]
    movable: NDArray[np.int64]  # (G,) index of the fiducial each free position is of
    centre: Array  # (G + P, 3) mm
    half: Array  # (G + P, 3) mm
    present_width: Array  # (K,) native units
    piece_counts: tuple[int, ...]  # of the outside, for each (keep-out zone, free fiducial)
    idle: NDArray[np.intp]  # variables of half-widths that move no quantile of the programme: as loose as may be
    explore: tuple[Any, ...]  # one solver per thread, sharing the derivatives
    polish: Any
    curvature: Curvature | None  # of the quantiles, which the solvers call: it lives as long as they do
    constraints: Any  # (x, p) -> (f, g)
    jacobian: Any
    gradient: Any
    expressions: dict[str, Any]  # x, p, f, g of the programme, for questions asked once
    held: Mapping[int, float] = field(default_factory=dict)  # variables that do not change, and where they are

    @property
    def widths_at(self) -> slice:
        """Where the logarithms of half-widths (or of their factor) stand among the variables."""
        start, count = 3 * len(self.movable), len(self.problem.half_widths)
        return slice(start, start + (min(count, 1) if self.problem.objective == "scaling" else count))

    @property
    def pivots_at(self) -> slice:
        start = self.widths_at.stop
        return slice(start, start + 3 * len(self.problem.pivots))

    def split(self, x: Array) -> Choice:
        """What the variables stand for."""
        positions = self.problem.system.fiducials_mm.copy()
        count = len(self.movable)
        placed = self.centre[:count] + self.half[:count] * x[: 3 * count].reshape(-1, 3)
        positions[self.movable] = placed
        for place, position in zip(self.problem.places, placed, strict=True):
            for i, copy in zip(place.fiducials[1:], self.problem.symmetry, strict=True):
                positions[i] = move(copy, position)
        widths = np.exp(x[self.widths_at])
        if self.problem.objective == "scaling":
            widths = self.present_width * (widths[0] if len(widths) else 1.0)
        pivots = self.centre[count:] + self.half[count:] * x[self.pivots_at].reshape(-1, 3)
        return Choice(positions, widths, pivots)

    def join(self, choice: Choice, slack: float = 0.0) -> Array:
        """The variables of a choice, those outside their bounds clipped; an axis without extent holds its at 0."""
        placed = np.vstack([choice.fiducials_mm[self.movable], choice.pivots_mm])
        scaled = (placed - self.centre) / np.where(self.half > 0, self.half, 1.0) * (self.half > 0)
        split = 3 * len(self.movable)
        flat = np.clip(scaled, -1, 1).ravel()
        widths = np.log(choice.half_width)
        if self.problem.objective == "scaling":
            widths = np.log(choice.half_width / self.present_width)[:1]
        return np.concatenate([flat[:split], widths, flat[split:], [slack]])

    def bounds(self, question: Question) -> tuple[Array, Array]:
        """Bounds of the variables for either question."""
        extent = (self.half > 0).astype(float).ravel()
        split = 3 * len(self.movable)
        low, high = width_bounds(self.problem, self.present_width)
        free = question == "least" or self.problem.objective == "quantile"
        if question == "least":
            high = low
        slack = [SLACK] if free else [0.0]
        lower = np.concatenate([-extent[:split], low, -extent[split:], np.negative(slack)])
        upper = np.concatenate([extent[:split], high, extent[split:], slack])
        for variable, value in self.held.items():
            lower[variable] = upper[variable] = value
        return lower, upper

    def pieces_of(self, choice: Choice) -> Array:
        """(Z,) the piece of the outside of each keep-out zone that each free fiducial is furthest into."""
        free = list(self.problem.free_fiducials)
        if not self.problem.keep_out:
            return np.zeros(0)
        return np.concatenate([clearest_piece(zone, choice.fiducials_mm[free]) for zone in self.problem.keep_out])

    def off_surface(self, choice: Choice) -> Array:
        """(S,) of the fiducials near a surface, what the spline lacks to the distance from the triangles."""
        each = [(region, choice.fiducials_mm[[i]]) for region, i in list_near_surfaces(self.problem)]
        return np.array([float(region.exact_level(at)[0]) - float(region.level(at[0])) for region, at in each])


_last = local()  # of each thread: the programme that it built last, and ``key``


def build_program(problem: PlacementProblem, terms: tuple[DemandTerms, ...], threads: int = 1) -> Program:
    """The programme of a problem with a solver for each thread: the last one again where only limits differ.

    Limits are its parameters, and to build that of the demo takes as long as to solve it from 16 starts.
    """
    key = _key(problem, terms, threads)
    if getattr(_last, "key", None) != key:
        _last.key = _last.program = None  # the old one goes first: a large one holds hundreds of megabytes
        _last.program, _last.key = _build(problem, terms, threads), key
    program: Program = _last.program
    quantiles = (replace(row, text=term.demand.text) for row, term in zip(program.rows, terms, strict=False))
    return replace(program, problem=problem, terms=terms, rows=(*quantiles, *program.rows[len(terms) :]))


def _key(problem: PlacementProblem, terms: tuple[DemandTerms, ...], threads: int) -> bytes:
    """All that a programme is built from but its limits: first order, of measures too."""

    def drop_limit(requirement: Requirement) -> Requirement:
        return replace(requirement, limit=1.0)

    system = replace(problem.system, requirements=())
    survival = problem.survival and replace(problem.survival, requirement=drop_limit(problem.survival.requirement))
    requirements = tuple(map(drop_limit, problem.requirements))
    problem = replace(problem, system=system, requirements=requirements, survival=survival)
    bare = [
        replace(term, demand=replace(own, requirement=drop_limit(own.requirement), site=replace(own.site, exact=None)))
        for term, own in ((term, term.demand) for term in terms)
    ]
    return sha256(pickle.dumps((problem, bare, threads))).digest()


def _build(problem: PlacementProblem, terms: tuple[DemandTerms, ...], threads: int) -> Program:
    """Expressions, exact derivatives, a solver for each thread and one that polishes, which share them."""
    movable = np.array([place.fiducials[0] for place in problem.places], dtype=np.int64)
    boxes = [bounding_box(place.region) for place in problem.places]
    boxes += [np.array([free.low_mm, free.high_mm]) for free in problem.pivots]
    low_high = np.array(boxes).reshape(-1, 2, 3)
    centre, half = low_high.mean(axis=1), (low_high[:, 1] - low_high[:, 0]) / 2
    present = present_choice(problem)

    symbols = _make_symbols(problem, terms)
    design = _express_design(problem, symbols, centre, half)
    cost = log_cost(problem, design.logs) if problem.half_widths else ca.SX(0)
    choosers = [
        ca.SX.sym(f"piece_{k}", len(outside_pieces(zone, problem.system.fiducials_mm[i])))
        for k, (zone, i) in enumerate(product(problem.keep_out, problem.free_fiducials))
    ]
    if problem.stay is not None and problem.stay.cost_per_mm:
        cost = ca.log(ca.exp(cost) + problem.stay.price_smoothly(design.points, ca.sqrt))
    rows, expressions = zip(
        *_quantile_rows(problem, terms, symbols, design),
        *_cost_row(problem, cost),
        *geometric_rows(problem, terms, design.points),
        *_keep_out_rows(problem, design.points, choosers),
        strict=True,
    )
    variables = ca.vertcat(symbols.x, symbols.u, symbols.w, symbols.s)
    parameters = ca.vertcat(
        symbols.limits, ca.vec(symbols.signs), ca.vec(symbols.corrections), *choosers, symbols.least
    )
    objective, constraints = ca.cse([symbols.least * symbols.s + (1 - symbols.least) * cost, ca.vertcat(*expressions)])
    nlp = {"x": variables, "p": parameters, "f": objective, "g": constraints}
    # Quantiles depend on everything, rules on few variables: one colouring for both would be that of the quantiles.
    slopes = ca.vertcat(
        *(ca.gradient(constraints[t], variables).T for t in range(len(terms))),
        ca.jacobian(constraints[len(terms) :], variables),
    )
    jacobian = ca.Function("nlp_jac_g", [variables, parameters], [constraints, slopes], ["x", "p"], ["g", "jac_g_x"])
    curvature = hessian = None
    if len(movable) <= EXACT_HESSIAN:
        curvature = Curvature(ca.vertcat(variables, parameters), constraints[: len(terms)], variables.numel())
        hessian = _hessian(nlp, curvature)
    if near := list_near_surfaces(problem):
        nlp, jacobian, hessian = _add_surfaces(near, design.points, nlp, jacobian, hessian)
    shared = {"jac_g": jacobian} | (LEARNT if hessian is None else {"hess_lag": hessian})
    explore = make_solver("explore", nlp, EXPLORE | shared)
    shared["grad_f"] = explore.get_function("nlp_grad_f")
    return Program(
        problem=problem,
        terms=terms,
        rows=(*rows, *_surface_rows(problem)),
        movable=movable,
        centre=centre,
        half=half,
        present_width=present.half_width,
        piece_counts=tuple(chosen.numel() for chosen in choosers),
        idle=3 * len(movable) + np.flatnonzero(blind_half_widths(problem, terms) & (problem.objective != "scaling")),
        explore=(explore, *(make_solver("explore", nlp, EXPLORE | shared) for _ in range(threads - 1))),
        polish=make_solver("polish", nlp, POLISH | shared),
        curvature=curvature,
        constraints=ca.Function("constraints", [nlp["x"], nlp["p"]], [nlp["f"], nlp["g"]]),
        jacobian=shared["jac_g"],
        gradient=shared["grad_f"],
        expressions=nlp,
    )


def _hessian(nlp: dict[str, Any], curvature: Curvature) -> Any:
    """Of the Lagrangian: that of the quantiles by their operations, that of the rest in symbols."""
    x, p, f, g = nlp.values()
    quantiles = curvature.numel_in(1)  # the first rows
    names = "x", "p", "lam_f", "lam_g"
    weights = ca.SX.sym("lam_f"), ca.SX.sym("lam_g", g.numel())
    rest = weights[0] * f + ca.dot(weights[1][quantiles:], g[quantiles:])
    of_rest = ca.Function("rest", [x, p, *weights], [ca.triu(ca.hessian(rest, x)[0])])
    given = [ca.MX.sym(name, part.numel()) for name, part in zip(names, (x, p, *weights), strict=True)]
    whole = of_rest(*given) + ca.triu(curvature(ca.vertcat(*given[:2]), given[3][:quantiles]))
    return ca.Function("nlp_hess_l", given, [whole], names, ["triu_hess_gamma_x_x"])


def list_near_surfaces(problem: PlacementProblem) -> list[tuple[NearSurface, int]]:
    """The fiducials that are kept near a surface, and which."""
    return [
        (place.region, i)
        for place in problem.places
        if isinstance(place.region, NearSurface)
        for copy, i in enumerate(place.fiducials)
        if not (copy and _keeps_anyway(problem, place, copy))
    ]


def _surface_rows(problem: PlacementProblem) -> Iterator[ConstraintRow]:
    """In the order of ``_add_surfaces``."""
    for region, i in list_near_surfaces(problem):
        for name, _, equal in region.rows(0.0):
            text = f"{problem.system.fiducial_labels[i]} at the {name} of its region"
            yield ConstraintRow("region", text, 0.0, 0.0 if equal else np.inf, (i,))


def _add_surfaces(
    near: list[tuple[NearSurface, int]], points: ArrayLike, nlp: dict[str, Any], jacobian: Any, hessian: Any | None
) -> tuple[dict[str, Any], Any, Any | None]:
    """A programme and its derivatives with rows for fiducials near surfaces, which are no expressions but functions."""
    x, p, f, g = nlp.values()
    variables, parameters = ca.MX.sym("x", x.numel()), ca.MX.sym("p", p.numel() + len(near))
    own, off = parameters[: p.numel()], parameters[p.numel() :]
    at = ca.Function("at", [x], [ca.vertcat(*(points[i, k] for _, i in near for k in range(3)))])(variables)
    levels = (region.level(at[3 * j : 3 * j + 3]) + off[j] for j, (region, _) in enumerate(near))
    added = ca.vertcat(
        *(row for (region, _), level in zip(near, levels, strict=True) for _, row, _ in region.rows(level))
    )
    values, slopes = jacobian(variables, own)
    names, count = ["x", "p", "lam_f", "lam_g"], g.numel()
    if hessian is not None:
        weight, weights = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", count + added.numel())
        bent = ca.triu(ca.hessian(ca.dot(weights[count:], added), variables)[0])
        given = [variables, parameters, weight, weights]
        whole = hessian(variables, own, weight, weights[:count]) + bent
        hessian = ca.Function("nlp_hess_l", given, [whole], names, ["triu_hess_gamma_x_x"])
    both = [ca.vertcat(values, added), ca.vertcat(slopes, ca.jacobian(added, variables))]
    jacobian = ca.Function("nlp_jac_g", [variables, parameters], both, names[:2], ["g", "jac_g_x"])
    objective, rules = (ca.Function(name, [x, p], [part])(variables, own) for name, part in (("f", f), ("g", g)))
    return {"x": variables, "p": parameters, "f": objective, "g": ca.vertcat(rules, added)}, jacobian, hessian


class _Symbols(NamedTuple):
    """Variables and parameters of the programme, CasADi columns (or matrices)."""

    x: Any  # (3G,) free positions, scaled
    u: Any  # (U,) logarithms of half-widths, or that of their common factor
    w: Any  # (3P,) free pivots, scaled
    s: Any  # the slack
    limits: Any  # (T,) logarithm of each limit
    signs: Any  # (B, T) ends of the bounded sources
    corrections: Any  # (1 + 15 + 3 C + K + 3P, T) to the exact law
    least: Any  # 1 where the slack is minimised, 0 where the cost is


def _make_symbols(problem: PlacementProblem, terms: tuple[DemandTerms, ...]) -> _Symbols:
    widths, pivots = len(problem.half_widths), 3 * len(problem.pivots)
    return _Symbols(
        x=ca.SX.sym("x", 3 * len(problem.places)),
        u=ca.SX.sym("u", min(widths, 1) if problem.objective == "scaling" else widths),
        w=ca.SX.sym("w", pivots),
        s=ca.SX.sym("s"),
        limits=ca.SX.sym("limits", len(terms)),
        signs=ca.SX.sym("signs", len(terms[0].at_ends), len(terms)),
        corrections=ca.SX.sym("corrections", 1 + count_seen(problem, terms[0]), len(terms)),
        least=ca.SX.sym("least"),
    )


class _SymbolicDesign(NamedTuple):
    """A design in symbols."""

    points: ArrayLike  # (N, 3) mm
    logs: ArrayLike  # (K,) of the half-widths, native units
    pivot_shift: ArrayLike  # (3P,) mm


def _express_design(problem: PlacementProblem, symbols: _Symbols, centre: Array, half: Array) -> _SymbolicDesign:
    points = plain(problem.system.fiducials_mm)
    for g, place in enumerate(problem.places):
        first = place.fiducials[0]
        for k in range(3):
            points[first, k] = float(centre[g, k]) + float(half[g, k]) * symbols.x[3 * g + k]
        for i, copy in zip(place.fiducials[1:], problem.symmetry, strict=True):
            points[i] = move(copy, points[first])
    present, count = present_choice(problem), len(problem.places)
    pivots = plain(centre[count:].ravel())
    for p in range(symbols.w.numel()):
        pivots[p] = pivots[p] + float(half[count:].flat[p]) * symbols.w[p]
    logs = elements(symbols.u)
    if problem.objective == "scaling":
        logs = np.array([float(np.log(value)) + symbols.u[0] for value in present.half_width], dtype=object)
    return _SymbolicDesign(points, logs, pivots - plain(present.pivots_mm.ravel()))


def log_cost(problem: PlacementProblem, logs: ArrayLike) -> Any:
    """Logarithm of the cost of half-widths given by theirs."""
    if any(free.price.curve == "exponential" for free in problem.half_widths):  # a sum of what may be no number
        priced = zip(problem.half_widths, logs, strict=True)
        return ca.logsumexp(ca.vertcat(*(log_smooth_cost(free.price, value, ca.exp) for free, value in priced)))
    return ca.log(sum(smooth_cost(f.price, value, ca.exp) for f, value in zip(problem.half_widths, logs, strict=True)))


def _quantile_rows(
    problem: PlacementProblem, terms: tuple[DemandTerms, ...], symbols: _Symbols, design: _SymbolicDesign
) -> Rows:
    """``log r^2 + correction - 2 log limit - s <= 0`` of every quantile in the programme."""
    half_width = np.array([ca.exp(value) for value in design.logs], dtype=object)
    shift = design.pivot_shift
    projections, assumed_shift = (_duck(part.at(shift)) for part in estimator_affine(problem))
    laid = lay(problem, design.points, shift)
    for t, term in enumerate(terms):
        reconstructed = _duck(term.reconstructed.at(shift))
        images = image_parts_at(problem.estimation, term, laid, projections, assumed_shift, reconstructed)
        law = error_moments(term, images, half_width, shift, elements(symbols.signs[:, t]))
        seen = [1.0, *images.numbers, *design.logs, *shift]
        correction = sum(symbols.corrections[i, t] * value for i, value in enumerate(seen))
        form = ca.log(squared_quantile(term.demand, law))
        row = ConstraintRow("quantile", term.demand.text, -np.inf, 0.0)
        yield row, form + correction - 2 * symbols.limits[t] - symbols.s


def rename_fiducials(
    program: Program, terms: tuple[DemandTerms, ...], labels: tuple[str, ...], layout: Array
) -> Program:
    """The programme with other labels for its fiducials, and so other words; terms: its own, renamed."""
    problem = replace(program.problem, system=replace(program.problem.system, fiducial_labels=labels))
    choosers = [np.zeros(count) for count in program.piece_counts]
    written = (*geometric_rows(problem, terms, layout), *_keep_out_rows(problem, layout, choosers))
    placed = (*(row for row, _ in written), *_surface_rows(problem))
    first = len(program.rows) - len(placed)
    quantiles = (replace(row, text=term.demand.text) for row, term in zip(program.rows, terms, strict=False))
    rows = (*quantiles, *program.rows[len(terms) : first], *placed)
    return replace(program, problem=problem, terms=terms, rows=rows)


def _cost_row(problem: PlacementProblem, cost: Any) -> Rows:
    if problem.cost_limit is not None:
        yield ConstraintRow("cost", "cost", -np.inf, 0.0), cost - float(np.log(problem.cost_limit * (1 - ROUNDED)))


def _keep_out_rows(problem: PlacementProblem, points: ArrayLike, choosers: list[Any]) -> Rows:
    """Every free fiducial in the piece of the outside of each zone that its parameter chooses."""
    for chosen, (zone, i) in zip(choosers, product(problem.keep_out, problem.free_fiducials), strict=True):
        text = f"{problem.system.fiducial_labels[i]} outside keep-out zone {zone.name!r}"
        outside = sum(chosen[j] * value for j, (_, value) in enumerate(outside_pieces(zone, points[i])))
        yield ConstraintRow("keep_out", text, 0.0, np.inf, (i,)), outside


def _duck(value: Any) -> Any:
    return value if value.dtype == object else plain(value)


def solve(
    program: Program,
    start: Array,
    parameters: Parameters,
    *,
    question: Question = "main",
    warm: Point | None = None,
    lane: int = 0,
) -> Point:
    """One solve from ``start``, or polishing from a point that an earlier solve ended at.

    Solves of different lanes may run at the same time; those of one lane, and polishing, may not.
    """
    lower, upper = program.bounds(question)
    given: dict[str, Any] = {
        "x0": np.clip(start if warm is None else warm.x, lower, upper),
        "p": parameters.vector(program, question),
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
    x, objective = np.clip(result["x"].full().ravel(), lower, upper), float(result["f"])
    bound_multipliers = result["lam_x"].full().ravel()
    bound_multipliers[list(program.held)] = 0.0  # what is held presses on no bound of anybody
    if program.idle.size:
        x[program.idle] = upper[program.idle]  # the cost may fall too little on the way for the solver to go it
        objective = float(program.constraints(x, given["p"])[0])
    return Point(
        x=x,
        row_multipliers=result["lam_g"].full().ravel(),
        bound_multipliers=bound_multipliers,
        objective=objective,
        solved=stats["return_status"] in SOLVED and bool(np.isfinite(x).all()),
        iterations=int(stats["iter_count"]),
    )


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
    row_lower, row_upper = np.array([(row.lower, row.upper) for row in program.rows]).T
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


@dataclass(frozen=True, slots=True)
class ConstraintRow:
    """One constraint ``lower <= g <= upper`` and what it is about, in the user's words."""

    kind: str  # quantile, cost, spacing, projected_spacing, image_gap, target_clearance, field, region, keep_out, stay
    text: str
    lower: float
    upper: float
    fiducials: tuple[int, ...] = ()


Rows = Iterator[tuple[ConstraintRow, Any]]


def geometric_rows(problem: PlacementProblem, terms: tuple[DemandTerms, ...], points: ArrayLike) -> Rows:
    """Row and expression, each about 1 in size; points (N, 3) mm, floats or symbols."""
    if not problem.places:
        return
    yield from _spacing(problem, points)
    assumed = points @ plain(problem.estimation.assumed_turn).T + plain(problem.estimation.assumed_shift_mm)
    for view, projection in zip(problem.system.views, problem.estimation.projections, strict=True):
        homogeneous = assumed @ plain(projection[:, :3]).T + plain(projection[:, 3])
        image = image_of(homogeneous)
        yield from _image_distances(problem, view, image, homogeneous[:, 2])
        yield from _target_clearance(problem, terms, view, projection, image)
        yield from _field(problem, view, projection, homogeneous)
    yield from _regions(problem, points)
    yield from _reach(problem, points)


def _pairs(problem: PlacementProblem) -> Iterator[tuple[tuple[int, int], str]]:
    """Fiducials of which one is free, and their labels."""
    free, labels = set(problem.free_fiducials), problem.system.fiducial_labels
    for i, j in combinations(range(len(labels)), 2):
        if i in free or j in free:
            yield (i, j), f"{labels[i]} and {labels[j]}"


def _apart(kind: str, text: str, fiducials: tuple[int, ...], gap: ArrayLike, least: Any) -> tuple[ConstraintRow, Any]:
    """That a difference of places, or of images, is at least so long."""
    return ConstraintRow(kind, text, 0.0, np.inf, fiducials), (gap @ gap) / least**2 - 1


def _spacing(problem: PlacementProblem, points: ArrayLike) -> Rows:
    """One row per distance: under a symmetry two free fiducials and their images are equally far apart."""
    if problem.min_spacing_mm <= 0:
        return
    copy_of = {i: copy for place in problem.places for copy, i in enumerate(place.fiducials)}
    for (i, j), labels in _pairs(problem):
        if problem.symmetry and i in copy_of and j in copy_of and 0 not in (copy_of[i], copy_of[j]):
            continue
        yield _apart("spacing", f"spacing of {labels}", (i, j), points[i] - points[j], problem.min_spacing_mm)


def _image_distances(problem: PlacementProblem, view: View, image: ArrayLike, depth: ArrayLike) -> Rows:
    """The distance that is asked for; shadows of balls must not merge, whatever that is."""
    least, radius = problem.min_projected_spacing_px, problem.system.fiducial_radius_mm
    if least > 0:
        for (i, j), labels in _pairs(problem):
            text = f"images of {labels} in {view.name}"
            yield _apart("projected_spacing", text, (i, j), image[i] - image[j], least)
    if radius is not None:
        for (i, j), labels in _pairs(problem):
            needed = needed_gap(view.projection, radius, depth[i], depth[j])
            yield _apart("image_gap", f"shadows of {labels} in {view.name}", (i, j), image[i] - image[j], needed)


def _target_clearance(
    problem: PlacementProblem, terms: tuple[DemandTerms, ...], view: View, projection: Array, image: ArrayLike
) -> Rows:
    if problem.target_clearance_px <= 0:
        return
    each = (zip(term.demand.targets, term.reconstructed_mm, strict=True) for term in terms)
    for name, aim in {target.name: aim for pairs in each for target, aim in pairs}.items():
        centre = plain(image_of(projection[:, :3] @ aim + projection[:, 3]))
        for i in problem.free_fiducials:
            text = f"images of {problem.system.fiducial_labels[i]} and of target {name!r} in {view.name}"
            yield _apart("target_clearance", text, (i,), image[i] - centre, problem.target_clearance_px)


def _field(problem: PlacementProblem, view: View, projection: Array, homogeneous: ArrayLike) -> Rows:
    """Inside the image with its margin, multiplied by the depth: linear in the position.

    A side that the whole bounding box of a region keeps (its corners do, and the constraint is linear) gives no rows.
    """
    if view.image_size_px is None:
        return
    for place in problem.places:
        for copy, i in enumerate(place.fiducials):
            reach = corners(bounding_box(place.region))
            if copy:
                reach = move(problem.symmetry[copy - 1], reach)
            seen = problem.estimation.assume(reach) @ projection[:, :3].T + projection[:, 3]
            scale = float(np.abs(seen[:, 2]).mean()) * max(view.image_size_px)
            for axis, sign, name in ((0, 1, "left"), (0, -1, "right"), (1, 1, "top"), (1, -1, "bottom")):
                edge = problem.image_margin_px if sign > 0 else view.image_size_px[axis] - 1 - problem.image_margin_px
                if (sign * (seen[:, axis] - edge * seen[:, 2]) >= 0).all():
                    continue
                text = f"{problem.system.fiducial_labels[i]} at the {name} edge of {view.name}"
                inside = sign * (homogeneous[i, axis] - float(edge) * homogeneous[i, 2]) / scale
                yield ConstraintRow("field", text, 0.0, np.inf, (i,)), inside


def _regions(problem: PlacementProblem, points: ArrayLike) -> Rows:
    """A box is held by the bounds of its variables; other regions, and boxes of copies, by rows; surfaces by rows of
    their own."""
    for place in problem.places:
        for copy, i in enumerate(place.fiducials):
            if _keeps_anyway(problem, place, copy):
                continue
            for face, expression, equal in inside_rows(place.region, points[i]):
                text = f"{problem.system.fiducial_labels[i]} at the {face} of its region"
                yield ConstraintRow("region", text, 0.0, 0.0 if equal else np.inf, (i,)), expression


def _reach(problem: PlacementProblem, points: ArrayLike) -> Rows:
    """Each fiducial in the ball about its place, less what rounding may add."""
    if problem.stay is None or problem.stay.at_most_mm == np.inf:
        return
    most = problem.stay.at_most_mm
    for i, way in zip(problem.stay.at_home, problem.stay.ways(points), strict=True):
        if i in problem.free_fiducials:
            text = f"{problem.system.fiducial_labels[i]} at the end of its way, {most:g} mm"
            yield ConstraintRow("stay", text, 0.0, np.inf, (i,)), 1 - (way @ way) / (most - GRID_MM) ** 2


def _keeps_anyway(problem: PlacementProblem, place: FreeFiducial, copy: int) -> bool:
    """Whether the bounds, or the rows of the first of the group, already keep this one in the region."""
    if copy == 0:
        return isinstance(place.region, BoxRegion)
    isometry = problem.symmetry[copy - 1]
    if isinstance(place.region, BoxRegion):
        reach = corners(bounding_box(place.region))
    else:
        reach = sample(place.region, np.random.default_rng(0), 400, 0.5)
    size = float(np.ptp(reach, axis=0).max())
    return bool(contains(place.region, move(isometry, reach), 1e-9 * size).all())

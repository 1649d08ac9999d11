"""What an optimum rests on: what binds, and how much cheaper anything else could be, by a lower bound of the cost where
one exists, and why by none elsewhere."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from ..errors import InfeasibleError, NotConvergedError
from ..results import Relaxation
from ..results.digits import at_least, at_most
from ..system import Law
from .allocation import allocate, gaussian_bracket
from .exact_law import Evaluation, error_moments, evaluate_demand, width_slopes
from .grades import Optimum
from .placement import PlacementSolution
from .prices import cheapest, cheapest_in_logarithm
from .problem import Choice, PlacementProblem, for_people, in_words, label_of, present_choice
from .program import ConstraintRow, Parameters, Point, Program
from .regions import BoxRegion
from .search import Search
from .terms import DemandTerms, free_laws, pivot_shift_of

ACTIVE = 1e-6  # slack, in the scaled units of the programme, up to which a constraint binds
TOUCHING = 1e-4  # of a rule of the layout: half of that in a distance
SAMPLED_ACTIVE = 1e-3  # of a quantile that is sampled


def name_binding(
    program: Program, point: Point, parameters: Parameters, order: tuple[str, ...] = ()
) -> tuple[str, ...]:
    """The constraints that hold with equality, in the user's words; ``order``: of the labels."""
    values = program.constraints(point.x, parameters.vector(program, "main"))[1].full().ravel()
    binding: list[str] = []
    touched: dict[str, list[str]] = {}
    labels = program.problem.system.fiducial_labels
    order = order or labels
    for t, (row, value) in enumerate(zip(program.rows, values, strict=True)):
        if row.lower == row.upper:  # on a surface by definition
            continue
        if row.kind in ("quantile", "cost"):
            sampled = row.kind == "quantile" and program.terms[t].demand.is_nested
            if value >= row.upper - (SAMPLED_ACTIVE if sampled else 10 * ACTIVE):
                binding.append(_upper_text(program, t, row))
        elif value <= row.lower + TOUCHING:
            face = row.text.partition(" at the ")[2] if row.kind in ("region", "stay") else ""
            if face:
                touched.setdefault(f"at the {face}", []).append(labels[row.fiducials[0]])
            else:
                binding.append(row.text + _minimum(program.problem, row.kind))
    binding += [f"{', '.join(sorted(names, key=order.index))} {face}" for face, names in touched.items()]
    binding += [*_faces(program, point, order), *_bounds_on_widths(program, point)]
    return *binding, *_bounds_on_mechanics(program, point)


def _upper_text(program: Program, t: int, row: ConstraintRow) -> str:
    if row.kind == "cost":
        return f"the cost limit of {program.problem.cost_limit:g}"
    demand = program.terms[t].demand
    if program.problem.objective == "quantile":
        return f"{row.text}: the largest part of its limit ({demand.requirement.name})"
    return f"{row.text}, limit {demand.limit_text} ({demand.requirement.name})"


def _minimum(problem: PlacementProblem, kind: str) -> str:
    if kind in problem.distances:
        _, unit, size = problem.distances[kind]
        return f" at {size:g} {unit}"
    return f" (margin {problem.image_margin_px:g} px)" if kind == "field" else ""


def _at_bound(program: Program, point: Point, index: int) -> int:
    """-1 at the lower bound, +1 at the upper one, 0 between them or where there is no room."""
    lower, upper = program.bounds("main")
    if upper[index] - lower[index] <= 0:
        return 0
    x = point.x[index]
    return 1 if x >= upper[index] - ACTIVE else -1 if x <= lower[index] + ACTIVE else 0


def _faces(program: Program, point: Point, order: tuple[str, ...]) -> list[str]:
    """Fiducials on the faces of their boxes, those on the same faces together."""
    problem = program.problem
    by_faces: dict[str, list[str]] = {}
    for g, place in enumerate(problem.places):
        if not isinstance(place.region, BoxRegion):
            continue
        sides = [(k, _at_bound(program, point, 3 * g + k)) for k in range(3)]
        low, high = place.region.low_mm, place.region.high_mm
        faces = [f"{'xyz'[k]} = {(high if side > 0 else low)[k]:g} mm" for k, side in sides if side]
        if faces:
            label = problem.system.fiducial_labels[place.fiducials[0]]
            by_faces.setdefault(", ".join(faces), []).append(label)
    return [f"{', '.join(sorted(on, key=order.index))} on the box at {faces}" for faces, on in by_faces.items()]


def _bounds_on_widths(program: Program, point: Point) -> list[str]:
    problem = program.problem
    if problem.objective == "scaling":
        side = _at_bound(program, point, program.widths_at.start)
        return ["the common factor at a bound of some half-width"] if side else []
    texts = []
    for k, free in enumerate(problem.half_widths):
        side = _at_bound(program, point, program.widths_at.start + k)
        if side:
            value, unit = for_people(problem, k, free.maximum if side > 0 else free.minimum)
            which = "largest" if side > 0 else "smallest"
            texts.append(f"{in_words(problem, k)} at its {which} half-width, {value:.4g} {unit}")
    return texts


def _bounds_on_mechanics(program: Program, point: Point) -> list[str]:
    problem, texts = program.problem, []
    for p, free in enumerate(problem.pivots):
        for k in range(3):
            side = _at_bound(program, point, program.pivots_at.start + 3 * p + k)
            if side:
                bound = (free.high_mm if side > 0 else free.low_mm)[k]
                texts.append(f"pivot of {label_of(problem, free.contributor)} at {'xyz'[k]} = {bound:g} mm")
    return texts


def bound_cost(search: Search, optimum: Optimum, exact: PlacementSolution | None) -> Relaxation:
    """The bound that goes with an optimum; exact: the one by the exact law at the limits themselves."""
    problem = optimum.problem
    if optimum.purchase is not None:
        return optimum.purchase.bound
    fixed = exact if problem.objective == "cost" and not problem.moves else None
    if fixed is not None and (proven := _bound_by_tangents(fixed, optimum.cost)):
        return proven
    reason = _no_bound(search, problem)
    if reason is not None:
        return Relaxation("none", optimum.cost or None, None, None, reason)
    try:
        low, high = _bracket(search, problem, optimum.choice)
    except (InfeasibleError, NotConvergedError) as error:
        reason = f"the convex relaxation gave none: {error.problems[0].detail}"
        return Relaxation("none", optimum.cost, None, None, reason)
    gap = 100 * (optimum.cost / low - 1)
    statement = (
        f"with this layout no allocation costs less than {at_most(low, 6)} ({gap:.2g} % below this one): the optimum "
        "of a convex relaxation, (tr S + c |S|_F) / k <= limit^2 with k checked numerically over all spectra; without "
        f"k it is always safe, and costs {at_least(high, 6)}"
    )
    return Relaxation("convex allocation", optimum.cost, low, gap, statement)


OF_MEANS = "means of an error, over all shots or the worst of them, are convex in the half-widths whatever the laws"
OF_QUANTILES = (
    "free tolerances normal, costs powers, no bias: the chance to be within is log-concave in the logarithms of the "
    "half-widths"
)


def _bound_by_tangents(exact: PlacementSolution, cost: float) -> Relaxation | None:
    """By the dual of the allocation, in which limits that are not convex are left out, which only lowers the bound;
    None where none that presses is convex.

    *Means.*  A mean M of |b + G h u| over all or over its tail is convex in the half-widths h whatever the law of u, as
    the norm is, and both are monotone and convex; so it lies above its tangent, M(h) >= M + s (h - h*).  With prices
    mu >= 0 of the limits L the least ``C(h) + mu (M + s (h - h*) - L)`` over the box is below every cost that keeps
    them, and a sum over the half-widths, each made least by itself.

    *Quantiles.*  ``P(|e| <= L)`` of a sum e about 0 of normal sources of sizes exp(x) and others of symmetric
    log-concave laws is log-concave in x = log h ((B) theorem: Cordero-Erausquin, Fradelizi and Maurey 2004), so its
    logarithm F lies below its tangent; and costs ``w exp(-k x)`` are convex.  The row is 2 log r: its slope by x is
    -2 F' p / (r f), f the density at r; so the price of F is this one's times 2 p / (r f), and F is above log p by
    f (L - r) / p.
    """
    problem, widths = exact.problem, exact.choice.half_width
    normal = all(law is Law.NORMAL for law, _ in free_laws(problem))
    in_logarithms = normal and all(free.price.curve == "power" for free in problem.half_widths)
    pressing = [*zip(exact.program.terms, exact.iterate.point.row_multipliers.tolist(), strict=False)]
    items = [evaluate_demand(problem, term, exact.choice) for term, _ in pressing]
    for logs in (False, True) if in_logarithms else (False,):
        charge, room = np.zeros(len(widths)), 0.0
        for (term, multiplier), item in zip(pressing, items, strict=True):
            if _is_log_concave(term, item) if logs else term.demand.is_convex:
                price = max(multiplier, 0.0) * exact.cost  # of the logarithm of the square
                charge += price * width_slopes(problem, term, exact.choice, item) / (1.0 if logs else widths)
                room += 2 * price * (item.limit / item.exact_mm - 1 + item.relative_error)
        if not charge.any():
            continue
        least = cheapest_in_logarithm if logs else cheapest
        each = zip(problem.half_widths, charge.tolist(), strict=True)
        best = np.array([least(free.price, pull, free.minimum, free.maximum) for free, pull in each])
        bound = problem.cost(best) + float(charge @ (np.log(best / widths) if logs else best - widths)) - room
        gap = exact.cost / bound - 1
        statement = (
            f"at this layout no other half-widths within the limits cost less than {at_most(bound, 6)} (duality gap "
            f"{gap:.1e}): to first order the optimum under the declared laws, {at_least(exact.cost, 6)}, is global "
            f"({OF_QUANTILES if logs else OF_MEANS}); from there to {at_least(cost, 6)} is the margin of the check"
        )
        return Relaxation("convex allocation", exact.cost, bound, 100 * gap, statement)
    return None


def _is_log_concave(term: DemandTerms, item: Evaluation) -> bool:
    """Whether a limit is that of a quantile of what nothing known moves, over all units and shots together."""
    demand = term.demand
    return not (demand.is_nested or not demand.requirement.row.by_quantile or term.at_ends or item.mean_mm.any())


def _no_bound(search: Search, problem: PlacementProblem) -> str | None:
    """Why the allocation is not convex, or its bound does not hold; None where it is and does."""
    if problem.objective != "cost":
        return "no cost is minimised: KKT certifies a local optimum"
    if problem.moves:
        what = "layout" if problem.places else "pivots"
        return (
            f"not convex in the {what}: KKT certifies a local optimum, the spread over starts is all that is known "
            "beyond that"
        )
    if any(term.demand.is_nested for term in search.terms):
        return "risk per unit or per mounting is not convex in the variances: KKT certifies a local optimum"
    if len({term.demand.requirement.quantile for term in search.terms}) > 1:
        return "the convex bound is of one quantile, and several are limited: KKT certifies a local optimum"
    sources = [source for term in search.terms for source in (*term.sources, *term.common)]
    sized = [source for source in sources if source.free is not None or source.half_width > 0]
    if any(source.law is not Law.NORMAL for source in sized) or _varies_unlike_normal(problem):
        return (
            "the convex bound is that of normal laws, and tolerances that are uniform, triangular or bounded have "
            "lighter tails: KKT certifies a local optimum"
        )
    if any(evaluate_demand(problem, term, present_choice(problem)).mean_mm.any() for term in search.terms):
        return "a known bias moves the quantile out of the convex form: KKT certifies a local optimum"
    return None


def _varies_unlike_normal(problem: PlacementProblem) -> bool:
    made = bool(problem.system.manufacturing_half_width_mm.any()) and problem.system.manufacturing_law is not Law.NORMAL
    told = [error.sources.laws for error in problem.system.believed_errors if error]
    return made or any(law is not Law.NORMAL for laws in told for law in laws)


def _bracket(search: Search, problem: PlacementProblem, choice: Choice) -> tuple[float, float]:
    """(lower bound, cost of the safe side) of the allocation at this layout."""
    noise, nothing = [], np.zeros(len(problem.half_widths))
    for term in search.terms:
        images = evaluate_demand(problem, term, replace(choice, half_width=problem.lower)).images
        fixed = error_moments(term, images, nothing, pivot_shift_of(problem, choice), np.zeros(0))
        noise.append((fixed.unit + fixed.shot).astype(float))
    p = search.terms[0].demand.requirement.quantile
    within = partial(
        allocate,
        np.array(noise),
        np.array([term.free_gain.T for term in search.terms]),
        [free.price for free in problem.half_widths],
        np.array([per for _, per in free_laws(problem)]),
        lower=problem.lower,
        upper=problem.upper,
        p=p,
    )
    return gaussian_bracket(within, np.array([term.demand.requirement.limit for term in search.terms]), p)

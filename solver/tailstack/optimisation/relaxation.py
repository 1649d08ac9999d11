"""How much cheaper anything else could be: a lower bound of the cost where one exists, and why none elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..errors import InfeasibleError, NotConvergedError
from ..results import Relaxation
from ..system import Law
from .allocation import gaussian_bracket
from .exact_law import evaluate_demand, image_parts
from .grades import Optimum
from .problem import Choice, PlacementProblem
from .search import Search
from .terms import free_laws


def relaxation_of(search: Search, optimum: Optimum) -> Relaxation:
    """The bound that goes with an optimum."""
    problem = optimum.problem
    if optimum.purchase is not None:
        return optimum.purchase.bound
    reason = _no_bound(search, problem)
    if reason is not None:
        return Relaxation("none", optimum.cost or None, None, None, reason)
    try:
        low, high = _bracket(search, problem, optimum.choice)
    except (InfeasibleError, NotConvergedError) as error:
        return Relaxation(
            "none", optimum.cost, None, None, f"the convex relaxation gave none: {error.problems[0].detail}"
        )
    gap = 100 * (optimum.cost / low - 1)
    return Relaxation(
        "convex allocation", optimum.cost, low, gap,
        f"with this layout no allocation costs less than {low:.6g} ({gap:.2g} % below this one): the optimum of a "
        "convex relaxation, (tr S + c |S|_F) / k <= limit^2 with k checked numerically over all spectra; without k it "
        f"is always safe, and costs {high:.6g}",
    )  # fmt: skip


def _no_bound(search: Search, problem: PlacementProblem) -> str | None:
    """Why the allocation is not convex, or its bound does not hold; None where it is and does."""
    if problem.objective != "cost":
        return "no cost is minimised: KKT certifies a local optimum"
    if problem.places or problem.pivots or problem.spacings:
        what = "layout" if problem.places else "pivots and spacings"
        return (
            f"not convex in the {what}: KKT certifies a local optimum, the spread over starts is all that is known "
            "beyond that"
        )
    if any(term.demand.per_unit for term in search.terms):
        return "per-unit risk is not convex in the variances: KKT certifies a local optimum"
    if len({term.demand.requirement.quantile for term in search.terms}) > 1:
        return "the convex bound is of one quantile, and several are limited: KKT certifies a local optimum"
    sources = [source for term in search.terms for source in term.sources]
    sized = [source for source in sources if source.free is not None or source.half_width > 0]
    if any(source.law is not Law.NORMAL for source in sized) or _manufactured(problem):
        return (
            "the convex bound is that of normal laws, and tolerances that are uniform, triangular or bounded have "
            "lighter tails: KKT certifies a local optimum"
        )
    if any(term.bias.base.any() for term in search.terms):
        return "a known bias moves the quantile out of the convex form: KKT certifies a local optimum"
    return None


def _manufactured(problem: PlacementProblem) -> bool:
    return bool(problem.system.manufacturing_half_width_mm.any()) and (
        problem.system.manufacturing_law is not Law.NORMAL
    )


def _bracket(search: Search, problem: PlacementProblem, choice: Choice) -> tuple[float, float]:
    """(lower bound, cost of the safe side) of the allocation at this layout."""
    noise, gains, limits = [], [], []
    for term in search.terms:
        evaluation = evaluate_demand(problem, term, replace(choice, half_width=problem.lower))
        covariance = sum(image_parts(evaluation.model, term.demand.requirement.error), term.covariance)
        noise.append(covariance)
        gains.append(term.free_gain.T)
        limits.append(term.demand.requirement.limit_mm)
    return gaussian_bracket(
        np.array(noise), np.array(gains), [free.price for free in problem.half_widths],
        np.array([per for _, per in free_laws(problem)]), np.array(limits), lower=problem.lower, upper=problem.upper,
        p=search.terms[0].demand.requirement.quantile,
    )  # fmt: skip

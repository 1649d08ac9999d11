"""The design as it stands: where it lies outside of what is asked for, and what it would be inside.

It is a candidate of every search: an answer is never worse than what was given, where that can be kept."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import dist, inf

import numpy as np
from scipy.optimize import brentq

from ..design import Design, compile_design
from ..errors import TailstackError
from ..geometry.arrays import Array
from ..results.digits import at_least, at_most
from ..system import System
from .exact_law import exact_ratios
from .prices import drop_dominated
from .problem import Choice, PlacementProblem, for_people, in_words, label_of, present_choice, width_bounds
from .program import ConstraintRow, geometric_rows
from .regions import clear_of
from .request import OptimiseRequest
from .starts import clip_to_regions
from .terms import DemandTerms, every_terms, is_singular

INSIDE_MM = 1e-5  # positions this far outside count as inside
ROUNDED = 1e-3  # of a rule: what rounding positions to a micrometre may break of it
WORTH_A_CHECK = 1.05  # of a limit: by estimate; further above it no check finds a quantile within it
MOST_TOLD = 4  # places where a design lies outside


@dataclass(frozen=True, slots=True, eq=False)
class PresentDesign:
    """A design as it stands, brought inside."""

    problem: PlacementProblem
    choice: Choice
    outside: tuple[str, ...]  # where it was not inside, in words
    moved: bool  # whether the choice is another than the design's own
    ratios: tuple[float, ...]  # exact quantile over its limit, every demand; empty: it is no candidate

    def may_keep(self, limits: float = 1.0) -> bool:
        """Whether a check may find it within a factor on its limits: estimates can be some per cent too large."""
        near = self.problem.objective == "quantile" or max(self.ratios, default=0.0) <= WORTH_A_CHECK * limits
        return bool(self.ratios) and near


def present_design(problem: PlacementProblem) -> PresentDesign:
    """The design that a problem starts from."""
    terms, here = every_terms(problem), present_choice(problem)
    choice = bring_inside(problem, here)
    outside = (*_outside_bounds(problem, here, choice), *broken_rules(problem, terms, here.fiducials_mm))
    ratios: tuple[float, ...] = ()
    spent = problem.cost_limit is not None and problem.cost(choice.half_width) > problem.cost_limit * (1 + 1e-9)
    if not (spent or any(broken_rules(problem, terms, choice.fiducials_mm))):
        with suppress(TailstackError):  # it has no answer, so it is none
            if not is_singular(problem.system, choice.fiducials_mm):
                ratios = tuple(float(ratio) for ratio in exact_ratios(problem, terms, choice))
    parts = ("fiducials_mm", "half_width", "pivots_mm")
    moved = any(not np.array_equal(getattr(choice, part), getattr(here, part)) for part in parts)
    return PresentDesign(problem, choice, outside, moved, ratios)


def merit_of(request: OptimiseRequest, problem: PlacementProblem, choice: Choice, ratios: Sequence[float]) -> float:
    """What is made least: the largest quantile over its limit, or the cost, that of the fiducials included."""
    if problem.objective == "quantile":
        return max(ratios)
    count = request.section.count
    each = 0.0 if count is None else count.cost_per_fiducial
    return problem.price_of(choice) + each * len(choice.fiducials_mm)


def merit_as_written(request: OptimiseRequest) -> float:
    """What is made least, of a design as it stands."""
    problem = request.problem
    choice = present_choice(problem)
    ratios = exact_ratios(problem, every_terms(problem), choice) if problem.objective == "quantile" else ()
    return merit_of(request, problem, choice, tuple(map(float, ratios)))


def price_as_written(request: OptimiseRequest, design: Design) -> float:
    """Of what moving has brought a design to that the request's became."""
    stay, before = request.problem.stay, request.problem.system
    if stay is None or not stay.cost_per_mm:
        return 0.0
    homes = dict(zip(before.fiducial_labels, before.fiducials_mm, strict=True))
    now: System = compile_design(design)
    placed = zip(now.fiducial_labels, now.fiducials_mm, strict=True)
    return stay.cost_per_mm * sum(dist(at, homes[label]) for label, at in placed if label in homes)


def bring_inside(problem: PlacementProblem, choice: Choice) -> Choice:
    """The nearest choice within the regions and bounds; of grades the loosest that is not looser."""
    if problem.objective == "scaling" and problem.half_widths:
        low, high = width_bounds(problem, choice.half_width)
        widths = choice.half_width * np.exp(np.clip(0.0, low[0], high[0]))
    else:
        widths = _pay_for(problem, choice.half_width)
    for k, free in enumerate(problem.half_widths):
        if free.price.curve == "grades":
            held = [grade.half_width for grade in drop_dominated(free.price.grades)]
            widths[k] = max([h for h in held if h <= widths[k] * (1 + 1e-9)], default=min(held))
    pivots = [np.clip(at, free.low_mm, free.high_mm) for free, at in zip(problem.pivots, choice.pivots_mm, strict=True)]
    placed = clip_to_regions(problem, choice.fiducials_mm)
    moved = np.linalg.norm(placed - choice.fiducials_mm, axis=1, keepdims=True) > INSIDE_MM
    return Choice(np.where(moved, placed, choice.fiducials_mm), widths, np.array(pivots).reshape(-1, 3))


def _pay_for(problem: PlacementProblem, half_width: Array) -> Array:
    """(K,) half-widths within their bounds, made looser by one factor where they cost more than is allowed."""
    least, limit = np.maximum(half_width, problem.lower), inf if problem.cost_limit is None else problem.cost_limit

    def loosen(log_factor: float) -> Array:
        return np.asarray(np.minimum(least * np.exp(log_factor), problem.upper))

    def excess(log_factor: float) -> float:
        return float(np.log(problem.cost(loosen(log_factor)) / limit))

    if limit == inf or not len(least) or excess(0.0) <= 0:
        return loosen(0.0)
    most = float(np.log(problem.upper / least).max())
    return loosen(most if excess(most) >= 0 else float(brentq(excess, 0.0, most, xtol=1e-12)) + 1e-11)


def _outside_bounds(problem: PlacementProblem, here: Choice, inside: Choice) -> Iterator[str]:
    """What a choice had to give up."""
    for k, free in enumerate(problem.half_widths):
        value = float(here.half_width[k])
        bound = min(max(value, free.minimum), free.maximum)
        if abs(value - bound) > 1e-9 * bound:
            (shown, unit), (least, _) = for_people(problem, k, value), for_people(problem, k, bound)
            over = value > bound
            told, word = (at_least(shown), "above the largest") if over else (at_most(shown), "below the smallest")
            yield f"{in_words(problem, k)} is ±{told} {unit}, {word} half-width, {least:.4g} {unit}"
    away = np.linalg.norm(inside.fiducials_mm - here.fiducials_mm, axis=1)
    for place in problem.places:
        for copy, i in enumerate(place.fiducials):
            if away[i] > INSIDE_MM:
                of = "where the symmetry puts it" if copy else "its region"
                yield f"{problem.system.fiducial_labels[i]} is {at_least(float(away[i]), 2)} mm away from {of}"
    for pivot, at, to in zip(problem.pivots, here.pivots_mm, inside.pivots_mm, strict=True):
        if (gone := float(np.linalg.norm(to - at))) > INSIDE_MM:
            yield f"the pivot of {label_of(problem, pivot.contributor)} is {at_least(gone, 2)} mm outside its box"
    if problem.cost_limit is not None:
        cost = problem.cost(here.half_width)
        if cost > problem.cost_limit * (1 + 1e-9):
            told = f"it costs {at_least(cost)}" if np.isfinite(cost) else "what it holds has no price"
            yield f"{told}, cost_limit is {problem.cost_limit:g}"


def broken_rules(problem: PlacementProblem, terms: tuple[DemandTerms, ...], layout: Array) -> Iterator[str]:
    """Rules that a layout (N, 3) does not keep."""
    for row, value in geometric_rows(problem, terms, layout):
        if row.kind not in ("region", "stay") and not value >= row.lower - ROUNDED:
            yield _say_broken(problem, row, float(value))
    labels = problem.system.fiducial_labels
    for zone in problem.keep_out:
        free = list(problem.free_fiducials)
        for i, clear in zip(free, clear_of(zone, layout[free]), strict=True):
            if not clear:
                yield f"{labels[i]} is in the keep-out zone {zone.name!r}"


def _say_broken(problem: PlacementProblem, row: ConstraintRow, value: float) -> str:
    if row.kind in problem.distances:
        _, unit, size = problem.distances[row.kind]
        apart = f"{at_most(size * max(1 + value, 0.0) ** 0.5)} {unit}"
        told = f"is {apart}" if row.kind == "spacing" else f"are {apart} apart"
        return f"{row.text} {told}, below {size:g} {unit}"
    if row.kind == "image_gap":
        return f"{row.text} are at {max(1 + value, 0.0) ** 0.5:.0%} of the distance that keeps them apart"
    return f"{row.text}: {at_least(-100 * value, 2)} % of the image outside (margin {problem.image_margin_px:g} px)"


def say_outside(outside: Sequence[str]) -> str:
    """Where a design lies outside, in one sentence without its full stop."""
    more = len(outside) - MOST_TOLD
    told = "; ".join(outside[:MOST_TOLD]) + (f"; and {more} more" if more > 0 else "")
    return f"The design as it stands lies outside of what is asked for: {told}"

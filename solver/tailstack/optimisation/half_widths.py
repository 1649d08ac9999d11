"""The cheapest half-widths at the layout as it is, under the declared laws: while a hand drags the limit.

With the layout fixed a half-width multiplies a column of the law, so nothing is linearised twice: the exact value of
each limit that may hold, and its slopes by the logarithms of the half-widths, make a model that SLSQP solves, and that
is made again where it led until it stands still.  A limit that not even the least half-widths keep is no error: the
answer says so, and what holds it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from math import log
from typing import Literal

import numpy as np
from scipy.optimize import minimize

from ..contributors import value_of, worst_case
from ..design import Design
from ..design.loading import locate_refusals
from ..errors import DesignError, NotConvergedError, Problem
from ..estimation.checks import check_geometry
from ..geometry.arrays import Array
from ..losses import without_fiducials
from ..propagation.linear import ErrorModel
from ..results import ChangedTolerance, Provenance
from ..results.record import Published
from ..scoring import provenance
from ..system import Law
from .contradictions import refuse_contradictions
from .exact_law import exact_quantile, law_slopes
from .prices import cost_of, slope_of
from .problem import (
    PlacementProblem,
    QuantileConstraint,
    apply_choice,
    for_people,
    in_words,
    present_choice,
    unit_of,
)
from .request import read_request, round_down
from .terms import linearise_demand

AIM = 3e-6  # of a limit: how far below it the values are brought
OPTIONS = {"ftol": 1e-9, "maxiter": 200}
MOST_STEPS, SETTLED = 40, 2e-6  # relative change of the cost
STAYS = 1e-2  # relative change of half-widths in a step, after which the slopes by them stay
BINDS = 1e-4  # relative: a value so near its limit holds the cost up


@dataclass(frozen=True, slots=True, repr=False)
class Allocation(Published):
    """The cheapest half-widths that keep the limits at the layout as it is, to first order under the declared laws."""

    schema: Literal["tailstack/allocation/1"]
    status: Literal["kept", "out of reach"]
    """out of reach: not even the least half-widths keep the limits; they are the answer then."""
    requirement: str
    """Name of the requirement whose limit was asked for; without one, of the one that is nearest to its limit."""
    limit: float
    """Its limit, in `unit`."""
    least: float
    """What it comes to with every free half-width at its least: no lower limit can be kept at this layout."""
    value: float
    """What it comes to with these half-widths, in `unit`."""
    unit: str
    """Of limit, least and value: mm, unless the measure has another."""
    cost_before: float | None
    """Cost of the free half-widths as they stood; null: some of them has no price."""
    cost_after: float
    """Cost of the new ones."""
    tolerances: tuple[ChangedTolerance, ...]
    """Half-widths that the design frees and that are not locked."""
    locked: tuple[str, ...]
    """What was locked, as CONTRIBUTOR.COMPONENT or CONTRIBUTOR."""
    moved_most: str | None
    """Label of the one whose part at the target changed most; null: none changed."""
    binding: tuple[str, ...]
    """Limits that hold the cost up, in words; out of reach: those that are broken."""
    held_by: str
    """Name of the contributor with most of the error when every free half-width is at its least, or bias and bounded
    components."""
    held_label: str
    """What the document calls it."""
    held_share: float
    """Its share of the mean square then, 0 to 1."""
    provenance: Provenance
    """Which design (as it stood), by which version, under which model, and what is not included."""


def allocate(
    design: Design, *, limit: float | None = None, requirement: str | None = None, locked: Collection[str] = ()
) -> Allocation:
    """The cheapest half-widths that the ``optimise`` section of a design frees, with its layout as it is.

    limit: of a requirement, in the unit of its measure, in place of the one that the design states; requirement: its
    name, where several are asked for.  locked: half-widths that stay, as CONTRIBUTOR.COMPONENT, or all of a
    CONTRIBUTOR.  To first order, as :func:`tailstack.score`; nothing is simulated.  Raises DesignError (nothing is
    free, grades, no such requirement or half-width), IllPosedError, NotConvergedError.
    """
    with locate_refusals(design):
        problem, asked = _read(design, limit, requirement, set(locked))
        refuse_contradictions(problem)
        check_geometry(problem.system)
        held = [_hold(problem, demand) for demand in problem.demands]
        least = np.array([each.ratio_at(problem.lower) for each in held])
        found = _find(problem, held) if least.max() <= 1 - AIM else problem.lower
        each = zip(found.tolist(), problem.half_widths, strict=True)
        found = np.array([round_down(value, free, unit_of(problem, k)) for k, (value, free) in enumerate(each)])
        return _report(problem, asked, held, least, found, list(locked))


def _read(
    design: Design, limit: float | None, name: str | None, locked: set[str]
) -> tuple[PlacementProblem, str | None]:
    """The problem with its layout, views and what is locked as they are, and the requirement that is asked about."""
    request = read_request(design)
    names = {f"{free.contributor}.{free.component}": free for free in request.problem.half_widths}
    free = tuple(each for full, each in names.items() if not {full, each.contributor} & locked)
    if unknown := locked - names.keys() - {each.contributor for each in names.values()}:
        detail = f"no free half-width is called {min(unknown)!r}; there are {', '.join(names)}"
        raise DesignError(Problem("/optimise/tolerances", "unknown-tolerance", detail, "lock some of those"))
    if request.graded or not free:
        detail = "half-widths are bought from tables of grades" if request.graded else "no half-width is free"
        hint = "free some by bounds and a cost, or lock fewer; tailstack optimise chooses grades"
        raise DesignError(Problem("/optimise/tolerances", "not-allocated", detail, hint))
    known = [item.name for item in request.problem.requirements]
    if name not in known and (name is not None or (limit is not None and len(known) != 1)):
        asked = f"a limit of {limit:g} is asked for" if name is None else f"the limit of {name!r} is asked for"
        detail = f"{asked}, and the requirements of optimise are {', '.join(known) or 'none'}"
        raise DesignError(Problem("/requirements", "unknown-requirement", detail, "name one of them"))
    if limit is not None and not 0 < limit < np.inf:
        raise DesignError(Problem("/requirements", "out-of-range", f"a limit is above 0; got {limit:g}", "say 1"))
    name = known[0] if len(known) == 1 else name
    wanted = tuple(
        replace(item, limit=limit) if limit is not None and item.name == name else item
        for item in request.problem.requirements
    )
    fixed = replace(request.problem, places=(), pivots=(), half_widths=free, objective="cost", cost_limit=None)
    return replace(fixed, requirements=wanted, stay=None), name


@dataclass(frozen=True, slots=True, eq=False)
class _Held:
    """One limit at the layout."""

    problem: PlacementProblem
    demand: QuantileConstraint
    model: ErrorModel
    places: tuple[tuple[int, int], ...]  # K: of each free half-width its block, and its source in that

    def model_at(self, half_width: Array) -> ErrorModel:
        """With these half-widths (K,)."""
        system = apply_choice(self.problem, replace(present_choice(self.problem), half_width=half_width))
        mounts = {mount.name: mount for mount in system.interfaces}
        blocks = (each._replace(effect=mounts.get(each.contributor, each.effect)) for each in self.model.blocks)
        return replace(self.model, blocks=tuple(blocks))

    @property
    def levers(self) -> Array:
        """(K,) mm at the target, or another unit of the measure, per native unit of each half-width."""
        error = self.demand.requirement.error
        return np.array([np.linalg.norm(self.model.blocks[b].gain(error)[:, j]) for b, j in self.places])

    def ratio_at(self, half_width: Array) -> float:
        """Its value over its limit."""
        return exact_quantile(self.model_at(half_width), self.demand).value_mm / self.demand.requirement.limit

    def slopes_at(self, half_width: Array, ratio: float) -> Array:
        """(K,) of its logarithm by that of each half-width, where it is ``ratio`` of its limit."""
        model, requirement, slopes = self.model_at(half_width), self.demand.requirement, np.zeros(len(half_width))
        error = requirement.error
        worst = worst_case(model, error, requirement.quantile, value=value_of(requirement))
        found = law_slopes(model, self.demand, worst.mean_mm)
        for k, (b, j) in enumerate(self.places):
            block = model.blocks[b]
            key, held = (block.contributor, j), block.drawn.is_held(self.demand.level)
            if block.laws[j] is Law.BOUNDED:
                slopes[k] = worst.signs[key] * half_width[k] * (found.by.by_mean @ block.gain(error)[:, j])
            else:
                slopes[k] = found.by_log_width(key, held, block.columns_mm(error)[:, j])
        size = sum(weight * each.quantile_mm for each, weight in found.mixture)
        if self.demand.nested:
            size = ratio * requirement.limit
        return slopes / (size or 1.0)


def _hold(problem: PlacementProblem, demand: QuantileConstraint) -> _Held:
    """Raises IllPosedError."""
    model, _ = linearise_demand(without_fiducials(problem.system, demand.lost), demand)
    places = {(o.contributor, name): (b, j) for b, o in enumerate(model.blocks) for j, name in enumerate(o.components)}
    own = tuple(places[free.contributor, free.component] for free in problem.half_widths)
    return _Held(problem, demand, model, own)


def _find(problem: PlacementProblem, held: Sequence[_Held]) -> Array:
    """(K,) the cheapest by the limit that is nearest at the present half-widths, and by all that are then broken.

    The square of a value over its limit is taken to be linear in the squares of half-widths, as a mean square is;
    solved again with the slopes at what was found, until that stands still.  Where that swings, further and further
    beyond a limit, steps are halved.  After a step within STAYS the slopes stay, and only the values are read again:
    what the slopes are wrong by is in the cost by its square, and those of a quantile over a sample of units jump by
    more than they would still change.  Raises NotConvergedError.
    """
    found = np.clip(present_choice(problem).half_width, problem.lower, problem.upper)
    ratios = {each: each.ratio_at(found) for each in held}
    taken = [max(held, key=ratios.__getitem__)]
    by_square: dict[_Held, Array] = {}
    cost, worst, part, step = np.inf, np.inf, 1.0, np.inf
    for _ in range(MOST_STEPS):
        squares = np.array([ratios[each] / (1 - AIM) for each in taken]) ** 2
        cost, before = problem.cost(found), cost
        if abs(cost - before) <= SETTLED * cost and squares.max() <= 1 + AIM:
            ratios |= {each: each.ratio_at(found) for each in held if each not in taken}
            more = [each for each in held if each not in taken and ratios[each] > 1]
            if not more:
                return found
            taken, worst, part = taken + more, np.inf, 1.0
            squares = np.array([ratios[each] / (1 - AIM) for each in taken]) ** 2
        worst, part = squares.max(), part / 2 if squares.max() > worst > 1 + AIM else part
        for each, square in zip(taken, squares.tolist(), strict=True):
            if step > STAYS or each not in by_square:
                by_square[each] = square * each.slopes_at(found, ratios[each]) / found**2
        linear = np.array([by_square[each] for each in taken])
        end = _solve_model(problem, squares - linear @ found**2, linear, found)
        step, found = float(np.abs(np.log(end / found)).max()), found * (end / found) ** part
        ratios |= {each: each.ratio_at(found) for each in taken}
    detail = f"the least cost within the limits was not found in {MOST_STEPS} steps"
    raise NotConvergedError(Problem("/optimise", "allocation-not-converged", detail, "report the design"))


def _solve_model(problem: PlacementProblem, fixed: Array, by_square: Array, begin: Array) -> Array:
    """(K,) the least cost with ``fixed + by_square h^2 <= 1`` for each limit, over the logarithms of half-widths."""

    def log_cost(u: Array) -> tuple[float, Array]:
        width, cost = np.exp(u), problem.cost(np.exp(u))
        slopes = [slope_of(free.price, h) * h for free, h in zip(problem.half_widths, width.tolist(), strict=True)]
        return log(cost), np.array(slopes) / cost

    limits = {
        "type": "ineq",
        "fun": lambda u: 1 - fixed - by_square @ np.exp(2 * u),
        "jac": lambda u: -2 * by_square * np.exp(2 * u),
    }
    bounds = np.log([problem.lower, problem.upper]).T
    start = np.clip(np.log(begin), *bounds.T)
    end = minimize(log_cost, start, jac=True, bounds=bounds, constraints=limits, method="SLSQP", options=OPTIONS)
    return np.asarray(np.clip(np.exp(end.x), problem.lower, problem.upper))


def _report(
    problem: PlacementProblem,
    asked: str | None,
    held: Sequence[_Held],
    least: Array,
    now: Array,
    locked: Sequence[str],
) -> Allocation:
    """least: ratios of what is held at the least half-widths; now: (K,) half-widths that were found."""
    before, low = present_choice(problem).half_width, problem.lower
    ratios = np.array([each.ratio_at(now) for each in held])
    asked = asked or held[int(ratios.argmax())].demand.requirement.name
    own = [t for t, each in enumerate(held) if each.demand.requirement.name == asked]
    binding = [each.demand for each, ratio in zip(held, ratios, strict=True) if ratio > 1 - BINDS]
    demand, tightest = held[own[0]].demand, held[int(least.argmax())]
    tight, of = tightest.model_at(low), tightest.demand.requirement
    shares = share_out(tight, worst_case(tight, of.error, of.quantile, value=value_of(of)).mean_mm, of.error)
    points = [t for t, each in enumerate(held) if each.demand.is_point]
    levers = (held[max(points, key=ratios.__getitem__)] if points else _hold(problem, problem.in_mm[0])).levers
    moved, cost_before = levers * np.abs(now - before), problem.cost(before)
    return Allocation(
        schema="tailstack/allocation/1",
        status="kept" if least.max() <= 1 - AIM else "out of reach",
        requirement=asked,
        limit=demand.requirement.limit,
        least=float(least[own].max() * demand.requirement.limit),
        value=float(ratios[own].max() * demand.requirement.limit),
        unit=demand.measure.unit,
        cost_before=cost_before if np.isfinite(cost_before) else None,
        cost_after=problem.cost(now),
        tolerances=list_changes(problem, (levers, levers), (before, now), [None] * len(now)),
        locked=tuple(sorted(locked)),
        moved_most=in_words(problem, int(moved.argmax())) if moved.max() > 0 else None,
        binding=tuple(f"{each.text}, limit {each.limit_text} ({each.requirement.name})" for each in binding),
        held_by=(most := max(shares, key=shares.__getitem__)),
        held_label=next((block.label for block in tight.blocks if block.contributor == most), ""),
        held_share=shares[most] / sum(shares.values()),
        provenance=provenance(problem.system),
    )


def share_out(model: ErrorModel, mean_mm: Array, error: str) -> dict[str, float]:
    """The mean square of each contributor, mm^2, and of the mean (3,)."""
    shares = {"bias and bounded components": float(mean_mm @ mean_mm)}
    for block in model.blocks:
        own = float((block.columns_mm(error) ** 2).sum())
        shares[block.contributor] = shares.get(block.contributor, 0.0) + own
    return shares


def list_changes(
    problem: PlacementProblem, levers: Sequence[Array], widths: Sequence[Array], grades: Sequence[str | None]
) -> tuple[ChangedTolerance, ...]:
    """What became of each free half-width; before and after: (K,) mm per native unit at the target, and half-widths."""
    changes = []
    for k, (free, grade) in enumerate(zip(problem.half_widths, grades, strict=True)):
        before, after = (float(width[k]) for width in widths)
        (old, unit), (new, _) = for_people(problem, k, before), for_people(problem, k, after)
        cost_before = cost_of(free.price, before)
        changes.append(
            ChangedTolerance(
                contributor=free.contributor,
                component=", ".join((free.component, *free.also)),
                label=in_words(problem, k),
                unit=unit,
                before_half_width=old,
                after_half_width=new,
                at_target_before_mm=float(levers[0][k] * before),
                at_target_mm=float(levers[1][k] * after),
                cost_before=cost_before if np.isfinite(cost_before) else None,
                cost_after=cost_of(free.price, after),
                grade=grade,
                before_drawn=None if free.drawn is None else free.drawn.now,
            )
        )
    return tuple(changes)

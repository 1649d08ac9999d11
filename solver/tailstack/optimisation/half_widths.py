"""The cheapest half-widths at the layout as it is, under the declared laws: while a hand drags the limit.

With the layout fixed a half-width multiplies a column of the law, so nothing is linearised twice: the exact value of
each limit that may hold, and its slopes by the logarithms of the half-widths, make a model whose dual is solved, and
that is made again where it led until it stands still.  A limit that not even the least half-widths keep is no error:
the answer says so, and what holds it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.optimize import brentq

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
from .allocation import PriceCurves, curves_of
from .contradictions import refuse_contradictions
from .exact_law import ExactQuantile, exact_quantile, law_slopes
from .prices import cost_of
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
EXACT, TRIES = 1e-9, 50  # of a limit: how far the model is solved, and how many steps that may take
LARGEST = 300.0  # logarithm of a multiplier at which everything is at its least
MOST_STEPS, SETTLED = 40, 2e-6  # relative change of the cost
STAYS = 1e-2  # relative change of half-widths in a step, after which the slopes by them stay
STILL = 1e-3  # likewise, after which the cost stands: what it is wrong by is of the order of the square
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
        held = _hold_all(problem, problem.demands)
        least = _read_all(problem, held, problem.lower)
        within = max(each.ratio for each in least) <= 1 - AIM
        found = _find(problem, held, least) if within else least
        return _report(problem, asked, least, found, list(locked))


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

    demand: QuantileConstraint
    model: ErrorModel
    places: tuple[tuple[int, int], ...]  # K: of each free half-width its block, and its source in that

    @property
    def levers(self) -> Array:
        """(K,) mm at the target, or another unit of the measure, per native unit of each half-width."""
        error = self.demand.requirement.error
        return np.array([np.linalg.norm(self.model.blocks[b].gain(error)[:, j]) for b, j in self.places])


@dataclass(frozen=True, slots=True, eq=False)
class _Reading:
    """One limit at half-widths (K,)."""

    held: _Held
    half_width: Array
    model: ErrorModel
    exact: ExactQuantile

    @property
    def ratio(self) -> float:
        """Its value over its limit."""
        return self.exact.value_mm / self.held.demand.requirement.limit

    def slopes(self) -> Array:
        """(K,) of the logarithm of its value by that of each half-width, to 1e-4: the cost is wrong by the square."""
        demand, model, slopes = self.held.demand, self.model, np.zeros(len(self.half_width))
        error, worst = demand.requirement.error, self.exact.worst
        found = law_slopes(model, demand, worst.mean_mm, self.exact.read, fine=False)
        for k, (b, j) in enumerate(self.held.places):
            block = model.blocks[b]
            key, held = (block.contributor, j), block.drawn.is_held(demand.level)
            if block.laws[j] is Law.BOUNDED:
                slopes[k] = worst.signs[key] * self.half_width[k] * (found.by.by_mean @ block.gain(error)[:, j])
            else:
                slopes[k] = found.by_log_width(key, held, block.columns_mm(error)[:, j])
        size = (
            self.exact.value_mm if demand.nested else sum(weight * each.quantile_mm for each, weight in found.mixture)
        )
        return slopes / (size or 1.0)


def _hold_all(problem: PlacementProblem, demands: Sequence[QuantileConstraint]) -> list[_Held]:
    """Linearised once for all limits of one error.  Raises IllPosedError."""
    models: dict[tuple[object, ...], ErrorModel] = {}
    held = []
    for demand in demands:
        key = demand.requirement.error, demand.site.name, demand.place, demand.lost
        if key not in models:
            models[key], _ = linearise_demand(without_fiducials(problem.system, demand.lost), demand)
        model = models[key]
        at = {(o.contributor, name): (b, j) for b, o in enumerate(model.blocks) for j, name in enumerate(o.components)}
        own = tuple(at[free.contributor, free.component] for free in problem.half_widths)
        held.append(_Held(demand, model, own))
    return held


def _read_all(problem: PlacementProblem, held: Sequence[_Held], half_width: Array) -> list[_Reading]:
    """Each limit with these half-widths (K,)."""
    system = apply_choice(problem, replace(present_choice(problem), half_width=half_width))
    mounts = {mount.name: mount for mount in system.interfaces}
    readings = []
    for each in held:
        blocks = tuple(own._replace(effect=mounts.get(own.contributor, own.effect)) for own in each.model.blocks)
        model = replace(each.model, blocks=blocks)
        readings.append(_Reading(each, half_width, model, exact_quantile(model, each.demand)))
    return readings


def _find(problem: PlacementProblem, held: Sequence[_Held], least: Sequence[_Reading]) -> list[_Reading]:
    """All limits at the cheapest half-widths, rounded down, by the limit that is nearest at the least half-widths, and
    by all that are then broken.

    The square of a value over its limit is taken to be linear in the squares of half-widths, as a mean square is;
    solved again with the slopes at what was found, until that stands still.  Where that swings, further and further
    beyond a limit, steps are halved.  After a step within STAYS the slopes stay, and only the values are read again:
    what the slopes are wrong by is in the cost by its square, and those of a quantile over a sample of units jump by
    more than they would still change.  Raises NotConvergedError.
    """
    found = np.clip(present_choice(problem).half_width, problem.lower, problem.upper)
    taken = [max(least, key=lambda each: each.ratio).held]
    readings = _read_all(problem, taken, found)
    by_square: dict[_Held, Array] = {}
    curves = curves_of([free.price for free in problem.half_widths])
    cost, worst, part, step = np.inf, np.inf, 1.0, np.inf
    for _ in range(MOST_STEPS):
        squares = np.array([each.ratio / (1 - AIM) for each in readings]) ** 2
        cost, before = problem.cost(found), cost
        stands = abs(cost - before) <= SETTLED * cost or (step <= STILL and squares.max() >= 1 - 2 * AIM)
        if stands and squares.max() <= 1 + AIM:
            found = _round(problem, found)
            every = _read_all(problem, held, found)
            more = [each.held for each in every if each.held not in taken and each.ratio > 1]
            if not more:
                return every
            taken, worst, part = taken + more, np.inf, 1.0
            of_each = {each.held: each for each in every}
            readings = [of_each[own] for own in taken]
            squares = np.array([each.ratio / (1 - AIM) for each in readings]) ** 2
        worst, part = squares.max(), part / 2 if squares.max() > worst > 1 + AIM else part
        for each, square in zip(readings, squares.tolist(), strict=True):
            if step > STAYS or each.held not in by_square:
                by_square[each.held] = square * each.slopes() / found**2
        linear = np.array([by_square[each] for each in taken])
        end = _Model(curves, problem.lower, problem.upper, squares - linear @ found**2, linear).solve()
        step, found = float(np.abs(np.log(end / found)).max()), found * (end / found) ** part
        readings = _read_all(problem, taken, found)
    detail = f"the least cost within the limits was not found in {MOST_STEPS} steps"
    raise NotConvergedError(Problem("/optimise", "allocation-not-converged", detail, "report the design"))


def _round(problem: PlacementProblem, half_width: Array) -> Array:
    """(K,) half-widths as the document has them, none looser."""
    each = zip(half_width.tolist(), problem.half_widths, strict=True)
    return np.array([round_down(value, free, unit_of(problem, k)) for k, (value, free) in enumerate(each)])


@dataclass(frozen=True, slots=True, eq=False)
class _Model:
    """The least cost with ``fixed + by_square h^2 <= 1`` for each of T limits: at what these charge for the square of
    each half-width, each is the cheapest by itself."""

    curves: PriceCurves
    lower: Array  # (K,)
    upper: Array  # (K,)
    fixed: Array  # (T,)
    by_square: Array  # (T, K)

    def charge(self, multipliers: Array) -> Array:
        """(K,) for the square of each half-width, at the multipliers (T,) of the limits."""
        return np.maximum(multipliers @ self.by_square, 0.0)

    def cheapest(self, multipliers: Array) -> Array:
        """(K,) half-widths at those."""
        return self.curves.cheapest(self.charge(multipliers), self.lower, self.upper)

    def excess(self, half_width: Array) -> Array:
        """(T,) beyond each limit."""
        return np.asarray(self.fixed + self.by_square @ half_width**2 - 1)

    def solve(self) -> Array:
        """(K,) half-widths; the least where they do not keep the limits."""
        multipliers = np.zeros(len(self.fixed))
        for t in range(len(multipliers)):
            self._meet(t, multipliers)
        if len(multipliers) > 1:
            self._meet_all(multipliers)
        return self.cheapest(multipliers)

    def _meet(self, t: int, multipliers: Array) -> None:
        """Put one multiplier where its limit is kept at the others as they are, in place."""

        def over(logarithm: float) -> float:
            multipliers[t] = np.exp(logarithm)
            return float(self.excess(self.cheapest(multipliers))[t])

        if self.excess(self.cheapest(multipliers))[t] <= 0:
            return
        if self.excess(self.lower)[t] >= 0:
            multipliers[t] = np.exp(LARGEST)
            return
        least = more = float(self.curves.log_cost(self.upper).max())
        while over(least) < 0:
            least -= 4.0
        while over(more) > 0 and more < LARGEST:
            more += 4.0
        multipliers[t] = np.exp(brentq(over, least, more, xtol=1e-13) if more > least else more)

    def _meet_all(self, multipliers: Array) -> None:
        """Newton's method in the dual with what is not above 0 held at 0 (Bertsekas 1982, SIAM Journal on Control and
        Optimization 20, 221-246), in place."""

        def dual(at: Array) -> float:
            half_width = self.cheapest(at)
            return float(self.curves.cost(half_width).sum() + at @ self.excess(half_width))

        for _ in range(TRIES):
            half_width = self.cheapest(multipliers)
            excess = self.excess(half_width)
            free = (multipliers > 0) | (excess > 0)
            if np.abs(excess[free]).max(initial=0.0) <= EXACT:
                return
            between = (half_width > self.lower) & (half_width < self.upper)
            yielding = np.where(between, self.curves.yielding(half_width, self.charge(multipliers)), 0.0)
            own = self.by_square[free]
            bend = (own * yielding) @ own.T
            step, part = np.zeros(len(multipliers)), 1.0
            step[free] = np.linalg.lstsq(bend + 1e-12 * np.trace(bend) * np.eye(len(bend)), excess[free], rcond=None)[0]
            here, moved = dual(multipliers), np.maximum(multipliers + step, 0.0)
            while dual(moved) < here + 1e-4 * float(excess @ (moved - multipliers)) and part > 1e-9:
                part /= 2
                moved = np.maximum(multipliers + part * step, 0.0)
            multipliers[:] = moved


def _report(
    problem: PlacementProblem,
    asked: str | None,
    least: Sequence[_Reading],
    found: Sequence[_Reading],
    locked: Sequence[str],
) -> Allocation:
    """least, found: all limits at the least half-widths, and at those that were found."""
    before, now = present_choice(problem).half_width, found[0].half_width
    asked = asked or max(found, key=lambda each: each.ratio).held.demand.requirement.name
    own = [t for t, each in enumerate(found) if each.held.demand.requirement.name == asked]
    binding = [each.held.demand for each in found if each.ratio > 1 - BINDS]
    demand, tightest = found[own[0]].held.demand, max(least, key=lambda each: each.ratio)
    shares = share_out(tightest.model, tightest.exact.worst.mean_mm, tightest.held.demand.requirement.error)
    points = [each for each in found if each.held.demand.is_point]
    leading = max(points, key=lambda each: each.ratio).held if points else _hold_all(problem, problem.in_mm[:1])[0]
    levers = leading.levers
    moved, cost_before = levers * np.abs(now - before), problem.cost(before)
    return Allocation(
        schema="tailstack/allocation/1",
        status="out of reach" if found is least else "kept",
        requirement=asked,
        limit=demand.requirement.limit,
        least=max(least[t].ratio for t in own) * demand.requirement.limit,
        value=max(found[t].ratio for t in own) * demand.requirement.limit,
        unit=demand.measure.unit,
        cost_before=cost_before if np.isfinite(cost_before) else None,
        cost_after=problem.cost(now),
        tolerances=list_changes(problem, (levers, levers), (before, now), [None] * len(now)),
        locked=tuple(sorted(locked)),
        moved_most=in_words(problem, int(moved.argmax())) if moved.max() > 0 else None,
        binding=tuple(f"{each.text}, limit {each.limit_text} ({each.requirement.name})" for each in binding),
        held_by=(most := max(shares, key=shares.__getitem__)),
        held_label=next((block.label for block in tightest.model.blocks if block.contributor == most), ""),
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

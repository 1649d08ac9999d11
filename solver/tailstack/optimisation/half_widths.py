"""The cheapest half-widths at the layout as it is, under the declared laws: while a hand drags the limit.

With the layout fixed a half-width multiplies a column of the law, so nothing is linearised twice: closed forms of all
limits lead to the answer, and the exact law is read there, two or three times, of the limits that matter.  A limit
that not even the least half-widths keep is no error: the answer says so, and what holds it."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ..contributors import read_value
from ..design import Design
from ..design.compile import loss_probabilities
from ..design.loading import locate_refusals
from ..errors import DesignError, NotConvergedError, OutOfRangeError, Problem
from ..estimation.checks import check_geometry
from ..fields import LEAST_LENGTH, LENGTH
from ..geometry.arrays import Array
from ..losses import LossSearch, without_fiducials
from ..propagation.linear import Chain, ErrorModel, chain_of, linearise_all
from ..results import ChangedTolerance, Provenance
from ..results.record import Published
from ..scoring import provenance
from ..system import Law
from ..tail.declared import LawReading
from .closed_limits import close_limits
from .contradictions import refuse_contradictions
from .exact_law import ExactQuantile, exact_quantile, law_slopes
from .least_cost import AIM, MOST_STEPS, Widths, curves_of, find_cheapest, log_squares
from .prices import cost_of
from .problem import PlacementProblem, QuantileConstraint, apply_choice, for_people, in_words, present_choice
from .request import read_request, round_down
from .terms import linearise_demand

SHORT = 1.2e-5  # of a limit: a value no farther below it is there
SETTLED, ROUGHLY = 1e-4, 1e-2  # relative steps of half-widths by which closed forms are solved, and before a reading
STAYS = 0.06  # relative change of half-widths, after which slopes by them are still good
NEARLY, CLOSELY = 0.02, 0.1  # of a limit: a value no farther below it may hold the cost up; in closed form
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
    free, grades, no such requirement or half-width), OutOfRangeError (a limit on what no estimate is known of where
    fiducials are missed), IllPosedError, NotConvergedError.
    """
    with locate_refusals(design):
        problem, asked = _read(design, limit, requirement, set(locked))
        refuse_contradictions(problem)
        check_geometry(problem.system)
        missed = loss_probabilities(design.document.fiducials, len(problem.system.fiducials_mm))
        held = _count_losses(problem, _hold_all(problem, problem.demands), problem.lower, missed)
        least = _Readings(problem, held, problem.lower).decide(asked)
        now, found = problem.lower, least
        if max(each.ratio for each in least) <= 1 - AIM:
            now, found = _settle(problem, held, least, asked, missed)
        return _report(problem, asked, least, found, now, list(locked), bool(missed))


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
        which = f"say of which: requirement, on the command line --requirement {known[0]}" if known else "state one"
        raise DesignError(Problem("/requirements", "unknown-requirement", detail, which))
    if limit is not None and not LEAST_LENGTH <= limit <= LENGTH:
        detail = f"a limit is from {LEAST_LENGTH:g} to {LENGTH:g}; got {limit:g}"
        raise DesignError(Problem("/requirements", "out-of-range", detail, "say 1"))
    name = known[0] if len(known) == 1 else name
    wanted = request.problem.requirements
    if limit is not None:
        wanted = tuple(replace(item, limit=limit) if item.name == name else item for item in wanted)
    fixed = replace(request.problem, places=(), pivots=(), half_widths=free, objective="cost", cost_limit=None)
    return replace(fixed, requirements=wanted, stay=None), name


@dataclass(frozen=True, slots=True, eq=False)
class _Held:
    """One limit at the layout."""

    demand: QuantileConstraint
    model: ErrorModel
    places: tuple[tuple[int, int], ...]  # K: of each free half-width its block, and its source in that
    times: float = 1.0  # its value over all shots by that of those that miss no fiducial

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
    error: float  # relative, of its value; 0: it was read exactly
    apart: float = 0.0  # largest logarithm of half-widths that it does for by its own

    @property
    def doubt(self) -> float:
        """Relative, of its value."""
        return self.error + 2 * float(np.expm1(self.apart))

    def may_reach(self, ratio: float) -> bool:
        """Whether its value over its limit may be this or more."""
        return self.ratio * (1 + self.doubt) >= ratio

    def is_like(self, other: _Reading) -> bool:
        """Whether it is of the same error, whose shares and levers are the same."""
        demand, with_demand = self.held.demand, other.held.demand
        same = self.held.model is other.held.model and demand.requirement.error == with_demand.requirement.error
        return same and bool((self.exact.worst.mean_mm == other.exact.worst.mean_mm).all())

    @property
    def ratio(self) -> float:
        """Its value over its limit."""
        return self.exact.value_mm * self.held.times / self.held.demand.requirement.limit

    def slopes(self) -> Array:
        """(K,) of the logarithm of its value by that of each half-width, to 1e-4: the cost is wrong by the square."""
        demand, model, slopes = self.held.demand, self.model, np.zeros(len(self.half_width))
        error, worst = demand.requirement.error, self.exact.worst
        found = law_slopes(model, demand, worst.mean_mm, self.exact.read, fine=False)
        for k, (b, j) in enumerate(self.held.places):
            block = model.blocks[b]
            key, held = (block.contributor, j), block.effect.drawn.is_held(demand.level)
            if block.laws[j] is Law.BOUNDED:
                slopes[k] = worst.signs[key] * self.half_width[k] * (found.by.by_mean @ block.gain(error)[:, j])
            else:
                slopes[k] = found.by_log_width(key, held, block.columns_mm(error)[:, j])
        size = self.exact.value_mm
        if not demand.is_nested:
            size = sum(weight * each.quantile_mm for each, weight in found.mixture)
        return slopes / (size or 1.0)


def _hold_all(problem: PlacementProblem, demands: Sequence[QuantileConstraint]) -> list[_Held]:
    """Linearised once for all limits of one error.  Raises IllPosedError."""
    models: dict[tuple[object, ...], ErrorModel] = {}
    chains: dict[tuple[str, ...], Chain] = {}
    held = []
    for demand in demands:
        if demand.lost not in chains:
            chains[demand.lost] = chain_of(without_fiducials(problem.system, demand.lost))
        key = demand.requirement.error, demand.site.name, demand.place, demand.lost
        if key not in models:
            models[key], _ = linearise_demand(chains[demand.lost], demand)
        model = models[key]
        at = {(o.contributor, name): (b, j) for b, o in enumerate(model.blocks) for j, name in enumerate(o.components)}
        own = tuple(at[free.contributor, free.component] for free in problem.half_widths)
        held.append(_Held(demand, model, own))
    return held


def _count_losses(
    problem: PlacementProblem, held: Sequence[_Held], half_width: Array, missed: tuple[float, ...]
) -> list[_Held]:
    """With ``times`` at half-widths (K,); missed: probability of each fiducial, or ().  Raises OutOfRangeError."""
    if not missed:
        return list(held)
    system = apply_choice(problem, replace(present_choice(problem), half_width=half_width))
    chain, counted = chain_of(replace(system, loss_probability=missed)), []
    search = LossSearch(chain, linearise_all(chain))
    for each in held:
        demand, asked = each.demand, each.demand.requirement
        if demand.lost:
            counted.append(each)
            continue
        if demand.is_nested or not demand.is_point:
            raise _refuse_losses(f"no estimate is known of {demand.text} where fiducials are missed")
        law = search.law_of_shots(demand.site.name, asked.error, asked.quantile)
        none = read_value(asked, LawReading(law.laws[0], asked.quantile, asked.limit))
        row, value = asked.row, law.quantile(asked.quantile)
        if not row.by_quantile and row.of_law is not None:
            value = row.of_law(law.summary(asked.quantile, asked.limit)) or 0.0
        if value == np.inf:
            raise _refuse_losses(f"too many shots leave too few fiducials for {demand.text} to have a bound")
        counted.append(replace(each, times=value / none if none else 1.0))
    return counted


def _refuse_losses(detail: str) -> OutOfRangeError:
    hint = "tailstack optimise holds its limits against all shots; without loss_probability those that miss none count"
    return OutOfRangeError(Problem("/fiducials/loss_probability", "not-allocated", detail, hint))


class _Readings:
    """Limits at half-widths (K,), each read when it is asked for.

    before: others nearby, whose readings do for limits that are far from reached.  Wider half-widths, times t > 1, make
    of an error m + u at most ``t |m + u| + (t - 1) |m|``, and |m| is at most its median; with room nothing bounds it.
    """

    def __init__(
        self, problem: PlacementProblem, held: Sequence[_Held], half_width: Array, before: _Readings | None = None
    ) -> None:
        self.held, self.half_width = held, half_width
        system = apply_choice(problem, replace(present_choice(problem), half_width=half_width))
        self._mounts = {mount.name: mount for mount in system.interfaces}
        self.read: dict[int, _Reading] = {}
        for t, each in before.read.items() if before else ():
            moved = replace(each, apart=float(np.abs(np.log(half_width / each.half_width)).max()))
            if each.model.room is None and not moved.may_reach(1 - NEARLY):
                self.read[t] = moved

    def at(self, t: int, *, fine: bool) -> _Reading:
        """Not fine: quickly, where it is not read yet."""
        known = self.read.get(t)
        if known is None or (fine and (known.doubt or known.half_width is not self.half_width)):
            own, mounts = self.held[t], self._mounts
            blocks = [block._replace(effect=mounts.get(block.contributor, block.effect)) for block in own.model.blocks]
            model = replace(own.model, blocks=tuple(blocks))
            exact = exact_quantile(model, own.demand, fine=fine)
            known = _Reading(own, self.half_width, model, exact, 0.0 if fine else 2 * exact.relative_error)
            self.read[t] = known
        return known

    def decide(self, asked: str | None) -> list[_Reading]:
        """All: exact of those that may be the largest, of all or of the requirement that is asked about, or reach their
        limit; others quickly."""
        every = [self.at(t, fine=False) for t in range(len(self.held))]
        own = [each for each in every if each.held.demand.requirement.name == asked]
        bars = [(group, max((each.ratio * (1 - each.doubt) for each in group), default=0.0)) for group in (every, own)]
        tops, highest = ([each for each in group if each.may_reach(bar)] for group, bar in bars)
        if asked and bars[0][1] < 1 and all(each.is_like(tops[0]) for each in tops):
            tops = []
        exactly = {each.held for each in (*tops, *highest)} | {each.held for each in every if each.may_reach(1.0)}
        return [self.at(t, fine=each.held in exactly) for t, each in enumerate(every)]


def _settle(
    problem: PlacementProblem,
    held: Sequence[_Held],
    least: Sequence[_Reading],
    asked: str | None,
    missed: tuple[float, ...],
) -> tuple[Array, list[_Reading]]:
    """The half-widths (K,) of :func:`_find`, and all limits there.

    What missed fiducials add hardly depends on the half-widths: it is counted where they led to, and they are found
    again, until it is what was reckoned with.  Raises NotConvergedError.
    """
    for _ in range(MOST_STEPS):
        best = _find(problem, held, least)
        found, counted = best.decide(asked), _count_losses(problem, held, best.half_width, missed)
        more = np.array([now.times / before.times - 1 for now, before in zip(counted, held, strict=True)])
        if (more <= 0).all() and (more >= -2 * SHORT).all():
            return best.half_width, [replace(each, held=own) for each, own in zip(found, counted, strict=True)]
        held = [replace(each, times=each.times * (1 + SHORT)) for each in counted]
    raise _not_converged("what missed fiducials add was not settled")


def _find(problem: PlacementProblem, held: Sequence[_Held], least: Sequence[_Reading]) -> _Readings:
    """The cheapest half-widths, rounded down.

    Closed forms lead near them; they are led through what is read there quickly, and in the end exactly, until all
    limits are kept and one of them is reached.  Slopes are read once, where a limit comes near, and again after a step
    beyond STAYS, twice as far each time: those of a quantile over a sample of units jump.  Raises NotConvergedError.
    """
    closed = close_limits(
        [each.demand for each in held],
        [each.model for each in held],
        [each.places for each in held],
        [each.exact.worst for each in least],
        problem.lower,
    )
    widths = Widths(curves_of([free.price for free in problem.half_widths]), problem.lower, problem.upper)
    start = np.clip(present_choice(problem).half_width, problem.lower, problem.upper)
    found, _ = find_cheapest(closed, widths, start, ROUGHLY)
    readings, turned_at = None, dict[int, tuple[Array, float]]()
    for steps in range(MOST_STEPS):
        exactly = steps > 0
        aimed, found = found, _round(problem, found) if exactly else found
        readings = _Readings(problem, held, found, readings)
        logs, _ = log_squares(closed, found)
        near = np.exp(logs / 2) >= 1 - (NEARLY if exactly else CLOSELY)
        ratios = np.full(len(held), np.nan)
        for t in np.flatnonzero(near | exactly).tolist():
            each = readings.at(t, fine=exactly and bool(near[t]))
            if exactly and each.may_reach(1 - NEARLY):  # known exactly it may do for the next half-widths, too
                each = readings.at(t, fine=True)
            if each.half_width is found:
                ratios[t] = each.ratio
        closed.anchor(logs, ratios)
        end, multipliers = find_cheapest(closed, widths, found, SETTLED)
        binding, turned = np.flatnonzero(multipliers).tolist() if exactly else [], False
        for t in binding:
            at, reach = turned_at.get(t, (found, 0.0))
            if not np.abs(np.log(found / at)).max() < reach:
                closed.turn(t, found, readings.at(t, fine=True).slopes())
                turned_at[t], turned = (found, 2 * reach or STAYS), True
        if turned:
            end, _ = find_cheapest(closed, widths, found, SETTLED)
        elif exactly:
            largest = max(readings.at(t, fine=False).ratio for t in range(len(held)))
            foreseen = np.abs(np.log(end / aimed)).max() <= SETTLED and all(
                abs(2 * np.log(ratios[t]) - logs[t]) <= AIM for t in binding
            )
            if largest <= 1 and (largest >= 1 - SHORT or foreseen):  # what is left is what was rounded down
                return readings
        found = end
    raise _not_converged("the least cost within the limits was not found")


def _not_converged(what: str) -> NotConvergedError:
    detail = f"{what} in {MOST_STEPS} steps"
    return NotConvergedError(Problem("/optimise", "allocation-not-converged", detail, "report the design"))


def _round(problem: PlacementProblem, half_width: Array) -> Array:
    """(K,) half-widths as the document has them, none looser."""
    return np.array([round_down(problem, k, value) for k, value in enumerate(half_width.tolist())])


def _report(
    problem: PlacementProblem,
    asked: str | None,
    least: Sequence[_Reading],
    found: Sequence[_Reading],
    now: Array,
    locked: Sequence[str],
    missed: bool,
) -> Allocation:
    """least, found: all limits at the least half-widths, and at those that were found, now (K,); missed: whether they
    are on shots that miss fiducials, too."""
    before = present_choice(problem).half_width
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
        tolerances=tuple(list_changes(problem, (levers, levers), (before, now), [None] * len(now))),
        locked=tuple(sorted(locked)),
        moved_most=in_words(problem, int(moved.argmax())) if moved.max() > 0 else None,
        binding=tuple(f"{each.text}, limit {each.limit_text} ({each.requirement.name})" for each in binding),
        held_by=(most := max(shares, key=shares.__getitem__)),
        held_label=next((block.label for block in tightest.model.blocks if block.contributor == most), ""),
        held_share=shares[most] / sum(shares.values()),
        provenance=provenance(problem.system, missed=missed),
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
) -> Iterator[ChangedTolerance]:
    """What became of each free half-width; before and after: (K,) mm per native unit at the target, and half-widths."""
    for k, (free, grade) in enumerate(zip(problem.half_widths, grades, strict=True)):
        before, after = (float(width[k]) for width in widths)
        (old, unit), (new, _) = for_people(problem, k, before), for_people(problem, k, after)
        cost_before = cost_of(free.price, before)
        yield ChangedTolerance(
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

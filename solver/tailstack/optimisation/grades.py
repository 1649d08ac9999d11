"""Process grades: tolerances that are bought from a table, together with a layout and with budgets that are not.

Alternates until neither step pays: the cheapest grades at the layout, then the layout and the continuous half-widths
with those grades held.  The first layout comes from the relaxation that prices grades by the power law through them.
Where every free tolerance has a table the grades are chosen exactly.  Beside continuous budgets each
assignment is worth its price and the least cost of those budgets at the layout: all assignments are compared, or
where there are too many, single changes are made as long as one pays.

*The exact choice* at a fixed layout, under the exact law: which assignments of grades meet the limits is asked of the
exact law, one evaluation at a time; which to ask about comes from a master problem over binary choices (one per
tolerance and undominated grade) that knows only *monotone cuts*: where an assignment fails, some tolerance must be
tighter than in it.  A failing assignment is first tightened as far as it still fails, which gives the strongest cut;
a passing one is loosened as far as it still passes, which gives a candidate.  The master's optimum never costs more
than the true one, a candidate never less; where they meet, the candidate is proven cheapest.

The cuts need the quantile not to fall when a half-width grows.  For symmetric unimodal laws without bias that is a
theorem (Anderson 1955, Proc. Amer. Math. Soc. 6, 170-176: spreading such a law takes probability out of every centred
ball).  With a bias inside the ball it is what is observed, not proven; the answer meets the limits either way, for
it was evaluated, and only the lower bound rests on it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from math import inf, log, prod

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp

from ..errors import InfeasibleError, NotConvergedError, Problem
from ..geometry.arrays import Array
from ..results import Relaxation
from ..results.digits import at_least, at_most
from .allocation import best_budget, budgets_of
from .exact_law import closed_form_at, evaluate_demand, exact_ratios
from .placement import PlacementSolution, settle
from .prices import Price, PricedGrade, cost_of, drop_dominated
from .problem import Choice, PlacementProblem, apply_choice, present_choice
from .program import build_program, solve
from .search import Iterate, Search, Stop, start_at
from .terms import every_terms

MAX_ALTERNATIONS = 4
PAYS = 1e-6  # relative: a cheaper choice than that is worth another round
COMPARED = 400  # assignments that are all compared; beyond, single changes
SPARE = 3  # next best assignments, for when the exact law refuses the best


@dataclass(frozen=True, slots=True, eq=False)
class Purchase:
    """Grades chosen at a layout."""

    half_width: Array  # (G,) of the graded tolerances, native units
    names: tuple[str, ...]
    bound: Relaxation


@dataclass(frozen=True, slots=True, eq=False)
class Optimum:
    """An optimum by the exact law: of the continuous programme, or of grades and what was left of it."""

    problem: PlacementProblem
    choice: Choice  # of the whole problem
    cost: float
    ratios: tuple[float, ...]  # exact quantile over its limit, every demand
    solution: PlacementSolution | None  # of what is continuous; None where everything was bought from tables
    purchase: Purchase | None = None

    @staticmethod
    def of(solution: PlacementSolution) -> Optimum:
        """Without grades."""
        return Optimum(solution.problem, solution.choice, solution.cost, solution.ratios, solution)


def settle_grades(search: Search, aims: Array, graded: tuple[int, ...], stop: Stop | None = None) -> Optimum:
    """Cheapest grades found, every exact quantile at or below its aim.

    Raises InfeasibleError when even the tightest grades do not do, NotConvergedError.
    """
    problem = search.program.problem
    exact = len(graded) == len(problem.half_widths)
    best: tuple[float, Choice, tuple[Purchase, ...]] | None = None
    for item in search.iterates:
        # The relaxation at its aims: the tightest grades are no looser, so there is something to choose.
        start = settle(replace(search, iterates=(item,)), aims)
        bought = _choose(search, aims, graded, start.choice, stop) if exact else _compare(search, aims, graded, start)
        cost = _price(problem, graded, bought[0].half_width) if exact else float(bought[0].bound.cost or inf)
        if best is None or cost < best[0] * (1 - PAYS):
            best = (cost, start.choice, bought)
        if stop is not None and stop():
            break
    assert best is not None  # a search has at least one point
    return _alternate(search, aims, graded, best[1], best[2], stop)


def _alternate(
    search: Search, aims: Array, graded: tuple[int, ...], start: Choice, first: tuple[Purchase, ...], stop: Stop | None
) -> Optimum:
    problem = search.program.problem
    exact = len(graded) == len(problem.half_widths)
    choice, best, bought = start, None, first
    for round_ in range(MAX_ALTERNATIONS):
        if round_:
            bought = (
                _choose(search, aims, graded, choice, stop) if exact else _compare_again(search, aims, graded, choice)
            )
        candidate = _first_that_holds(search, aims, graded, choice, bought)
        if best is not None and candidate.cost >= best.cost * (1 - PAYS):
            break
        best, choice = candidate, candidate.choice
        if not (problem.places or problem.pivots or problem.spacings) or (stop is not None and stop()):
            break
    assert best is not None  # the loop ran
    return best


def _first_that_holds(
    search: Search, aims: Array, graded: tuple[int, ...], choice: Choice, bought: tuple[Purchase, ...]
) -> Optimum:
    """The cheapest of the proposals that the exact law accepts.  Raises InfeasibleError when it accepts none."""
    refused: InfeasibleError | None = None
    for item in bought:
        width = _replace_widths(choice.half_width, graded, item.half_width)
        try:
            return _place(search, aims, graded, replace(choice, half_width=width), item)
        except InfeasibleError as error:
            refused = refused or error
    assert refused is not None  # there is at least one proposal
    raise refused


def _price(problem: PlacementProblem, graded: tuple[int, ...], half_width: Array) -> float:
    priced = zip((problem.half_widths[k].price for k in graded), half_width, strict=True)
    return sum((cost_of(price, float(value)) for price, value in priced), 0.0)


def _choose(
    search: Search, aims: Array, graded: tuple[int, ...], choice: Choice, stop: Stop | None
) -> tuple[Purchase, ...]:
    """The cheapest grades at this layout, by the exact law and with a bound; every free tolerance has a table."""
    problem = search.program.problem

    def worst(half_width: Array) -> float:
        at = replace(choice, half_width=_replace_widths(choice.half_width, graded, half_width))
        return float((exact_ratios(problem, search.terms, at) / aims).max())

    prices = [problem.half_widths[k].price for k in graded]
    solution = choose_grades(prices, worst, start=choice.half_width[list(graded)], stop=stop)
    where = "at this layout" if problem.places else "for this layout"
    bound = Relaxation(
        "monotone cuts over grades",
        solution.cost,
        solution.lower_bound,
        solution.gap_percent,
        f"{solution.statement.rstrip('.')} ({where})",
    )
    return (Purchase(solution.half_width, solution.names, bound),)


def _replace_widths(half_width: Array, graded: tuple[int, ...], values: Array) -> Array:
    changed = half_width.copy()
    changed[list(graded)] = values
    return changed


def _compare_again(search: Search, aims: Array, graded: tuple[int, ...], choice: Choice) -> tuple[Purchase, ...]:
    """The comparison at a layout that was optimised since."""
    layout = start_at(search.program, choice.fiducials_mm)
    point = solve(search.program, layout.x, layout.parameters)
    start = settle(replace(search, iterates=(Iterate(point, layout.parameters),)), aims)
    return _compare(search, aims, graded, start)


def _compare(search: Search, aims: Array, graded: tuple[int, ...], start: PlacementSolution) -> tuple[Purchase, ...]:
    """The best assignments beside continuous budgets at the layout of a settled relaxation, cheapest first."""
    program, choice = start.program, start.choice
    problem = program.problem
    ladders = [drop_dominated(problem.half_widths[k].price.grades) for k in graded]
    evaluations = [evaluate_demand(problem, term, choice) for term in program.terms]
    own = {term.demand.key: aim for term, aim in zip(search.terms, aims, strict=True)}
    offsets = np.array(
        [
            2 * log(item.exact_mm / closed_form_at(problem, term, item, choice)) - 2 * log(own[term.demand.key])
            for term, item in zip(program.terms, evaluations, strict=True)
        ]
    )
    small, start_logs = budgets_of(program), np.log(choice.half_width)
    known: dict[tuple[int, ...], float] = {}

    def cost(levels: tuple[int, ...]) -> float:
        if levels not in known:
            fixed = {k: ladder[level].half_width for k, ladder, level in zip(graded, ladders, levels, strict=True)}
            budget = best_budget(small, choice, evaluations, start_logs, fixed=fixed, offsets=offsets)
            known[levels] = (
                inf
                if budget is None
                else problem.cost(
                    # as they are in their tables, not as the solver rounded them
                    _replace_widths(budget.half_width, graded, np.array(list(fixed.values())))
                )
            )
        return known[levels]

    if prod(map(len, ladders)) <= COMPARED:
        for levels in product(*(range(len(ladder)) for ladder in ladders)):
            cost(levels)
        how = f"all {len(known)} assignments of grades were compared at this layout"
    else:
        _descend(
            cost,
            ladders,
            tuple(_no_looser(ladder, choice.half_width[k]) for k, ladder in zip(graded, ladders, strict=True)),
        )
        how = f"{len(known)} assignments of grades were compared at this layout; no single change of grade is cheaper"
    ranked = sorted((value, levels) for levels, value in known.items() if value < inf)[: 1 + SPARE]
    if not ranked:  # the closed form refuses what the exact law may accept
        ranked = [(inf, tuple(0 for _ in ladders))]
    statement = f"{how}, the other half-widths optimised for each; no bound is known beyond that"
    return tuple(
        Purchase(
            np.array([ladder[level].half_width for ladder, level in zip(ladders, levels, strict=True)]),
            tuple(ladder[level].name for ladder, level in zip(ladders, levels, strict=True)),
            Relaxation("none", value if value < inf else None, None, None, statement),
        )
        for value, levels in ranked
    )


def _no_looser(ladder: tuple[PricedGrade, ...], half_width: float) -> int:
    """The loosest grade that holds a half-width."""
    return max([level for level, grade in enumerate(ladder) if grade.half_width <= half_width * (1 + 1e-9)], default=0)


def _descend(
    cost: Callable[[tuple[int, ...]], float], ladders: list[tuple[PricedGrade, ...]], start: tuple[int, ...]
) -> None:
    """One grade up or down at a time, and exchanges of one up for one down, as long as one pays."""
    here = start
    while True:
        near = [_shift_levels(here, {k: step}) for k in range(len(here)) for step in (-1, 1)]
        near += [_shift_levels(here, {a: 1, b: -1}) for a in range(len(here)) for b in range(len(here)) if a != b]
        inside = [
            levels
            for levels in near
            if all(0 <= level < len(ladder) for level, ladder in zip(levels, ladders, strict=True))
        ]
        best = min(inside, key=cost, default=here)
        if cost(best) >= cost(here) * (1 - PAYS) or cost(best) == inf:
            return
        here = best


def _shift_levels(levels: tuple[int, ...], steps: dict[int, int]) -> tuple[int, ...]:
    return tuple(level + steps.get(k, 0) for k, level in enumerate(levels))


def _place(search: Search, aims: Array, graded: tuple[int, ...], choice: Choice, bought: Purchase) -> Optimum:
    """Everything else optimised with the grades held: budgets that are continuous, or the layout for more room."""
    whole = search.program.problem
    rest = hold_grades(whole, choice, graded)
    if not (rest.half_widths or rest.places or rest.pivots or rest.spacings):
        ratios = tuple(float(ratio) for ratio in exact_ratios(whole, search.terms, choice))
        return Optimum(whole, choice, whole.cost(choice.half_width), ratios, None, bought)
    program = build_program(rest, search.estimator, every_terms(rest))
    start = start_at(program, choice.fiducials_mm)
    point = solve(program, start.x, start.parameters)
    inner = replace(search, program=program, iterates=(Iterate(point, start.parameters),), terms=program.terms)
    solution = settle(inner, aims)
    others = tuple(k for k in range(len(choice.half_width)) if k not in graded)
    width = _replace_widths(choice.half_width, others, solution.choice.half_width)
    placed = replace(solution.choice, half_width=width)
    return Optimum(whole, placed, whole.cost(width), solution.ratios, solution, bought)


def hold_grades(problem: PlacementProblem, choice: Choice, graded: tuple[int, ...]) -> PlacementProblem:
    """The problem with these half-widths no longer free but at their value in a choice."""
    here = present_choice(problem)
    width = _replace_widths(here.half_width, graded, choice.half_width[list(graded)])
    system = apply_choice(problem, replace(here, half_width=width))
    left = tuple(free for k, free in enumerate(problem.half_widths) if k not in graded)
    return replace(problem, system=system, half_widths=left, objective="cost" if left else "quantile")


Levels = tuple[int, ...]  # of each tolerance the index of its grade, 0 the tightest
_EQUAL = 1e-9  # relative: costs closer than this are the same
# A master is solved only as well as the bracket at the time deserves: its bound holds whatever its own gap is.
_SHARE, _SMALLEST_SHARE = 0.3, 1e-4
_STRIDE = (
    3  # every third rotation of the order of tightening makes a cut of its own: fewer masters, as many evaluations
)
_MASTER_TOTAL = 1e5  # the largest cost in the master, so that its absolute tolerances are below _EQUAL


@dataclass(frozen=True, slots=True, eq=False)
class GradeChoice:
    """The cheapest assignment found, and what none can undercut."""

    half_width: Array  # (k,) native units
    names: tuple[str, ...]
    cost: float
    lower_bound: float
    gap_percent: float  # of the cost
    evaluations: int  # of the exact law
    proven: bool  # the cost is the lower bound
    statement: str


class _SpentError(Exception):
    """No further evaluation is allowed."""


@dataclass(slots=True)
class _Descent:
    """What is known so far.  Feasible assignments are closed downwards, infeasible ones upwards."""

    ladders: tuple[tuple[PricedGrade, ...], ...]
    worst_ratio: Callable[[Array], float]
    max_evaluations: int
    stop: Callable[[], bool]
    best: Levels
    cost: float
    evaluations: int = 0
    feasible: list[Levels] = field(default_factory=list)  # evaluated, none below another
    infeasible: list[Levels] = field(default_factory=list)  # evaluated, none above another: the cuts


def choose_grades(
    prices: Sequence[Price],
    worst_ratio: Callable[[Array], float],
    *,
    start: Array | None = None,
    max_evaluations: int = 4000,
    stop: Callable[[], bool] | None = None,
) -> GradeChoice:
    """The cheapest grade of every tolerance with ``worst_ratio <= 1``, or the best found and how far off it may be.

    prices (k,) are tables of grades; worst_ratio takes half-widths (k,), native units, and returns the largest
    quantile over its limit.  start (k,) half-widths, rounded down to grades, gives the first candidate.  Ends early
    after max_evaluations, or when ``stop()`` is true.  Raises InfeasibleError when the tightest grades are over a
    limit.
    """
    ladders = tuple(drop_dominated(price.grades) for price in prices)
    tightest, loosest = tuple(0 for _ in ladders), tuple(len(ladder) - 1 for ladder in ladders)
    ratio = worst_ratio(_half_widths(ladders, tightest))
    if not ratio <= 1:
        raise _refuse_infeasible(ratio)
    search = _Descent(
        ladders,
        worst_ratio,
        max_evaluations,
        stop or (lambda: False),
        tightest,
        _cost(ladders, tightest),
        1,
        [tightest],
    )
    lower_bound = _cost(ladders, loosest)
    try:
        _explore(search, loosest if start is None else _round_down(ladders, start))
        while lower_bound < search.cost * (1 - _EQUAL):
            wanted = _SHARE * (search.cost - lower_bound) / search.cost
            wanted = wanted if wanted > _SMALLEST_SHARE else 0.0
            assignment, bound = _master(search, wanted)
            lower_bound = max(lower_bound, min(bound, search.cost))
            if _explore(search, assignment) and wanted == 0:
                break  # the master's optimum itself passes
    except _SpentError:
        pass
    return _answer(search, lower_bound)


def _half_widths(ladders: Sequence[Sequence[PricedGrade]], levels: Levels) -> Array:
    return np.array([ladder[level].half_width for ladder, level in zip(ladders, levels, strict=True)])


def _cost(ladders: Sequence[Sequence[PricedGrade]], levels: Levels) -> float:
    return sum((ladder[level].price for ladder, level in zip(ladders, levels, strict=True)), 0.0)


def _round_down(ladders: Sequence[Sequence[PricedGrade]], half_width: Array) -> Levels:
    """The loosest grades not above the half-widths; the tightest where there is none."""
    return tuple(
        max(0, sum(grade.half_width <= h * (1 + 1e-9) for grade in ladder) - 1)
        for ladder, h in zip(ladders, half_width, strict=True)
    )


def _below(levels: Levels, others: Iterable[Levels]) -> bool:
    return any(all(a <= b for a, b in zip(levels, other, strict=True)) for other in others)


def _above(levels: Levels, others: Iterable[Levels]) -> bool:
    return any(all(a >= b for a, b in zip(levels, other, strict=True)) for other in others)


def _passes(search: _Descent, levels: Levels) -> bool:
    """Does an assignment meet the limits: from what is known, or by evaluating it."""
    if _below(levels, search.feasible):
        return True
    if _above(levels, search.infeasible):
        return False
    if search.evaluations >= search.max_evaluations or search.stop():
        raise _SpentError
    search.evaluations += 1
    if not search.worst_ratio(_half_widths(search.ladders, levels)) <= 1:
        search.infeasible = [other for other in search.infeasible if not _above(other, [levels])] + [levels]
        return False
    search.feasible = [other for other in search.feasible if not _below(other, [levels])] + [levels]
    cost = _cost(search.ladders, levels)
    if cost < search.cost:
        search.best, search.cost = levels, cost
    return True


def _with(levels: Levels, index: int, level: int) -> Levels:
    return (*levels[:index], level, *levels[index + 1 :])


def _explore(search: _Descent, levels: Levels) -> bool:
    """Does it pass; on the way to candidates that cannot be loosened and cuts that cannot be tightened."""
    if _passes(search, levels):
        _loosen(search, levels)
        return True
    by_saving = sorted(
        range(len(levels)), key=lambda i: search.ladders[i][0].price - search.ladders[i][levels[i]].price
    )
    _loosen(search, _tighten(search, levels, by_saving))
    for turn in range(0, len(levels), _STRIDE):
        _tighten(search, levels, by_saving[turn:] + by_saving[:turn])
    return False


def _loosen(search: _Descent, levels: Levels) -> None:
    """Step by step the loosening that saves most, until none passes: candidates are kept as they are evaluated."""
    open_ = {i for i, ladder in enumerate(search.ladders) if levels[i] < len(ladder) - 1}
    while open_:
        ladders = search.ladders
        i = max(sorted(open_), key=lambda i: ladders[i][levels[i]].price - ladders[i][levels[i] + 1].price)
        looser = _with(levels, i, levels[i] + 1)
        if _passes(search, looser):
            levels = looser
        else:
            open_.discard(i)
        if levels[i] == len(ladders[i]) - 1:
            open_.discard(i)


def _tighten(search: _Descent, levels: Levels, order: Iterable[int]) -> Levels:
    """From a failing assignment to one that passes as soon as any grade is tightened; returns a passing one next to it.

    Tolerances are tightened in the order given: the first ones tend to leave the cut, which then asks more of the rest.
    """
    passing = levels
    for i in order:
        low, high = -1, levels[i]  # fails at high, passes at low (or low is below the tightest)
        while high - low > 1:
            middle = (low + high) // 2
            if _passes(search, _with(levels, i, middle)):
                low = middle
            else:
                high = middle
        levels = _with(levels, i, high)
        if low >= 0:
            passing = _with(levels, i, low)
    return passing


def _master(search: _Descent, gap: float) -> tuple[Levels, float]:
    """(cheapest assignment no cut forbids, to a relative gap, lower bound of the cost).  Raises NotConvergedError."""
    sizes = [len(ladder) for ladder in search.ladders]
    first = np.concatenate([[0], np.cumsum(sizes)])
    price = np.array([grade.price for ladder in search.ladders for grade in ladder])
    scale = _MASTER_TOTAL / _cost(search.ladders, tuple(0 for _ in sizes))
    one_each = np.zeros((len(sizes), price.size))
    for i in range(len(sizes)):
        one_each[i, first[i] : first[i + 1]] = 1
    tighter = np.zeros((len(search.infeasible), price.size))
    for row, failing in zip(tighter, search.infeasible, strict=True):
        for i, level in enumerate(failing):
            row[first[i] : first[i] + level] = 1
    constraints = [
        LinearConstraint(one_each, 1, 1),
        LinearConstraint(tighter, 1, np.inf),
        LinearConstraint(scale * price, -np.inf, scale * search.cost * (1 + 1e-7)),
    ]
    solution = milp(
        scale * price,
        integrality=np.ones(price.size),
        bounds=Bounds(0, 1),
        constraints=constraints,
        options={"mip_rel_gap": gap},
    )
    if solution.x is None or solution.status != 0:
        detail = f"the integer programme over grades stopped: {solution.message}"
        raise NotConvergedError(Problem("/optimise", "grades-not-converged", detail, "report the design"))
    levels = tuple(int(solution.x[first[i] : first[i + 1]].argmax()) for i in range(len(sizes)))
    return levels, float(solution.mip_dual_bound) / scale


def _refuse_infeasible(ratio: float) -> InfeasibleError:
    return InfeasibleError(
        Problem(
            "/optimise/tolerances",
            "tightest-grades-exceed-limit",
            f"with the tightest grade of every tolerance the quantile is {at_least(ratio)} times its limit",
            "add a tighter grade, loosen the limit, or move the fiducials",
        )
    )


def _answer(search: _Descent, lower_bound: float) -> GradeChoice:
    least = search.cost if lower_bound >= search.cost * (1 - _EQUAL) else lower_bound
    proven = least == search.cost
    gap = 0.0 if proven else 100 * (search.cost - least) / search.cost
    asked = f"{search.evaluations} evaluations of the exact law"
    statement = (
        f"No assignment of the given grades that meets the limits costs less than {at_most(least, 6)} ({asked})"
        if proven
        else f"Stopped after {asked}: none costs less than {at_most(least, 6)}, {gap:.2g} % below the one found"
    )
    grades = [ladder[level] for ladder, level in zip(search.ladders, search.best, strict=True)]
    return GradeChoice(
        _half_widths(search.ladders, search.best),
        tuple(grade.name for grade in grades),
        search.cost,
        least,
        gap,
        search.evaluations,
        proven,
        f"{statement}, provided no quantile falls as a tolerance widens.",
    )

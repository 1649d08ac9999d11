"""Process grades: tolerances that are bought from a table, together with a layout.

Alternates until neither step pays: the cheapest grades at the layout, then the layout with those grades held.  The
first layout comes from the relaxation that prices grades by the power law through them.

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

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp

from ..errors import InfeasibleError, NotConvergedError, Problem
from ..geometry.arrays import Array
from ..results import Relaxation
from ..results.digits import at_least, at_most
from .exact_law import exact_ratios
from .placement import PlacementSolution, settle
from .prices import Price, PricedGrade, drop_dominated
from .problem import Choice, PlacementProblem, apply_choice, present_choice
from .program import build_program, solve
from .search import Iterate, Search, Stop, start_at
from .terms import every_terms

MAX_ALTERNATIONS = 4
PAYS = 1e-6  # relative: a cheaper choice than that is worth another round


@dataclass(frozen=True, slots=True, eq=False)
class Purchase:
    """The cheapest assignment of grades found, and what none can undercut."""

    half_width: Array  # (K,) native units
    names: tuple[str, ...]
    bound: Relaxation


@dataclass(frozen=True, slots=True, eq=False)
class Optimum:
    """An optimum by the exact law: of the continuous programme, or of grades and the layout."""

    problem: PlacementProblem
    choice: Choice
    cost: float
    ratios: tuple[float, ...]  # exact quantile over its limit, every demand
    solution: PlacementSolution | None  # of what is continuous; None where nothing is
    purchase: Purchase | None = None

    @staticmethod
    def of(solution: PlacementSolution) -> Optimum:
        """Without grades."""
        return Optimum(solution.problem, solution.choice, solution.cost, solution.ratios, solution)


def settle_grades(search: Search, aims: Array, stop: Stop | None = None) -> Optimum:
    """Cheapest grades found, every exact quantile at or below its aim.

    Raises InfeasibleError when even the tightest grades do not do, NotConvergedError.
    """
    problem = search.program.problem
    best: tuple[float, Choice, Purchase] | None = None
    for item in search.iterates:
        # The relaxation at its aims: the tightest grades are no looser, so there is something to choose.
        start = settle(replace(search, iterates=(item,)), aims)
        bought = _choose(search, aims, start.choice, stop)
        cost = problem.cost(bought.half_width)
        if best is None or cost < best[0] * (1 - PAYS):
            best = (cost, start.choice, bought)
        if stop is not None and stop():
            break
    assert best is not None  # a search has at least one point
    return _alternate(search, aims, best[1], best[2], stop)


def _alternate(search: Search, aims: Array, choice: Choice, bought: Purchase, stop: Stop | None) -> Optimum:
    best: Optimum | None = None
    for _ in range(MAX_ALTERNATIONS):
        candidate = _place(search, aims, replace(choice, half_width=bought.half_width), bought)
        if best is not None and candidate.cost >= best.cost * (1 - PAYS):
            break
        best, choice = candidate, candidate.choice
        if not search.program.problem.moves or (stop is not None and stop()):
            break
        bought = _choose(search, aims, choice, stop)
    assert best is not None  # the loop ran
    return best


def _choose(search: Search, aims: Array, choice: Choice, stop: Stop | None) -> Purchase:
    """The cheapest grades at this layout, by the exact law and with a bound."""
    problem = search.program.problem

    def worst(half_width: Array) -> float:
        return float((exact_ratios(problem, search.terms, replace(choice, half_width=half_width)) / aims).max())

    prices = [free.price for free in problem.half_widths]
    found = choose_grades(prices, worst, start=choice.half_width, stop=stop)
    where = "at this layout" if problem.places else "for this layout"
    return replace(found, bound=replace(found.bound, statement=f"{found.bound.statement} ({where})"))


def _place(search: Search, aims: Array, choice: Choice, bought: Purchase) -> Optimum:
    """The layout optimised for more room, with the grades held."""
    whole, width = search.program.problem, choice.half_width
    if not whole.moves:
        ratios = tuple(float(ratio) for ratio in exact_ratios(whole, search.terms, choice))
        return Optimum(whole, choice, whole.cost(width), ratios, None, bought)
    system = apply_choice(whole, replace(present_choice(whole), half_width=width))
    rest = replace(whole, system=system, half_widths=(), objective="quantile")
    program = build_program(rest, every_terms(rest))
    start = start_at(program, choice.fiducials_mm)
    point = solve(program, start.x, start.parameters)
    inner = replace(search, program=program, iterates=(Iterate(point, start.parameters),), terms=program.terms)
    solution = settle(inner, aims)
    return Optimum(
        whole, replace(solution.choice, half_width=width), whole.cost(width), solution.ratios, solution, bought
    )


Levels = tuple[int, ...]  # of each tolerance the index of its grade, 0 the tightest
_EQUAL = 1e-9  # relative: costs closer than this are the same
# A master is solved only as well as the bracket at the time deserves: its bound holds whatever its own gap is.
_SHARE, _SMALLEST_SHARE = 0.3, 1e-4
# Every third rotation of the order of tightening makes a cut of its own: fewer masters, as many evaluations.
_STRIDE = 3
_MASTER_TOTAL = 1e5  # the largest cost in the master, so that its absolute tolerances are below _EQUAL


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
) -> Purchase:
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
    dearest, ends = _cost(ladders, tightest), stop or (lambda: False)
    search = _Descent(ladders, worst_ratio, max_evaluations, ends, tightest, dearest, 1, [tightest])
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
    each = zip(ladders, half_width, strict=True)
    return tuple(max(0, sum(grade.half_width <= h * (1 + 1e-9) for grade in ladder) - 1) for ladder, h in each)


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
    saved = [ladder[0].price - ladder[level].price for ladder, level in zip(search.ladders, levels, strict=True)]
    by_saving = sorted(range(len(levels)), key=saved.__getitem__)
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
    costs = scale * price
    rows = [
        LinearConstraint(one_each, 1, 1),
        LinearConstraint(tighter, 1, np.inf),
        LinearConstraint(costs, -np.inf, scale * search.cost * (1 + 1e-7)),
    ]
    solution = milp(
        costs, integrality=np.ones(price.size), bounds=Bounds(0, 1), constraints=rows, options={"mip_rel_gap": gap}
    )
    if solution.x is None or solution.status != 0:
        detail = f"the integer programme over grades stopped: {solution.message}"
        raise NotConvergedError(Problem("/optimise", "grades-not-converged", detail, "report the design"))
    levels = tuple(int(solution.x[first[i] : first[i + 1]].argmax()) for i in range(len(sizes)))
    return levels, float(solution.mip_dual_bound) / scale


def _refuse_infeasible(ratio: float) -> InfeasibleError:
    detail = f"with the tightest grade of every tolerance the quantile is {at_least(ratio)} times its limit"
    hint = "add a tighter grade, loosen the limit, or move the fiducials"
    return InfeasibleError(Problem("/optimise/tolerances", "tightest-grades-exceed-limit", detail, hint))


def _answer(search: _Descent, lower_bound: float) -> Purchase:
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
    statement += ", provided no quantile falls as a tolerance widens"
    bound = Relaxation("monotone cuts over grades", search.cost, least, gap, statement)
    return Purchase(_half_widths(search.ladders, search.best), tuple(grade.name for grade in grades), bound)

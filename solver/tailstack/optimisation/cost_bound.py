"""How cheap any layout could be: a lower bound of the cost over every layout and all half-widths, to first order.

Every layout's images leave a covariance of at least L (``global_bound``), and what is known, and what comes through
the images and is not normal, can be left out: so no half-widths keep a limit that these do not keep with L in the place
of the images.  What is left is to bound one allocation over its whole box, though it need not be convex.

*Above the chance to be within.*  ``P(|e| <= limit)`` of a sum of independent sources is, times ``h^n`` of each free
one, a volume under a log-concave function of the deviations and, jointly, of ``h^m`` (m, n = 1, 1: uniform; 1, 2:
triangular; 2, 1: normal), so by Prekopa (1973) its logarithm is concave in these.  With t = log(h / h0) and D the slope
of the logarithm by t at h0,

    log P <= log P0 + sum of (D + n) (e^(m t) - 1) / m - n t.

Where all free sources that act are normal it is D t (the (B) theorem: Cordero-Erausquin, Fradelizi, Maurey 2004).
Of others it is D t for any two, as ``P h^n`` of the rest is an integral over these two of a function that is even in
them and log-concave in all: symmetric sets of the plane, cut by rectangles, obey the log-Brunn-Minkowski inequality
(Boroczky, Lutwak, Yang, Zhang 2012).  What is above falls no further from where it is least: a larger half-width does
not raise P (Anderson 1955).  Fixed sources may have any of these laws.

*Below the cost.*  ``cost(h) - mu log(P / p)`` with prices mu >= 0 of the limits, and P replaced by what is above it, is
a sum over the half-widths, each made least by itself on a cell of the box: no half-widths in the cell are cheaper,
however the costs are shaped.  The cell with the least such bound is halved until the bound is near the cheapest
half-widths that keep the limits with L.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from heapq import heappop, heappush
from itertools import count
from math import exp, expm1, inf, log, log1p
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..design import Design
from ..design.loading import locate_refusals
from ..geometry.arrays import Array
from ..kernels.store import kernel
from ..laws import PARTS
from ..results import GlobalBound, Relaxation
from ..results.digits import at_most, number
from ..system import Law
from ..tail.declared import chance_gradient
from .aimed_bound import read_looks
from .global_bound import (
    AS_THEY_LOOK,
    SAID,
    SAMPLED,
    Looks,
    NoBound,
    certify_layout,
    columns_with,
    fit_images,
    is_bias_moved,
    law_with,
    left_out,
    sure_quantile,
    value_at,
    why_none,
)
from .grades import choose_grades
from .prices import Price, cost_of, slope_of, smooth_cost
from .problem import PlacementProblem, present_choice
from .request import read_request
from .search import LEADING, MANY_DEMANDS
from .terms import DemandTerms, every_terms

NEAR = 0.01  # of the cost of what keeps the limits with L
MOST_CELLS, LEAST_CELLS = 500, 80  # that are looked into; beside a search besides one for each start and variable
FIRST = 8  # tangents of the whole box, each nearer to where none pays more than another
SMALL = 0.03  # of what a relative change of all half-widths saves: one that saves less is held
STEPS = 64  # of a cell along each half-width, for its least cost
EDGES = np.linspace(0.0, 1.0, STEPS + 1)
SPREAD = 2.0 ** np.linspace(-2, 2, 9)  # prices that are tried, about the one of the slopes, and then between two
ON_LIMIT, LEAST_CHANCE = 0.01, 1e-9  # relative, of half-widths; of a probability
CDF_ERROR, SLOPE_ERROR = 1e-7, 1e-6  # absolute, of a probability, and of a slope of its logarithm
CERTAIN = 1e-6  # what a probability lacks to 1, of a limit that charges nothing
ROUNDING = 1e-9  # relative, of the bound
FORM = {Law.NORMAL: (2, 1)} | {law: (1, 2 if second else 1) for law, (_, second) in PARTS.items()}  # (m, n)


class Allowed(NamedTuple):
    """A limit with the least that images can add, at any layout."""

    term: DemandTerms
    level: float  # of the quantile that keeps it
    images: Array  # (3, 3) mm^2
    power: NDArray[np.int64]  # (K,) m of each free half-width; 0: normal among normal, or it does not act
    order: NDArray[np.int64]  # (K,) n; 0 where m is
    acts: NDArray[np.bool_]  # (K,)
    held: NDArray[np.bool_]  # (K,) which stand at the least of a cell: not normal beside some that are, or cheap

    @property
    def limit_mm(self) -> float:
        return self.term.demand.requirement.limit

    def bent_in(self, wide: Array) -> NDArray[np.bool_]:
        """(K,) for which what is above is no straight line in a cell so wide (K,): all that are not normal but the two
        of the widest sides."""
        bends = (self.power > 0) & ~self.held
        bends[np.argsort(np.where(bends, wide, -inf))[-2:]] = False
        return bends

    def slope_within(self, slope: Array) -> Array:
        """(K,) slopes of the logarithm brought to where they can be: it falls, and ``h^n`` times the chance rises."""
        return np.clip(slope, np.where(self.power > 0, -self.order, -1.0), 0.0)


class Tangent(NamedTuple):
    """What is above the logarithm of P / p of one limit, for all half-widths."""

    at: Array  # (K,) logarithms of half-widths
    value: float
    slope: Array  # (K,) D

    def seen_from(self, logs: Array) -> Tangent:
        """The same straight line, told at other half-widths."""
        return Tangent(logs, self.value + float(self.slope @ (logs - self.at)), self.slope)


def bound_any_layout(
    problem: PlacementProblem,
    terms: Sequence[DemandTerms],
    half_width: Array,
    cost: float,
    besides: float,
    most: int = MOST_CELLS,
    looks: Looks = AS_THEY_LOOK,
) -> Relaxation | None:
    """What no layout within what was asked for undercuts, compared with a cost; the reason where that is not known;
    None where no cost is made least.

    half_width (K,): where L is chosen and the search for the bound begins; besides: what so many fiducials cost; most:
    cells that are looked into, of which the bound found by then holds; looks: which way views may look.
    """
    if problem.objective != "cost" or not problem.half_widths:
        return None
    compared = cost if np.isfinite(cost) else None
    bounded = [term for term in terms if not why_none(problem, term) and _level_of(term)]
    try:
        if not bounded:
            raise NoBound(why_none(problem, terms[0]) or "the mean of an error is limited, and no quantile of it")
        if not all(free.drawn is None or free.drawn.widens for free in problem.half_widths):
            raise NoBound("a value of a drawing is wider in one scalar than the next, and narrower in another")
        if any(len(free.names) > 1 and not _is_bought(problem) for free in problem.half_widths):
            raise NoBound("a value of a drawing that is several scalars is chosen beside half-widths of any size")
        allowed = [_allow(problem, term, half_width, looks) for term in _take_leading(problem, bounded, half_width)]
        least, is_cut = bound_allocation(problem, allowed, half_width, most)
    except NoBound as reason:
        return Relaxation("none", compared, None, None, f"No bound: {reason}.")
    names = dict.fromkeys(name for term in bounded for name in left_out(problem, term))
    if is_bias_moved(problem) or any(term.bias_mm.any() for term in bounded):
        names["the known bias"] = None
    names |= dict.fromkeys(term.demand.text for term in terms if term not in bounded)
    rest = f" Left out: {', '.join(names)}, which can only add." if names else ""
    if is_cut:
        rest += f" The search for this bound ended with its budget of {most} cells; more might raise it."
    what = f"no layout of {len(problem.system.fiducial_labels)} fiducials within what was asked for, at these pivots "
    what += f"and {looks.words}, and no half-widths"
    if least == inf:
        statement = f"To first order, {what} within their bounds, keep the limits. Proven.{rest}"
        return Relaxation("any layout", compared, None, None, statement)
    bound = float(at_most(least + besides, SAID))
    gap = None if compared is None else 100 * (compared / bound - 1)
    own = "" if gap is None else f"; this one costs {cost:.5g} ({number(gap, 2)} % more)"
    statement = f"To first order, {what} within their bounds, can cost less than {bound:g}{own}. Proven.{rest}"
    return Relaxation("any layout", compared, bound, gap, statement)


def take_smallest(kinds: Mapping[str, Relaxation | None], cost: float, which: str) -> Relaxation:
    """What no design of several kinds undercuts, by what each kind is in words, compared with a cost; which, in words,
    these are.  None where one of them has no bound."""
    for name, own in kinds.items():
        if own is None or own.kind == "none":
            reason = f" ({own.statement.rstrip('.')})" if own is not None else ""
            statement = f"No bound of all designs {which}: there is none of those {name}{reason}."
            return Relaxation("none", cost, None, None, statement)
    each = {name: own for name, own in kinds.items() if own is not None}
    name, least = min(each.items(), key=lambda item: inf if item[1].lower_bound is None else item[1].lower_bound)
    told = f" The smallest of {len(each)} bounds, that {name}: {least.statement}"
    what = f"To first order, no design within what was asked for, {which},"
    if least.lower_bound is None:
        return Relaxation("any layout", cost, None, None, f"{what} keeps the limits.{told}")
    bound = float(at_most(least.lower_bound, SAID))
    gap = 100 * (cost / bound - 1)
    statement = f"{what} can cost less than {bound:g}; this one costs {cost:.5g} ({number(gap, 2)} % more).{told}"
    return Relaxation("any layout", cost, bound, gap, statement)


def bound_layouts(design: Design) -> tuple[tuple[GlobalBound, ...], Relaxation | None]:
    """What no layout within the ``optimise`` section of a design undercuts, before anything is solved: for each
    requirement that it asks for at the design's half-widths, and of the cost where that is made least.  Raises
    DesignError."""
    with locate_refusals(design):
        request = read_request(design)
    problem, section, looks = request.problem, request.section, read_looks(design, starts=0)
    terms, here = every_terms(problem), present_choice(problem)
    of_each = ([term for term in terms if term.demand.requirement.name == each.name] for each in problem.requirements)
    each = tuple(certify_layout(problem, own, here, looks) for own in of_each)
    besides = 0.0 if section.count is None else section.count.cost_per_fiducial * len(here.fiducials_mm)
    cost = problem.price_of(here) + besides
    return each, bound_any_layout(problem, terms, here.half_width, cost, besides, looks=looks)


def cells_for(problem: PlacementProblem, starts: int) -> int:
    """The budget of a bound of the cost beside a search from so many starts: what they evaluate grows with their number
    and with what is free, and no clock is asked, so that one seed has one answer."""
    variables = 3 * len(problem.places) + len(problem.half_widths)
    return min(MOST_CELLS, LEAST_CELLS + starts * variables)


def enough_for(problem: PlacementProblem, gap: float | None) -> float:
    """An objective, as people read it, that is within a gap (0.01: 1 %) of what no layout undercuts; -inf where none is
    asked for, or no bound is known."""
    least = None
    if gap is not None:
        terms, here = every_terms(problem), present_choice(problem)
        if problem.objective == "quantile":
            told = certify_layout(problem, terms, here)
            least_mm = told.tightest_bound_mm if problem.half_widths else told.lower_bound_mm
            least = None if least_mm is None else least_mm / told.limit
        elif (known := bound_any_layout(problem, terms, here.half_width, inf, 0.0)) is not None:
            least = known.lower_bound
    return -inf if gap is None or least is None else least * (1 + gap)


def _take_leading(problem: PlacementProblem, terms: Sequence[DemandTerms], half_width: Array) -> Sequence[DemandTerms]:
    """Of many limits those that are likely to bind, by the present layout: each has a net of its own, and to leave
    some out only lowers the bound."""
    if len(terms) <= MANY_DEMANDS:
        return terms
    here = replace(present_choice(problem), half_width=half_width)
    ratios = np.array([value_at(problem, term, here) / term.demand.requirement.limit for term in terms])
    return [term for term, ratio in zip(terms, ratios, strict=True) if ratio >= LEADING * ratios.max()]


def _level_of(term: DemandTerms) -> float:
    """The quantile of the pooled law that keeps a limit where what is limited does; 0: none is known to."""
    requirement = term.demand.requirement
    if not (requirement.row.by_quantile or requirement.row.implies):
        return 0.0
    return requirement.quantile * (term.demand.fraction if term.demand.is_nested else 1.0)


def _is_bought(problem: PlacementProblem) -> bool:
    """Whether every half-width is one of a table."""
    return all(free.price.curve == "grades" for free in problem.half_widths)


def _allow(problem: PlacementProblem, term: DemandTerms, half_width: Array, looks: Looks = AS_THEY_LOOK) -> Allowed:
    """Raises NoBound."""
    laws: list[Law | None] = [None] * len(problem.half_widths)
    for source, gain in zip(term.sources, term.gains.base, strict=True):
        if source.free is not None and gain.any() and source.law is not Law.BOUNDED:
            laws[source.free] = source.law
    acts, normal = (np.array([law in some for law in laws]) for some in (FORM, (Law.NORMAL,)))
    held = acts & ~normal & normal.any()
    forms = np.array([FORM[law] if law and not normal.any() else (0, 0) for law in laws], dtype=np.int64)
    power, order = np.ascontiguousarray(forms.T)
    images = fit_images(looks.bound_images(problem, term, half_width).net, term, half_width)
    return Allowed(term, _level_of(term), images, power, order, acts, held)


class Cell(NamedTuple):
    """Half-widths between two, by their logarithms."""

    least: float  # no half-widths here that keep the limits are cheaper
    number: int  # cells of one bound in the order in which they were made
    low: Array  # (K,)
    high: Array  # (K,)
    tangents: tuple[Tangent, ...]  # one for each limit; none where all of the cell keeps them

    def halves(self, k: int) -> tuple[tuple[Array, Array], ...]:
        """Its lower and its upper half along one half-width."""
        side, middle = np.arange(len(self.low)) == k, (self.low + self.high) / 2
        return (self.low, np.where(side, middle, self.high)), (np.where(side, middle, self.low), self.high)


class AllocationBound(NamedTuple):
    """What no half-widths that keep the limits undercut; inf where none within their bounds keep them."""

    cost: float
    is_cut: bool = False  # whether its budget ended the search for it


def bound_allocation(
    problem: PlacementProblem, allowed: Sequence[Allowed], begin: Array, most: int = MOST_CELLS
) -> AllocationBound:
    """begin (K,): half-widths about which the first tangents touch; most: cells that are looked into.

    Raises NoBound.
    """

    def ratio(logs: Array) -> float:
        each = ((law_with(own.term, np.exp(logs), own.images), own.level, own.limit_mm) for own in allowed)
        return max(sure_quantile(law, level) / limit for law, level, limit in each)

    low, high = np.log(problem.lower), np.log(problem.upper)
    if ratio(low) > 1:
        return AllocationBound(inf)
    if _is_bought(problem):
        bought = choose_grades([free.price for free in problem.half_widths], lambda width: ratio(np.log(width)))
        return AllocationBound(bought.bound.lower_bound or 0.0)
    acts, held, bends = (np.any([getattr(own, name) for own in allowed], axis=0) for name in ("acts", "held", "power"))
    low, best, near, made = np.where(acts, low, high), inf, np.log(begin), count()
    at = near
    for _ in range(FIRST):
        if (touch := _touch_on_limit(allowed, low, high, near)) is None:
            return AllocationBound(inf)
        if not touch.tangents:
            return AllocationBound(problem.cost(problem.upper))
        at = touch.at
        best, near = min(best, problem.cost(np.exp(at))), _balance(problem, touch.tangents)
    pull = _pull(problem, at)
    held |= bends & (pull < SMALL * pull[acts].sum())
    allowed = [each._replace(held=each.acts & held) for each in allowed]

    def look(low: Array, high: Array, above: Cell | None = None) -> Cell | None:
        """A cell, or nothing where none keep the limits for less than the best that is known."""
        nonlocal best, near
        least, tangents = problem.cost(np.exp(high)), tuple[Tangent, ...]()
        if above is not None:
            least, tangents = max(least, above.least), above.tangents
            least = max(least, _least_cost(problem, allowed, tangents, low, high)) if tangents else least
        # The cell's own would touch no better where these do within it, or stand at the same half-widths that are held
        touched = bool(tangents)
        if tangents:
            inside = (low <= tangents[0].at) & (tangents[0].at <= np.where(held, low, high))
            touched = bool((inside[held] if held.any() and not bends.any() else inside).all())
        if least >= best * (1 - NEAR):
            return None
        if not touched:
            touch = _touch_on_limit(allowed, low, np.where(held, low, high), near, tangents)
            if touch is None:
                return None
            if tangents := touch.tangents:
                if (cost := problem.cost(np.exp(touch.at))) < best:
                    best, near = cost, touch.at
                least = max(least, _least_cost(problem, allowed, tangents, low, high))
        return Cell(least, next(made), low, high, tangents)

    cells = [cell for cell in (look(low, high),) if cell]
    while cells and cells[0].least < best * (1 - NEAR) and next(made) < most:
        cell = heappop(cells)
        wide = cell.high - cell.low
        falls = max([-own.slope.sum() for own in cell.tangents], default=0.0)
        bent = np.any([own.bent_in(wide) for own in allowed], axis=0)
        weight = np.where(held, pull * wide, bent * wide**2 * pull.sum() / 8 / max(falls, LEAST_CHANCE))
        k = int((weight if weight.any() else wide).argmax())
        for half in cell.halves(k):
            if (found := look(*half, cell)) is not None:
                heappush(cells, found)
    least = min((best * (1 - NEAR), *(cell.least for cell in cells)))
    return AllocationBound(least * (1 - ROUNDING), least < best * (1 - NEAR))


class Touch(NamedTuple):
    """Where a cell comes to its limits, and what is above the chances there."""

    at: Array  # (K,) logarithms of half-widths
    tangents: tuple[Tangent, ...]  # one for each limit; none where all of the cell keeps them


def _touch_on_limit(
    allowed: Sequence[Allowed], low: Array, high: Array, near: Array, known: Sequence[Tangent] = ()
) -> Touch | None:
    """Reached from half-widths that are near (K,), along the diagonal of a cell; None where nothing in the cell keeps
    the limits.  known: tangents by which that is told before a law is asked.  Raises NoBound."""
    if known:
        told = _follow(lambda at: [own.seen_from(at) for own in known], low, high, near)
        near = low if told is None else told.at
    return _follow(lambda at: [_touch(each, at) for each in allowed], low, high, near)


def _follow(see: Callable[[Array], list[Tangent]], low: Array, high: Array, near: Array) -> Touch | None:
    """By Newton's method, with the tangents that are seen from each of the half-widths on the way."""
    near, diagonal = np.clip(near, low, high), high - low
    first, last, s = -1.0, 1.0, 0.0
    while True:
        at = np.clip(near + s * diagonal, low, high)
        tangents = see(at)
        over = min(tangent.value for tangent in tangents)
        moved = diagonal * ((at < high) if over >= 0 else (at > low))
        if not moved.any():
            return Touch(at, ()) if over >= 0 else None
        first, last = (s, last) if over >= 0 else (first, s)
        step = min(tangent.value / max(-float(tangent.slope @ moved), LEAST_CHANCE) for tangent in tangents)
        step = step if first < s + step < last else (first if over < 0 else last) / 2 - s / 2
        if abs(step) * diagonal.max() <= ON_LIMIT:
            return Touch(np.clip(at + step * moved, low, high), tuple(tangents))
        s += step


def _balance(problem: PlacementProblem, tangents: Sequence[Tangent]) -> Array:
    """(K,) logarithms at which every half-width saves about as much for what it takes of the chance to be within: a
    variance goes as the square of a half-width, and most prices as its inverse."""
    at, taken = tangents[0].at, -np.min([tangent.slope for tangent in tangents], axis=0)
    acts = taken > 0
    more = np.log(_pull(problem, at)[acts] / taken[acts]) / 3
    found = at.copy()
    found[acts] += more - more.mean()
    return found


def _pull(problem: PlacementProblem, logs: Array) -> Array:
    """(K,) what a relative change of each half-width saves."""
    return np.array([-slope_of(free.price, exp(x)) * exp(x) for free, x in zip(problem.half_widths, logs, strict=True)])


def _touch(each: Allowed, logs: Array) -> Tangent:
    """The bound that touches at half-widths on the limit."""
    found = chance_gradient(law_with(each.term, np.exp(logs), each.images), each.limit_mm)
    if found is None:
        raise NoBound(SAMPLED)
    chance, by = found
    if chance > 1 - CERTAIN:  # no half-width takes from it
        return Tangent(logs, log((1 + CDF_ERROR) / each.level), np.zeros(len(logs)))
    columns = columns_with(each.term, np.exp(logs))
    normal = columns.gain * columns.std
    grown = 2 * np.einsum("aj,ab,bj->j", normal, by.by_covariance, normal)
    grown[columns.wide] = by.by_log_column
    free = np.array([-1 if own.law is Law.BOUNDED or own.free is None else own.free for own in each.term.sources])
    slope = np.bincount(free + 1, grown, len(logs) + 1)[1:] / max(chance, LEAST_CHANCE)
    return Tangent(logs, log((chance + CDF_ERROR) / each.level), each.slope_within(slope))


def _least_cost(
    problem: PlacementProblem, allowed: Sequence[Allowed], tangents: Sequence[Tangent], low: Array, high: Array
) -> float:
    """What no half-widths in a cell that keep the limits undercut.

    In each part of a cell a price is above its value at the end, and that of a power law above its tangent; what the
    limits charge is concave, and so least at an end.
    """
    edges = low[:, None] + (high - low)[:, None] * EDGES
    step = (high - low)[:, None] / STEPS / 2
    cost = np.array([_cost(free.price, own) for free, own in zip(problem.half_widths, edges, strict=True)])
    exponent = [free.price.exponent * (free.price.curve == "power") for free in problem.half_widths]
    falls = step * np.array(exponent)[:, None]
    at_end = cost[:, 1:]
    middle = np.where(falls > 0, np.sqrt(cost[:, :-1] * at_end), at_end)
    sides = np.stack([middle * (1 + falls), middle * (1 - falls), at_end])
    charges = np.array([_charge(*each, edges) for each in zip(allowed, tangents, strict=True)], order="C")
    values = np.array([tangent.value for tangent in tangents])
    scales = np.array([-tangent.slope.sum() for tangent in tangents])
    scales = _pull(problem, tangents[0].at).sum() / np.maximum(scales, LEAST_CHANCE)
    return float(raise_prices(sides, charges, values, scales, SPREAD))


@kernel(nogil=True)
def raise_prices(sides: Array, charges: Array, values: Array, scales: Array, spread: Array) -> float:
    """The best bound of prices of limits, each tried about its scale (T,), and then between two.

    sides (3, K, E): what the price in each part of a half-width's range is above, with what the limits charge (T, K,
    E + 1) per price at its lower end, its upper end, or the less of the two; values (T,) of tangents.
    """
    prices, tried, best = np.zeros(len(values)), np.zeros(len(values)), -inf
    charged = np.empty(charges.shape[2])
    for turn in range(1 if len(values) == 1 else 2):
        for t in range(len(values)):
            for finer in range(3):
                middle = prices[t] if prices[t] > 0.0 else scales[t]
                for k in range(-1, len(spread)):
                    tried[:] = prices
                    if k >= 0:
                        tried[t] = middle * spread[k] ** (0.25**finer)
                    elif turn or t or finer:
                        continue
                    total = -(tried * values).sum()
                    for j in range(sides.shape[1]):
                        charged[:] = 0.0
                        for i in range(len(values)):
                            charged += tried[i] * charges[i, j]
                        least = inf
                        for e in range(sides.shape[2]):
                            low, high = charged[e], charged[e + 1]
                            part = min(sides[0, j, e] + low, sides[1, j, e] + high)
                            least = min(least, max(part, sides[2, j, e] + min(low, high)))
                        total += least
                    if total > best:
                        best, prices[t] = total, tried[t]
    return best


def _cost(price: Price, logs: Array) -> Array:
    """Of half-widths by their logarithms."""
    if price.curve == "grades":
        return np.array([cost_of(price, exp(x)) for x in logs])
    return np.asarray(smooth_cost(price, logs, np.exp))


def _charge(each: Allowed, tangent: Tangent, edges: Array) -> Array:
    """(K, E): what stands above the logarithm of the chance, negative, of each half-width by itself."""
    slopes = np.stack([each.slope_within(tangent.slope + error) for error in (-SLOPE_ERROR, SLOPE_ERROR)])
    bent = each.bent_in(edges[:, -1] - edges[:, 0])
    return fill_charges(edges - tangent.at[:, None], np.where(each.held, 0.0, slopes), each.order, each.power, bent)


@kernel(nogil=True)
def fill_charges(
    t: Array, slopes: Array, order: NDArray[np.int64], power: NDArray[np.int64], bent: NDArray[np.bool_]
) -> Array:
    """(K, E): what stands above the logarithm of the chance, negative, at t (K, E) from where it touches, for the less
    of two slopes (2, K); ``bent`` (K,) with m and n, else straight."""
    found = np.empty(t.shape)
    for j in range(t.shape[0]):
        m, n = max(power[j], 1), order[j]
        for e in range(t.shape[1]):
            above = -inf
            for i in range(2):
                slope = slopes[i, j]
                if bent[j]:
                    risen = min(t[j, e], -log1p(max(slope / max(n, 1), -1 + ROUNDING)) / m)  # from there on as much
                    above = max(above, (slope + n) * expm1(m * risen) / m - n * risen)
                else:
                    above = max(above, slope * t[j, e])
            found[j, e] = -above
    return found

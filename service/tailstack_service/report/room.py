"""How far each half-width could go by itself before the limit is met, and what it costs as it stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import degrees
from typing import Literal

import numpy as np

from tailstack.budget import Line, lines_of
from tailstack.contributors import error_law, unit_for_people
from tailstack.design import Design
from tailstack.errors import NotConvergedError, Problem
from tailstack.propagation.linear import LinearModel
from tailstack.results import Check
from tailstack.system import System
from tailstack.tail.declared import law_quantile

from .headline import tightest_check
from .records import Allowance

FURTHEST = 1024.0  # times the half-width as it is: beyond, it has no influence worth a number
RELATIVE = 1e-9  # of the limit, or of the half-width at it: how well it is met
STEPS = 200


@dataclass(frozen=True, slots=True)
class Priced:
    """What the optimise section says of one half-width, in the unit of the document."""

    cost: float | None
    smallest: float
    largest: float


def allowances(
    design: Design, system: System, model: LinearModel, target: str, checks: tuple[Check, ...]
) -> tuple[Allowance, ...]:
    """Every line of the budget with one half-width, in the order of the chain.

    checks: the first-order ones.  What decides is the pooled requirement at the target that is nearest to its limit.
    """
    tightest = tightest_check(checks, target)
    priced = prices(design, system)
    found = []
    for line in lines_of(model):
        block, j = line.block, line.sources[0]
        if not line.alike:
            continue
        unit, factor = unit_for_people(block.units[j])
        width = float(block.half_width[j]) * factor
        status, ratio = _ratio(model, line, tightest)
        price = priced.get((block.contributor, line.component))
        found.append(
            Allowance(
                target=target,
                contributor=block.contributor,
                component=line.component,
                unit=unit,
                half_width=width,
                requirement=None if tightest is None else tightest.requirement,
                status=status,
                at_limit=None if ratio is None else width * ratio,
                slack=None if ratio is None else width * (ratio - 1),
                cost=None if price is None else price.cost,
                smallest=None if price is None else price.smallest,
                largest=None if price is None else price.largest,
                label=block.label,
            )
        )
    return tuple(found)


Status = Literal["spare", "too wide", "zero is not enough", "no influence", "no requirement"]


def _ratio(model: LinearModel, line: Line, check: Check | None) -> tuple[Status, float | None]:
    """By which factor on the line's half-width the check's quantile is at its limit."""
    if check is None:
        return "no requirement", None
    if not line.block.half_width[line.sources[0]] > 0:
        return "no influence", None
    beyond = _excess(model, line, check)
    at_one = beyond(1.0)
    if at_one > 0:
        if beyond(0.0) > 0:
            return "zero is not enough", None
        return "too wide", _crossing(beyond, 0.0, 1.0, check)
    high = 2.0
    while beyond(high) < 0:
        high *= 4
        if high > FURTHEST:
            return "no influence", None
    return "spare", _crossing(beyond, 1.0, high, check)


def _crossing(beyond: Callable[[float], float], low: float, high: float, check: Check) -> float:
    """Where a rising function passes zero, by the Illinois rule; scipy.optimize takes half a second to import.

    Raises NotConvergedError.
    """
    at_low, at_high, side = beyond(low), beyond(high), 0
    for _ in range(STEPS):
        middle = (low * at_high - high * at_low) / (at_high - at_low)
        value = beyond(middle)
        if abs(value) <= RELATIVE * check.limit_mm or high - low <= RELATIVE * high:
            return middle
        if value > 0:
            high, at_high = middle, value
            at_low = at_low / 2 if side > 0 else at_low
            side = 1
        else:
            low, at_low = middle, value
            at_high = at_high / 2 if side < 0 else at_high
            side = -1
    detail = f"the half-width at which {check.requirement} is met was not found in {STEPS} steps"
    raise NotConvergedError(Problem("/requirements", "not-converged", detail))


def _excess(model: LinearModel, line: Line, check: Check) -> Callable[[float], float]:
    """mm by which the quantile is over its limit when a line's half-width is so many times what it is."""
    chosen = np.zeros(len(line.block.half_width), dtype=bool)
    chosen[list(line.sources)] = True

    def beyond(factor: float) -> float:
        scale = np.where(chosen, factor, 1.0)
        block = line.block._replace(std=line.block.std * scale, half_width=line.block.half_width * scale)
        blocks = tuple(block if other is line.block else other for other in model.blocks)
        law = error_law(replace(model, blocks=blocks), check.error, check.quantile).law
        return law_quantile(law, check.quantile).quantile_mm - check.limit_mm

    return beyond


def prices(design: Design, system: System) -> dict[tuple[str, str], Priced]:
    """By contributor and component: half-widths that the optimise section sets free; none without such a section."""
    if design.document.optimise is None:
        return {}
    from tailstack.optimisation.prices import cost_of
    from tailstack.optimisation.request import read_request

    free_widths = read_request(design).problem.half_widths
    mounts = {mount.name: mount for mount in system.interfaces}
    found = {}
    for free in free_widths:
        sources = mounts[free.contributor].sources
        place = sources.names.index(free.component)
        shown = degrees if sources.units[place] == "rad" else float
        cost = cost_of(free.price, float(sources.half_width[place]))
        found[free.contributor, free.component] = Priced(
            cost if np.isfinite(cost) else None, shown(free.minimum), shown(free.maximum)
        )
    return found

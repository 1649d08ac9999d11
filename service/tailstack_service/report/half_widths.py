"""How far each half-width may go by itself until a limit is met, the others staying, and what it costs.

A half-width changes neither bias nor sensitivities, so the linear model of the design serves for all of them.
"""

from __future__ import annotations

from dataclasses import replace
from math import degrees
from typing import Literal

import numpy as np

from tailstack.budget import BudgetEntry, lines_of
from tailstack.contributors import error_law, risk_of_units, unit_for_people
from tailstack.design import Design
from tailstack.levels import Drawn, level_of
from tailstack.optimisation.prices import cost_of
from tailstack.propagation.linear import LinearModel
from tailstack.results import Check
from tailstack.system import System
from tailstack.tail.declared import law_quantile

from .records import Allowance, tightest_check

FURTHEST = 1024.0  # times the half-width as it is: beyond, it has no influence worth a number


def quantile_mm(model: LinearModel, check: Check, line: BudgetEntry, factor: float = 1.0) -> float:
    """What a check limits, with the half-widths of a line of the budget ``factor`` times what they are."""
    if factor != 1.0:
        scale = np.ones(len(line.block.half_width))
        scale[list(line.sources)] = factor
        block = line.block.with_half_widths(line.block.half_width * scale)
        blocks = tuple(block if number == line.number else other for number, other in enumerate(model.blocks))
        model = replace(model, blocks=blocks)
    law = error_law(model, check.error, check.quantile)
    if check.min_yield is None:
        return law_quantile(law.law, check.quantile).quantile_mm
    level = level_of(check.risk) or Drawn.UNIT
    return risk_of_units(model, law, check.quantile, None, check.min_yield, level).value_mm


def half_width_of(line: BudgetEntry) -> tuple[float, str]:
    """In the unit that people use, and that unit."""
    unit, people = unit_for_people(line.block.units[line.sources[0]])
    return float(line.block.half_width[line.sources[0]]) * people, unit


def allowances(
    design: Design, system: System, model: LinearModel, target: str, checks: tuple[Check, ...]
) -> tuple[Allowance, ...]:
    """Every line of the budget with one half-width, in the order of the chain.

    checks: the first-order ones.  The slack is to the requirement that decides at the target, pooled or of each unit.
    """
    tightest = tightest_check(checks, target)
    priced = prices(design, system)
    entries = []
    for line in (line for line in lines_of(model) if line.alike):  # they do not overlap
        width, unit = half_width_of(line)
        status, ratio = ("no requirement", None) if tightest is None else _ratio(model, line, tightest)
        cost, smallest, largest = priced.get((line.block.contributor, line.component), (None, None, None))
        entries.append(
            Allowance(
                target=target,
                contributor=line.block.contributor,
                component=line.component,
                unit=unit,
                half_width=width,
                requirement=None if tightest is None else tightest.requirement,
                status=status,
                at_limit=None if ratio is None else width * ratio,
                slack=None if ratio is None else width * (ratio - 1),
                cost=cost,
                smallest=smallest,
                largest=largest,
                label=line.block.label,
            )
        )
    return tuple(entries)


Status = Literal["spare", "too wide", "zero is not enough", "no influence", "no requirement"]


def _ratio(model: LinearModel, line: BudgetEntry, check: Check) -> tuple[Status, float | None]:
    """By which factor on the line's half-width what the check limits is at its limit."""
    if not half_width_of(line)[0] > 0:
        return "no influence", None
    from scipy.optimize import brentq  # a tenth of a second, of which a report without limits has no use

    limit_mm = check.limit if check.beyond is None else check.beyond

    def excess(factor: float) -> float:
        return quantile_mm(model, check, line, factor) - limit_mm

    if excess(1.0) > 0:
        if excess(0.0) > 0:
            return "zero is not enough", None
        return "too wide", float(brentq(excess, 0.0, 1.0, xtol=1e-12))
    high = 2.0
    while excess(high) < 0:
        high *= 4
        if high > FURTHEST:
            return "no influence", None
    return "spare", float(brentq(excess, 1.0, high, xtol=1e-12))


def prices(design: Design, system: System) -> dict[tuple[str, str], tuple[float | None, float, float]]:
    """Cost, smallest and largest of the half-widths that the optimise section sets free, in the unit of the document,
    by contributor and component; none without such a section."""
    if design.document.optimise is None:
        return {}
    from tailstack.optimisation.request import read_request

    free_widths = read_request(design).problem.half_widths
    mounts = {mount.name: mount for mount in system.interfaces}
    priced = {}
    for free in free_widths:
        sources = mounts[free.contributor].sources
        place = sources.names.index(free.component)
        shown = degrees if sources.units[place] == "rad" else float
        cost = cost_of(free.price, float(sources.half_width[place]))
        known = cost if np.isfinite(cost) else None
        priced[free.contributor, free.component] = known, shown(free.minimum), shown(free.maximum)
    return priced

"""The first-order quantile over one half-width, the others staying: its curve, how far it may go, what it costs.

A half-width changes neither bias nor sensitivities, so the linear model of the design serves for all of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import degrees
from typing import Literal

import numpy as np

from tailstack.budget import BudgetEntry, lines_of
from tailstack.contributors import error_law, risk_of_units, unit_for_people
from tailstack.design import Design, compile_design
from tailstack.levels import Drawn, level_of
from tailstack.optimisation.prices import cost_of
from tailstack.propagation.linear import LinearModel, linearise
from tailstack.results import Check
from tailstack.system import System
from tailstack.tail.declared import law_quantile

from .headline import tightest_check
from .records import Allowance

FURTHEST = 1024.0  # times the half-width as it is: beyond, it has no influence worth a number
MOST = 12  # curves: those that could change the quantile most
FACTORS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0)


@dataclass(frozen=True, slots=True)
class Judgement:
    """Which quantile of which error is looked at, and its limit, if there is one."""

    error: str = "tcp"
    quantile: float = 0.95
    limit_mm: float | None = None
    units_fraction: float | None = None  # of units (mountings) that keep their own quantile within; None: all together
    risk: str = "per_unit"  # of what

    def quantile_mm(self, model: LinearModel, line: BudgetEntry | None = None, factor: float = 1.0) -> float:
        """What is limited, with the half-widths of a line of the budget ``factor`` times what they are."""
        if line is not None and factor != 1.0:
            scale = np.ones(len(line.block.half_width))
            scale[list(line.sources)] = factor
            block = line.block.with_half_widths(line.block.half_width * scale)
            blocks = tuple(block if number == line.number else other for number, other in enumerate(model.blocks))
            model = replace(model, blocks=blocks)
        law = error_law(model, self.error, self.quantile)
        if self.units_fraction is not None:
            level = level_of(self.risk) or Drawn.UNIT
            return risk_of_units(model, law, self.quantile, None, self.units_fraction, level).value_mm
        return law_quantile(law.law, self.quantile).quantile_mm

    def factor_at_limit(self, model: LinearModel, line: BudgetEntry, low: float, high: float) -> float:
        """Between two factors of which one keeps the limit and the other does not: where it is just met."""
        from scipy.optimize import brentq  # a tenth of a second, of which a report without limits has no use

        limit_mm = self.limit_mm or 0.0
        return float(brentq(lambda factor: self.quantile_mm(model, line, factor) - limit_mm, low, high, xtol=1e-12))


P95_OF_TCP = Judgement()


def judgement_of(check: Check | None) -> Judgement:
    """What a check that a quantile decides looks at; without one, P95 of the error at the tool."""
    if check is None:
        return P95_OF_TCP
    limit = check.limit if check.beyond is None else check.beyond
    return Judgement(check.error, check.quantile, limit, check.min_yield, check.risk)


def lines_with_one_half_width(model: LinearModel) -> list[BudgetEntry]:
    """Lines of the budget that do not overlap: components, and contributors whose sources are all alike."""
    return [line for line in lines_of(model) if line.alike]


def half_width_of(line: BudgetEntry) -> tuple[float, str]:
    """In the unit that people use, and that unit."""
    unit, people = unit_for_people(line.block.units[line.sources[0]])
    return float(line.block.half_width[line.sources[0]]) * people, unit


# --- curves ---------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class ToleranceCurve:
    """The quantile as one half-width changes.  ``half_width`` is sigma for image noise."""

    contributor: str  # as in the budget
    component: str
    label: str  # what people call the contributor
    unit: str
    half_width: float  # as it is
    half_widths: tuple[float, ...]
    quantile_mm: tuple[float, ...]  # at those


@dataclass(frozen=True, slots=True)
class ToleranceCurves:
    """Curves of one error at one target, the steepest first."""

    target: str
    judgement: Judgement
    quantile_mm: float  # as it is
    curves: tuple[ToleranceCurve, ...]
    left_out: int  # sources that change the quantile less


def tolerance_curves(
    design: Design, target: str, judgement: Judgement = P95_OF_TCP, most: int = MOST
) -> ToleranceCurves:
    """First-order quantile over the half-width of each source, each by itself, 0 to 3 times what it is.

    Raises DesignError, IllPosedError; ValueError for a target that the design does not have.
    """
    system = compile_design(design)
    place = next((entry for entry in system.targets if entry.name == target), None)
    if place is None:
        raise ValueError(f"the design has no target {target!r}")
    model = linearise(system, place)
    rises = []
    for line in lines_with_one_half_width(model):
        if half_width_of(line)[0] > 0:
            low, high = (judgement.quantile_mm(model, line, factor) for factor in (FACTORS[0], FACTORS[-1]))
            rises.append((high - low, line))
    rises = sorted((entry for entry in rises if entry[0] > 1e-9), key=lambda entry: -entry[0])
    now = judgement.quantile_mm(model)
    curves = tuple(_curve(model, line, judgement, now) for _, line in rises[:most])
    return ToleranceCurves(target, judgement, now, curves, max(len(rises) - most, 0))


def _curve(model: LinearModel, line: BudgetEntry, judgement: Judgement, now: float) -> ToleranceCurve:
    values = [now if factor == 1.0 else judgement.quantile_mm(model, line, factor) for factor in FACTORS]
    width, unit = half_width_of(line)
    return ToleranceCurve(
        contributor=line.block.contributor,
        component=line.component,
        label=line.block.label,
        unit=unit,
        half_width=width,
        half_widths=tuple(width * factor for factor in FACTORS),
        quantile_mm=tuple(values),
    )


# --- how far each may go --------------------------------------------------------------------------


def allowances(
    design: Design, system: System, model: LinearModel, target: str, checks: tuple[Check, ...]
) -> tuple[Allowance, ...]:
    """Every line of the budget with one half-width, in the order of the chain.

    checks: the first-order ones.  The slack is to the requirement that decides at the target, pooled or of each unit.
    """
    tightest = tightest_check(checks, target)
    priced = prices(design, system)
    entries = []
    for line in lines_with_one_half_width(model):
        width, unit = half_width_of(line)
        status, ratio = ("no requirement", None) if tightest is None else _ratio(model, line, judgement_of(tightest))
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


def _ratio(model: LinearModel, line: BudgetEntry, judgement: Judgement) -> tuple[Status, float | None]:
    """By which factor on the line's half-width the quantile is at its limit."""
    if not half_width_of(line)[0] > 0:
        return "no influence", None
    limit_mm = judgement.limit_mm or 0.0
    if judgement.quantile_mm(model) > limit_mm:
        if judgement.quantile_mm(model, line, 0.0) > limit_mm:
            return "zero is not enough", None
        return "too wide", judgement.factor_at_limit(model, line, 0.0, 1.0)
    high = 2.0
    while judgement.quantile_mm(model, line, high) < limit_mm:
        high *= 4
        if high > FURTHEST:
            return "no influence", None
    return "spare", judgement.factor_at_limit(model, line, 1.0, high)


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

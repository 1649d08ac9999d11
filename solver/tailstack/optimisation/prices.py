"""What a half-width costs: a falling curve, or a table of process grades."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import exp, floor, inf, log, log10
from typing import Any, Literal

import numpy as np

Curve = Literal["power", "exponential", "grades"]


@dataclass(frozen=True, slots=True)
class PricedGrade:
    """One process: the half-width it holds (native unit) and its price."""

    name: str
    half_width: float
    price: float


@dataclass(frozen=True, slots=True)
class Price:
    """power: ``weight h^-exponent``; exponential: ``weight exp(-h / scale)``; grades: the cheapest that holds h.

    h in native units (rad, mm).  A table of grades carries the power law through its points as well, which
    stands in for it where derivatives are needed.
    """

    curve: Curve
    weight: float
    exponent: float = 1.0
    scale: float = 1.0
    grades: tuple[PricedGrade, ...] = ()  # ascending half-width


def reciprocal(weight: float = 1.0) -> Price:
    """``weight / h``."""
    return Price("power", weight)


def of_grades(grades: tuple[PricedGrade, ...]) -> Price:
    """A table; its power law is the least-squares line through the logarithms of its useful grades."""
    ordered = tuple(sorted(grades, key=lambda grade: (grade.half_width, grade.price)))
    useful = [grade for grade in drop_dominated(ordered) if grade.price > 0]
    widths, prices = np.log([g.half_width for g in useful]), np.log([g.price for g in useful])
    if len(useful) > 1 and np.ptp(widths) > 0:
        slope, offset = np.polyfit(widths, prices, 1)
        return Price("grades", exp(float(offset)), max(-float(slope), 0.05), grades=ordered)
    weight = useful[0].price * useful[0].half_width if useful else 1.0
    return Price("grades", weight, grades=ordered)


def drop_dominated(grades: tuple[PricedGrade, ...]) -> tuple[PricedGrade, ...]:
    """Grades without those that a looser and not dearer one, or a tighter and cheaper one, makes pointless.

    A tighter grade is always acceptable, so one that costs no more than a looser one replaces it; equal prices
    keep the tighter one.
    """
    remaining: list[PricedGrade] = []
    for grade in sorted(grades, key=lambda grade: (grade.half_width, grade.price)):
        if not remaining or grade.price < remaining[-1].price:
            remaining.append(grade)
    return tuple(remaining)


def grade_for(price: Price, half_width: float) -> PricedGrade | None:
    """The cheapest that holds a half-width; None: none does."""
    held = (grade for grade in price.grades if grade.half_width <= half_width * (1 + 1e-9))
    return min(held, key=lambda grade: grade.price, default=None)


def cost_of(price: Price, half_width: float) -> float:
    """Cost of holding a half-width; inf where no grade does, or at zero on a power law."""
    if price.curve == "grades":
        grade = grade_for(price, half_width)
        return inf if grade is None else grade.price
    if half_width <= 0:
        return inf if price.curve == "power" else price.weight
    return float(smooth_cost(price, log(half_width), exp))


def slope_of(price: Price, half_width: float) -> float:
    """d cost / d half-width of the curve; for grades of the power law through them."""
    if price.curve == "exponential":
        return -price.weight / price.scale * exp(-half_width / price.scale)
    return float(-price.exponent * price.weight * half_width ** (-price.exponent - 1))


def cheapest(price: Price, charge: float, low: float, high: float) -> float:
    """The half-width in [low, high] with the least ``cost + charge h``, of a curve: both are convex in h."""
    if charge <= 0:
        return high
    if price.curve == "exponential":
        best = -price.scale * log(charge * price.scale / price.weight)
    else:
        best = (price.exponent * price.weight / charge) ** (1 / (price.exponent + 1))
    return min(max(best, low), high)


def cheapest_in_logarithm(price: Price, charge: float, low: float, high: float) -> float:
    """The same of ``cost + charge log h``, of a power law: both are convex in the logarithm."""
    best = inf if charge <= 0 else (price.exponent * price.weight / charge) ** (1 / price.exponent)
    return min(max(best, low), high)


def log_smooth_cost(price: Price, log_half_width: Any, exponential: Callable[[Any], Any]) -> Any:
    """The logarithm of :func:`smooth_cost`, which is finite where the curve itself is too small for a number."""
    if price.curve == "exponential":
        return log(price.weight) - exponential(log_half_width) / price.scale
    return log(price.weight) - price.exponent * log_half_width


def smooth_cost(price: Price, log_half_width: Any, exponential: Callable[[Any], Any]) -> Any:
    """The curve at ``exp(log_half_width)``, float or symbol; for grades the power law through them."""
    if price.curve == "exponential":
        return price.weight * exponential(-exponential(log_half_width) / price.scale)
    return price.weight * exponential(-price.exponent * log_half_width)


HOLDS = 1 / 8  # of the objective, and of the limit or bound itself: a derivative is told for steps up to that


def part_that_holds(share: float, part: float) -> float:
    """The largest of 1, 1/2, 1/5, 1/10, ... that a step is told with: ``share`` of the objective and ``part`` of what
    it is a step of are then within what a derivative is good for."""
    most = HOLDS / max(share, part, HOLDS)
    scale = 10.0 ** floor(log10(most) + 1e-9)
    return max(factor for factor in (1.0, 2.0, 5.0, 10.0) if factor * scale <= most * (1 + 1e-9)) * scale

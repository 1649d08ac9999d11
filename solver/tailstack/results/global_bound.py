"""How good and how cheap any layout could be: what every optimum, and a validation that is asked for it, says."""

from __future__ import annotations

from dataclasses import dataclass

from .verdicts import Vector3


@dataclass(frozen=True, slots=True)
class GlobalBound:
    """How good any layout within what was asked for could be, proven to first order."""

    requirement: str
    """Name of the requirement whose quantile that is: with an optimum the one nearest to its limit."""
    target: str
    """Target at which it is."""
    limit: float
    """Its limit, in the unit of its measure."""
    quantile_mm: float | None
    """First-order quantile of the error of the design there, mm; null where it has none, or none that could be bounded.
    """
    lower_bound_mm: float | None
    """What no layout undercuts at the design's half-widths, mm; null without a bound."""
    tightest_bound_mm: float | None
    """What none undercuts with every free half-width at its smallest, mm; null where none is free, and without a bound.
    """
    gap_percent: float | None
    """How far the design is above the lower bound, %; null without one."""
    left_out: tuple[str, ...]
    """What the bound does not count, and which can only add to it."""
    statement: str
    """What the bound holds for, or why there is none, in a sentence."""
    images_gap_percent: float | None = None
    """How far the root mean square of what comes through the images, in the directions that the quantile feels, is at
    most above the least of any layout, %; null without a bound, and in an answer of an older version."""


@dataclass(frozen=True, slots=True)
class Relaxation:
    """A lower bound of the cost that no design within the given freedom (as said) can undercut."""

    kind: str
    """How the bound was found (convex allocation, monotone cuts over grades, any layout), or none."""
    cost: float | None
    """Cost of the optimum that it is compared with; null without a bound."""
    lower_bound: float | None
    """Cost that no design within the given freedom can undercut; null without a bound."""
    gap_percent: float | None
    """How far the optimum is above the bound, %; null without a bound."""
    statement: str
    """What the bound holds for, in a sentence."""


@dataclass(frozen=True, slots=True)
class WorthyPlace:
    """A place in the envelope where information is worth having."""

    position_mm: Vector3
    """The middle of that cell of the envelope, in con."""
    fiducials: float
    """How many fiducials the best mixture of layouts has there: 1 is a place that the best layouts all take."""

"""What every answer shares: remarks, checks of requirements, the verdict, visibility, where an answer came from."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Literal

Vector3 = tuple[float, float, float]
Matrix3 = tuple[Vector3, Vector3, Vector3]
Interval = tuple[float, float]

Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True, slots=True)
class Finding:
    """One remark about the design, with the number it rests on."""

    rule: str  # stable id, kebab-case
    severity: Severity
    message: str
    pointer: str = ""  # into the design document
    value: float | None = None
    limit: float | None = None


@dataclass(frozen=True, slots=True)
class Check:
    """One requirement at one target: a value, its interval, and the limit that the interval is held against.

    The status is read off the interval alone: ``pass`` if its upper end is within the limit, so if the margin is not
    negative; ``fail`` if its lower end is beyond.  The yield stands beside: it is at least what is required just where
    the value is within the limit.
    """

    requirement: str
    target: str
    error: str  # tcp or localisation
    risk: str  # pooled or per_unit
    quantile: float
    value_mm: float  # pooled: the quantile; per_unit: what ``min_yield`` of units keep their own quantile within
    # Monte Carlo: confidence interval; first order: calibrated error of linearisation, null where it is not valid
    interval_mm: tuple[float, float | None]
    limit_mm: float
    yield_fraction: float | None  # per_unit: fraction of units whose own quantile is within the limit
    min_yield: float | None
    status: Literal["pass", "fail", "inconclusive"]
    headline: str = ""  # what the value is, in words: "P95 that 90 % of units keep"; follows from the fields above
    margin_mm: float | None = None  # the limit less the upper end of the interval; null where that end is not known

    def __post_init__(self) -> None:
        high = self.interval_mm[1]
        object.__setattr__(self, "headline", headline_of(self.quantile, self.min_yield))
        object.__setattr__(self, "margin_mm", None if high is None else self.limit_mm - high)

    @property
    def upper_mm(self) -> float:
        """Upper end of the interval, infinite where there is none."""
        high = self.interval_mm[1]
        return inf if high is None else high


def headline_of(quantile: float, min_yield: float | None, of: str = "") -> str:
    """What a requirement limits: P95, or P95 that 90 % of units keep; ``of`` what, if that is named."""
    whose = f" of {of}" if of else ""
    units = "" if min_yield is None else f" that {100 * min_yield:.6g} % of units keep"
    return f"P{100 * quantile:.6g}{whose}{units}"


@dataclass(frozen=True, slots=True)
class Verdict:
    """``pass`` only when the upper end of every check's interval is within its limit."""

    status: Literal["pass", "fail", "inconclusive", "no requirement"]
    basis: str  # "first order" or "Monte Carlo"
    checks: tuple[Check, ...]
    findings: tuple[Finding, ...]


@dataclass(frozen=True, slots=True)
class ViewCheck:
    """Visibility of the fiducials in one view, at the biased geometry."""

    view: str
    checked: bool  # False when the image size is not stated
    depth_range_mm: Interval  # along the ray direction, fiducials
    outside: tuple[str, ...]
    smallest_margin_px: float | None
    closest_pair: tuple[str, str]
    closest_pair_px: float


@dataclass(frozen=True, slots=True)
class Provenance:
    design_name: str
    design_sha256: str | None
    tailstack_version: str
    reading: str
    rotation_form: str
    triangulation: str
    notes: tuple[str, ...]
    not_included: tuple[str, ...]

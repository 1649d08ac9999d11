"""The answer of a score."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from .verdicts import Matrix3, Provenance, Vector3, Verdict, ViewCheck


@dataclass(frozen=True, slots=True)
class Bounds:
    """Upper bounds of the quantile under ever weaker assumptions on the law of the error."""

    gaussian: float  # Gaussian with the same mean and covariance
    unimodal: float  # any symmetric-unimodal law (about its mean)
    moments: float  # any law with this mean and covariance


@dataclass(frozen=True, slots=True)
class Contributor:
    """One line of the budget."""

    name: str  # "fiducial_noise:AP", "fiducial_manufacturing", "interface_1", ...
    component: str  # "rx", a locator's name, "all" for a grouped line
    law: str
    half_width: float | None  # None for a grouped line
    unit: str  # deg, mm, px, N
    std: float | None
    sensitivity_mm_per_unit: float | None  # |g|: mm of error at the tool for one unit
    variance_share: float  # of tr(covariance)
    dp95_per_unit: float | None  # d p / d half_width, mm per unit
    p95_without_mm: float  # the same quantile with this contributor removed


@dataclass(frozen=True, slots=True)
class PerUnit:
    """The second reading of risk: the installation is drawn once per unit and stays."""

    limit_mm: float | None  # of the tightest requirement on each unit; without one, the target's
    yield_fraction: float | None  # fraction of units whose own quantile over shots meets the limit
    yield_standard_error: float | None
    p95_of_units_mm: float  # 95th percentile over units of the unit's own P95
    p95_of_units_standard_error_mm: float
    quantile: float = 0.95  # over a unit's own shots: that of the requirement
    units_fraction: float = 0.95  # of units: the requirement's min_yield
    value_mm: float | None = None  # what this fraction of units keep their own quantile within
    standard_error_mm: float | None = None


@dataclass(frozen=True, slots=True)
class SecondOrder:
    """Correction of the TCP error by the Hessian of the chain; see its own range of validity."""

    status: Literal["applied", "refused", "not requested"]
    reason: str
    mean_shift_mm: Vector3 | None = None
    std_mm: Vector3 | None = None
    p95_mm: float | None = None


@dataclass(frozen=True, slots=True)
class MetricScore:
    """First-order result for one error metric at one target."""

    frame: str
    bias_mm: Vector3
    covariance_mm2: Matrix3
    std_mm: Vector3
    mean_norm_mm: float
    p95_mm: float
    law: str  # the law it was computed with, in words
    law_error_mm: float  # its own numerical error
    bounds_mm: Bounds
    cvar95_mm: float
    limit_mm: float | None
    exceedance_probability: float | None


@dataclass(frozen=True, slots=True)
class TargetScore:
    """``bias_mm`` ... ``bounds_mm`` are the TCP error; ``localisation`` is the same before interface 2."""

    name: str
    frame: str
    bias_mm: Vector3
    covariance_mm2: Matrix3
    std_mm: Vector3
    mean_norm_mm: float
    p95_mm: float
    law: str
    law_error_mm: float
    bounds_mm: Bounds
    cvar95_mm: float
    limit_mm: float | None
    exceedance_probability: float | None
    localisation: MetricScore
    block_diagonal_p95_mm: float  # Gaussian, cross-view covariance dropped (Eq 16): compare bounds_mm.gaussian
    contributors: tuple[Contributor, ...]
    worst_vertex: tuple[str, ...]  # bounded components at their worst ends, e.g. ("interface_1.rz=+0.10 deg",)
    per_unit: PerUnit
    second_order: SecondOrder
    extrapolation: float  # distance of the target from the fiducials' centroid over their RMS radius


@dataclass(frozen=True, slots=True)
class Validity:
    """How far to trust the linearisation: nu and what it was calibrated to mean."""

    nu: float
    status: Literal["good to 1 %", "good to 5 %", "good to 20 %", "not valid"]
    expected_error_percent: float | None
    statement: str


@dataclass(frozen=True, slots=True)
class Score:
    """First order: bias, covariance, tail and budget at every target."""

    schema: Literal["tailstack/score/1"]
    targets: tuple[TargetScore, ...]
    validity: Validity
    views: tuple[ViewCheck, ...]
    verdict: Verdict
    provenance: Provenance

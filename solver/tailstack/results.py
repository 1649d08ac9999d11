"""What the library answers with: frozen records of plain Python numbers, units in every name.

The command line prints them, the service serialises them as they stand, and their JSON Schemas are
published.  Names in them are a contract (``docs/interfaces.md``).
"""

from __future__ import annotations

from dataclasses import dataclass
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
    """One requirement at one target."""

    requirement: str
    target: str
    error: str  # tcp or localisation
    risk: str  # pooled or per_unit
    quantile: float
    value_mm: float  # the quantile; per_unit: 95th percentile over units of the unit's own quantile
    interval_mm: Interval  # Monte Carlo: confidence interval; first order: calibrated error of linearisation
    limit_mm: float
    yield_fraction: float | None
    min_yield: float | None
    status: Literal["pass", "fail", "inconclusive"]


@dataclass(frozen=True, slots=True)
class Verdict:
    """``pass`` only when the upper end of every check's interval is within its limit."""

    status: Literal["pass", "fail", "inconclusive", "no requirement"]
    basis: str  # "first order" or "Monte Carlo"
    checks: tuple[Check, ...]
    findings: tuple[Finding, ...]


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

    limit_mm: float | None
    yield_fraction: float | None  # fraction of units whose own P95 over shots meets the limit
    yield_standard_error: float | None
    p95_of_units_mm: float  # 95th percentile over units of the unit's own P95
    p95_of_units_standard_error_mm: float


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


@dataclass(frozen=True, slots=True)
class Score:
    """First order: bias, covariance, tail and budget at every target."""

    schema: Literal["tailstack/score/1"]
    targets: tuple[TargetScore, ...]
    validity: Validity
    views: tuple[ViewCheck, ...]
    verdict: Verdict
    provenance: Provenance


@dataclass(frozen=True, slots=True)
class Exceedance:
    limit_mm: float
    probability: float
    interval: Interval


@dataclass(frozen=True, slots=True)
class MetricEstimate:
    """Sampled result for one error metric at one target."""

    bias_mm: Vector3
    std_mm: Vector3
    mean_norm_mm: float
    p95_mm: float
    p95_interval_mm: Interval
    cvar95_mm: float
    worst_mm: float
    exceedance: Exceedance | None
    first_order_ratio: float


@dataclass(frozen=True, slots=True)
class TargetEstimate:
    """``bias_mm`` ... ``exceedance`` are the TCP error; ``localisation`` is the same before interface 2."""

    name: str
    frame: str
    bias_mm: Vector3
    std_mm: Vector3
    mean_norm_mm: float
    p95_mm: float
    p95_interval_mm: Interval
    confidence: float
    cvar95_mm: float
    worst_mm: float
    exceedance: Exceedance | None
    flagged_trials: int
    first_order_p95_mm: float
    first_order_ratio: float
    localisation: MetricEstimate


@dataclass(frozen=True, slots=True)
class Reprojection:
    """RMS over fiducials and views of the distance between measured and reprojected images."""

    trials: int
    mean_px: float
    p95_px: float


@dataclass(frozen=True, slots=True)
class Verification:
    """Monte Carlo on the full nonlinear chain."""

    schema: Literal["tailstack/verification/1"]
    seed: int
    trials: int
    method: Literal["plain", "radial"]
    engine: str
    precision_requested: float | None
    precision_reached: float
    stopping: str  # why it stopped, in a sentence
    targets: tuple[TargetEstimate, ...]
    reprojection: Reprojection
    first_order_ratio: float  # first-order P95 over verified P95 at the worst target
    verdict: Verdict
    provenance: Provenance


@dataclass(frozen=True, slots=True)
class MovedFiducial:
    label: str
    before_mm: Vector3
    after_mm: Vector3


@dataclass(frozen=True, slots=True)
class ChangedTolerance:
    contributor: str
    component: str
    unit: str
    before_half_width: float
    after_half_width: float
    at_target_mm: float  # what the new half-width moves the worst target by
    cost_before: float
    cost_after: float


@dataclass(frozen=True, slots=True)
class ShadowPrice:
    name: str
    unit: str
    cost_per_unit: float
    sentence: str


@dataclass(frozen=True, slots=True)
class Certificate:
    kkt_residual: float
    starts: int
    converged_starts: int
    best_costs: tuple[float, ...]
    seed: int
    tightening_rounds: int
    verification: Verification


@dataclass(frozen=True, slots=True)
class Optimisation:
    schema: Literal["tailstack/optimisation/1"]
    status: Literal["verified"]
    objective: str
    cost_before: float
    cost_after: float
    p95_before_mm: float | None  # None: the layout as it stands does not determine the target
    p95_after_mm: float
    moved: tuple[MovedFiducial, ...]
    tolerances: tuple[ChangedTolerance, ...]
    certificate: Certificate
    shadow_prices: tuple[ShadowPrice, ...]
    binding: tuple[str, ...]
    design: dict[str, object]  # the new document, complete
    provenance: Provenance

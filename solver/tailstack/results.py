"""What the library answers with: frozen records of plain Python numbers, units in every name.

The command line prints them, the service serialises them as they stand, and their JSON Schemas are
published.  Names in them are a contract (``docs/interfaces.md``).
"""

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
    """One requirement at one target."""

    requirement: str
    target: str
    error: str  # tcp or localisation
    risk: str  # pooled or per_unit
    quantile: float
    value_mm: float  # the quantile; per_unit: 95th percentile over units of the unit's own quantile
    # Monte Carlo: confidence interval; first order: calibrated error of linearisation, null where it is not valid
    interval_mm: tuple[float, float | None]
    limit_mm: float
    yield_fraction: float | None
    min_yield: float | None
    status: Literal["pass", "fail", "inconclusive"]

    @property
    def upper_mm(self) -> float:
        """Upper end of the interval, infinite where there is none."""
        high = self.interval_mm[1]
        return inf if high is None else high


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
    """A fiducial that could move; ``before_mm`` is None for one that is new, ``after_mm`` for one left out."""

    label: str
    before_mm: Vector3 | None
    after_mm: Vector3 | None


@dataclass(frozen=True, slots=True)
class ChangedTolerance:
    """A half-width that was free.  ``at_target_*_mm``: what it moves the worst target by, half-width times lever."""

    contributor: str
    component: str
    label: str  # what the document calls the interface, and the component
    unit: str  # deg or mm
    before_half_width: float
    after_half_width: float
    at_target_before_mm: float
    at_target_mm: float
    cost_before: float | None  # None: the half-width as it stands has no price (zero, or tighter than every grade)
    cost_after: float
    grade: str | None  # the process grade chosen from a table


@dataclass(frozen=True, slots=True)
class MovedPivot:
    """A pivot that was free."""

    contributor: str
    label: str
    before_mm: Vector3
    after_mm: Vector3


@dataclass(frozen=True, slots=True)
class ChangedSpacing:
    """Locators that could be spread about their centre, by which factor."""

    contributor: str
    label: str
    scale: float


@dataclass(frozen=True, slots=True)
class ShadowPrice:
    """What one unit of a limit or bound is worth, from the multipliers: a derivative, good for small steps."""

    name: str
    unit: str
    cost_per_unit: float  # of the objective: cost, or mm of the quantile where that is minimised
    sentence: str


@dataclass(frozen=True, slots=True)
class LocalOptimum:
    """A distinct optimum among the starts, by the closed form that ranks them."""

    objective: float  # cost; or the largest quantile over its limit
    starts: int  # how many ended there
    first_start: int
    rms_distance_mm: float  # of its fiducials from those of the best one, matched to the nearest


@dataclass(frozen=True, slots=True)
class Relaxation:
    """A lower bound of the cost that no design within the given freedom (as said) can undercut."""

    kind: str  # "convex allocation", "monotone cuts over grades", or why there is none
    cost: float | None
    lower_bound: float | None
    gap_percent: float | None
    statement: str


@dataclass(frozen=True, slots=True)
class Certificate:
    """What the optimum rests on."""

    kkt_residual: float  # of the programme with the exact law, recomputed from the multipliers
    starts: int
    converged_starts: int
    best_costs: tuple[float, ...]  # distinct, ascending, by the closed form; objectives where no cost is minimised
    optima: tuple[LocalOptimum, ...]
    relaxation: Relaxation
    seed: int
    tightening_rounds: int
    stopped: str  # why the search ended, in a sentence
    verification: Verification


@dataclass(frozen=True, slots=True)
class FrontPoint:
    """One limit of the front of cost and limit; with a design that was verified like the one returned, or without.

    Every requirement's limit is scaled by the same factor; limit, quantile and upper limit are those of the first.
    """

    factor: float
    limit_mm: float
    status: Literal["verified", "dominated", "out of reach", "not tried"]
    note: str  # why there is no design, or what costs less
    cost: float | None
    quantile_mm: float | None  # largest over its targets, first order
    verified_upper_mm: float | None  # largest upper confidence limit of the check
    half_widths: tuple[float, ...]  # in the order and units of ``tolerances``
    pivots_mm: tuple[Vector3, ...]  # in the order of ``pivots``
    locator_scales: tuple[float, ...]  # in the order of ``spacings``
    fiducials_mm: tuple[Vector3, ...]


@dataclass(frozen=True, slots=True)
class CountTried:
    """The best design with so many fiducials, by the closed form."""

    fiducials: int
    cost: float | None  # fiducials included; None: nothing feasible
    worst_ratio: float | None  # largest quantile over its limit
    note: str


@dataclass(frozen=True, slots=True)
class PlacementValue:
    """What the placement bought, against a textbook layout and against careless ones, tolerances optimised alike."""

    textbook: str  # what the textbook layout is, or why there is none
    textbook_objective: float | None  # None: it cannot meet the limit
    careless_layouts: int  # random ones that keep the rules
    careless_infeasible: int
    careless_median: float | None  # of those that can meet the limit
    careless_worst: float | None
    best: float  # the optimum, by the same closed form
    sentence: str


@dataclass(frozen=True, slots=True)
class Optimisation:
    """A design that keeps its limit at least cost (or what was asked for), verified by Monte Carlo."""

    schema: Literal["tailstack/optimisation/1"]
    status: Literal["verified"]
    objective: str
    cost_before: float | None
    cost_after: float
    cost_closed_form: float | None  # optimum by the smooth closed form that drives the search
    cost_exact_law: float | None  # optimum by the exact law at the limit itself, before the check's margin
    p95_before_mm: float | None  # None: the layout as it stands does not determine the target
    p95_after_mm: float
    moved: tuple[MovedFiducial, ...]
    tolerances: tuple[ChangedTolerance, ...]
    pivots: tuple[MovedPivot, ...]
    spacings: tuple[ChangedSpacing, ...]
    scaling: float | None  # objective scaling: the factor
    certificate: Certificate
    shadow_prices: tuple[ShadowPrice, ...]
    binding: tuple[str, ...]
    influence: tuple[Finding, ...]  # what the free variables can and cannot do, known before solving
    placement_value: PlacementValue | None
    counts: tuple[CountTried, ...]
    front: tuple[FrontPoint, ...]
    design: dict[str, object]  # the new document, complete
    provenance: Provenance

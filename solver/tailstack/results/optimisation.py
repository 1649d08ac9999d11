"""The answer of the optimiser."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from .verdicts import Finding, Provenance, Vector3
from .verification import Verification


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
    design_before: dict[str, object]  # the document that it started from, complete
    design: dict[str, object]  # the new one
    provenance: Provenance

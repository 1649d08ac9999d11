"""What the gate answers with: frozen records, published as ``tailstack/gate/1``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from tailstack.results import Severity, Vector3

GateVerdict = Literal["pass", "fail", "inconclusive", "not evaluated"]
WORST_FIRST: tuple[GateVerdict, ...] = ("not evaluated", "fail", "inconclusive", "pass")
Mode = Literal["analytic", "verify", "auto"]
Level = Literal["error", "warning"]
Fold = Literal["fail", "warn"]
Basis = Literal["first order", "Monte Carlo", "none"]


@dataclass(frozen=True, slots=True)
class GateFinding:
    """One remark, at the place of the offending value."""

    rule: str  # stable id, see `tailstack gate --explain ID`
    severity: Severity
    file: str  # the name given with the design; of the policy, waivers or baseline where it is about them
    line: int | None  # 1-based; null where the document did not come as text
    column: int | None
    pointer: str  # RFC 6901, into the file's document
    message: str
    value: float | None
    limit: float | None
    suppressed_by: str | None  # the waiver that accepts it; it then does not count


@dataclass(frozen=True, slots=True)
class GateNumber:
    """One number that was held against a limit."""

    rule: str
    requirement: str  # the requirement's name; of a limit that the policy sets, the rule's id
    target: str
    unit: str  # mm, or "fraction" for a yield
    value: float
    interval: tuple[float, float | None] | None  # null: of a yield; an end that is null is not known
    limit: float
    status: Literal["pass", "fail", "inconclusive"]
    error_rate: float | None  # by Monte Carlo: largest probability that pass is said of a fail, or fail of a pass
    # What decided, in mm; of a yield, too: the value is within the limit just where as many units are good as required.
    headline: str = ""  # what the value is: "P95 that 90 % of units keep"
    value_mm: float | None = None
    interval_mm: tuple[float, float | None] | None = None
    limit_mm: float | None = None
    margin_mm: float | None = None  # the limit less the upper end of the interval; null where that end is not known

    def __post_init__(self) -> None:
        if self.unit == "mm":
            for name in ("value", "interval", "limit"):
                object.__setattr__(self, f"{name}_mm", getattr(self, name))
        high = None if self.interval_mm is None else self.interval_mm[1]
        margin = None if high is None or self.limit_mm is None else self.limit_mm - high
        object.__setattr__(self, "margin_mm", margin)


@dataclass(frozen=True, slots=True)
class GateTarget:
    """The error at one target: what a later gate compares with."""

    name: str
    first_order_p95_mm: float
    p95_mm: float | None  # Monte Carlo; null where it was not drawn
    p95_interval_mm: tuple[float, float] | None
    cvar95_mm: float
    position_mm: Vector3 | None = None  # con; null in records written before this field was


@dataclass(frozen=True, slots=True)
class GateRequirement:
    """What a design was asked for, by itself or by the policy: what a later gate must not ask less than."""

    name: str  # the requirement's; of a limit that the policy sets, the rule's id
    origin: Literal["design", "policy"]
    rule: str  # under which it is judged
    severity: Literal["error", "warning", "note", "off"]  # of that rule, for this design
    error: Literal["tcp", "localisation"]
    quantile: float  # of the error; of cvar, where the tail begins
    limit_mm: float
    min_yield: float | None  # of a requirement per unit
    confidence: float
    targets: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Unjudged:
    """Something that was asked for, or a target, that nothing was held against."""

    requirement: str | None  # null: no requirement and no limit of the policy is about the target
    target: str
    rule: str | None
    reason: str


@dataclass(frozen=True, slots=True)
class GateSection:
    """One section of a design document, by its content: how a design is found again in a baseline."""

    name: str
    sha256: str


@dataclass(frozen=True, slots=True)
class GatedDesign:
    """One design and the numbers that were judged."""

    file: str
    name: str | None  # null: the document could not be read
    sha256: str | None
    design_class: str | None  # class of the policy whose rules applied
    verdict: GateVerdict
    basis: Basis
    trials: int | None
    targets: tuple[GateTarget, ...]
    numbers: tuple[GateNumber, ...]
    requirements: tuple[GateRequirement, ...] = ()  # judged or not; empty too in records written before this field was
    not_judged: tuple[Unjudged, ...] = ()
    sections: tuple[GateSection, ...] = ()


@dataclass(frozen=True, slots=True)
class GateProvenance:
    """What decided, besides the designs."""

    tailstack_version: str
    policy_name: str
    policy_sha256: str | None  # of the canonical content, defaults filled in; null: it could not be read
    waivers_sha256: str | None
    baseline_sha256: str | None
    today: str  # ISO 8601 date by which waivers were judged
    not_included: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class GateRecord:
    """Designs held to a policy."""

    schema: Literal["tailstack/gate/1"]
    verdict: GateVerdict
    exit_code: int  # 0 pass, 1 fail, 2 bad input, 3 not evaluated, 4 inconclusive, 130 interrupted
    mode: Mode
    seed: int
    fail_level: Level
    on_inconclusive: Fold | None
    max_regression_percent: float | None
    findings: tuple[GateFinding, ...]
    designs: tuple[GatedDesign, ...]
    provenance: GateProvenance

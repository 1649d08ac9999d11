"""The policy, ``tailstack/policy/1``: which rules count, how much, with which limits, and for which designs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import ConfigDict, Field, model_validator

from tailstack.design.plausibility import PLAUSIBILITY
from tailstack.fields import Length, Name, Record, refusal, refuse_repeated
from tailstack.montecarlo import FINEST_PRECISION, MOST_TRIALS

from .file_names import match_names
from .reading import GateDesign, GateInput, Given, Remark, hash_content, read_document

POLICY_SCHEMA = "tailstack/policy/1"

Severity = Literal["error", "warning", "note", "off"]
# At most ten stars: the time that a pattern takes is bounded by what can lie between them.
Pattern = Annotated[
    str, Field(min_length=1, max_length=400, pattern=r"^([^*\x00-\x1f\x7f]*\*){0,10}[^*\x00-\x1f\x7f]*$")
]
Patterns = Annotated[list[Pattern], Field(min_length=1, max_length=100)]
Percent = Annotated[float, Field(ge=0, le=1e6)]
Pixels = Annotated[float, Field(ge=0, le=1e5)]
Probability = Annotated[float, Field(ge=1e-4, le=0.5)]
Confidence = Annotated[float, Field(ge=0.5, le=0.9999)]
Ratio = Annotated[float, Field(ge=1, le=1e6)]

_WEIGHT = "error, warning, note or off."
_CONFIDENCE = "Confidence of the interval that decides. Default 0.95."


def _refuse_half(rule: Record, first: str, second: str) -> None:
    missing = [name for name in (first, second) if getattr(rule, name) is None]
    if len(missing) == 1:
        raise refusal("missing-field", f"{first} and {second} go together; {missing[0]} is missing")


class ErrorRule(Record):
    """A rule whose findings are errors."""

    severity: Severity = Field(default="error", description=_WEIGHT, examples=["error"])


class WarningRule(Record):
    """A rule whose findings are warnings."""

    severity: Severity = Field(default="warning", description=_WEIGHT, examples=["warning"])


class NoteRule(Record):
    """A rule whose findings are notes."""

    severity: Severity = Field(default="note", description=_WEIGHT, examples=["note"])


class P95Rule(ErrorRule):
    """Quantiles: every pooled requirement of the design, and a P95 limit of the policy's own."""

    limit_mm: Length | None = Field(default=None, examples=[2.0])
    """P95 of the TCP error at every target must not exceed this, mm."""
    confidence: Confidence = Field(default=0.95, description=_CONFIDENCE)


class CvarRule(ErrorRule):
    """Mean of the worst 5 % of errors."""

    limit_mm: Length | None = Field(default=None, examples=[2.5])
    """CVaR95 of the TCP error at every target must not exceed this, mm."""
    confidence: Confidence = Field(default=0.95, description=_CONFIDENCE)


class ExceedanceRule(ErrorRule):
    """How often an error may be large."""

    limit_mm: Length | None = Field(default=None, examples=[2.5])
    """Error that counts as large, mm."""
    max_probability: Probability | None = Field(default=None, examples=[0.01])
    """Largest share of shots beyond limit_mm."""
    confidence: Confidence = Field(default=0.95, description=_CONFIDENCE)

    @model_validator(mode="after")
    def _require_both(self) -> ExceedanceRule:
        _refuse_half(self, "limit_mm", "max_probability")
        return self


class YieldRule(ErrorRule):
    """Share of installed units that are good: per-unit requirements of the design, and one of the policy's own."""

    limit_mm: Length | None = Field(default=None, examples=[2.0])
    """A unit is good if the P95 of its own shots is within this, mm."""
    min_yield: Annotated[float, Field(gt=0, lt=1)] | None = Field(default=None, examples=[0.95])
    """Fraction of units that must be good."""
    confidence: Confidence = Field(default=0.95, description=_CONFIDENCE)

    @model_validator(mode="after")
    def _require_both(self) -> YieldRule:
        _refuse_half(self, "limit_mm", "min_yield")
        return self


class GapRule(WarningRule):
    """How far first order may be from Monte Carlo."""

    max_percent: Percent = Field(default=5.0, examples=[5.0])
    """Largest difference of the two P95, per cent of the verified one."""


if TYPE_CHECKING:
    Implausible = str
else:
    Implausible = Literal[tuple(PLAUSIBILITY)]


class PlausibilityRule(WarningRule):
    """Values that are allowed and hardly ever meant."""

    remarks: Annotated[list[Implausible], Field(max_length=100)] | None = Field(
        default=None, examples=[["noise-too-small", "half-width-too-fine"]]
    )
    """Remarks that count with the severity; the others are noted. Default all."""


class AssumedRule(WarningRule):
    """Values of the design that nobody stated."""

    max_count: Annotated[int, Field(ge=0, le=1000)] = Field(default=0, examples=[3])
    """So many assumed values are accepted. Default none."""


class SpacingRule(ErrorRule):
    """Distance between fiducials."""

    min_mm: Length | None = Field(default=None, examples=[8.0])
    """Smallest distance of two fiducials, mm."""


class LossRule(ErrorRule):
    """Every limit is kept when fiducials are lost."""

    lost: Literal[1, 2] | None = Field(default=None, examples=[1])
    """So many fiducials may be lost in all views, whichever they are, and every requirement keeps its limit by
    estimate. Default none: nothing is judged."""


class ReliabilityRule(ErrorRule):
    """A slip of a fiducial's image is noticed before it does much."""

    max_effect_mm: Length | None = Field(default=None, examples=[0.5])
    """Largest error at the tool that a slip of one fiducial's image in one view may do without being noticed by its
    residuals, mm. Default none: nothing is judged."""


class VisibilityRule(WarningRule):
    """Margin between the images of fiducials and the border of each view."""

    min_margin_px: Pixels = Field(default=0.0, examples=[20.0])
    """Smallest distance from the border, px."""


class OverlapRule(WarningRule):
    """Distance between the images of two fiducials in each view."""

    min_px: Pixels = Field(default=10.0, examples=[10.0])
    """Smallest distance of two images, px."""


class Process(Record):
    """What a manufacturing process can hold."""

    name: Name = Field(examples=["milled seat"])
    """Name of the process."""
    tolerances: Patterns = Field(examples=[["structure_connector.r?"]])
    """Tolerances made by it, as patterns (* and ?) of names like structure_connector.rx, connector_flange.tz,
    structure_connector.A1 (a locator), fiducials.manufacturing, hand_eye.tx."""
    min_half_width_deg: Annotated[float, Field(gt=0, le=45)] | None = Field(default=None, examples=[0.05])
    """Smallest half-width of a rotation that it holds, degrees."""
    min_half_width_mm: Annotated[float, Field(gt=0, le=1e3)] | None = Field(default=None, examples=[0.02])
    """Smallest half-width of a length that it holds, mm."""

    @model_validator(mode="after")
    def _require_width(self) -> Process:
        if self.min_half_width_deg is None and self.min_half_width_mm is None:
            raise refusal("missing-field", "a process states min_half_width_deg, min_half_width_mm or both")
        return self


class ProcessRule(ErrorRule):
    """Tolerances tighter than their process can hold."""

    processes: Annotated[list[Process], Field(max_length=200)] = Field(default=[])
    """What each process can hold. Default none: nothing is judged."""


class RegressionRule(ErrorRule):
    """Worse than the baseline."""

    max_percent: Percent = Field(default=0.0, examples=[2.0])
    """By how much the P95 at a target may exceed the baseline's, per cent; --max-regression goes before it. Default 0.
    """


class InconclusiveRule(Record):
    """An interval that holds the limit."""

    severity: Literal["error", "warning"] = Field(default="error", examples=["error"])
    """error or warning, never less: an open question is no pass. warning has the meaning of --on-inconclusive warn."""


class ExpiredRule(Record):
    """A waiver beyond its date."""

    severity: Literal["error"] = Field(default="error", examples=["error"])
    """Always an error."""


class UnjudgedRule(Record):
    """A requirement that nothing was held against."""

    severity: Literal["error", "warning", "note"] = Field(default="warning", examples=["warning"])
    """error, warning or note, never off: what was not judged is always named."""


class WideWaiverRule(WarningRule):
    """A waiver that accepts more than anybody looked at."""

    max_limit_ratio: Ratio = Field(default=2.0, examples=[2.0])
    """A waiver may accept up to so many times the limit. Default 2."""
    max_value_ratio: Ratio = Field(default=1.5, examples=[1.5])
    """A waiver may accept up to so many times what it accepts now (the end of the interval). Default 1.5."""


class Rules(Record):
    """Rules by id.  A rule that is not given has its defaults."""

    model_config = ConfigDict(alias_generator=lambda name: name.replace("_", "-"))

    p95: P95Rule = Field(default_factory=P95Rule)
    cvar: CvarRule = Field(default_factory=CvarRule)
    exceedance: ExceedanceRule = Field(default_factory=ExceedanceRule)
    per_unit_yield: YieldRule = Field(default_factory=YieldRule)
    statistic: ErrorRule = Field(default_factory=ErrorRule)
    first_order_gap: GapRule = Field(default_factory=GapRule)
    conditioning: WarningRule = Field(default_factory=WarningRule)
    plausibility: PlausibilityRule = Field(default_factory=PlausibilityRule)
    assumed_values: AssumedRule = Field(default_factory=AssumedRule)
    fiducial_spacing: SpacingRule = Field(default_factory=SpacingRule)
    survives_loss: LossRule = Field(default_factory=LossRule)
    reliability: ReliabilityRule = Field(default_factory=ReliabilityRule)
    visibility: VisibilityRule = Field(default_factory=VisibilityRule)
    overlap: OverlapRule = Field(default_factory=OverlapRule)
    process_capability: ProcessRule = Field(default_factory=ProcessRule)
    process_unused: NoteRule = Field(default_factory=NoteRule)
    regression: RegressionRule = Field(default_factory=RegressionRule)
    limit_relaxed: ErrorRule = Field(default_factory=ErrorRule)
    not_compared: WarningRule = Field(default_factory=WarningRule)
    not_judged: UnjudgedRule = Field(default_factory=UnjudgedRule)
    class_relaxed: WarningRule = Field(default_factory=WarningRule)
    class_unused: WarningRule = Field(default_factory=WarningRule)
    inconclusive: InconclusiveRule = Field(default_factory=InconclusiveRule)
    waiver_expired: ExpiredRule = Field(default_factory=ExpiredRule)
    waiver_unused: NoteRule = Field(default_factory=NoteRule)
    waiver_wide: WideWaiverRule = Field(default_factory=WideWaiverRule)
    model_version: WarningRule = Field(default_factory=WarningRule)


class DesignClass(Record):
    """Designs with rules of their own: what is given here goes before ``rules``, field by field."""

    name: Name = Field(examples=["prototypes"])
    """Name, unique."""
    files: Patterns | None = Field(default=None, examples=[["prototypes/*"]])
    """Patterns of files (* and ?, * also crosses /; **/ is any depth), from the root of the repository or from a folder
    between that and this document."""
    rules: Rules = Field(default_factory=Rules)
    """What differs from the policy's rules."""


class SimulationSettings(Record):
    """How Monte Carlo is drawn."""

    precision: Annotated[float, Field(ge=FINEST_PRECISION, le=0.5)] = Field(default=0.01, examples=[0.01])
    """Mode verify: relative half-width of the interval of P95 at which drawing may end."""
    max_trials: Annotated[int, Field(ge=1000, le=MOST_TRIALS)] = Field(default=2**20, examples=[1048576])
    """Trials after which an open question is inconclusive."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = Field(default=0, examples=[0])
    """Seed; with a baseline, the baseline's is used."""


class Policy(Record):
    """What a design must keep to pass."""

    schema_: Literal["tailstack/policy/1"] = Field(alias="schema", examples=["tailstack/policy/1"])
    """Version of this document."""
    name: Name = Field(default="policy", examples=["drill guides"])
    """Name of the policy."""
    description: Annotated[str, Field(max_length=4000)] = ""
    """Free text."""
    rules: Rules = Field(default_factory=Rules)
    """Rules by id."""
    classes: Annotated[list[DesignClass], Field(max_length=100)] = Field(default=[])
    """Designs with rules of their own; the first class that matches counts."""
    verification: SimulationSettings = Field(default_factory=SimulationSettings)
    """How Monte Carlo is drawn, in modes verify and auto."""
    guard_band_percent: Percent = Field(default=10.0, examples=[10.0])
    """Mode auto draws Monte Carlo where a first-order value lies within so much of its limit, or where first order
    cannot decide. Default 10."""

    @model_validator(mode="after")
    def _require_unique_names(self) -> Policy:
        refuse_repeated([entry.name for entry in self.classes], "classes", "classes/{}/name")
        return self


# --- which rules apply to a design -------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class GatePolicy(GateInput):
    """A policy and where it came from."""

    document: Policy

    def choose_class(self, design: GateDesign) -> str | None:
        """The class of a design: the one that is given, or the first whose patterns match its file."""
        chosen = (entry.name for entry in self.document.classes if _is_chosen(entry, design))
        return design.design_class or next(chosen, None)

    def merge_rules(self, design_class: str | None) -> Rules:
        """The rules of a class: its own fields before the policy's."""
        rules = self.document.rules
        own = next((entry.rules for entry in self.document.classes if entry.name == design_class), None)
        if own is None:
            return rules
        changes = {}
        for name in own.model_fields_set:
            entry = getattr(own, name)
            fields = {field: getattr(entry, field) for field in entry.model_fields_set}
            changes[name] = getattr(rules, name).model_copy(update=fields)
        return rules.model_copy(update=changes)

    def point_at_processes(self, design_class: str | None) -> str:
        """Where the processes of a class stand: its own go before the policy's."""
        for index, entry in enumerate(self.document.classes):
            if entry.name == design_class and "processes" in entry.rules.process_capability.model_fields_set:
                return f"/classes/{index}/rules/process-capability/processes"
        return "/rules/process-capability/processes"


def _is_chosen(entry: DesignClass, design: GateDesign) -> bool:
    return any(match_names(design.known_as, pattern) for pattern in entry.files or ())


def read_policy(given: Given | None, *, prefix: str = "") -> GatePolicy:
    """A policy from a path, text or data; None is the default policy.  Raises GateError.

    prefix: pointer to the policy inside the request that it came in.
    """
    if given is None:
        given = {"schema": POLICY_SCHEMA, "name": "default"}
    source, document = read_document(given, Policy, POLICY_SCHEMA, prefix, "the rules: tailstack schema policy")
    return GatePolicy(
        source, source.file or "policy", hash_content(document.model_dump(mode="json", by_alias=True)), document
    )


# --- what classes take away --------------------------------------------------------------------------


def find_weak_classes(policy: Policy, members: Mapping[str | None, Sequence[str]]) -> Iterator[tuple[str, Remark]]:
    """Rule class-relaxed: what classes switch off or weaken, of those that designs of this gate are in.

    members: files of the designs by class.
    """
    for index, entry in enumerate(policy.classes):
        files = members.get(entry.name, ())
        for rule, field, words, lost in _list_weaker(policy.rules, entry) if files else ():
            inside = files[0] if len(files) == 1 else f"{files[0]} and {len(files) - 1} more"
            message = f"class {entry.name}: {rule} {words}; in it {inside}"
            yield "class-relaxed", Remark(f"/classes/{index}/rules/{rule}/{field}", message, note=not lost)


def _list_weaker(rules: Rules, entry: DesignClass) -> Iterator[tuple[str, str, str, bool]]:
    """Rule, field, words, and whether the rule is lost altogether."""
    for name in sorted(entry.rules.model_fields_set):
        own, before = getattr(entry.rules, name), getattr(rules, name)
        if before.severity != "error":
            continue
        rule = Rules.model_fields[name].alias or name
        if "severity" in own.model_fields_set and own.severity != "error":
            lost = own.severity == "off"
            words = "is off, an error for all others" if lost else f"is a {own.severity}, an error for all others"
            yield rule, "severity", words, lost
        for field in type(own).model_fields:
            limit = getattr(before, field)
            if field in own.model_fields_set and getattr(own, field) is None and isinstance(limit, int | float):
                yield rule, field, f"has no {field}, {limit:g} for all others", True
        if "processes" in own.model_fields_set and not own.processes and before.processes:
            yield rule, "processes", "has no processes, unlike for all others", True


# --- what classes do not choose -----------------------------------------------------------------------


def find_idle_classes(policy: GatePolicy, designs: Sequence[GateDesign]) -> Iterator[tuple[str, Remark]]:
    """Rule class-unused: patterns that match no design of this gate, and classes whose designs others take.

    A slip in a pattern would be a class, with its limits, that nobody is held to.  designs: all of the gate.
    """
    taken = {design.file: policy.choose_class(design) for design in designs}
    of = "the design" if len(designs) == 1 else f"any of the {len(designs)} designs"
    for index, entry in enumerate(policy.document.classes):
        if any(design.design_class == entry.name for design in designs):
            continue
        idle = [
            number
            for number, pattern in enumerate(entry.files or ())
            if not any(match_names(design.known_as, pattern) for design in designs)
        ]
        for number in idle:
            message = f"class {entry.name}: {(entry.files or ())[number]!r} does not match {of} judged here"
            yield "class-unused", Remark(f"/classes/{index}/files/{number}", message)
        if not idle and entry.name not in taken.values():
            others = [design.file for design in designs if _is_chosen(entry, design)]
            why = f"{others[0]} is in class {taken[others[0]]} before it" if others else "it has no patterns of files"
            yield "class-unused", Remark(f"/classes/{index}", f"class {entry.name}: it chooses nothing here, {why}")

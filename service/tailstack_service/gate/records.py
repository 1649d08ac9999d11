"""What the gate answers with: frozen records, published as ``tailstack/gate/1``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from tailstack.design import Design
from tailstack.measures import MEASURE, MeasureName
from tailstack.results import Vector3
from tailstack.results.digits import decimals_of
from tailstack.results.outline import Bar, Bars, Frame, Outline, frame, row_of
from tailstack.results.record import Result
from tailstack.results.tables import PAPER, TERMINAL, Column, On, Table, tabulate
from tailstack.results.verdicts import Check, Finding, check_columns, decided_by, name_basis
from tailstack.statistic import StatisticName

from .asked import Fold, Level, Mode

GateVerdict = Literal["pass", "fail", "inconclusive", "not evaluated"]
WORST_FIRST: tuple[GateVerdict, ...] = ("not evaluated", "fail", "inconclusive", "pass")
Basis = Literal["first order", "Monte Carlo", "none"]


@dataclass(frozen=True, slots=True)
class GateFinding(Finding):
    """A finding at the place of the offending value, with its severity under the policy: `tailstack gate --explain`."""

    file: str = ""
    """Name given with the design; of the policy, waivers or baseline where it is about them."""
    line: int | None = None
    """Line in the file, from 1; null where the document did not come as text."""
    column: int | None = None
    """Column in the line, from 1; null where the document did not come as text."""
    suppressed_by: str | None = None
    """The waiver that accepts it, so that it does not count; otherwise null."""


@dataclass(frozen=True, slots=True)
class GateNumber(Check):
    """A check of the solver, and the rule that judged it: one number that was held against a limit."""

    rule: str = ""
    """Id of the rule; its requirement is called after it where the policy sets the limit."""
    error_rate: float | None = None
    """By Monte Carlo: largest probability that pass is said of a fail, or fail of a pass; null: first order."""

    def __post_init__(self) -> None:
        Check.__post_init__(self)
        if self.rule == "cvar":
            object.__setattr__(self, "headline", "CVaR95")

    @property
    def judged_value(self) -> float:
        """What findings and waivers are about: the yield, otherwise what decided."""
        return self.value if self.yield_fraction is None else self.yield_fraction

    @property
    def judged_limit(self) -> float:
        """What that was held against."""
        return self.limit if self.min_yield is None else self.min_yield


@dataclass(frozen=True, slots=True)
class GateTarget:
    """The error at one target: what a later gate compares with."""

    name: str
    """Name of the target, or of one sample of a region (zone[3])."""
    first_order_p95_mm: float
    """First-order P95 of the TCP error, mm."""
    p95_mm: float | None
    """Sampled P95 of the TCP error, mm; null where nothing was drawn."""
    p95_interval_mm: tuple[float, float] | None
    """Confidence interval of it, mm; null where nothing was drawn."""
    cvar95_mm: float
    """Mean of the worst 5 % of the TCP error's norm, mm."""
    position_mm: Vector3
    """Position of the target, con, mm."""


@dataclass(frozen=True, slots=True)
class GateRequirement:
    """What a design was asked for, by itself or by the policy: what a later gate must not ask less than."""

    name: str
    """Name of the requirement; of a limit that the policy sets, the rule's id."""
    origin: Literal["design", "policy"]
    """Who asks: the design or the policy."""
    rule: str
    """Rule under which it is judged."""
    severity: Literal["error", "warning", "note", "off"]
    """Severity of that rule for this design."""
    error: MeasureName
    """Measure that is limited: tcp (error at the tool), localisation (of the target)."""
    quantile: float
    """Quantile of the error's norm, 0.95 for P95; of cvar, where the tail begins; of max_of_n that of one shot, of
    probability what it leaves to 1."""
    limit: float
    """The limit, in `unit`."""
    min_yield: float | None
    """Fraction of units, or of mountings, that must keep it; null: the risk is pooled."""
    confidence: float
    """Confidence with which it is judged, 0 to 1."""
    targets: tuple[str, ...]
    """Targets that it is about."""
    unit: str = ""
    """Unit of the limit: mm, unless the measure has another."""
    risk: str = "per_unit"
    """Of what `min_yield` is a fraction: per_unit, per_mounting."""
    statistic: StatisticName = "quantile"
    """What of the error is limited."""
    n: int | None = None
    """max_of_n: number of shots of which the largest error is limited; otherwise null."""
    ids: tuple[str, ...] = ()
    """What it is called in a system of requirements, as the design says."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "unit", MEASURE[self.error].unit)


@dataclass(frozen=True, slots=True)
class Unjudged:
    """Something that was asked for, or a target, that nothing was held against."""

    requirement: str | None
    """Name of the requirement; null: no requirement and no limit of the policy is about the target."""
    target: str
    """Name of the target."""
    rule: str | None
    """Rule that would have judged it; null without requirement."""
    reason: str
    """Why nothing was held against it."""


@dataclass(frozen=True, slots=True)
class GateSection:
    """One section of a design document, by its content: how a design is found again in a baseline."""

    name: str
    """Name of the section."""
    sha256: str
    """SHA-256 of its canonical content, hexadecimal."""


@dataclass(frozen=True, slots=True)
class GatedDesign:
    """One design and the numbers that were judged."""

    file: str
    """Name given with the design."""
    name: str | None
    """Name of the design; null: the document could not be read."""
    sha256: str | None
    """SHA-256 of the design's canonical content; null: the document could not be read."""
    design_class: str | None
    """Class of the policy whose rules applied; null: the general ones."""
    verdict: GateVerdict
    """Verdict on this design."""
    basis: Basis
    """What it rests on."""
    trials: int | None
    """Trials that were drawn; null: first order."""
    targets: tuple[GateTarget, ...]
    """The error at each target: what a later gate compares with."""
    numbers: tuple[GateNumber, ...]
    """Every number that was held against a limit."""
    requirements: tuple[GateRequirement, ...] = ()
    """What was asked for, judged or not."""
    not_judged: tuple[Unjudged, ...] = ()
    """What was asked for, or targets, that nothing was held against."""
    sections: tuple[GateSection, ...] = ()
    """Sections of the document by their content: how a design is found again in a baseline."""
    assumed: tuple[str, ...] = ()
    """What nobody stated: a JSON pointer (RFC 6901) into the design document for each assumed value."""


@dataclass(frozen=True, slots=True)
class GateProvenance:
    """What decided, besides the designs."""

    tailstack_version: str
    """Version of the solver."""
    policy_name: str
    """Name of the policy."""
    policy_sha256: str | None
    """SHA-256 of the policy's canonical content, defaults filled in; null: it could not be read."""
    waivers_sha256: str | None
    """SHA-256 of the waivers' canonical content; null without waivers."""
    baseline_sha256: str | None
    """SHA-256 of the baseline; null without one."""
    today: str
    """Date by which waivers were judged, ISO 8601."""
    not_included: tuple[str, ...]
    """Errors that no number here includes."""


@dataclass(frozen=True, slots=True, repr=False)
class GateRecord(Result):
    """Designs held to a policy."""

    schema: Literal["tailstack/gate/1"]
    verdict: GateVerdict
    """The worst verdict of all designs."""
    exit_code: int
    """Exit code of the command: 0 pass, 1 fail, 2 bad input, 3 not evaluated, 4 inconclusive, 130 interrupted."""
    mode: Mode
    """analytic: first order; verify: Monte Carlo; auto: Monte Carlo where first order cannot decide."""
    seed: int
    """Seed of the checks."""
    fail_level: Level
    """Severity from which a finding fails the gate."""
    on_inconclusive: Fold | None
    """How inconclusive is counted: fail or warn; null: as it is."""
    max_regression_percent: float | None
    """What P95 at a target may rise by against the baseline, %; null: nothing was asked for."""
    findings: tuple[GateFinding, ...]
    """Remarks, at the places of the offending values."""
    designs: tuple[GatedDesign, ...]
    """The designs and the numbers that were judged."""
    provenance: GateProvenance
    """What decided, besides the designs."""

    def outline(self) -> Outline:
        """The designs with their verdicts, and what was found."""
        designs = [row_of(design, largest_p95_mm=find_largest_p95(design)) for design in self.designs]
        numbers = [row_of(entry, file=design.file) for design in self.designs for entry in design.numbers]
        targets = [row_of(entry, file=design.file) for design in self.designs for entry in design.targets]
        counted = sum(counts(entry, self.fail_level) for entry in self.findings)
        judged = f"{len(self.designs)} design{'' if len(self.designs) == 1 else 's'}"
        drawn = [(design, p95) for design in self.designs if (p95 := find_largest_p95(design)) is not None]
        return Outline(
            "Gate",
            self.provenance.policy_name,
            self.verdict,
            f"{judged}, {counted} of {len(self.findings)} findings count; exit code {self.exit_code}.",
            (
                Frame("designs", tuple(designs), shown=designs_table(self)),
                frame(GateFinding, "findings", self.findings, findings_table("Findings", "Findings", self.findings)),
                Frame("numbers", tuple(numbers)),
                Frame("targets", tuple(targets)),
            ),
            Bars(
                "Largest P95 of each design",
                "P95 of the error at the tool, mm",
                tuple(Bar(design.file, p95, limit=_p95_limit(design)) for design, p95 in drawn),
            ),
        )


MOST_ROWS = 200  # of a page


def designs_table(record: GateRecord) -> Table:
    """Every design with its verdict."""
    decimals = decimals_of([number for design in record.designs for number in design.numbers])
    columns = (
        Column("File", of=lambda design: design.file),
        Column("Design", of=lambda design: design.name),
        Column("Class", on=PAPER, of=lambda design: design.design_class or ""),
        Column("Basis", of=lambda design: name_basis(design.basis)),
        Column("Trials", "", "whole", of=lambda design: design.trials),
        Column("Largest P95", "mm", "fixed", decimals, of=find_largest_p95),
        Column("Verdict", kind="status", of=lambda design: design.verdict),
    )
    return tabulate("Designs", "Designs", columns, record.designs)


class JudgedNumber(NamedTuple):
    """What a row of a table of numbers is about."""

    file: str
    check: GateNumber
    targets: int = 1  # that pass; this one is nearest to its limit


def choose_numbers(design: GatedDesign) -> list[JudgedNumber]:
    """Everything that does not pass; of what passes, for each requirement the target nearest to its limit."""
    passing = decided_by([number for number in design.numbers if number.status == "pass"])
    return [
        *(JudgedNumber(design.file, number) for number in design.numbers if number.status != "pass"),
        *(JudgedNumber(design.file, number, count) for number, count in passing),
    ]


def numbers_table(rows: Sequence[JudgedNumber]) -> Table:
    """Numbers that were held against limits; of yields the fraction of units beside them."""
    requirement, target, _, _, *values = check_columns([row.check for row in rows])
    columns = (
        Column("File", on=~TERMINAL, of=lambda row: row.file),
        requirement,
        target,
        Column("Rule", on=TERMINAL | On.SHEET, of=lambda row: row.check.rule),
        Column("What", on=~TERMINAL, of=lambda row: row.check.headline),
        *values,
    )
    return tabulate("Numbers", "Numbers that were held against limits", columns, rows, most=MOST_ROWS)


def unjudged_table(record: GateRecord) -> Table:
    """What nothing was held against."""
    columns = (
        Column("File", of=lambda row: row[0]),
        Column("Requirement", of=lambda row: row[1].requirement or ""),
        Column("Target", of=lambda row: row[1].target),
        Column("Reason", of=lambda row: row[1].reason),
    )
    unjudged = [(design.file, entry) for design in record.designs for entry in design.not_judged]
    return tabulate("Not judged", "What nothing was held against", columns, unjudged, most=MOST_ROWS)


def name_place(finding: GateFinding) -> str:
    """``file:line:column`` where they are known, else the pointer."""
    if finding.line is not None:
        return f"{finding.file}:{finding.line}:{finding.column or 1}"
    return f"{finding.file}#{finding.pointer}" if finding.pointer else finding.file


def findings_table(name: str, caption: str, findings: Sequence[GateFinding]) -> Table:
    """Findings at their places."""
    accepted = Column("Accepted by", of=lambda finding: finding.suppressed_by or "")
    columns = (
        Column("Severity", kind="status", of=lambda finding: finding.severity),
        Column("Rule", of=lambda finding: finding.rule),
        Column("Place", of=name_place),
        Column("Finding", of=lambda finding: finding.message),
        Column("Value", "", "significant", 4, PAPER, of=lambda finding: finding.value),
        Column("Limit", "", "significant", 4, PAPER, of=lambda finding: finding.limit),
        *((accepted,) if any(finding.suppressed_by for finding in findings) else ()),
    )
    return tabulate(name, caption, columns, findings, most=MOST_ROWS)


def _p95_limit(design: GatedDesign) -> float | None:
    """The tightest limit on P95 of the error at the tool that a design was held against, mm."""
    limits = [
        entry.limit
        for entry in design.requirements
        if (entry.error, entry.quantile, entry.min_yield, entry.statistic) == ("tcp", 0.95, None, "quantile")
        and entry.rule != "cvar"
    ]
    return min(limits, default=None)


def counts(finding: GateFinding, fail_level: Level) -> bool:
    """Whether a finding fails the gate by its weight."""
    heavy = ("error",) if fail_level == "error" else ("error", "warning")
    return finding.suppressed_by is None and finding.severity in heavy


def find_largest_p95(design: GatedDesign) -> float | None:
    """P95 of the TCP error at the worst target, mm, by Monte Carlo where it was drawn; None where nothing was."""
    values = (target.first_order_p95_mm if target.p95_mm is None else target.p95_mm for target in design.targets)
    return max(values, default=None)


def split_findings(record: GateRecord) -> tuple[list[GateFinding], list[GateFinding]]:
    """Findings that no waiver accepts, and those that one does."""
    counted = [finding for finding in record.findings if finding.suppressed_by is None]
    return counted, [finding for finding in record.findings if finding.suppressed_by is not None]


def record_unread(file: str, design: Design | None = None, design_class: str | None = None) -> GatedDesign:
    """The record of a design of which nothing was computed; without ``design``, it could not be read either."""
    name, sha256 = (None, None) if design is None else (design.name, design.sha256)
    return GatedDesign(file, name, sha256, design_class, "not evaluated", "none", None, (), ())

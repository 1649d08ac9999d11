"""The chapters of a gate."""

from __future__ import annotations

import shlex

from ...gate.records import GateFinding, GateRecord
from ..blocks import (
    Block,
    Bullets,
    Column,
    Document,
    Facts,
    KeyNumber,
    Listing,
    Paragraph,
    Row,
    Section,
    Table,
    tone_of,
)

MOST = 200  # rows of a page
MOST_FILES = 20  # in a command


def gate_document(record: GateRecord, sha256: str) -> Document:
    """Which designs passed, what was found, and what was accepted."""
    counted = [finding for finding in record.findings if finding.suppressed_by is None]
    accepted = [finding for finding in record.findings if finding.suppressed_by is not None]
    errors = sum(finding.severity == "error" for finding in counted)
    warnings = sum(finding.severity == "warning" for finding in counted)
    passed = sum(design.verdict == "pass" for design in record.designs)
    blocks: list[Block] = [gate_findings_table("Findings", "Findings that count", counted)] if counted else []
    if accepted:
        blocks.append(gate_findings_table("Accepted", "Findings that a waiver accepts", accepted))
    return Document(
        kind="Gate",
        title=f"{record.provenance.policy_name}: gate of {_counted(len(record.designs), 'design')}",
        tone=tone_of(record.verdict),
        status=record.verdict,
        sentence=f"{passed} of {len(record.designs)} designs pass; {_counted(errors, 'error')} and "
        f"{_counted(warnings, 'warning')} count, {len(accepted)} accepted by waivers. Exit code {record.exit_code}.",
        numbers=(
            KeyNumber(
                "Designs that pass", f"{passed} of {len(record.designs)}", f"mode {record.mode}, seed {record.seed}"
            ),
            KeyNumber("Errors", str(errors), "that count"),
            KeyNumber("Accepted", str(len(accepted)), "by waivers in force"),
        ),
        matters=tuple(f"{finding.file}: {finding.message}" for finding in counted if finding.severity == "error")[:3],
        sections=(
            Section("Designs", (_designs_table(record), _numbers_table(record), *_not_judged_table(record))),
            Section("Findings", tuple(blocks) or (Bullets(("None.",)),)),
            Section("What is not included", (Bullets(record.provenance.not_included),), reader="auditor"),
            Section("Reproduction", (Listing(_command(record)), Paragraph(REPRODUCTION)), reader="auditor"),
        ),
        provenance=Facts(
            "Provenance",
            (
                ("Policy", record.provenance.policy_name),
                ("SHA-256 of the policy", record.provenance.policy_sha256 or "could not be read"),
                ("SHA-256 of the waivers", record.provenance.waivers_sha256 or "no waivers"),
                ("SHA-256 of the baseline", record.provenance.baseline_sha256 or "no baseline"),
                ("Waivers judged by", record.provenance.today),
                ("SHA-256 of this record", sha256),
                ("Record", record.schema),
                ("Computed by", f"tailstack {record.provenance.tailstack_version}"),
            ),
        ),
    )


REPRODUCTION = (
    "With the policy, waivers, baseline and designs of the hashes in this record, the seed above (the policy's or "
    "the baseline's), and the waivers judged by the day named on the first page: one that has expired since then fails "
    "the gate today."
)


def _command(record: GateRecord) -> str:
    """The command that gives this gate again, as far as the record knows its files."""
    made = record.provenance
    files = " ".join(shlex.quote(design.file) for design in record.designs[:MOST_FILES])
    files += " ..." if len(record.designs) > MOST_FILES else ""
    options = [f"--mode {record.mode}", f"--fail-level {record.fail_level}"]
    options += [] if record.on_inconclusive is None else [f"--on-inconclusive {record.on_inconclusive}"]
    options += ["--policy POLICY"] if made.policy_name != "default" else []
    options += ["--waivers WAIVERS"] if made.waivers_sha256 is not None else []
    options += ["--baseline BASELINE"] if made.baseline_sha256 is not None else []
    if record.max_regression_percent is not None and made.baseline_sha256 is not None:
        options.append(f"--max-regression {record.max_regression_percent:g}")
    return f"tailstack gate {files} {' '.join(options)} --format json"


def _counted(count: int, what: str) -> str:
    return f"{count} {what}" + ("" if count == 1 else "s")


def _designs_table(record: GateRecord) -> Table:
    rows = [
        Row((
            design.file, design.name or "could not be read", design.design_class or "", design.basis, design.trials,
            max((t.first_order_p95_mm if t.p95_mm is None else t.p95_mm for t in design.targets), default=None),
            design.verdict,
        ))
        for design in record.designs
    ]  # fmt: skip
    return Table(
        "Designs", "Designs",
        (
            Column("File"), Column("Design"), Column("Class"), Column("Basis"), Column("Trials", "", "whole"),
            Column("Largest P95", "mm", "fixed", 4), Column("Verdict", kind="status"),
        ),
        tuple(rows),
    )  # fmt: skip


def _numbers_table(record: GateRecord) -> Table:
    rows = [
        Row((
            design.file, number.requirement, number.rule, number.target, number.headline, number.value_mm,
            *(number.interval_mm or (None, None)), number.limit_mm, number.margin_mm,
            *((number.value, number.limit) if number.unit == "fraction" else (None, None)), number.status,
        ))
        for design in record.designs
        for number in design.numbers
    ]  # fmt: skip
    return Table(
        "Numbers", "Numbers that were held against limits",
        (
            Column("File"), Column("Requirement"), Column("Rule", on_page=False), Column("Target"), Column("What"),
            Column("Value", "mm", "fixed", 4), Column("From", "mm", "fixed", 4), Column("To", "mm", "fixed", 4),
            Column("Limit", "mm", "significant", 4), Column("Margin", "mm", "signed"),
            Column("Yield", "%", "percent", 2), Column("Required", "%", "percent", 2), Column("Status", kind="status"),
        ),
        tuple(rows),
        most=MOST,
    )  # fmt: skip


def _not_judged_table(record: GateRecord) -> tuple[Table, ...]:
    rows = tuple(
        Row((design.file, entry.requirement or "", entry.target, entry.reason))
        for design in record.designs
        for entry in design.not_judged
    )
    columns = (Column("File"), Column("Requirement"), Column("Target"), Column("Reason"))
    return (Table("Not judged", "What nothing was held against", columns, rows, most=MOST),) if rows else ()


def gate_findings_table(name: str, caption: str, findings: list[GateFinding]) -> Table:
    rows = [
        Row((
            finding.severity, finding.rule, _place(finding), finding.message, finding.value, finding.limit,
            finding.suppressed_by or "",
        ))
        for finding in findings
    ]  # fmt: skip
    return Table(
        name, caption,
        (
            Column("Severity", kind="status"), Column("Rule"), Column("Place"), Column("Finding"),
            Column("Value", "", "significant", 4), Column("Limit", "", "significant", 4), Column("Accepted by"),
        ),
        tuple(rows),
        most=MOST,
    )  # fmt: skip


def _place(finding: GateFinding) -> str:
    return f"{finding.file}:{finding.line}:{finding.column}" if finding.line else f"{finding.file}#{finding.pointer}"

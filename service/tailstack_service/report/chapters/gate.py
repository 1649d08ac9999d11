"""The chapters of a gate."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from ...gate.records import (
    GatedDesign,
    GateFinding,
    GateNumber,
    GateRecord,
    Unjudged,
    find_largest_p95,
    split_findings,
)
from ...rendering.sentences import name_basis
from ...rendering.tables import spell_count
from ..blocks import (
    Block,
    Bullets,
    Cell,
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

MOST = {"Designs": 60, "Numbers": 200, "Not judged": 200, "Findings": 200, "Accepted": 200}  # rows of a page
MOST_FILES = 20  # in a command


def gate_document(record: GateRecord, sha256: str) -> Document:
    """Which designs passed, what was found, and what was accepted."""
    counted, accepted = split_findings(record)
    errors = sum(finding.severity == "error" for finding in counted)
    warnings = sum(finding.severity == "warning" for finding in counted)
    passed = sum(design.verdict == "pass" for design in record.designs)
    tables: list[Block] = [_make_table("Findings", "Findings that count", FINDINGS, counted)] if counted else []
    if accepted:
        tables.append(_make_table("Accepted", "Findings that a waiver accepts", FINDINGS, accepted))
    designs = [_make_table("Designs", "Designs", DESIGNS, record.designs)]
    numbers = [(design.file, number) for design in record.designs for number in design.numbers]
    designs.append(_make_table("Numbers", "Numbers that were held against limits", NUMBERS, numbers))
    if unjudged := [(design.file, entry) for design in record.designs for entry in design.not_judged]:
        designs.append(_make_table("Not judged", "What nothing was held against", UNJUDGED, unjudged))
    return Document(
        kind="Gate",
        title=f"{record.provenance.policy_name}: gate of {spell_count(len(record.designs), 'design')}",
        tone=tone_of(record.verdict),
        status=record.verdict,
        sentence=f"{passed} of {len(record.designs)} designs pass; {spell_count(errors, 'error')} and "
        f"{spell_count(warnings, 'warning')} count, {len(accepted)} accepted by waivers. Exit code {record.exit_code}.",
        numbers=(
            KeyNumber(
                "Designs that pass", f"{passed} of {len(record.designs)}", f"mode {record.mode}, seed {record.seed}"
            ),
            KeyNumber("Errors", str(errors), "that count"),
            KeyNumber("Accepted", str(len(accepted)), "by waivers in force"),
        ),
        matters=tuple(f"{finding.file}: {finding.message}" for finding in counted if finding.severity == "error")[:3],
        sections=(
            Section("Designs", tuple(designs)),
            Section("Findings", tuple(tables) or (Bullets(("None.",)),)),
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
    provenance = record.provenance
    files = " ".join(shlex.quote(design.file) for design in record.designs[:MOST_FILES])
    files += " ..." if len(record.designs) > MOST_FILES else ""
    options = [f"--mode {record.mode}", f"--fail-level {record.fail_level}"]
    options += [] if record.on_inconclusive is None else [f"--on-inconclusive {record.on_inconclusive}"]
    options += ["--policy POLICY"] if provenance.policy_name != "default" else []
    options += ["--waivers WAIVERS"] if provenance.waivers_sha256 is not None else []
    options += ["--baseline BASELINE"] if provenance.baseline_sha256 is not None else []
    if record.max_regression_percent is not None and provenance.baseline_sha256 is not None:
        options.append(f"--max-regression {record.max_regression_percent:g}")
    return f"tailstack gate {files} {' '.join(options)} --format json"


def _make_table(
    name: str, caption: str, columns: Sequence[tuple[Column, Callable[[Any], Cell]]], entries: Iterable[Any]
) -> Table:
    rows = tuple(Row(tuple(cell(entry) for _, cell in columns)) for entry in entries)
    return Table(name, caption, tuple(column for column, _ in columns), rows, most=MOST[name])


def _name_place(finding: GateFinding) -> str:
    return f"{finding.file}:{finding.line}:{finding.column}" if finding.line else f"{finding.file}#{finding.pointer}"


def _end(number: GateNumber, index: int) -> float | None:
    return None if number.interval_mm is None else number.interval_mm[index]


# Columns with the cell of each in a row: of a design, of (file, number), of (file, what was not judged), of a finding.
DESIGNS: tuple[tuple[Column, Callable[[GatedDesign], Cell]], ...] = (
    (Column("File"), lambda design: design.file),
    (Column("Design"), lambda design: design.name or "could not be read"),
    (Column("Class"), lambda design: design.design_class or ""),
    (Column("Basis"), lambda design: name_basis(design.basis)),
    (Column("Trials", "", "whole"), lambda design: design.trials),
    (Column("Largest P95", "mm", "fixed", 4), find_largest_p95),
    (Column("Verdict", kind="status"), lambda design: design.verdict),
)
NUMBERS: tuple[tuple[Column, Callable[[tuple[str, GateNumber]], Cell]], ...] = (
    (Column("File"), lambda row: row[0]),
    (Column("Requirement"), lambda row: row[1].requirement),
    (Column("Rule", on_page=False), lambda row: row[1].rule),
    (Column("Target"), lambda row: row[1].target),
    (Column("What"), lambda row: row[1].headline),
    (Column("Value", "mm", "fixed", 4), lambda row: row[1].value_mm),
    (Column("From", "mm", "fixed", 4), lambda row: _end(row[1], 0)),
    (Column("To", "mm", "fixed", 4), lambda row: _end(row[1], 1)),
    (Column("Limit", "mm", "significant", 4), lambda row: row[1].limit_mm),
    (Column("Margin", "mm", "signed"), lambda row: row[1].margin_mm),
    (Column("Yield", "%", "percent", 2), lambda row: row[1].value if row[1].unit == "fraction" else None),
    (Column("Required", "%", "percent", 2), lambda row: row[1].limit if row[1].unit == "fraction" else None),
    (Column("Status", kind="status"), lambda row: row[1].status),
)
UNJUDGED: tuple[tuple[Column, Callable[[tuple[str, Unjudged]], Cell]], ...] = (
    (Column("File"), lambda row: row[0]),
    (Column("Requirement"), lambda row: row[1].requirement or ""),
    (Column("Target"), lambda row: row[1].target),
    (Column("Reason"), lambda row: row[1].reason),
)
FINDINGS: tuple[tuple[Column, Callable[[GateFinding], Cell]], ...] = (
    (Column("Severity", kind="status"), lambda finding: finding.severity),
    (Column("Rule"), lambda finding: finding.rule),
    (Column("Place"), _name_place),
    (Column("Finding"), lambda finding: finding.message),
    (Column("Value", "", "significant", 4), lambda finding: finding.value),
    (Column("Limit", "", "significant", 4), lambda finding: finding.limit),
    (Column("Accepted by"), lambda finding: finding.suppressed_by or ""),
)

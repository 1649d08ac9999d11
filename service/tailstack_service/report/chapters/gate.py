"""The chapters of a gate."""

from __future__ import annotations

import shlex

from tailstack.results.verdicts import urgency

from ...gate.records import (
    GateRecord,
    JudgedNumber,
    designs_table,
    findings_table,
    numbers_table,
    split_findings,
    unjudged_table,
)
from ...rendering.document import (
    Bullets,
    Document,
    Facts,
    KeyNumber,
    Listing,
    Paragraph,
    Section,
    closing_sections,
    tone_of,
)
from ...rendering.text import spell_count

MOST_FILES = 20  # in a command


def gate_document(record: GateRecord, sha256: str) -> Document:
    """Which designs passed, what was found, and what was accepted."""
    counted, accepted = split_findings(record)
    errors = sum(finding.severity == "error" for finding in counted)
    warnings = sum(finding.severity == "warning" for finding in counted)
    passed = f"{sum(design.verdict == 'pass' for design in record.designs)} of {len(record.designs)}"
    tables = [findings_table("Findings", "Findings that count", counted)] if counted else []
    if accepted:
        tables.append(findings_table("Accepted", "Findings that a waiver accepts", accepted))
    numbers = [JudgedNumber(design.file, entry) for design in record.designs for entry in design.numbers]
    numbers.sort(key=lambda row: urgency(row.check))
    made = record.provenance
    pairs = (
        ("Policy", made.policy_name),
        ("SHA-256 of the policy", made.policy_sha256 or "could not be read"),
        ("SHA-256 of the waivers", made.waivers_sha256 or "no waivers"),
        ("SHA-256 of the baseline", made.baseline_sha256 or "no baseline"),
        ("Waivers judged by", made.today),
        ("SHA-256 of this record", sha256),
        ("Record", record.schema),
        ("Computed by", f"tailstack {made.tailstack_version}"),
    )
    return Document(
        kind="Gate",
        title=f"{made.policy_name}: gate of {spell_count(len(record.designs), 'design')}",
        tone=tone_of(record.verdict),
        status=record.verdict,
        sentence=f"{passed} designs pass; {spell_count(errors, 'error')} and "
        f"{spell_count(warnings, 'warning')} count, {len(accepted)} accepted by waivers. Exit code {record.exit_code}.",
        numbers=(
            KeyNumber("Designs that pass", passed, f"mode {record.mode}, seed {record.seed}"),
            KeyNumber("Errors", str(errors), "that count"),
            KeyNumber("Accepted", str(len(accepted)), "by waivers in force"),
        ),
        matters=tuple(f"{finding.file}: {finding.message}" for finding in counted if finding.severity == "error")[:3],
        requirements=numbers_table(numbers) if numbers else None,
        sections=(
            Section("Designs", (designs_table(record), unjudged_table(record))),
            Section("Findings", tuple(tables) or (Bullets(("None.",)),)),
            *closing_sections(made, Listing(_command(record)), Paragraph(REPRODUCTION)),
        ),
        provenance=Facts("Provenance", pairs),
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

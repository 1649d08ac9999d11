"""A gate as Markdown: for a summary in a pipeline or a comment.  What comes from documents cannot become markup."""

from __future__ import annotations

import re

from ..rendering.tables import number, shortened, signed
from .places import not_judged
from .records import GateFinding, GateRecord
from .terminal import place_of, telling

MOST = 100
_SPECIAL = re.compile(r"([\\`*_{}\[\]<>()#+!|~$@&])")
_MARK = {"pass": "✅", "fail": "❌", "inconclusive": "❔", "not evaluated": "⛔"}


def markdown_text(record: GateRecord) -> str:
    """Verdict, one row per design, then findings, then what waivers accept."""
    counted = [finding for finding in record.findings if finding.suppressed_by is None]
    accepted = [finding for finding in record.findings if finding.suppressed_by is not None]
    lines = [
        f"## {_MARK[record.verdict]} Gate: {record.verdict}",
        "",
        f"Exit code {record.exit_code} · mode {record.mode} · seed {record.seed} · policy "
        f"{plain(record.provenance.policy_name, 60)} · tailstack {record.provenance.tailstack_version}"
        + not_judged(record).replace(", ", " · "),
        "",
        "| design | verdict | largest P95, mm | basis |",
        "|---|---|---:|---|",
    ]
    for design in record.designs:
        values = [t.first_order_p95_mm if t.p95_mm is None else t.p95_mm for t in design.targets]
        largest = number(max(values)) if values else "–"
        verdict = f"{_MARK[design.verdict]} {design.verdict}"
        basis = design.basis + (f", {design.trials:,} trials" if design.trials is not None else "")
        lines.append(f"| {plain(design.file, 80)} | {verdict} | {largest} | {basis} |")
    if any(design.numbers for design in record.designs):
        lines += ["", "### Requirements", "", *_numbers(record)]
    if counted:
        lines += ["", "### Findings", "", *_table(counted)]
    if accepted:
        lines += ["", "### Accepted by waivers", "", *_table(accepted)]
    return "\n".join(lines) + "\n"


def _numbers(record: GateRecord) -> list[str]:
    """Each requirement at the target that is nearest to its limit, and every one that does not pass."""
    lines = [
        "| design | requirement | target | what | value, mm | limit, mm | margin, mm | status |",
        "|---|---|---|---|---:|---:|---:|---|",
    ]
    rows = [(design, *entry) for design in record.designs for entry in telling(design.numbers)]
    for design, entry, target in rows[:MOST]:
        texts = " | ".join(plain(text, 80) for text in (design.file, entry.requirement, target, entry.headline))
        values = " | ".join((number(entry.value_mm), number(entry.limit_mm), signed(entry.margin_mm)))
        lines.append(f"| {texts} | {values} | {_MARK[entry.status]} {entry.status} |")
    if len(rows) > MOST:
        lines.append(f"| | | | {len(rows) - MOST} more are in the record | | | | |")
    return lines


def plain(text: str, width: int = 400) -> str:
    """Text that Markdown shows as it stands, on one line."""
    return _SPECIAL.sub(r"\\\1", shortened(" ".join(text.split()), width))


def _table(findings: list[GateFinding]) -> list[str]:
    lines = ["| | rule | place | finding |", "|---|---|---|---|"]
    for finding in findings[:MOST]:
        message = plain(finding.message)
        if finding.suppressed_by is not None:
            message += f"<br>accepted by {plain(finding.suppressed_by)}"
        lines.append(f"| {finding.severity} | {finding.rule} | {plain(place_of(finding), 90)} | {message} |")
    if len(findings) > MOST:
        lines.append(f"| | | | {len(findings) - MOST} more are in the record |")
    return lines

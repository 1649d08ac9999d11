"""A gate for people: as text for a terminal, and as Markdown for a summary in a pipeline or a comment.

Places are named as compilers name them.  What comes from documents cannot become markup or a command to a runner.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from tailstack.results.digits import count_decimals, decimal, percent, signed_decimal, stated
from tailstack.results.verdicts import name_basis

from ..rendering.alike import gather_alike, list_others, name_field, name_rule
from ..rendering.page import current, write_on
from ..rendering.sentences import error_of
from ..rendering.tables import draw_table, paint, visible, wrap
from .records import WORST_FIRST, GateFinding, GateNumber, GateRecord, counts, find_largest_p95, split_findings

_MARKUP = re.compile(r"([\\`*_{}\[\]<>()#+!|~$@&])")
_COMMAND = re.compile(r"(?m)^([ \t]*)(?=::|##\[)")
YIELD = "units\nwithin, %"  # title of a column
MOST_TOLD = 10  # of a kind, in a summary
MOST_ROWS = 100  # of a table in Markdown
_ROLE = {"error": "fail", "warning": "warning", "pass": "pass", "fail": "fail", "inconclusive": "inconclusive"}
_MARK = {"pass": "✅", "fail": "❌", "inconclusive": "❔", "not evaluated": "⛔"}


def render_text(record: GateRecord) -> str:
    """Designs and their numbers, findings at their places, verdict and exit code."""
    parts = [_list_designs(record)]
    counted, accepted = split_findings(record)
    for heading, findings in (([], counted), (["accepted by waivers"], accepted)):
        if findings:
            groups = gather_alike(findings, _name_group)
            parts.append("\n".join([*heading, *(_write_finding(first, others) for first, *others in groups)]))
    circumstances = (
        f"Mode {record.mode}, seed {record.seed}, policy {record.provenance.policy_name}; waivers are those of "
        f"{record.provenance.today}."
    )
    parts.append(wrap(visible(circumstances), first="", indent="  "))
    # the verdict stays on a line of its own, the last: scripts look for it there
    verdict = f"verdict: {record.verdict}"
    outcome = visible(f"verdict: {describe_outcome(record)}")
    parts.append(outcome.replace(verdict, paint(verdict, _ROLE.get(record.verdict, "fail")), 1))
    # a line that begins like this is a command to the runners of GitHub and Azure, and names come from strangers
    return _COMMAND.sub(r"\1\\", "\n\n".join(parts)) + "\n"


def summarise(record: GateRecord) -> list[str]:
    """In a few lines what the gate came to and why, for a log that gets no other words: designs, the worst first, the
    findings that decide, the verdict."""
    designs = sorted(record.designs, key=lambda design: WORST_FIRST.index(design.verdict))
    lines = [f"{visible(design.file)}: {design.verdict}" for design in designs[:MOST_TOLD]]
    if more := designs[MOST_TOLD:]:
        bad = sum(design.verdict != "pass" for design in more)
        lines.append(f"... and {len(more)} more designs, " + (f"{bad} of which do not pass" if bad else "which pass"))
    counted, _ = split_findings(record)
    decisive = [finding for finding in counted if counts(finding, record.fail_level) or finding.rule == "inconclusive"]
    lines += [f"{visible(name_place(f))}: {visible(f.message)} [{f.rule}]" for f in decisive[:MOST_TOLD]]
    if len(decisive) > MOST_TOLD:
        lines.append(f"... and {len(decisive) - MOST_TOLD} more findings that count")
    lines.append(f"verdict: {describe_outcome(record)}")
    return [_COMMAND.sub(r"\1\\", " ".join(line.split())) for line in lines]


def describe_outcome(record: GateRecord) -> str:
    """Verdict and exit code, what waivers accept and what was not judged, for a closing line."""
    accepted = len(split_findings(record)[1])
    waived = f", {accepted} accepted by waivers" if accepted else ""
    return f"{record.verdict} (exit code {record.exit_code}{waived}{count_not_judged(record)})"


def name_place(finding: GateFinding) -> str:
    """``file:line:column`` where they are known, else the pointer."""
    if finding.line is not None:
        return f"{finding.file}:{finding.line}:{finding.column or 1}"
    return f"{finding.file}#{finding.pointer}" if finding.pointer else finding.file


def _list_designs(record: GateRecord) -> str:
    blocks = []
    for design in record.designs:
        basis = "" if design.basis == "none" else name_basis(design.basis)
        basis += f", {design.trials:,} trials" if design.trials is not None else ""
        kind = f" [{design.design_class}]" if design.design_class else ""
        verdict = paint(design.verdict, _ROLE.get(design.verdict, "fail"))
        name = f" ({visible(design.name)})" if design.name else ""
        rates = [number.error_rate for number in design.numbers if number.error_rate is not None]
        basis += f"; each status wrong with a probability of at most {100 * max(rates):.3g} %" if rates else ""
        line = f"{visible(design.file)}{name}{kind}: {design.verdict}" + (f" ({basis})" if basis else "")
        # the verdict is painted once the line is laid out, for colours take no room
        blocks.append(wrap(line, first="", indent="  ").replace(f": {design.verdict}", f": {verdict}", 1))
        if design.numbers:
            with write_on(replace(current(), width=current().width - 2)):
                lines = _write_table(design.numbers).splitlines()
            blocks.append("\n".join(f"  {line}".rstrip() for line in lines))
    return "\n".join(blocks)


def choose_numbers(numbers: tuple[GateNumber, ...]) -> list[tuple[GateNumber, str]]:
    """Everything that does not pass, with its target; of what passes, for each requirement the target nearest to its
    limit."""
    rows = [(entry, entry.target) for entry in numbers if entry.status != "pass"]
    for name in dict.fromkeys(entry.requirement for entry in numbers):
        passing = [entry for entry in numbers if entry.requirement == name and entry.status == "pass"]
        if passing:
            nearest = max(passing, key=lambda entry: (entry.value_mm or 0.0) / (entry.limit_mm or 1.0))
            others = f" (worst of {len(passing)})" if len(passing) > 1 else ""
            rows.append((nearest, nearest.target + others))
    return rows


def _write_table(numbers: tuple[GateNumber, ...]) -> str:
    """What decided, in mm, and of a yield the fraction of units beside it."""
    decimals = _decimals_of(numbers)
    rows = [_write_row(entry, target, decimals) for entry, target in choose_numbers(numbers)]
    known = current().details and any(row[YIELD] != "-" for row in rows)
    titles = [title for title in rows[0] if title != YIELD or known]
    return draw_table(titles, [[row[title] for title in titles] for row in rows], left=3, above=True)


def _decimals_of(numbers: Sequence[GateNumber]) -> int:
    """Decimals of the lengths of a design that was judged."""
    asked = [
        count_decimals(entry.limit_mm, error_of(entry.value_mm, entry.interval_mm or (0.0, None)))
        for entry in numbers
        if entry.limit_mm and entry.value_mm is not None
    ]
    return max(asked, default=3)


def _write_row(entry: GateNumber, target: str, decimals: int) -> dict[str, str]:
    low_mm, high_mm = entry.interval_mm or (None, None)
    return {
        "require-\nment": entry.requirement,
        "target": target,
        "rule": entry.rule,
        "value\nmm": decimal(entry.value_mm, decimals),
        "between\nmm": "-"
        if entry.interval_mm is None
        else f"{decimal(low_mm, decimals)} .. {decimal(high_mm, decimals)}",
        "limit\nmm": stated(entry.limit_mm, decimals),
        "to spare\nmm": signed_decimal(entry.margin_mm, decimals),
        YIELD: percent(entry.value) if entry.unit == "fraction" else "-",
        "status": entry.status,
    }


def _name_group(finding: GateFinding) -> tuple[str, ...] | None:
    """What findings share that are written as one; None of a finding with a number of its own."""
    if finding.value is not None or finding.suppressed_by is not None:
        return None
    said = name_rule(finding.message.partition(" — ")[0])
    return (finding.file, finding.rule, finding.severity, said, name_field(finding.pointer))


def _write_finding(finding: GateFinding, others: Sequence[GateFinding] = ()) -> str:
    severity = paint(finding.severity, _ROLE.get(finding.severity, "none"))
    text = f"{finding.message} [{finding.rule}]"
    lines = wrap(text, first=f"{visible(name_place(finding))}: {severity}: ", indent="  ")
    if finding.suppressed_by is not None:
        lines += "\n" + wrap(finding.suppressed_by, first="  accepted by ", indent="  ")
    if others:
        places = list_others([other.line for other in others], [other.pointer for other in others])
        lines += "\n" + wrap(visible(places), first="  ", indent="  ")
    return lines


def count_not_judged(record: GateRecord) -> str:
    """How many requirements and limits nothing was held against, in words for a closing line; "" if there are none."""
    count = sum(
        len({(entry.rule, entry.requirement) for entry in design.not_judged if entry.requirement is not None})
        for design in record.designs
    )
    return f", {count} requirement{'s' if count > 1 else ''} not judged" if count else ""


def render_markdown(record: GateRecord) -> str:
    """Verdict, one row per design, then findings, then what waivers accept."""
    counted, accepted = split_findings(record)
    lines = [
        f"## {_MARK[record.verdict]} Gate: {record.verdict}",
        "",
        f"Exit code {record.exit_code} · mode {record.mode} · seed {record.seed} · policy "
        f"{escape_markdown(record.provenance.policy_name)} · tailstack {record.provenance.tailstack_version}"
        + count_not_judged(record).replace(", ", " · "),
        "",
        "| design | verdict | largest P95, mm | basis |",
        "|---|---|---:|---|",
    ]
    for design in record.designs:
        p95_mm = find_largest_p95(design)
        largest = "–" if p95_mm is None else decimal(p95_mm, _decimals_of(design.numbers))
        verdict = f"{_MARK[design.verdict]} {design.verdict}"
        basis = name_basis(design.basis) + (f", {design.trials:,} trials" if design.trials is not None else "")
        lines.append(f"| {escape_markdown(design.file)} | {verdict} | {largest} | {basis} |")
    if any(design.numbers for design in record.designs):
        lines += ["", "### Requirements", "", *_write_markdown_numbers(record)]
    if counted:
        lines += ["", "### Findings", "", *_write_markdown_findings(counted)]
    if accepted:
        lines += ["", "### Accepted by waivers", "", *_write_markdown_findings(accepted)]
    return "\n".join(lines) + "\n"


def _write_markdown_numbers(record: GateRecord) -> list[str]:
    """Each requirement at the target that is nearest to its limit, and every one that does not pass."""
    lines = [
        "| design | requirement | target | what | value, mm | limit, mm | margin, mm | status |",
        "|---|---|---|---|---:|---:|---:|---|",
    ]
    rows = [(design, *entry) for design in record.designs for entry in choose_numbers(design.numbers)]
    for design, entry, target in rows[:MOST_ROWS]:
        texts = " | ".join(escape_markdown(text) for text in (design.file, entry.requirement, target, entry.headline))
        decimals = _decimals_of(design.numbers)
        values = " | ".join((
            decimal(entry.value_mm, decimals), stated(entry.limit_mm, decimals),
            signed_decimal(entry.margin_mm, decimals),
        ))  # fmt: skip
        lines.append(f"| {texts} | {values} | {_MARK[entry.status]} {entry.status} |")
    if len(rows) > MOST_ROWS:
        lines.append(f"| | | | {len(rows) - MOST_ROWS} more are in the record | | | | |")
    return lines


def escape_markdown(text: str) -> str:
    """Text that Markdown shows as it stands, on one line."""
    return _MARKUP.sub(r"\\\1", visible(" ".join(text.split())))


def _write_markdown_findings(findings: list[GateFinding]) -> list[str]:
    lines = ["| | rule | place | finding |", "|---|---|---|---|"]
    for finding in findings[:MOST_ROWS]:
        message = escape_markdown(finding.message)
        if finding.suppressed_by is not None:
            message += f"<br>accepted by {escape_markdown(finding.suppressed_by)}"
        lines.append(f"| {finding.severity} | {finding.rule} | {escape_markdown(name_place(finding))} | {message} |")
    if len(findings) > MOST_ROWS:
        lines.append(f"| | | | {len(findings) - MOST_ROWS} more are in the record |")
    return lines

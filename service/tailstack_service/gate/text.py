"""A gate for people: as text for a terminal, and as Markdown for a summary in a pipeline or a comment.

Places are named as compilers name them.  What comes from documents cannot become markup or a command to a runner.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from tailstack.results.tables import Cell, Column, On, Table, write_cell
from tailstack.results.verdicts import MISSED, name_basis, rest_of

from ..rendering.text import (
    current,
    group_alike,
    list_others,
    name_field,
    name_rule,
    paint,
    visible,
    wrap,
    write_on,
    write_table,
)
from .records import (
    WORST_FIRST,
    GateFinding,
    GateRecord,
    choose_numbers,
    counts,
    designs_table,
    findings_table,
    name_place,
    numbers_table,
    split_findings,
)

_MARKUP = re.compile(r"([\\`*_{}\[\]<>()#+!|~$@&])")
_COMMAND = re.compile(r"(?m)^([ \t]*)(?=::|##\[)")
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
            groups = group_alike(findings, _name_group)
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
    lines = [
        ", ".join(filter(None, (f"{visible(design.file)}: {design.verdict}", rest_of(design.assumed))))
        for design in designs[:MOST_TOLD]
    ]
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


def _list_designs(record: GateRecord) -> str:
    blocks = []
    for design in record.designs:
        basis = "" if design.basis == "none" else name_basis(design.basis)
        basis += f", {MISSED}" if any(number.missed for number in design.numbers) else ""
        basis += f", {design.trials:,} trials" if design.trials is not None else ""
        kind = f" [{design.design_class}]" if design.design_class else ""
        verdict = paint(design.verdict, _ROLE.get(design.verdict, "fail"))
        name = f" ({visible(design.name)})" if design.name else ""
        rates = [number.error_rate for number in design.numbers if number.error_rate is not None]
        basis += f"; each status wrong with a probability of at most {100 * max(rates):.3g} %" if rates else ""
        rests = f", {rest_of(design.assumed)}" if design.assumed else ""
        line = f"{visible(design.file)}{name}{kind}: {design.verdict}{rests}" + (f" ({basis})" if basis else "")
        # the verdict is painted once the line is laid out, for colours take no room
        blocks.append(wrap(line, first="", indent="  ").replace(f": {design.verdict}", f": {verdict}", 1))
        if design.numbers:
            with write_on(replace(current(), width=current().width - 2)):
                lines = write_table(numbers_table(choose_numbers(design))).splitlines()
            blocks.append("\n".join(f"  {line}".rstrip() for line in lines))
    return "\n".join(blocks)


def _name_group(finding: GateFinding) -> tuple[str, ...] | None:
    """What findings share that are written as one; None of a finding with a number of its own."""
    if finding.value is not None or finding.suppressed_by is not None:
        return None
    rule_text = name_rule(finding.message.partition(" — ")[0])
    return (finding.file, finding.rule, finding.severity, rule_text, name_field(finding.pointer))


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
    ]
    judged = [row for design in record.designs for row in choose_numbers(design)]
    lines += [*_write_markdown(designs_table(record), len(record.designs)), ""]
    for title, table in (
        ("Requirements", numbers_table(judged)),
        ("Findings", findings_table("", "", counted)),
        ("Accepted by waivers", findings_table("", "", accepted)),
    ):
        if table.rows:
            lines += [f"### {title}", "", *_write_markdown(table, MOST_ROWS), ""]
    return "\n".join(lines)


def _write_markdown(table: Table, most: int) -> Iterator[str]:
    """The table as GitHub and GitLab read it, so many rows of it."""
    table = table.on(On.NOTEBOOK)
    heads = (f"{column.title}, {column.unit}" if column.unit else column.title for column in table.columns)
    yield f"| {' | '.join(heads)} |"
    yield f"|{'|'.join('---:' if column.numeric else '---' for column in table.columns)}|"
    for row in table.rows[:most]:
        cells = zip(row.cells, table.columns, strict=True)
        yield f"| {' | '.join(_write_markdown_cell(cell, column) for cell, column in cells)} |"
    if len(table.rows) > most:
        yield f"| {len(table.rows) - most} more are in the record |{' |' * (len(table.columns) - 1)}"


def _write_markdown_cell(cell: Cell, column: Column) -> str:
    text = write_cell(cell, column)
    if column.kind == "status":
        return f"{_MARK[text]} {text}" if text in _MARK else text
    return text if column.numeric else escape_markdown(text)


def escape_markdown(text: str) -> str:
    """Text that Markdown shows as it stands, on one line."""
    return _MARKUP.sub(r"\\\1", visible(" ".join(text.split())))

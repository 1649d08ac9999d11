"""The chapters of a comparison of two designs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from tailstack.results import Score, TargetEstimate, TargetScore
from tailstack.results.digits import in_percent, length, signed_decimal
from tailstack.results.score import single_lines, source_name
from tailstack.results.tables import Cell, Column, On, Row, Table, tabulate
from tailstack.results.verdicts import (
    MARGIN_NOTE,
    P95,
    Judged,
    check_columns,
    checks_table,
    decided_by,
    findings_table,
    name_basis,
)

from ...rendering.blocks import Block, Bullets, Document, Facts, Figure, KeyNumber, Listing, Paragraph, Section, tone_of
from ..charts import Scaled, draw_budgets, draw_errors, draw_scale, draw_tolerances
from ..dots import draw_dots, say_misses
from ..half_widths import judgement_of, tolerance_curves
from ..headline import comparison_decimals, decided_difference, difference_decimals, tightest_check
from ..records import Comparison, Difference, Report
from .layout import layout_blocks, load_inside
from .optimisation import design_listing
from .report import method_chapter
from .review import review_sections
from .tables import closing_sections

COLUMNS = ("First", "Second")
DESIGNS = ("first design", "second design")


def _name_both(comparison: Comparison) -> tuple[str, str]:
    """What each is called within a sentence."""
    return comparison.names or DESIGNS


def _the(called: str) -> str:
    return f"the {called}" if called in DESIGNS else called


def _begin(words: str) -> str:
    """Where a sentence begins with it; names stay as they were given."""
    return words[:1].upper() + words[1:] if words.endswith(DESIGNS) else words


def comparison_document(comparison: Comparison, sha256: str) -> Document:
    """What sets two designs apart, then each by itself as far as the comparison rests on it."""
    first, second = comparison.first, comparison.second
    reports = tuple(zip(_name_both(comparison), (first, second), strict=True))
    sections = [
        Section("The difference", _difference_blocks(comparison)),
        Section("What changed in the document", _change_blocks(comparison)),
        Section("Both layouts", _layouts(comparison)),
        Section("Budgets side by side", tuple(_budgets(comparison))),
        Section("Requirements and findings", _verdict_blocks(comparison)),
        *review_sections(second.design),
        Section("Method and assumptions", _method(comparison), reader="auditor"),
        *closing_sections(second.provenance, *_reproduction(second), design=second.design),
    ]
    for which, report in reports:
        listing = design_listing(report.design, f"{_begin(which)}, as YAML")
        sections.append(Section(_begin(_the(which)), (listing,), reader="auditor"))
    return Document(
        kind="Comparison of two designs",
        title=comparison.title,
        tone=tone_of(comparison.headline.status),
        status=f"{comparison.names[1] if comparison.names else 'second'}: {comparison.headline.status}",
        sentence=comparison.headline.sentence,
        numbers=_numbers(comparison),
        matters=comparison.headline.matters,
        figures=tuple(_scales(comparison)),
        requirements=_requirements(comparison),
        sections=tuple(sections),
        provenance=_provenance(comparison, sha256),
        made=second.provenance,
    )


def _numbers(comparison: Comparison) -> tuple[KeyNumber, ...]:
    worst = decided_difference(comparison.second, comparison.differences)
    decimals = comparison_decimals(comparison.first, comparison.second)
    quantiles = [
        KeyNumber(
            f"P95, {which}",
            f"{length(value, decimals)} mm",
            f"target {worst.target}, {name_basis(worst.basis)}",
        )
        for which, value in zip(_name_both(comparison), (worst.first_p95_mm, worst.second_p95_mm), strict=True)
    ]
    fine = difference_decimals(worst, decimals)
    size = f"{_with_sign(worst.difference_mm, fine)} mm"
    return (*quantiles, KeyNumber("Difference", size, _ends(worst, fine)))


def _ends(difference: Difference, decimals: int) -> str:
    if difference.interval_mm is None or difference.confidence is None:
        return "estimate"
    low, high = (_with_sign(end, decimals) for end in difference.interval_mm)
    return f"{low} to {high} mm, {in_percent(difference.confidence)}"


def _with_sign(value: float, decimals: int) -> str:
    return signed_decimal(value, decimals).replace("-", "−")


def _scales(comparison: Comparison) -> Iterator[Figure]:
    """P95 of both designs at the target of the headline, on scales that are alike."""
    worst = decided_difference(comparison.second, comparison.differences)
    drawn = [_at(report, worst.target) for report in (comparison.first, comparison.second)]
    decimals = comparison_decimals(comparison.first, comparison.second)
    reach = max(value for target, limit in drawn for value in (_upper(target), target.cvar95_mm, limit or 0.0))
    for place, which, (target, limit) in zip(COLUMNS, _name_both(comparison), drawn, strict=True):
        name = f"headline-{place.lower()}"
        beside = (("mean", target.mean_norm_mm), ("CVaR95", target.cvar95_mm))
        ends = target.p95_interval_mm if isinstance(target, TargetEstimate) else (target.p95_mm, target.p95_mm)
        shown = Scaled(worst.target, target.p95_mm, ends, limit, beside, decimals=decimals, reach_mm=reach)
        svg = draw_scale(shown, name)
        bar = "the bar is the interval" if isinstance(target, TargetEstimate) else "by estimate"
        yield Figure(name, svg, f"{_begin(which)}. Size of the error at the tool, target {worst.target}: {bar}.")


def _at(report: Report, name: str) -> tuple[TargetScore | TargetEstimate, float | None]:
    """What is known of a target, and the limit that its P95 is held against."""
    judged = report.verification or report.score
    limits = [
        check.limit
        for check in judged.verdict.checks
        if (check.target, check.error, check.risk, check.quantile, check.statistic)
        == (name, "tcp", "pooled", P95, "quantile")
    ]
    target: TargetScore | TargetEstimate = next(entry for entry in judged.targets if entry.name == name)
    return target, min(limits, default=None)


def _upper(target: TargetScore | TargetEstimate) -> float:
    return target.p95_interval_mm[1] if isinstance(target, TargetEstimate) else target.p95_mm


def _requirements(comparison: Comparison) -> Table | None:
    """Each requirement of both designs, at the target that decides it; what the second fails first."""
    names = comparison.names or COLUMNS
    judged = [
        (which, check, count)
        for which, report in zip(names, (comparison.first, comparison.second), strict=True)
        for check, count in decided_by((report.verification or report.score).verdict.checks)
    ]
    if not judged:
        return None
    places = {check.requirement: k for k, (which, check, _) in enumerate(judged) if which == names[1]}
    judged.sort(key=lambda entry: places.get(entry[1].requirement, len(judged)))
    columns = (
        Column("Design", of=lambda row: row[0]),
        *(replace(each, of=_of_second(each.of)) for each in check_columns([check for _, check, _ in judged])),
    )
    rows = [(which, Judged(check, "", count)) for which, check, count in judged]
    return tabulate("Requirements", "Requirements of both designs", columns, rows, MARGIN_NOTE)


def _of_second(cell: Callable[[Any], Cell] | None) -> Callable[[Any], Cell] | None:
    """What a cell is of the second of a pair."""
    return None if cell is None else lambda row: cell(row[1])


def _difference_blocks(comparison: Comparison) -> tuple[Block, ...]:
    rows = [
        Row((
            entry.target, entry.first_p95_mm, entry.second_p95_mm, entry.difference_mm,
            *(entry.interval_mm or (None, None)),
            entry.difference_mm / entry.first_p95_mm if entry.first_p95_mm > 0 else None, entry.conclusion,
        ))
        for entry in comparison.differences
    ]  # fmt: skip
    decimals = comparison_decimals(comparison.first, comparison.second)
    fine = max(difference_decimals(entry, decimals) for entry in comparison.differences)
    columns = comparison.names or COLUMNS
    note = "P95 of the TCP error, second minus first: negative is better."
    if comparison.compared_trials is not None:
        note += (
            f" Both designs were drawn with the same random numbers, {_trials(comparison):,} trials each; every "
            "interval holds by itself, they are not corrected for being several."
        )
    blocks: list[Block] = [
        Table(
            "Differences",
            "P95 at the targets that both designs have",
            (
                Column("Target"), *(Column(name, "mm", "fixed", decimals) for name in columns),
                Column("Difference", "mm", "fixed", fine), Column("From", "mm", "fixed", fine),
                Column("To", "mm", "fixed", fine), Column("Of the first", "%", "percent", 1),
                Column(f"{columns[1]} is"),
            ),
            tuple(rows),
            note,
        )
    ]  # fmt: skip
    alone = [
        f"Only {_the(which)} has {', '.join(names)}."
        for which, names in zip(_name_both(comparison), (comparison.only_first, comparison.only_second), strict=True)
        if names
    ]
    shared = {target.name for target in comparison.first.score.targets} & {
        t.name for t in comparison.second.score.targets
    }
    if len(shared) > len(comparison.differences):
        alone.append(f"Compared are the {len(comparison.differences)} targets with the largest P95 of {len(shared)}.")
    return (*blocks, *((Bullets(tuple(alone)),) if alone else ()), *_shots(comparison), *_errors(comparison))


def _shots(comparison: Comparison) -> Iterator[Figure]:
    """Fifty shots of what decides each design on one scale; on two where their units differ."""
    both = [
        (f"{_begin(which)}, {shots.of}: {say_misses(shots)}", shots)
        for which, report in zip(_name_both(comparison), (comparison.first, comparison.second), strict=True)
        if (shots := report.score.fifty_shots) is not None
    ]
    for k, unit in enumerate(dict.fromkeys(shots.unit for _, shots in both)):
        name, alike = f"fifty-shots-{k + 1}", [row for row in both if row[1].unit == unit]
        yield Figure(name, draw_dots(alike, name), "Fifty shots that stand for all, by estimate, of what decides each.")


def _errors(comparison: Comparison) -> Iterator[Figure]:
    """Both errors over one another, at the targets that both reports draw."""
    drawn = [
        {shown.target: shown for shown in report.distributions} for report in (comparison.first, comparison.second)
    ]
    limits = {target.name: target.limit_mm for target in comparison.second.score.targets}
    for k, entry in enumerate(comparison.differences):
        if entry.target in drawn[0] and entry.target in drawn[1]:
            name = f"errors-{k + 1}"
            svg = draw_errors(
                drawn[0][entry.target], drawn[1][entry.target], (entry.first_p95_mm, entry.second_p95_mm),
                limits[entry.target], _name_both(comparison), name,
                comparison_decimals(comparison.first, comparison.second),
            )  # fmt: skip
            yield Figure(name, svg, f"Target {entry.target}: size of the error at the tool, both designs.")


def _change_blocks(comparison: Comparison) -> tuple[Block, ...]:
    if not comparison.changes:
        return (Paragraph("Nothing: the two documents say the same."),)
    rows = [
        Row((entry.name, entry.unit, _show_value(entry.first), _show_value(entry.second), entry.kind, entry.pointer))
        for entry in comparison.changes
    ]
    columns = (
        Column("Field"), Column("Unit"), *map(Column, comparison.names or COLUMNS), Column("What"),
        Column("Pointer", on=On.SHEET),
    )  # fmt: skip
    note = "Elements of lists are told by their names or labels. Defaults that were not written out are compared too."
    if comparison.changes_left_out:
        note += f" {comparison.changes_left_out:,} more differ and are left out."
    return (Table("Changes", "Fields of the design document that differ", columns, tuple(rows), note),)


def _show_value(value: str | None) -> Cell:
    """What a document says, as JSON: a number is one, and what is not there is a dash."""
    if value is None:
        return "–"
    try:
        return float(value)
    except ValueError:
        return value


def _layouts(comparison: Comparison) -> tuple[Block, ...]:
    first, second = comparison.first, comparison.second
    return layout_blocks(
        (second.design, second.score), f"{second.title}: {' over '.join(reversed(_name_both(comparison)))}", "layout",
        (first.design, first.score), _name_both(comparison)[0],
    )  # fmt: skip


def _budgets(comparison: Comparison) -> Iterator[Block]:
    decimals = comparison_decimals(comparison.first, comparison.second)
    for k, difference in enumerate(comparison.differences[:3]):
        a, b = (
            next(entry for entry in report.score.targets if entry.name == difference.target)
            for report in (comparison.first, comparison.second)
        )
        name = f"budgets-{k + 1}"
        svg = draw_budgets(a, b, _name_both(comparison), name, decimals)
        yield Figure(name, svg, f"Target {difference.target}: what each source adds to the spread, by estimate.")
        yield _budget_table(comparison.first.score, comparison.second.score, difference.target, k, decimals)

    yield from _curves(comparison, decided_difference(comparison.second, comparison.differences).target)


def _curves(comparison: Comparison, target: str) -> Iterator[Figure]:
    """The quantile that the second design is judged by, over each half-width, for both."""
    check = tightest_check(comparison.second.score.verdict.checks, target)
    first, second = (
        tolerance_curves(load_inside(e.design), target, judgement_of(check))
        for e in (comparison.first, comparison.second)
    )
    if second.curves:
        svg = draw_tolerances(
            second,
            "tolerances",
            first,
            (_name_both(comparison)[1], _name_both(comparison)[0]),
            comparison_decimals(comparison.first, comparison.second),
        )
        yield Figure("tolerances", svg, f"Target {target}: the estimated error over each half-width, both designs.")


def _budget_table(first: Score, second: Score, target: str, place: int, decimals: int) -> Table:
    a, b = (next(entry for entry in score.targets if entry.name == target) for score in (first, second))
    before, after = ({(e.name, e.component): e for e in single_lines(each.contributors)} for each in (a, b))
    spreads = [sum(entry.covariance_mm2[k][k] for k in range(3)) for entry in (a, b)]
    rows = []
    for key in [*after, *(key for key in before if key not in after)]:
        pair = (before.get(key), after.get(key))
        label = source_name(after.get(key) or before[key])
        unit = next((line.unit for line in pair if line is not None and line.unit), "")
        cells: list[Cell] = [label, unit]
        cells += [None if line is None else line.half_width for line in pair]
        cells += [
            None if line is None else (line.variance_share * total) ** 0.5
            for line, total in zip(pair, spreads, strict=True)
        ]
        cells += [None if line is None else line.variance_share for line in pair]
        cells += [None if line is None else line.p95_without_mm for line in pair]
        rows.append(Row(tuple(cells)))
    return Table(
        "Budgets" if place == 0 else f"Budgets {place + 1}",
        f"Budgets at target {target}, by estimate",
        (
            Column("Contributor"), Column("Unit"),
            Column("Half-width, first", "unit", "significant"), Column("Half-width, second", "unit", "significant"),
            Column("Std, first", "mm", "fixed", decimals), Column("Std, second", "mm", "fixed", decimals),
            Column("Share, first", "%", "percent", 1), Column("Share, second", "%", "percent", 1),
            Column("P95 without, first", "mm", "fixed", decimals),
            Column("P95 without, second", "mm", "fixed", decimals),
        ),
        tuple(rows),
        "Std: of the error at the target from this source alone, all three axes together. Shares are of each design's "
        "own variance.",
    )  # fmt: skip


def _verdict_blocks(comparison: Comparison) -> tuple[Block, ...]:
    blocks: list[Block] = []
    for place, which, report in zip(
        COLUMNS, _name_both(comparison), (comparison.first, comparison.second), strict=True
    ):
        verdict = (report.verification or report.score).verdict
        if verdict.checks:
            blocks.append(checks_table(verdict, name=f"Checks, {place.lower()}", of=f" of {_the(which)}"))
        if verdict.findings:
            blocks.append(findings_table(verdict.findings, name=f"Findings, {place.lower()}", of=f" on {_the(which)}"))
    return tuple(blocks) or (Paragraph("Neither design states a requirement, and nothing was found."),)


def _method(comparison: Comparison) -> tuple[Block, ...]:
    paired = "Nothing was drawn: differences are to first order and have no interval."
    if comparison.compared_trials is not None:
        paired = (
            f"Trial k of both designs has the same random numbers. {_compared_trials(comparison)} are cut into "
            f"{comparison.sections} sections; the spread of the sections' differences about the difference of all "
            "gives the interval (Student's t). That holds however the two samples depend on each other; designs with "
            "other numbers of fiducials or shots share less, and their interval is wider."
        )
    elif comparison.first.verification is not None:
        paired = "Too few trials were drawn for an interval of the difference: differences are to first order."
    blocks: list[Block] = [Bullets((paired,))]
    for which, report in zip(_name_both(comparison), (comparison.first, comparison.second), strict=True):
        blocks.append(Paragraph(f"{_begin(which)}:"))
        blocks += method_chapter(report)
    return tuple(blocks)


def _trials(comparison: Comparison) -> int:
    """Of each design's check."""
    return (
        comparison.compared_trials or 0
        if comparison.second.verification is None
        else comparison.second.verification.trials
    )


def _compared_trials(comparison: Comparison) -> str:
    count, drawn = comparison.compared_trials or 0, _trials(comparison)
    if drawn - count < (comparison.sections or 1):
        return f"The {count:,} trials"
    return f"P95 is that of all {drawn:,}; the first {count:,}, whose interval is wider than all would give,"


def _reproduction(second: Report) -> tuple[Block, ...]:
    words = (
        "The first command finds in this file all it needs. first.yaml and second.yaml are the designs below. The same "
        "version of tailstack gives the same digits, whatever the number of threads, workers or machines."
    )
    return (Listing("\n".join(second.reproduction.commands), "Commands"), Paragraph(words))


def _provenance(comparison: Comparison, sha256: str) -> Facts:
    pairs = []
    for which, report in zip(_name_both(comparison), (comparison.first, comparison.second), strict=True):
        pairs.append((_begin(which), report.title))
        pairs.append((f"SHA-256 of {_the(which)}", report.provenance.design_sha256 or "not known"))
    made = comparison.second
    seed = [] if made.reproduction.seed is None else [("Seed of both", str(made.reproduction.seed))]
    return Facts(
        "Provenance",
        (
            *pairs, *seed, ("SHA-256 of this record", sha256), ("Record", comparison.schema),
            ("Computed by", f"tailstack {made.provenance.tailstack_version}"),
        ),
    )  # fmt: skip

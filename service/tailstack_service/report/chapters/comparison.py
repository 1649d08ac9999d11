"""The chapters of a comparison of two designs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

from tailstack.results import TargetScore, Verdict
from tailstack.results.digits import in_percent, length, signed_decimal
from tailstack.results.score import single_lines, source_name
from tailstack.results.tables import Cell, Column, On, Row, Table, tabulate
from tailstack.results.verdicts import (
    MARGIN_NOTE,
    Judged,
    check_columns,
    checks_table,
    decided_by,
    findings_table,
    name_basis,
)

from ...rendering.document import (
    Block,
    Bullets,
    Document,
    Facts,
    Figure,
    KeyNumber,
    Listing,
    Paragraph,
    Section,
    closing_sections,
    tone_of,
)
from ..charts import draw_budgets, draw_dots, draw_errors
from ..records import Comparison, Difference, Report, comparison_decimals, decided_difference, difference_decimals
from .layout import layout_blocks
from .optimisation import design_listing
from .report import method_chapter, review_section
from .score import say_misses

COLUMNS = ("First", "Second")
DESIGNS = ("first design", "second design")


class _Side(NamedTuple):
    """One of the two designs."""

    place: str  # First, Second
    called: str  # within a sentence
    column: str  # above its numbers
    report: Report

    @property
    def the(self) -> str:
        """What it is called, with an article where that is no name."""
        return f"the {self.called}" if self.called in DESIGNS else self.called

    @property
    def verdict(self) -> Verdict:
        """That of its check, where it was drawn."""
        return (self.report.verification or self.report.score).verdict

    def target(self, name: str) -> TargetScore:
        return next(target for target in self.report.score.targets if target.name == name)


Sides = tuple[_Side, _Side]


def _sides_of(comparison: Comparison) -> Sides:
    called, columns = comparison.names or DESIGNS, comparison.names or COLUMNS
    first, second = map(_Side, COLUMNS, called, columns, (comparison.first, comparison.second))
    return first, second


def _begin(words: str) -> str:
    """Where a sentence begins with it; names stay as they were given."""
    return words[:1].upper() + words[1:] if words.endswith(DESIGNS) else words


def comparison_document(comparison: Comparison, sha256: str) -> Document:
    """What sets two designs apart, then each by itself as far as the comparison rests on it."""
    sides, second = _sides_of(comparison), comparison.second
    errors = tuple(_errors(comparison, sides))
    sections = [
        Section("The difference", (*_difference_blocks(comparison, sides), *_shots(sides), *errors[1:])),
        Section("What changed in the document", _change_blocks(comparison, sides)),
        Section("Both layouts", _layouts(*sides)),
        Section("Budgets side by side", tuple(_budgets(comparison, sides))),
        Section("Requirements and findings", _verdict_blocks(sides)),
        review_section(second.design),
        Section("Method and assumptions", _method(comparison, sides), reader="auditor"),
        *closing_sections(second.provenance, *_reproduction(second), design=second.design),
    ]
    for side in sides:
        listing = design_listing(side.report.design, f"{_begin(side.called)}, as YAML")
        sections.append(Section(_begin(side.the), (listing,), reader="auditor"))
    return Document(
        kind="Comparison of two designs",
        title=comparison.title,
        tone=tone_of(comparison.headline.status),
        status=f"{comparison.names[1] if comparison.names else 'second'}: {comparison.headline.status}",
        sentence=comparison.headline.sentence,
        numbers=tuple(_numbers(comparison, sides)),
        matters=comparison.headline.matters,
        figures=errors[:1],
        requirements=_requirements(sides),
        sections=tuple(sections),
        provenance=_provenance(comparison, sides, sha256),
        made=second.provenance,
    )


def _decimals(comparison: Comparison) -> int:
    return comparison_decimals(comparison.first, comparison.second)


def _numbers(comparison: Comparison, sides: Sides) -> Iterator[KeyNumber]:
    worst, decimals = decided_difference(comparison.second, comparison.differences), _decimals(comparison)
    for side, value in zip(sides, (worst.first_p95_mm, worst.second_p95_mm), strict=True):
        what = f"target {worst.target}, {name_basis(worst.basis)}"
        yield KeyNumber(f"P95, {side.called}", f"{length(value, decimals)} mm", what)
    fine = difference_decimals(worst, decimals)
    values = (worst.difference_mm, *(worst.interval_mm or ()))
    size, *ends = (signed_decimal(value, fine).replace("-", "−") for value in values)
    within = f"{' to '.join(ends)} mm, {in_percent(worst.confidence)}" if worst.confidence else "estimate"
    yield KeyNumber("Difference", f"{size} mm", within)


def _requirements(sides: Sides) -> Table | None:
    """Each requirement of both designs, at the target that decides it; what the second fails first."""
    judged = [(side.column, check, count) for side in sides for check, count in decided_by(side.verdict.checks)]
    if not judged:
        return None
    places = {check.requirement: k for k, (which, check, _) in enumerate(judged) if which == sides[1].column}
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


def _difference_blocks(comparison: Comparison, sides: Sides) -> Iterator[Block]:
    decimals = _decimals(comparison)
    fine = max(difference_decimals(entry, decimals) for entry in comparison.differences)
    note = "P95 of the TCP error, second minus first: negative is better."
    if comparison.compared_trials is not None:
        note += (
            f" Both designs were drawn with the same random numbers, {_trials(comparison):,} trials each; every "
            "interval holds by itself, they are not corrected for being several."
        )
    columns = (
        Column("Target", of=lambda entry: entry.target),
        Column(sides[0].column, "mm", "fixed", decimals, of=lambda entry: entry.first_p95_mm),
        Column(sides[1].column, "mm", "fixed", decimals, of=lambda entry: entry.second_p95_mm),
        Column("Difference", "mm", "fixed", fine, of=lambda entry: entry.difference_mm),
        Column("From", "mm", "fixed", fine, of=lambda entry: entry.interval_mm and entry.interval_mm[0]),
        Column("To", "mm", "fixed", fine, of=lambda entry: entry.interval_mm and entry.interval_mm[1]),
        Column("Of the first", "%", "percent", 1, of=_share_of_first),
        Column(f"{sides[1].column} is", of=lambda entry: entry.conclusion),
    )
    caption = "P95 at the targets that both designs have"
    yield tabulate("Differences", caption, columns, comparison.differences, note)
    pairs = zip(sides, (comparison.only_first, comparison.only_second), strict=True)
    alone = [f"Only {side.the} has {', '.join(names)}." for side, names in pairs if names]
    named = [{target.name for target in side.report.score.targets} for side in sides]
    shared = len(named[0] & named[1])
    if shared > len(comparison.differences):
        alone.append(f"Compared are the {len(comparison.differences)} targets with the largest P95 of {shared}.")
    if alone:
        yield Bullets(tuple(alone))


def _share_of_first(entry: Difference) -> float | None:
    return entry.difference_mm / entry.first_p95_mm if entry.first_p95_mm > 0 else None


def _shots(sides: Sides) -> Iterator[Figure]:
    """Fifty shots of what decides each design on one scale; on two where their units differ."""
    both = [
        (f"{_begin(side.called)}, {shots.of}: {say_misses(shots)}", shots)
        for side in sides
        if (shots := side.report.score.fifty_shots) is not None
    ]
    for k, unit in enumerate(dict.fromkeys(shots.unit for _, shots in both)):
        name, alike = f"fifty-shots-{k + 1}", [row for row in both if row[1].unit == unit]
        yield Figure(name, draw_dots(alike, name), "Fifty shots that stand for all, by estimate, of what decides each.")


def _errors(comparison: Comparison, sides: Sides) -> Iterator[Figure]:
    """Both errors over one another at the targets that both reports draw, first where the second design is judged."""
    drawn = [{shown.target: shown for shown in side.report.distributions} for side in sides]
    decides = decided_difference(comparison.second, comparison.differences)
    for k, entry in enumerate(sorted(comparison.differences, key=lambda entry: entry is not decides)):
        if entry.target in drawn[0] and entry.target in drawn[1]:
            name = f"errors-{k + 1}"
            svg = draw_errors(
                drawn[0][entry.target], drawn[1][entry.target], (entry.first_p95_mm, entry.second_p95_mm),
                sides[1].target(entry.target).limit_mm, (sides[0].called, sides[1].called), name, _decimals(comparison),
            )  # fmt: skip
            yield Figure(name, svg, f"Target {entry.target}: size of the error at the tool, both designs.")


def _change_blocks(comparison: Comparison, sides: Sides) -> tuple[Block, ...]:
    if not comparison.changes:
        return (Paragraph("Nothing: the two documents say the same."),)
    columns = (
        Column("Field", of=lambda change: change.name),
        Column("Unit", of=lambda change: change.unit),
        Column(sides[0].column, of=lambda change: _show_value(change.first)),
        Column(sides[1].column, of=lambda change: _show_value(change.second)),
        Column("What", of=lambda change: change.kind),
        Column("Pointer", on=On.SHEET, of=lambda change: change.pointer),
    )
    note = "Elements of lists are told by their names or labels. Defaults that were not written out are compared too."
    if comparison.changes_left_out:
        note += f" {comparison.changes_left_out:,} more differ and are left out."
    return (tabulate("Changes", "Fields of the design document that differ", columns, comparison.changes, note),)


def _show_value(value: str | None) -> Cell:
    """What a document says, as JSON: a number is one, and what is not there is a dash."""
    if value is None:
        return "–"
    try:
        return float(value)
    except ValueError:
        return value


def _layouts(first: _Side, second: _Side) -> tuple[Block, ...]:
    now, before = ((side.report.design, side.report.score) for side in (second, first))
    title = f"{second.report.title}: {second.called} over {first.called}"
    return layout_blocks(now, title, "layout", before, first.called)


def _budgets(comparison: Comparison, sides: Sides) -> Iterator[Block]:
    decimals, called = _decimals(comparison), (sides[0].called, sides[1].called)
    for k, difference in enumerate(comparison.differences[:3], 1):
        first, second = (side.target(difference.target) for side in sides)
        svg = draw_budgets(first, second, called, f"budgets-{k}", decimals)
        caption = f"Target {difference.target}: what each source adds to the spread, by estimate."
        yield Figure(f"budgets-{k}", svg, caption)
        yield _budget_table(first, second, "Budgets" if k == 1 else f"Budgets {k}", decimals)


def _budget_table(first: TargetScore, second: TargetScore, name: str, decimals: int) -> Table:
    """Both budgets of a target, line by line; a line that only one of them has is there too."""
    before, after = ({(e.name, e.component): e for e in single_lines(each.contributors)} for each in (first, second))
    totals = [sum(target.covariance_mm2[k][k] for k in range(3)) for target in (first, second)]
    rows = []
    for key in {**after, **before}:
        pair = (before.get(key), after.get(key))
        unit = next((line.unit_in_words for line in pair if line is not None and line.unit), "")
        cells: list[Cell] = [source_name(after.get(key) or before[key]), unit]
        cells += [None if line is None else line.half_width for line in pair]
        each = zip(pair, totals, strict=True)
        cells += [None if line is None else (line.variance_share * total) ** 0.5 for line, total in each]
        cells += [None if line is None else line.variance_share for line in pair]
        cells += [None if line is None else line.p95_without_mm for line in pair]
        rows.append(Row(tuple(cells)))
    which = ("first", "second")
    columns = (
        Column("Contributor"), Column("Unit"), *(Column(f"Half-width, {w}", "unit", "significant") for w in which),
        *(Column(f"Std, {w}", "mm", "fixed", decimals) for w in which),
        *(Column(f"Share, {w}", "%", "percent", 1) for w in which),
        *(Column(f"P95 without, {w}", "mm", "fixed", decimals) for w in which),
    )  # fmt: skip
    note = (
        "Std: of the error at the target from this source alone, all three axes together. Shares are of each design's "
        "own variance."
    )
    return Table(name, f"Budgets at target {second.name}, by estimate", columns, tuple(rows), note)


def _verdict_blocks(sides: Sides) -> tuple[Block, ...]:
    blocks: list[Block] = []
    for side in sides:
        place, verdict = side.place.lower(), side.verdict
        if verdict.checks:
            blocks.append(checks_table(verdict, name=f"Checks, {place}", of=f" of {side.the}"))
        if verdict.findings:
            blocks.append(findings_table(verdict.findings, name=f"Findings, {place}", of=f" on {side.the}"))
    return tuple(blocks) or (Paragraph("Neither design states a requirement, and nothing was found."),)


def _method(comparison: Comparison, sides: Sides) -> tuple[Block, ...]:
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
    for side in sides:
        blocks += [Paragraph(f"{_begin(side.called)}:"), *method_chapter(side.report)]
    return tuple(blocks)


def _trials(comparison: Comparison) -> int:
    """Of each design's check."""
    check = comparison.second.verification
    return comparison.compared_trials or 0 if check is None else check.trials


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


def _provenance(comparison: Comparison, sides: Sides, sha256: str) -> Facts:
    pairs = []
    for side in sides:
        pairs.append((_begin(side.called), side.report.title))
        pairs.append((f"SHA-256 of {side.the}", side.report.provenance.design_sha256 or "not known"))
    seed = comparison.second.reproduction.seed
    pairs += [] if seed is None else [("Seed of both", str(seed))]
    pairs += [("SHA-256 of this record", sha256), ("Record", comparison.schema)]
    pairs.append(("Computed by", f"tailstack {comparison.second.provenance.tailstack_version}"))
    return Facts("Provenance", tuple(pairs))

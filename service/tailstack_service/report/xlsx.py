"""The numbers as a spreadsheet: what was found, where it comes from, then every table; texts are never formulas.

Every sheet prints on landscape pages as wide as its columns, its header repeated.  A row states how high its texts
are: a program that opens the file does not find out.
"""

from __future__ import annotations

import io
import json
import re
import textwrap
from collections.abc import Sequence
from datetime import datetime
from math import ceil, floor, isfinite, log10
from typing import Any

import xlsxwriter

from tailstack.results.tables import Cell, Column, On, Table

from ..rendering.document import Bullets, ChangeableNumber, Document, Facts, Formula, KeyNumber, Listing

# A workbook says when it was made; a report must not, or the same result would give other bytes tomorrow.
EPOCH = datetime(2000, 1, 1)
LONGEST_TEXT = 32_000  # of a cell; the format's own limit is 32,767
NUMBER, WIDEST = 10, 60  # widths of columns, in digits
INDENT = 3  # digits that an indented text has less
LETTERS = 0.85  # of a column's width, in digits, that a line of text fills at most, also in a wider font
BOLD_LETTERS = 0.65  # the same of bold letters
LINE = 15.0  # points
READABLE = 110  # digits: the width that a caption or note takes
SHEET_TITLE = 31
A4 = 9
MOST_LINES = 20  # of a text in a cell; longer ones, such as a design document, have a sheet
FORMULA_STARTS = ("=", "+", "-", "@")


def xlsx_report(document: Document, record: bytes) -> bytes:
    """The report as XLSX: numbers as numbers with their units in the headers; the same document, the same bytes.

    record: the result's JSON, which the last sheet keeps.
    """
    document = document.of(On.SHEET)
    target = io.BytesIO()
    options = {
        "in_memory": True, "strings_to_formulas": False, "strings_to_urls": False, "strings_to_numbers": False,
        "nan_inf_to_errors": False,
    }  # fmt: skip
    with xlsxwriter.Workbook(target, options) as book:
        about = {"title": document.title[:250], "subject": document.kind, "author": "tailstack", "created": EPOCH}
        book.set_properties(about)
        formats = _Formats(book)
        _summary(book, formats, document)
        _provenance(book, formats, document)
        taken = {"summary", "provenance", "record"}
        blocks = [block for section in document.sections for block in section.blocks]
        for table in (document.requirements, *blocks):
            if isinstance(table, Table):
                _sheet(book, formats, table.on(On.SHEET), _title(table.name, taken))
        for listing in blocks:
            if isinstance(listing, Listing) and len(listing.text.splitlines()) > MOST_LINES:
                _lines(book, formats, listing, _title("Design", taken))
        _record(book, formats, record)
    return target.getvalue()


Look = dict[str, Any]
BOLD: Look = {"bold": True, "valign": "top"}
TITLE: Look = {"bold": True, "font_size": 14, "text_wrap": True, "valign": "top"}
HEAD: Look = {"bold": True, "text_wrap": True, "valign": "top", "bottom": 1, "bg_color": "#EEF2F6"}
WRAPPED: Look = {"text_wrap": True, "valign": "top"}
ENTRY: Look = {"bg_color": "#FFF4C2", "border": 1}
MONO: Look = {"font_name": "Courier New", "text_wrap": True, "valign": "top"}


class _Formats:
    """Cell formats, each made once."""

    def __init__(self, book: Any) -> None:
        self._book = book
        self._known: dict[tuple[tuple[str, Any], ...], Any] = {}

    def of(self, look: Look) -> Any:
        key = tuple(sorted(look.items()))
        if key not in self._known:
            self._known[key] = self._book.add_format(look)
        return self._known[key]


def _look_of(column: Column, cell: Cell, indent: int) -> Look:
    """How a cell of a column looks; ``indent`` is that of texts."""
    decimals = "0." + "0" * column.digits
    kind = {
        "fixed": decimals, "signed": f"+{decimals};-{decimals};0", "percent": f"{decimals}%", "whole": "#,##0",
        "significant": _significant(cell, column.digits), "stated": "General", "given": "General",
    }.get(column.kind, "@")  # fmt: skip
    if isinstance(cell, int | float) and not column.numeric:
        kind = "General"  # a number among texts, such as what a field was and is
    look: Look = {"num_format": kind, "valign": "top"} | (ENTRY if isinstance(cell, ChangeableNumber) else {})
    return look if column.numeric else look | {"align": "left", "indent": indent, "text_wrap": True}


def _significant(cell: Cell, digits: int) -> str:
    """The format that shows so many digits of a number, as the pages do; the cell keeps all that it has."""
    if cell is None or isinstance(cell, str) or cell == 0 or not isfinite(cell):
        return "General"
    decimals = digits - 1 - floor(log10(abs(cell)))
    if abs(cell) < 1e-3:
        return f"0.{'0' * (digits - 1)}E+00"
    return f"0.{'0' * decimals}" if decimals > 0 else "0"


def _open(book: Any, title: str, widths: Sequence[int], repeated: int = 0) -> Any:
    """A sheet with columns of these widths, in digits, and so many rows that stand on every printed page."""
    sheet = book.add_worksheet(title)
    for place, width in enumerate(widths):
        sheet.set_column(place, place, width)
    sheet.set_landscape()
    sheet.set_paper(A4)
    sheet.set_margins(left=0.5, right=0.5, top=0.6, bottom=0.7)
    sheet.set_footer("&L&A&R&P / &N")
    sheet.fit_to_pages(1, 0)
    if repeated:
        sheet.repeat_rows(0, repeated - 1)
    return sheet


def _height(text: str, width: float, bold: bool = False) -> float:
    """Points that a text takes in a column of this width, in digits."""
    letters = max(int(width * (BOLD_LETTERS if bold else LETTERS)), 1)
    return LINE * sum(len(textwrap.wrap(line, letters)) or 1 for line in text.split("\n"))


def _numbers(sheet: Any, formats: _Formats, row: int, numbers: Sequence[KeyNumber]) -> int:
    """Large numbers of the first page, a row each: the number, its unit beside the word; gives the row below them."""
    for place, entry in enumerate(numbers, row):
        said = WRITTEN_NUMBER.fullmatch(entry.value)
        if said is None:
            _pairs(sheet, formats, place, [(entry.label, entry.value)])
        else:
            sign, digits, unit = said.groups()
            number = float(digits.replace(",", "")) * (-1 if sign in ("-", "−") else 1)
            percent = unit == "%"
            decimals = len(digits.partition(".")[2])
            format_ = f"0.{'0' * decimals}" if decimals else "#,##0"
            _pairs(sheet, formats, place, [(f"{entry.label}, {unit}" if unit and not percent else entry.label, "")])
            look = {"num_format": f"{format_}%" if percent else format_, "align": "left", "valign": "top"}
            sheet.write_number(place, 1, number / 100 if percent else number, formats.of(look))
        _text(formats, sheet, place, 2, entry.detail, WRAPPED)
        sheet.set_row(place, max(_height(entry.label, FRONT[0], True) + LINE, _height(entry.detail, FRONT[2])))
    return row + len(numbers)


def _pairs(sheet: Any, formats: _Formats, row: int, pairs: Sequence[tuple[str, str]], look: Look = WRAPPED) -> int:
    """A word and what it is, a row each; gives the row below them."""
    larger = look.get("font_size", 11) / 11
    for place, (label, value) in enumerate(pairs, row):
        _text(formats, sheet, place, 0, label, look if look is TITLE else BOLD | WRAPPED)
        _text(formats, sheet, place, 1, value, look)
        height = max(_height(label, FRONT[0] / larger, True), _height(value, FRONT[1] / larger, "bold" in look))
        sheet.set_row(place, larger * height)
    return row + len(pairs)


def _paragraph(sheet: Any, formats: _Formats, row: int, text: str, look: Look, widths: Sequence[int]) -> None:
    """A text across as many columns as make it readable."""
    span, width = 0, 0.0
    while width < READABLE:
        width += widths[span] if span < len(widths) else UNSET
        span += 1
    if span > 1:
        sheet.merge_range(row, 0, row, span - 1, "", formats.of(look | WRAPPED))
    _text(formats, sheet, row, 0, text, look | WRAPPED)
    sheet.set_row(row, _height(text, width, "bold" in look))


FRONT = (30, 100, 60)
WRITTEN_NUMBER = re.compile(r"([-+−])?([0-9][0-9,]*(?:\.[0-9]+)?)(?: (mm|px|deg|%))?")
UNSET = 8.43  # width of a column of which nothing is said


def _summary(book: Any, formats: _Formats, document: Document) -> None:
    sheet = _open(book, "Summary", FRONT)
    row = _pairs(sheet, formats, 0, [(document.kind, document.title)], TITLE)
    row = _pairs(sheet, formats, row, [("Verdict", ", ".join(filter(None, (document.status, document.rests))))], BOLD)
    row = _pairs(sheet, formats, row, document.title_block)
    row = _pairs(sheet, formats, row, [("In words", document.sentence)])
    row = _numbers(sheet, formats, row, document.numbers)
    pairs = [(f"What matters, {k}", sentence) for k, sentence in enumerate(document.matters, 1)]
    _pairs(sheet, formats, row, pairs)


def _provenance(book: Any, formats: _Formats, document: Document) -> None:
    """Hashes and versions, then what the sections say in words."""
    sheet = _open(book, "Provenance", FRONT)
    row = _pairs(sheet, formats, 0, document.provenance.pairs)
    for section in document.sections:
        for block in section.blocks:
            pairs: list[tuple[str, str]] = []
            if isinstance(block, Facts):
                pairs = list(block.pairs)
            elif isinstance(block, Bullets):
                pairs = [(section.title if k == 0 else "", item) for k, item in enumerate(block.items)]
            elif isinstance(block, Listing) and len(block.text.splitlines()) <= MOST_LINES:
                pairs = [(block.caption or section.title, block.text)]
            if pairs:
                row = _pairs(sheet, formats, row + 1, pairs)


def _sheet(book: Any, formats: _Formats, table: Table, title: str) -> None:
    # a percent format says its unit itself
    heads = [f"{c.title}, {c.unit}" if c.unit and c.kind != "percent" else c.title for c in table.columns]
    widths = []
    for place, (head, column) in enumerate(zip(heads, table.columns, strict=True)):
        if column.numeric:
            widths.append(max(NUMBER, 1 + ceil(max(map(len, head.split()), default=0) / BOLD_LETTERS)))
        else:
            longest = max((len(str(row.cells[place] or "")) for row in table.rows), default=0)
            widths.append(min(ceil(max(longest / LETTERS, len(head) / BOLD_LETTERS)) + INDENT, WIDEST))
    sheet = _open(book, title, widths, repeated=2)
    _paragraph(sheet, formats, 0, table.caption, BOLD, widths)
    for place, column in enumerate(table.columns):
        aligned = {"align": "right"} if column.numeric else {"align": "left", "indent": min(place, 1)}
        _text(formats, sheet, 1, place, heads[place], HEAD | aligned)
    height = max(_height(head, width * BOLD_LETTERS / LETTERS) for head, width in zip(heads, widths, strict=True))
    sheet.set_row(1, height)
    for index, row in enumerate(table.rows, 2):
        for place, (cell, column) in enumerate(zip(row.cells, table.columns, strict=True)):
            _cell(formats, sheet, index, place, cell, _look_of(column, cell, min(place, 1) or row.depth))
        texts = [(cell, width) for cell, width in zip(row.cells, widths, strict=True) if isinstance(cell, str)]
        sheet.set_row(index, max([LINE, *(_height(text, width - INDENT) for text, width in texts)]))
    if table.note:
        _paragraph(sheet, formats, len(table.rows) + 3, table.note, {}, widths)
    sheet.freeze_panes(2, 1)


def _lines(book: Any, formats: _Formats, listing: Listing, title: str) -> None:
    """A text line by line: one cell could not hold it."""
    sheet = _open(book, title, [READABLE], repeated=1)
    _paragraph(sheet, formats, 0, listing.caption, BOLD, [READABLE])
    for index, line in enumerate(listing.text.splitlines(), 1):
        _text(formats, sheet, index, 0, line, MONO)
        sheet.set_row(index, _height(line, READABLE))


def _record(book: Any, formats: _Formats, record: bytes) -> None:
    """The record in pieces, one below the other: what ``tailstack report --verify`` reads.  ASCII, whatever it says.

    It is for programs: of this sheet, what it says of itself is printed.
    """
    sheet = _open(book, "Record", [READABLE])
    sheet.print_area(0, 0, 0, 0)
    words = "The record of this report as JSON; the cells below, put together, are what tailstack report --verify reads"
    _paragraph(sheet, formats, 0, words, BOLD, [READABLE])
    text = json.dumps(json.loads(record), ensure_ascii=True, separators=(",", ":"))  # noqa: TID251 - cells hold ASCII
    for row, start in enumerate(range(0, len(text), LONGEST_TEXT), 1):
        sheet.write_string(row, 0, text[start : start + LONGEST_TEXT])
        sheet.set_row(row, LINE)


def _cell(formats: _Formats, sheet: Any, row: int, column: int, cell: Cell, look: Look) -> None:
    if cell is None:
        sheet.write_blank(row, column, None, formats.of(look))
    elif isinstance(cell, str):
        _text(formats, sheet, row, column, cell, look)
    elif isinstance(cell, Formula):
        sheet.write_formula(row, column, f"={cell.text.format(row=row + 1)}", formats.of(look), float(cell))
    else:
        sheet.write_number(row, column, cell, formats.of(look))


def _text(formats: _Formats, sheet: Any, row: int, column: int, text: str, look: Look) -> None:
    """A text as text, whatever it begins with: a name like =HYPERLINK(...) must not become a formula."""
    clean = "".join(c if c.isprintable() or c == "\n" else "?" for c in text)
    # marked as text also for whoever edits the cell or saves the sheet in another format
    marked = {"quote_prefix": True} if clean.lstrip()[:1] in FORMULA_STARTS else {}
    sheet.write_string(row, column, clean[:LONGEST_TEXT], formats.of(look | marked))


def _title(name: str, taken: set[str]) -> str:
    """A name that a sheet may have and no other has."""
    base = re.sub(r"[\[\]:*?/\\']", " ", name)[: SHEET_TITLE - 4].strip() or "Sheet"
    title, count = base, 2
    while title.lower() in taken:
        title, count = f"{base} {count}", count + 1
    taken.add(title.lower())
    return title

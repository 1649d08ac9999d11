"""The numbers as a spreadsheet: provenance first, then every table; texts are never formulas."""

from __future__ import annotations

import io
import json
import re
from datetime import datetime
from typing import Any

import xlsxwriter

from .blocks import Bullets, Cell, Column, Document, Facts, Listing, Table

# A workbook says when it was made; a report must not, or the same result would give other bytes tomorrow.
EPOCH = datetime(2000, 1, 1)
LONGEST_TEXT = 32_000  # of a cell; the format's own limit is 32,767
WIDEST = 60
SHEET_TITLE = 31
FORMULA_STARTS = ("=", "+", "-", "@")


def xlsx_report(document: Document, record: bytes) -> bytes:
    """The report as XLSX: numbers as numbers with their units in the headers; the same document, the same bytes.

    record: the result's JSON, which the last sheet keeps.
    """
    target = io.BytesIO()
    options = {
        "in_memory": True, "strings_to_formulas": False, "strings_to_urls": False, "strings_to_numbers": False,
        "nan_inf_to_errors": False,
    }  # fmt: skip
    with xlsxwriter.Workbook(target, options) as book:
        book.set_properties(
            {"title": document.title[:250], "subject": document.kind, "author": "tailstack", "created": EPOCH}
        )
        formats = _Formats(book)
        _front(book, formats, document)
        taken = {"provenance", "record"}
        for table in tables_of(document):
            _sheet(book, formats, table, _title(table.name, taken))
        for listing in listings_of(document):
            _lines(book, formats, listing, _title("Design", taken))
        _record(book, formats, record)
    return target.getvalue()


def tables_of(document: Document) -> list[Table]:
    """Every table of the report, in its order."""
    first = [] if document.requirements is None else [document.requirements]
    return first + [block for section in document.sections for block in section.blocks if isinstance(block, Table)]


def listings_of(document: Document) -> list[Listing]:
    """Long texts: the design document."""
    blocks = [block for section in document.sections for block in section.blocks if isinstance(block, Listing)]
    return [block for block in blocks if len(block.text.splitlines()) > 20]


class _Formats:
    """Cell formats by column, made once."""

    def __init__(self, book: Any) -> None:
        self._book = book
        self._known: dict[tuple[Any, ...], Any] = {}
        self.bold = book.add_format({"bold": True})
        self.title = book.add_format({"bold": True, "font_size": 14})
        self.head = book.add_format(
            {"bold": True, "text_wrap": True, "valign": "top", "bottom": 1, "bg_color": "#EEF2F6"}
        )
        self.wrapped = book.add_format({"text_wrap": True, "valign": "top"})
        self.quoted = book.add_format({"text_wrap": True, "valign": "top", "quote_prefix": True})
        self.mono = book.add_format({"font_name": "Courier New"})

    def of(self, column: Column, depth: int) -> Any:
        decimals = "0." + "0" * column.digits
        kind = {
            "fixed": decimals, "signed": f"+{decimals};-{decimals};0", "percent": f"{decimals}%", "whole": "#,##0",
            "significant": "General", "given": "General",
        }.get(column.kind, "@")  # fmt: skip
        key = (kind, depth, column.numeric)
        if key not in self._known:
            look: dict[str, Any] = {"num_format": kind, "valign": "top"}
            if not column.numeric:
                look |= {"indent": depth, "text_wrap": True}
            self._known[key] = self._book.add_format(look)
        return self._known[key]


def _front(book: Any, formats: _Formats, document: Document) -> None:
    sheet = book.add_worksheet("Provenance")
    sheet.set_column(0, 0, 30)
    sheet.set_column(1, 1, 100)
    row = 0
    for label, value, look in (
        (document.kind, document.title, formats.title),
        ("Verdict", document.status, formats.bold),
        ("In words", document.sentence, formats.wrapped),
    ):
        _text(formats, sheet, row, 0, label, look if look is formats.title else formats.bold)
        _text(formats, sheet, row, 1, value, look)
        row += 1
    for entry in document.numbers:
        _text(formats, sheet, row, 0, entry.label, formats.bold)
        _text(
            formats, sheet, row, 1, f"{entry.value}  ({entry.detail})" if entry.detail else entry.value, formats.wrapped
        )
        row += 1
    for index, sentence in enumerate(document.matters, 1):
        _text(formats, sheet, row, 0, f"What matters, {index}", formats.bold)
        _text(formats, sheet, row, 1, sentence, formats.wrapped)
        row += 1
    row += 1
    for label, value in document.provenance.pairs:
        _text(formats, sheet, row, 0, label, formats.bold)
        _text(formats, sheet, row, 1, value, formats.wrapped)
        row += 1
    for section in document.sections:
        for block in section.blocks:
            pairs: list[tuple[str, str]] = []
            if isinstance(block, Facts):
                pairs = list(block.pairs)
            elif isinstance(block, Bullets):
                pairs = [(section.title if k == 0 else "", item) for k, item in enumerate(block.items)]
            elif isinstance(block, Listing) and len(block.text.splitlines()) <= 20:
                pairs = [(block.caption or section.title, block.text)]
            if pairs:
                row += 1
            for label, value in pairs:
                _text(formats, sheet, row, 0, label, formats.bold)
                _text(formats, sheet, row, 1, value, formats.wrapped)
                row += 1


def _sheet(book: Any, formats: _Formats, table: Table, title: str) -> None:
    sheet = book.add_worksheet(title)
    _text(formats, sheet, 0, 0, table.caption, formats.bold)
    for place, column in enumerate(table.columns):
        unit = "" if column.kind == "percent" else column.unit  # a percent format says it itself
        _text(formats, sheet, 1, place, f"{column.title}, {unit}" if unit else column.title, formats.head)
    for index, row in enumerate(table.rows, 2):
        for place, (cell, column) in enumerate(zip(row.cells, table.columns, strict=True)):
            _cell(formats, sheet, index, place, cell, formats.of(column, row.depth if place == 0 else 0))
    for place, column in enumerate(table.columns):
        longest = max(
            [len(column.title) + len(column.unit) + 2, *(len(_shown(row.cells[place])) for row in table.rows)]
        )
        sheet.set_column(place, place, 14 if column.numeric else min(max(longest + 1, 8), WIDEST))
    if table.note:
        _text(formats, sheet, len(table.rows) + 3, 0, table.note, None)
    sheet.freeze_panes(2, 1)


def _lines(book: Any, formats: _Formats, listing: Listing, title: str) -> None:
    """A text line by line: one cell could not hold it."""
    sheet = book.add_worksheet(title)
    sheet.set_column(0, 0, 110)
    _text(formats, sheet, 0, 0, listing.caption, formats.bold)
    for index, line in enumerate(listing.text.splitlines(), 1):
        _text(formats, sheet, index, 0, line, formats.mono)


def _record(book: Any, formats: _Formats, record: bytes) -> None:
    """The record in pieces, one below the other: what ``tailstack report --verify`` reads.  ASCII, whatever it says."""
    sheet = book.add_worksheet("Record")
    sheet.set_column(0, 0, 110)
    words = "The record of this report as JSON; the cells below, put together, are what tailstack report --verify reads"
    _text(formats, sheet, 0, 0, words, formats.bold)
    text = json.dumps(json.loads(record), ensure_ascii=True, separators=(",", ":"))  # noqa: TID251 - cells hold ASCII
    for row, start in enumerate(range(0, len(text), LONGEST_TEXT), 1):
        sheet.write_string(row, 0, text[start : start + LONGEST_TEXT])


def _cell(formats: _Formats, sheet: Any, row: int, column: int, cell: Cell, look: Any) -> None:
    if cell is None:
        sheet.write_blank(row, column, None, look)
    elif isinstance(cell, str):
        _text(formats, sheet, row, column, cell, look)
    else:
        sheet.write_number(row, column, cell, look)


def _text(formats: _Formats, sheet: Any, row: int, column: int, text: str, look: Any) -> None:
    """A text as text, whatever it begins with: a name like =HYPERLINK(...) must not become a formula."""
    clean = "".join(c if c.isprintable() or c == "\n" else "?" for c in text)
    # marked as text also for whoever edits the cell or saves the sheet in another format
    look = formats.quoted if clean.lstrip()[:1] in FORMULA_STARTS else look
    sheet.write_string(row, column, clean[:LONGEST_TEXT], look)


def _shown(cell: Cell) -> str:
    return f"{cell:.5g}" if isinstance(cell, float) else str(cell or "")


def _title(name: str, taken: set[str]) -> str:
    """A name that a sheet may have and no other has."""
    base = re.sub(r"[\[\]:*?/\\']", " ", name)[: SHEET_TITLE - 4].strip() or "Sheet"
    title, count = base, 2
    while title.lower() in taken:
        title, count = f"{base} {count}", count + 1
    taken.add(title.lower())
    return title

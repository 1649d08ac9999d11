"""The chapters of a table of designs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from tailstack.results.batch import ScoredTable
from tailstack.results.tables import EVERYWHERE, LONG_TABLE, PAPER, TERMINAL, Column, Row, Table

from ...rendering.document import Bullets, Document, KeyNumber, Paragraph, Section, compose_document, group

SHOWN = 40  # rows in a terminal


def batch_document(record: ScoredTable, sha256: str) -> Document:
    """The table with its answers, row by row."""
    worst = [name for name in record.columns if name.startswith("p95_mm:")]
    p95_values = [cell for name in worst for cell in record.columns[name] if isinstance(cell, float)]
    numbers = [KeyNumber("Designs", f"{record.rows:,}", f"{record.refused:,} could not be scored")]
    sentence = f"{record.rows:,} designs, each estimated."
    if p95_values:
        low, high = f"{min(p95_values):.3f} mm", f"{max(p95_values):.3f} mm"
        sentence = f"P95 of the TCP error is between {low} and {high} in {record.rows:,} designs."
        numbers += [KeyNumber("Smallest P95", low, ""), KeyNumber("Largest P95", high, "")]
    matters: tuple[str, ...] = ()
    if record.refused:
        matters = (f"{record.refused:,} designs could not be scored; the column reason says why.",)
    given = ", ".join(f"{name}: {pointer}" for name, pointer in record.pointers.items())
    ways = ", ".join(f"{count:,} {way}" for way, count in record.ways.items() if count)
    how = f"Rows were computed {ways}" + (f": {record.why}." if record.why else ".")
    designs = (
        group(Paragraph(f"Numbers of the design by column: {given}."), on=PAPER),
        _table(record),
        group(*(Paragraph(words) for words in _left_out(record)), on=TERMINAL),
    )
    return compose_document(
        record,
        sha256,
        (
            Section("Designs", designs),
            Section("Method and assumptions", (Bullets((how, *record.provenance.notes)),), on=PAPER, reader="auditor"),
        ),
        kind="Table of designs",
        status="table",
        sentence=sentence,
        numbers=tuple(numbers),
        matters=matters,
        question=f"{record.rows:,} designs of a table, each estimated.",
        method="first order",
    )


def _left_out(record: ScoredTable) -> Iterator[str]:
    """What of the table a terminal does not show."""
    if record.rows > SHOWN:
        yield f"{record.rows - SHOWN:,} further rows are in the record (--json)."
    if record.refused:
        yield f"{record.refused:,} rows could not be scored; the column reason says why."


def _table(record: ScoredTable) -> Table:
    def column(name: str, cells: tuple[object, ...]) -> Column:
        numeric = any(isinstance(cell, float) for cell in cells)
        answer = name.partition(":")[0].endswith("_mm") and name not in record.pointers
        on = PAPER if name in record.pointers or name == "reason" else EVERYWHERE
        written: Literal["fixed", "given"] = "fixed" if answer else "given"
        return Column(name, "mm" if answer else "", written if numeric else "text", 4, on, brief=name)

    columns = (Column("row", on=TERMINAL), *(column(name, cells) for name, cells in record.columns.items()))
    rows = tuple(
        Row((str(k + 1), *cells), on=EVERYWHERE if k < SHOWN else PAPER)
        for k, cells in enumerate(zip(*record.columns.values(), strict=True))
    )
    return Table("Designs", "Every row of the table", columns, rows, most=LONG_TABLE)

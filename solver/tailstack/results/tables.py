"""Tables of results, each column declared once: its heading, its unit, how it is written, and where it is shown.

Terminal, notebook, HTML, PDF and spreadsheet are written from the same table; none of them has columns of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from enum import Flag, auto
from typing import Any, Literal

from .digits import decimal, exact, number, percent, saving, signed_decimal

Cell = str | float | int | None
LONG_TABLE = 400  # rows on a page of one that has a row for each thing of a design or a study


class On(Flag):
    """Where a column or a row is shown."""

    PLAIN = auto()  # a terminal
    DETAIL = auto()  # a terminal that was asked for details
    NOTEBOOK = auto()
    PAGE = auto()  # HTML and PDF
    SHEET = auto()  # a spreadsheet, which has room for everything


EVERYWHERE = On.PLAIN | On.DETAIL | On.NOTEBOOK | On.PAGE | On.SHEET
PAPER = On.PAGE | On.SHEET
TERMINAL = On.PLAIN | On.DETAIL
IN_DETAIL = On.DETAIL | PAPER  # what a method needs, and not whoever asks for its result


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table."""

    title: str
    unit: str = ""  # mm, px, deg, %, ... shown in the header
    kind: Literal[
        "text", "unit", "fixed", "signed", "significant", "stated", "saving", "percent", "whole", "given", "status"
    ] = "text"
    digits: int = 3  # decimals of fixed, signed, stated, saving and percent, digits of significant; given: all it has
    on: On = EVERYWHERE
    brief: str = ""  # heading of a terminal's narrow columns, with line breaks; its last line has the unit
    bar: bool = False  # a share that is drawn as a bar, too, where there is room for one
    of: Callable[[Any], Cell] | None = None  # its cell, of what a row is about

    @property
    def numeric(self) -> bool:
        """Whether its cells stand right, as numbers do."""
        return self.kind not in ("text", "unit", "status")


@dataclass(frozen=True, slots=True)
class Row:
    """Cells in the order of the columns; ``depth`` 1 belongs to the row of depth 0 above it.

    A cell of a percent column is a fraction.
    """

    cells: tuple[Cell, ...]
    depth: int = 0
    on: On = EVERYWHERE


@dataclass(frozen=True, slots=True)
class Table:
    """Numbers with their units."""

    name: str  # of the sheet in a spreadsheet
    caption: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    note: str = ""
    most: int = 60  # rows that a page shows; a spreadsheet has all

    def on(self, place: On) -> Table:
        """What of it is shown at a place."""
        shown = [column.on & place == place for column in self.columns]
        return replace(
            self,
            columns=tuple(column for column, here in zip(self.columns, shown, strict=True) if here),
            rows=tuple(
                Row(tuple(cell for cell, here in zip(row.cells, shown, strict=True) if here), row.depth)
                for row in self.rows
                if row.on & place == place
            ),
        )

    @property
    def left_out(self) -> int:
        """How many rows a page does not show."""
        return max(len(self.rows) - self.most, 0)


def fill(columns: Sequence[Column], of: Any, depth: int = 0, on: On = EVERYWHERE) -> Row:
    """The row that is about ``of``; columns without a cell of their own are empty."""
    return Row(tuple(None if column.of is None else column.of(of) for column in columns), depth, on)


def tabulate(
    name: str, caption: str, columns: Sequence[Column], entries: Iterable[Any], note: str = "", most: int = 60
) -> Table:
    """A row for each entry."""
    return Table(name, caption, tuple(columns), tuple(fill(columns, entry) for entry in entries), note, most)


def write_cell(cell: Cell, column: Column) -> str:
    """A cell as text, in the way of its column: ``-`` for what is not there, minus as a hyphen."""
    if cell is None:
        return "-"
    if isinstance(cell, str) or not column.numeric:
        return str(cell)
    if column.kind == "signed":
        return signed_decimal(float(cell), column.digits)
    if column.kind == "fixed":
        return decimal(cell + 0.0, column.digits)
    if column.kind == "percent":
        return percent(cell + 0.0, column.digits)
    if column.kind == "stated":
        return exact(float(cell), column.digits)
    if column.kind == "saving":
        return saving(float(cell), column.digits)
    if column.kind == "given":
        return f"{cell:.12g}"
    if column.kind == "whole":
        return f"{cell:,.0f}"
    return number(float(cell), column.digits)

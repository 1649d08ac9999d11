"""What a report is made of, without saying how it looks: HTML, PDF and spreadsheet are made from the same blocks."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

Cell = str | float | int | None
Tone = Literal["pass", "fail", "inconclusive", "neutral"]


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table."""

    title: str
    unit: str = ""  # mm, px, deg, %, ... shown in the header
    kind: Literal["text", "fixed", "signed", "significant", "percent", "whole", "given", "status"] = "text"
    digits: int = 3  # decimals of fixed, signed and percent, digits of significant; given: as many as it has
    on_page: bool = True  # False: only a spreadsheet has room for it

    @property
    def numeric(self) -> bool:
        return self.kind not in ("text", "status")


@dataclass(frozen=True, slots=True)
class Row:
    """Cells in the order of the columns; ``depth`` 1 belongs to the row of depth 0 above it.

    A cell of a percent column is a fraction.
    """

    cells: tuple[Cell, ...]
    depth: int = 0


@dataclass(frozen=True, slots=True)
class Table:
    """Numbers with their units."""

    name: str  # of the sheet in a spreadsheet
    caption: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    note: str = ""
    most: int = 60  # rows that a page shows; a spreadsheet has all

    @property
    def page_columns(self) -> tuple[Column, ...]:
        return tuple(column for column in self.columns if column.on_page)

    @property
    def shown(self) -> tuple[Row, ...]:
        """The rows of a page, with the cells of ``page_columns``."""
        kept = [column.on_page for column in self.columns]
        return tuple(
            Row(tuple(cell for cell, on in zip(row.cells, kept, strict=True) if on), row.depth)
            for row in self.rows[: self.most]
        )

    @property
    def left_out(self) -> int:
        return max(len(self.rows) - self.most, 0)


@dataclass(frozen=True, slots=True)
class Figure:
    """A picture, SVG with its own title and description."""

    name: str  # kebab-case, unique in the report
    svg: str
    caption: str
    scene: str = ""  # JSON: on a screen the picture is replaced by a viewer of the same scene, which can be turned


@dataclass(frozen=True, slots=True)
class Paragraph:
    text: str


@dataclass(frozen=True, slots=True)
class Bullets:
    items: tuple[str, ...]
    numbered: bool = False


@dataclass(frozen=True, slots=True)
class Facts:
    """Pairs of a word and what it is."""

    name: str
    pairs: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class Listing:
    """Text that is kept as it stands: commands, a design document."""

    text: str
    caption: str = ""


Block = Table | Figure | Paragraph | Bullets | Facts | Listing


@dataclass(frozen=True, slots=True)
class Section:
    """A chapter; ``page`` starts it on a new page when printed."""

    title: str
    blocks: tuple[Block, ...]
    page: bool = False
    reader: Literal["designer", "auditor"] = "designer"  # whom it is for: the contents say so


@dataclass(frozen=True, slots=True)
class KeyNumber:
    """One of the large numbers of the first page."""

    label: str
    value: str
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Document:
    """A whole report."""

    kind: str  # "Tolerance-budget report", "Gate", ...
    title: str
    tone: Tone
    status: str  # one or two words for the badge
    sentence: str
    numbers: tuple[KeyNumber, ...]
    matters: tuple[str, ...]
    sections: tuple[Section, ...]
    provenance: Facts
    figures: tuple[Figure, ...] = field(default=())  # on the first page
    requirements: Table | None = None  # on the first page, too: each with its value, limit, margin and status


def tone_of(status: str) -> Tone:
    """The tone of a verdict."""
    if status == "pass" or status == "verified":
        return "pass"
    if status in ("fail", "not evaluated"):
        return "fail"
    return "inconclusive" if status == "inconclusive" else "neutral"

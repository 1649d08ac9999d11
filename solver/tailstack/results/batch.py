"""The record of a table of designs, each scored."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from .record import Published
from .verdicts import Provenance

Cells = tuple[float | str | None, ...]


@dataclass(frozen=True, slots=True, repr=False)
class ScoredTable(Published):
    """A design scored for each row of a table: the table's own columns, and those of the answer."""

    schema: Literal["tailstack/batch/1"]
    pointers: dict[str, str]
    """JSON pointer of the number of the design that each of these columns gave."""
    columns: dict[str, Cells]
    """Cells by column, row by row: those of the table as they were sent; numbers of the answer (p95_mm:TARGET), null
    where a row could not be scored; texts of the answer, empty where it could not; and `reason`, why."""
    rows: int
    """Number of rows."""
    refused: int
    """Rows that could not be scored."""
    ways: dict[str, int]
    """Rows that were computed compiled and in full."""
    why: str
    """All that keeps rows from the fastest of these ways, with `; ` between: each has to go; empty: nothing does."""
    provenance: Provenance
    """Of the design as it stands."""

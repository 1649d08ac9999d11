"""Rows of a grid: as CSV for spreadsheets, and why some of them have no numbers."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence

FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")


def csv_text(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """One line for each row; None is left empty, truths are ``true`` and ``false``."""
    out = io.StringIO()
    lines = csv.writer(out, lineterminator="\n")
    lines.writerow(header)
    lines.writerows([_cell(value) for value in row] for row in rows)
    return out.getvalue()


def _cell(value: object) -> object:
    if isinstance(value, bool):
        return str(value).lower()
    return "" if value is None else value


def plain_text(text: str) -> str:
    """A text of the user's that no spreadsheet takes for a formula."""
    return f"'{text}" if text.startswith(FORMULA_STARTS) else text


def list_reasons(reasons: Sequence[str | None], most: int, *, numbered: bool = False) -> list[str]:
    """Each reason once, with the rows it holds for (``numbered``, from one) or how many they are; None is no reason."""
    places: dict[str, list[int]] = {}
    for place, reason in enumerate(reasons):
        if reason is not None:
            places.setdefault(reason, []).append(place + 1)
    listed = []
    for reason, held in list(places.items())[:most]:
        which = f"{len(held)} point{'s' if len(held) > 1 else ''}"
        if numbered:
            which = f"point{'s' if len(held) > 1 else ''} {', '.join(map(str, held[:8]))}"
            which += ", ..." if len(held) > 8 else ""
        listed.append(f"{which}: {reason}")
    if len(places) > most:
        listed.append(f"{len(places) - most} more reasons (--json and --csv list them all)")
    return listed

"""JSON as tailstack writes it: one writer, so that equal content has equal bytes, and equal bytes have one hash."""

from __future__ import annotations

import json
from typing import Any


def write_json(data: Any, *, sort_keys: bool = False, indent: int | None = None) -> str:
    """JSON text of plain data: numbers as Python writes them, the shortest digits that read back the same.

    Compact unless ``indent`` lays it out for people; keys stay in their order, or are sorted where whoever sent them
    chose it.  Raises ValueError for a number that is not finite: JSON has no such number.
    """
    separators = (",", ":") if indent is None else (",", ": ")
    return json.dumps(  # noqa: TID251 - this is the one writer
        data, sort_keys=sort_keys, indent=indent, separators=separators, ensure_ascii=False, allow_nan=False
    )


def find_repeated(items: list[tuple[str, Any]]) -> str:
    """The first name that stands again among the fields of a mapping, of which one does."""
    seen: set[str] = set()
    return next(key for key, _ in items if key in seen or seen.add(key))  # type: ignore[func-returns-value]

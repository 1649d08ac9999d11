"""One HTML file: everything inside, nothing asked of any network, the record itself at its end."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from ..rendering.tables import number
from .blocks import Cell, Column, Document

_BLOCKS = ("Table", "Figure", "Paragraph", "Bullets", "Facts", "Listing")


def html_report(document: Document, record: bytes | None) -> str:
    """The report as HTML.  ``record``: the result's JSON, which is kept in the file; None leaves it out (print)."""
    template = _environment().get_template("report.html")
    return template.render(document=document, record=None if record is None else _inert(record))


@cache
def _environment() -> Environment:
    made = Environment(
        loader=PackageLoader("tailstack_service.reports", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters["shown"] = shown
    made.filters["kind"] = lambda block: type(block).__name__
    return made


def shown(cell: Cell, column: Column) -> str:
    """A cell as text, in the way of its column."""
    if cell is None:
        return "–"
    if isinstance(cell, str) or not column.numeric:
        return str(cell)
    if column.kind == "fixed":
        return f"{cell + 0.0:.{column.digits}f}".replace("-", "−")
    if column.kind == "percent":
        smallest = 10.0**-column.digits
        if 0 < 100 * cell < smallest / 2:
            return f"< {smallest:g}"
        return f"{100 * cell:.{column.digits}f}"
    if column.kind == "given":
        return f"{cell:g}".replace("-", "−")
    if column.kind == "whole":
        return f"{cell:,.0f}"
    return number(float(cell), column.digits).replace("-", "−")


def _inert(record: bytes) -> str:
    """JSON that cannot end the element it stands in, nor begin another."""
    data: Any = json.loads(record)
    text = json.dumps(data, ensure_ascii=False, separators=(",", ":"))
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")

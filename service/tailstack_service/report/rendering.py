"""From a published result to a document in one of the formats."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from .blocks import Document

MEDIA_TYPES = {
    "html": "text/html; charset=utf-8",
    "pdf": "application/pdf",
    "xlsx": "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
    "json": "application/json",
}
CHAPTERS = ("score", "verification", "optimisation", "sweep", "gate", "report", "comparison")


def rendered(name: str, body: bytes, form: str) -> tuple[bytes, str]:
    """See :func:`tailstack_service.report.render`."""
    if form not in MEDIA_TYPES:
        raise ValueError(f"no format is called {form!r}; there are {', '.join(MEDIA_TYPES)}")
    return rendered_all(name, body, (form,))[0][1], MEDIA_TYPES[form]


def rendered_all(name: str, body: bytes, forms: Sequence[str]) -> list[tuple[str, bytes]]:
    """A result in several formats, its chapters and pictures made once.  Raises what ``document_of`` raises."""
    drawn = [form for form in forms if form != "json"]
    document = document_of(name, body) if drawn else None
    return [(form, body if document is None or form == "json" else _content(document, body, form)) for form in forms]


def _content(document: Document, body: bytes, form: str) -> bytes:
    if form == "html":
        from .html import html_report

        return html_report(document, body).encode()
    if form == "pdf":
        from .pdf import pdf_report

        return pdf_report(document, body)
    from .xlsx import xlsx_report

    return xlsx_report(document, body)


def document_of(name: str, body: bytes) -> Document:
    """The chapters of a result.  Raises ValueError for a name without chapters, or a body that is not its record."""
    from ..documents import read_record

    if name not in CHAPTERS:
        raise ValueError(f"no report is made of {name!r}; there are {', '.join(CHAPTERS)}")
    make: Callable[[Any, str], Document] = getattr(import_module(f"{__package__}.chapters.{name}"), f"{name}_document")
    return make(read_record(name, body), hashlib.sha256(body).hexdigest())

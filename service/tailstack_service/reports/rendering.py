"""From a published result to a document in one of the formats."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from importlib import import_module
from typing import Any

from .blocks import Document

MEDIA_TYPES = {
    "html": "text/html; charset=utf-8",
    "pdf": "application/pdf",
    "xlsx": "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
    "json": "application/json",
}
CHAPTERS = ("score", "verification", "optimisation", "sweep", "gate", "report")


def rendered(name: str, body: bytes, form: str) -> tuple[bytes, str]:
    """See :func:`tailstack_service.reports.render`."""
    if form not in MEDIA_TYPES:
        raise ValueError(f"no format is called {form!r}; there are {', '.join(MEDIA_TYPES)}")
    if form == "json":
        return body, MEDIA_TYPES[form]
    document = document_of(name, body)
    if form == "html":
        from .html import html_report

        content = html_report(document, body).encode()
    elif form == "pdf":
        from .pdf import pdf_report

        content = pdf_report(document)
    else:
        from .xlsx import xlsx_report

        content = xlsx_report(document)
    return content, MEDIA_TYPES[form]


def document_of(name: str, body: bytes) -> Document:
    """The chapters of a result.  Raises ValueError for a name without chapters, or a body that is not its record."""
    from ..documents import read_record

    if name not in CHAPTERS:
        raise ValueError(f"no report is made of {name!r}; there are {', '.join(CHAPTERS)}")
    make: Callable[[Any, str], Document] = getattr(import_module(f"{__package__}.chapters.{name}"), f"{name}_document")
    return make(read_record(name, body), hashlib.sha256(body).hexdigest())

"""From a published result to a document in one of the formats."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

from ..documents import from_json
from ..rendering.document import Document
from .operation import Operation
from .registry import OPERATIONS

MEDIA_TYPES = {
    "html": "text/html; charset=utf-8",
    "pdf": "application/pdf",
    "xlsx": "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
    "json": "application/json",
}
FORMATS = ("html", "pdf", "xlsx", "json")
CSV = "text/csv; charset=utf-8"


def media_types_of(operation: Operation) -> dict[str, str]:
    """What its record is rendered as, by format: pages where it has chapters, and lines of CSV where it has those."""
    return (MEDIA_TYPES if operation.document else {}) | ({"csv": CSV} if operation.csv else {})


def render(name: str, body: bytes, form: str, *, summary: bool = False) -> bytes:
    """A published result as a document; the same body gives the same bytes.

    name: of an operation whose record has chapters.  body: the record's JSON, as recorded.  summary: of a PDF, one
    page.  Raises PdfUnavailable where the libraries for PDF are missing, ValueError for a name or format that does not
    exist.
    """
    known = MEDIA_TYPES | (media_types_of(OPERATIONS[name]) if name in OPERATIONS else {})
    if form not in known:
        raise ValueError(f"no format is called {form!r}; there are {', '.join(known)}")
    return render_all(name, body, (form,), summary=summary)[0][1]


def render_all(name: str, body: bytes, forms: Sequence[str], *, summary: bool = False) -> list[tuple[str, bytes]]:
    """A result in several formats, its chapters and pictures made once.  Raises what ``document_of`` raises."""
    document = document_of(name, body) if not set(forms) <= {"json", "csv"} else None
    return [(form, _content(name, document, body, form, summary)) for form in forms]


def _content(name: str, document: Document | None, body: bytes, form: str, summary: bool) -> bytes:
    if form == "csv":
        operation = OPERATIONS[name]
        assert operation.csv is not None, name
        lines: str = operation.csv.write(from_json(operation.record(), body))
        return lines.encode()
    if document is None or form == "json":
        return body
    if form == "html":
        from ..report.html import html_report

        return html_report(document, body).encode()
    if form == "pdf":
        from ..report.pdf import pdf_report

        return pdf_report(document, body, summary=summary)
    from ..report.xlsx import xlsx_report

    return xlsx_report(document, body)


def document_of(name: str, body: bytes) -> Document:
    """The chapters of a result.  Raises ValueError for a name without chapters, or a body that is not its record."""
    make = OPERATIONS[name].document if name in OPERATIONS else None
    if make is None:
        raise ValueError(f"no report is made of {name!r}; there are {', '.join(list_reported_names())}")
    return make(from_json(OPERATIONS[name].record(), body), hashlib.sha256(body).hexdigest())


def list_reported_names() -> tuple[str, ...]:
    """Names of the records that reports are made of."""
    return tuple(name for name, operation in OPERATIONS.items() if operation.document is not None)

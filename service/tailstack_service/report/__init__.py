"""Results as documents for people: HTML, PDF, spreadsheet, JSON, all from the published record."""

from __future__ import annotations

FORMATS = ("html", "pdf", "xlsx", "json")

__all__ = ["FORMATS", "render"]


def render(name: str, body: bytes, form: str) -> tuple[bytes, str]:
    """A published result as a document: its bytes and their media type.

    name: score, verification, optimisation, sweep, gate or report.  body: the result's JSON, as recorded.  The same
    body gives the same bytes.  Raises PdfUnavailable where the libraries for PDF are missing, ValueError for a name
    or format that does not exist.
    """
    from .rendering import rendered

    return rendered(name, body, form)

"""The same pages as PDF, by WeasyPrint, which is loaded only here."""

from __future__ import annotations

from typing import Any

from tailstack.errors import Problem

from .blocks import Document
from .errors import PdfUnavailable
from .html import html_report

PACKAGES = "apt install libpango-1.0-0 libpangoft2-1.0-0 libharfbuzz-subset0"


def pdf_report(document: Document) -> bytes:
    """The report as PDF; the same document gives the same bytes.  Raises PdfUnavailable."""
    try:
        import weasyprint
    except ImportError:
        problem = Problem(
            "", "missing-package", "the Python package weasyprint is not installed", "pip install 'tailstack[pdf]'"
        )
        raise PdfUnavailable(problem) from None
    except OSError as error:
        detail = f"a library that WeasyPrint draws with is missing: {str(error).splitlines()[0][:200]}"
        raise PdfUnavailable(Problem("", "missing-library", detail, PACKAGES)) from None
    page = weasyprint.HTML(string=html_report(document, None), url_fetcher=_refuse)
    content: bytes = page.write_pdf(pdf_identifier=False)
    return content


def _refuse(url: str, *_arguments: Any, **_options: Any) -> Any:
    raise ValueError(f"a report holds everything it needs; it asked for {url[:100]}")

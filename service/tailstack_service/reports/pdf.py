"""The same pages as PDF, by WeasyPrint, which is loaded only here."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
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
    with _fixed_clock():
        content: bytes = page.write_pdf()
    return content


_clock = Lock()


@contextmanager
def _fixed_clock() -> Iterator[None]:
    """fontTools writes the time into each font that it cuts down, unless the environment names one."""
    name = "SOURCE_DATE_EPOCH"
    with _clock:
        before = os.environ.get(name)
        os.environ[name] = "946684800"
        try:
            yield
        finally:
            if before is None:
                del os.environ[name]
            else:
                os.environ[name] = before


def _refuse(url: str, *_arguments: Any, **_options: Any) -> Any:
    raise ValueError(f"a report holds everything it needs; it asked for {url[:100]}")

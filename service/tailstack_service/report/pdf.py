"""The same pages as PDF, by WeasyPrint, which is loaded only here."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from threading import Lock
from typing import Any

from tailstack.errors import MissingExtraError, Problem
from tailstack.extras import install_command

from ..environment import temporary_directory
from ..problems import PdfUnavailable
from ..rendering.document import Document
from .html import html_report

PACKAGES = "apt install libpango-1.0-0 libpangoft2-1.0-0 libharfbuzz-subset0"
FONTS = "apt install fonts-dejavu-core, or any other font that fontconfig finds (fc-list shows them)"
RECORD_NAME = "tailstack-record.json"
RECORD_NOTE, SUMMARY_NOTE = "The record that this report renders", "The record that this summary is of"
MADE = datetime(2000, 1, 1, tzinfo=UTC)  # a PDF says when its attachments were made; a report must not


def pdf_report(document: Document, record: bytes, *, summary: bool = False) -> bytes:
    """The report as PDF with its record as an attachment; the same document gives the same bytes.

    summary: the first page alone, with as much on it as one sheet of A4 holds.  Raises PdfUnavailable.
    """
    weasyprint = load_weasyprint()
    with _fixed_clock(), _without_collector():
        attached = weasyprint.Attachment(
            string=record, name=RECORD_NAME, description=SUMMARY_NOTE if summary else RECORD_NOTE, created=MADE,
            modified=MADE, relationship="Source",
        )  # fmt: skip
        smaller = 1.0
        for each in document.summaries() if summary else (document,):
            sheet = weasyprint.HTML(string=html_report(each, None), url_fetcher=_refuse)
            pages = sheet.render(attachments=[attached])
            if len(pages.pages) == 1:
                break
        if summary and len(pages.pages) > 1:  # names of the greatest length everywhere
            smaller = 1.5
            twice = weasyprint.CSS(string=f"@page {{ size: {210 * smaller}mm {297 * smaller}mm !important }}")
            pages = sheet.render(attachments=[attached], stylesheets=[twice])
        content: bytes = pages.write_pdf(zoom=1 / smaller, attachments=[attached])
    return content


def load_weasyprint() -> Any:
    """The library, able to write here.  Raises PdfUnavailable, and FolderError where it has no room for its files."""
    try:
        import weasyprint
    except ImportError:
        detail = "the Python package weasyprint is not installed"
        refusal = PdfUnavailable(Problem("", "missing-package", detail, install_command("pdf")))
        refusal.exit_code = MissingExtraError.exit_code
        raise refusal from None
    except OSError as error:
        detail = f"a library that WeasyPrint draws with is missing: {str(error).splitlines()[0][:200]}"
        raise PdfUnavailable(Problem("", "missing-library", detail, PACKAGES)) from None
    if not count_fonts():
        detail = "fontconfig finds no font here, and without one Pango ends the process"
        raise PdfUnavailable(Problem("", "missing-font", detail, FONTS))
    temporary_directory()  # where WeasyPrint puts the fonts of a page
    return weasyprint


def count_fonts() -> int:
    """How many fonts fontconfig finds on this machine."""
    from weasyprint.text.ffi import fontconfig

    config = fontconfig.FcInitLoadConfigAndFonts()
    try:
        return int(fontconfig.FcConfigGetFonts(config, fontconfig.FcSetSystem).nfont)
    finally:
        fontconfig.FcConfigDestroy(config)


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


@contextmanager
def _without_collector() -> Iterator[None]:
    """Looking for cycles among the boxes of a page takes a third of the time, and they live to the end anyway."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def _refuse(url: str, *_arguments: Any, **_options: Any) -> Any:
    raise ValueError(f"a report holds everything it needs; it asked for {url[:100]}")

"""The record that a file holds, whatever its format: JSON itself, or inside HTML, XLSX or PDF."""

from __future__ import annotations

import io
import re
import zipfile
import zlib
from dataclasses import dataclass, replace
from html import unescape
from typing import Literal

from tailstack.design.loading import read_source
from tailstack.errors import DesignError, Problem

from ..gate.reading import LIMITS
from ..operations.reading import ReadResult, result_of
from ..problems import RequestError

Form = Literal["html", "pdf", "xlsx", "json"]
LARGEST_UNPACKED = 400_000_000  # bytes: a file that grows beyond is no report
RECORD_SHEET = "Record"
_HTML_RECORD = re.compile(rb'<script type="application/json" id="tailstack-record">(.*?)</script>', re.DOTALL)
_PDF_RECORD = re.compile(rb"<<[^<>]*/Type /EmbeddedFile.*?/Length (\d+)>>\nstream\n", re.DOTALL)
_CELL = re.compile(r'<c r="([A-Z]+)(\d+)"([^>]*?)(?:/>|>(.*?)</c>)', re.DOTALL)
_SHARED = re.compile(r"<si>(.*?)</si>", re.DOTALL)
_TEXT = re.compile(r"<t(?:>| [^>]*>)(.*?)</t>", re.DOTALL)
_ESCAPED = re.compile(r"_x([0-9A-Fa-f]{4})_")
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"


@dataclass(frozen=True, slots=True, eq=False)
class ReportFile:
    """A file and the result in it."""

    form: Form
    content: bytes
    result: ReadResult


def read_report(content: bytes, file: str) -> ReportFile:
    """The result in a report.  Raises RequestError for what is no report of tailstack, or holds a broken record."""
    form = form_of(content)
    if form == "json":
        return ReportFile(form, content, _read(content, file, 1))
    if form == "html":
        matches = list(_HTML_RECORD.finditer(content))
        if len(matches) != 1:
            raise _no_record(file, "an HTML report holds one element <script id=tailstack-record>", len(matches))
        text, line = matches[0].group(1), content.count(b"\n", 0, matches[0].start(1)) + 1
    else:
        text, line = (_from_pdf if form == "pdf" else _from_xlsx)(content, file), 0
    return ReportFile(form, content, _read(text, file, line))


def form_of(content: bytes) -> Form:
    """By the first bytes."""
    if content.startswith(b"%PDF-"):
        return "pdf"
    if content.startswith(b"PK\x03\x04"):
        return "xlsx"
    return "html" if content.removeprefix(_BYTE_ORDER_MARK).lstrip().startswith(b"<") else "json"


def _read(text: bytes, file: str, first_line: int) -> ReadResult:
    """The result in JSON that begins in a line of the file; 0: the file has no lines."""
    try:
        source = read_source(text, form="json", limits=LIMITS)
        schema = source.data.get("schema") if isinstance(source.data, dict) else None
        if not isinstance(schema, str):
            detail = "the record does not say of which schema it is"
            raise RequestError(Problem("/schema", "bad-result", detail, "give a report or a result of tailstack"))
        return result_of(source, schema, file)
    except (DesignError, RequestError) as error:
        problems = [_give_hint(problem, of_design=isinstance(error, DesignError)) for problem in error.problems]
        raise RequestError([_shift_lines(problem, file, first_line) for problem in problems]) from None


def _give_hint(problem: Problem, *, of_design: bool) -> Problem:
    """What to do about a file that holds no result; the cures of a design's slips do not help there."""
    if problem.hint and not of_design:
        return problem
    return replace(problem, hint="give a file that tailstack report wrote, or a result")


def _shift_lines(problem: Problem, file: str, first_line: int) -> Problem:
    line = None if problem.line is None or first_line == 0 else problem.line + first_line - 1
    return replace(problem, file=file, line=line, column=None if line is None else problem.column)


def _no_record(file: str, wanted: str, count: int) -> RequestError:
    hint = "give a file that tailstack report wrote"
    return RequestError(Problem("", "no-record", f"{wanted}; this file has {count}", hint, file))


def _from_pdf(content: bytes, file: str) -> bytes:
    matches = list(_PDF_RECORD.finditer(content))
    if len(matches) != 1:
        raise _no_record(file, "a PDF report holds its record as one attachment", len(matches))
    start, length = matches[0].end(), int(matches[0].group(1))
    try:
        return _inflate(content[start : start + length])
    except zlib.error as error:
        raise RequestError(Problem("", "bad-result", f"the attachment cannot be unpacked: {error}", "", file)) from None


def _inflate(packed: bytes) -> bytes:
    unpacking = zlib.decompressobj()
    text = unpacking.decompress(packed, LARGEST_UNPACKED)
    if unpacking.unconsumed_tail or not unpacking.eof:
        raise zlib.error("it is cut off, or too large")
    return text


def _from_xlsx(content: bytes, file: str) -> bytes:
    parts = unpack_streams(content, file)
    cells = sheet_cells(parts, RECORD_SHEET)
    if cells is None:
        raise _no_record(file, f"a spreadsheet of tailstack has one sheet {RECORD_SHEET!r}", 0)
    rows = sorted((row, text) for (column, row), text in cells.items() if column == "A" and row > 1)
    return "".join(text for _, text in rows).encode()


def unpack_streams(content: bytes, file: str) -> dict[str, bytes]:
    """The parts of a spreadsheet by their names.  Raises RequestError."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if sum(part.file_size for part in archive.infolist()) > LARGEST_UNPACKED:
                raise zipfile.BadZipFile("it is too large")
            return {part.filename: archive.read(part) for part in archive.infolist()}
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise RequestError(
            Problem("", "bad-result", f"the spreadsheet cannot be unpacked: {error}", "", file)
        ) from None


def sheet_cells(parts: dict[str, bytes], name: str) -> dict[tuple[str, int], str] | None:
    """Texts and numbers as texts, by column and row; None without such a sheet."""
    book = parts.get("xl/workbook.xml", b"").decode("utf-8", "replace")
    names = [unescape(each) for each in re.findall(r'<sheet name="([^"]*)"', book)]  # the first is in sheet1.xml
    if name not in names:
        return None
    shared = [
        _plain("".join(_TEXT.findall(entry)))
        for entry in _SHARED.findall(parts.get("xl/sharedStrings.xml", b"").decode("utf-8", "replace"))
    ]
    page = parts.get(f"xl/worksheets/sheet{names.index(name) + 1}.xml", b"").decode("utf-8", "replace")
    cells = {}
    for column, row, attributes, inside in _CELL.findall(page):
        value = re.search(r"<v>(.*?)</v>", inside or "", re.DOTALL)
        text = value.group(1) if value else ""
        if 't="s"' in attributes and text.isdecimal() and int(text) < len(shared):
            text = shared[int(text)]
        cells[column, int(row)] = text
    return cells


def _plain(text: str) -> str:
    """A text of a spreadsheet without XML's escapes and its own."""
    return _ESCAPED.sub(lambda match: chr(int(match.group(1), 16)), unescape(text))

"""``report --verify``: is a report what it says?  Its hash, its pages and its numbers are made again and compared."""

from __future__ import annotations

import hashlib
import io
import re
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from html import unescape
from math import isclose
from typing import Any, Literal

from tailstack import __version__
from tailstack.design import Design, compile_design, load_design
from tailstack.design.loading import read_source
from tailstack.errors import DesignError, LimitError, Problem, escape
from tailstack.verification import UNITS, shots_for

from .documents import plain
from .gate.reading import LIMITS
from .operations.operation import HeldDesign, Progress, Repetition
from .operations.reading import ReadResult, result_of
from .operations.registry import OPERATIONS
from .operations.rendering import render
from .problems import PdfUnavailable, RequestError

Answer = Literal["same", "different", "not compared", "trusted"]


@dataclass(frozen=True, slots=True)
class AuditCheck:
    """One thing that was looked at."""

    what: str  # record, design, pages, numbers, ...
    answer: Answer
    words: str
    details: tuple[str, ...] = ()  # what differs


@dataclass(frozen=True, slots=True)
class Audit:
    """Everything that was looked at in one file."""

    file: str
    title: str
    schema: str
    written_by: str
    questions: tuple[AuditCheck, ...]

    @property
    def verdict(self) -> Literal["verified", "differs", "not verified"]:
        """``not verified``: nothing differs, but something that should have been compared could not be."""
        answers = {question.answer for question in self.questions}
        return "differs" if "different" in answers else "not verified" if "not compared" in answers else "verified"


def audit_text(audit: Audit) -> str:
    """The audit for people."""
    wide = max(len(question.what) for question in audit.questions)
    lines = [f"{audit.file}: {audit.title}", f"  {audit.schema}, written by tailstack {audit.written_by}"]
    for question in audit.questions:
        mark = {"same": " ", "different": "!", "not compared": "?", "trusted": "-"}[question.answer]
        lines.append(f"{mark} {question.what:{wide}}  {question.words}")
        lines += [f"  {'':{wide}}  {detail}" for detail in question.details]
    return "\n".join([*lines, audit.verdict]) + "\n"


MOST_NUMBERS = 8  # differing numbers that are listed
OTHERWISE = "or --fast: without Monte Carlo and optimiser"


@dataclass(frozen=True, slots=True)
class Effort:
    """The most that an audit computes: trials of all checks together, starts of the optimiser."""

    trials: int = 100_000_000
    starts: int = 256


def audit(
    content: bytes, file: str, given: Design | None = None, *, fast: bool = False, most: Effort | None = None,
    progress: Progress | None = None,
) -> Audit:  # fmt: skip
    """Everything that can be compared of a report or result.

    given: the design of a record that does not hold its own.  fast: Monte Carlo and optimiser are not run again.
    most: what computing again may take; default ``Effort()``.  Raises RequestError for what cannot be read or lacks
    its design, LimitError for what asks for more than that, TailstackError where computing fails.
    """
    report_file = read_report(content, file)
    result = report_file.result
    operation = OPERATIONS[result.kind]
    holds = operation.hold(result.record)
    designs = tuple(load_design(each.data, allow_files=False) for each in holds)
    if not fast:
        _check_effort(result, (*(() if given is None else (given,)), *designs), most or Effort())
    questions = [AuditCheck("record", "same", f"SHA-256 {hashlib.sha256(result.body).hexdigest()}")]
    questions += [_design_question(*pair) for pair in zip(holds, designs, strict=True) if pair[0].stated_sha256]
    # Of a comparison the second design's; a record of several designs states the version itself
    origin = result.record.second if result.kind == "comparison" else result.record
    provenance = getattr(origin, "provenance", origin)
    written_by = provenance.tailstack_version
    questions.append(pages_question(report_file, written_by, file))
    if designs and given is not None:
        detail = "the record holds its design: none is to be given"
        raise RequestError(Problem("", "unused-option", detail, "leave the second file out"))
    if not designs and operation.designs and given is not None:
        stated, designs = getattr(provenance, "design_sha256", given.sha256), (given,)
        if stated != given.sha256:
            words = f"this is another design: its SHA-256 is {given.sha256}, the record is of {stated}"
            questions.append(AuditCheck("design", "different", words))
            designs, fast = (), True
    questions += _number_questions(result, designs, fast, progress, written_by)
    title = getattr(result.record, "title", None) or getattr(provenance, "design_name", result.kind)
    return Audit(file, str(title), result.record.schema, written_by, tuple(questions))


def _design_question(each: HeldDesign, design: Design) -> AuditCheck:
    if design.sha256 == each.stated_sha256:
        return AuditCheck(each.name, "same", f"SHA-256 {design.sha256}")
    detail = f"its SHA-256 is {design.sha256}; the record says {each.stated_sha256}"
    return AuditCheck(each.name, "different", detail)


# --- the numbers, computed again ------------------------------------------------------------------------


def _number_questions(
    result: ReadResult, designs: tuple[Design, ...], fast: bool, progress: Progress | None, written_by: str
) -> list[AuditCheck]:
    """Raises RequestError where the design is missing that the numbers are computed from."""
    operation = OPERATIONS[result.kind]
    can_repeat = operation.can_repeat(result.record)
    if fast and not (can_repeat and designs):
        return [AuditCheck("numbers", "trusted", "not computed again: the record does not hold its design")]
    if not can_repeat:
        detail = f"the numbers of a {result.kind} are computed again by tailstack {operation.verb}, from what it was of"
        raise RequestError(Problem("", "not-recomputed", detail, "add --fast: hash and pages only"))
    if not designs:
        detail = f"a {result.kind} does not hold its design, so its numbers cannot be computed again"
        hint = "tailstack report --verify FILE DESIGN, or --fast: hash and pages only"
        raise RequestError(Problem("", "missing-design", detail, hint))
    again = operation.compute_again(Repetition(result.record, designs, fast, progress))
    questions = [_compare(result.record, plain(again.record), written_by)]
    if again.trusted:
        questions.append(AuditCheck("taken on trust", "trusted", f"{again.trusted} (--fast)"))
    return questions


def _compare(recorded: Any, computed: Any, written_by: str) -> AuditCheck:
    every = list(values(plain(recorded), computed))
    pairs = [pair for pair in every if not _is_version(pair)]
    apart = [pair for pair in pairs if not pair.close]
    exact = sum(pair.same for pair in pairs)
    if not apart:
        digits = "to the last digit" if exact == len(pairs) else f"{exact:,} to the last digit, all to {CLOSE:g}"
        return AuditCheck("numbers", "same", f"{len(pairs):,} values computed again: the same, {digits}")
    other = ""
    if written_by != __version__:
        other = f" (by tailstack {__version__}, which is not the one that wrote them)"
    elif any(_is_version(pair) and not pair.same and pair.recorded is not None for pair in every):
        other = f" (by other sources of tailstack {__version__} than those that wrote them)"
    listed = [pair.words for pair in apart[:MOST_NUMBERS]]
    more = [f"... and {len(apart) - MOST_NUMBERS} more"] if len(apart) > MOST_NUMBERS else []
    words = f"{len(apart):,} of {len(pairs):,} values are not what is computed again{other}"
    return AuditCheck("numbers", "different", words, (*listed, *more))


def _is_version(pair: Value) -> bool:
    """The code that computes is another one by nature."""
    return pair.pointer.endswith(("/provenance/tailstack_version", "/provenance/sources_sha256"))


def _check_effort(result: ReadResult, designs: tuple[Design, ...], most: Effort) -> None:
    """How much a record asks to be computed again is a stranger's word: it is held to a limit before anything runs.

    designs: all that the record is of; of each, the units that its requirements take are counted too.  Raises
    LimitError for a record that asks for more, RequestError for one that cannot be.
    """
    demand = OPERATIONS[result.kind].demand(result.record)
    units = demand.checks * sum(_unit_trials(design) for design in designs)
    if demand.trials and demand.trials + units > most.trials:
        also = f", {units:,} of them for requirements on each unit" if units else ""
        detail = (
            f"up to {demand.trials + units:,} trials would be drawn to verify this{also}; at most {most.trials:,} are "
            "drawn unless you say otherwise"
        )
        hint = f"add --max-trials {demand.trials + units}, {OTHERWISE}"
        raise LimitError(Problem(demand.trials_at, "too-many", detail, hint))
    if demand.starts > most.starts:
        detail = (
            f"the optimiser would be started {demand.starts:,} times; at most {most.starts:,} unless you say otherwise"
        )
        raise LimitError(Problem(demand.starts_at, "too-many", detail, f"add --starts {demand.starts}, {OTHERWISE}"))


def _unit_trials(design: Design) -> int:
    """Trials that a check draws for requirements on each unit, or each mounting, at their targets."""
    each = (entry for entry in compile_design(design).requirements if entry.risk != "pooled")
    return sum(UNITS * shots_for(entry.quantile) * len(entry.targets) for entry in each)


# --- two records, value by value ------------------------------------------------------------------------

CLOSE = 1e-9  # relative: what another processor may leave of the last digits of first order
NONE = 1e-12  # of numbers about zero
ABSENT = "(absent)"


@dataclass(frozen=True, slots=True)
class Value:
    """A value of a record, and of the record that was computed anew."""

    pointer: str
    recorded: Any
    computed: Any

    @property
    def same(self) -> bool:
        """To the last digit."""
        return type(self.recorded) is type(self.computed) and self.recorded == self.computed

    @property
    def close(self) -> bool:
        """The same up to the last digits of a number."""
        pair = (self.recorded, self.computed)
        if not all(isinstance(value, int | float) and not isinstance(value, bool) for value in pair):
            return self.same
        return isclose(*pair, rel_tol=CLOSE, abs_tol=NONE)

    @property
    def words(self) -> str:
        return f"{self.pointer}: recorded {_short(self.recorded)}, computed {_short(self.computed)}"


def _short(value: Any) -> str:
    text = repr(value) if not isinstance(value, str) or value != ABSENT else value
    return text if len(text) <= 90 else f"{text[:89]}…"


def values(recorded: Any, computed: Any, at: str = "") -> Iterator[Value]:
    """Every value of either, from plain data."""
    if isinstance(recorded, dict) and isinstance(computed, dict):
        for key in dict.fromkeys([*computed, *recorded]):
            yield from values(recorded.get(key, ABSENT), computed.get(key, ABSENT), f"{at}/{escape(key)}")
    elif isinstance(recorded, list | tuple) and isinstance(computed, list | tuple):
        if len(recorded) != len(computed):
            yield Value(at, f"{len(recorded)} entries", f"{len(computed)} entries")
        for index, pair in enumerate(zip(recorded, computed, strict=False)):
            yield from values(*pair, f"{at}/{index}")
    else:
        yield Value(at, recorded, computed)


# --- the pages, rendered again ------------------------------------------------------------------------

MOST_PARTS = 5  # differences that are told
BEFORE, LONGEST = 20, 90  # letters before a difference, and in all
PLACES = "its table of places"  # the last stream of a PDF, which hangs on how the others are packed
_STREAM = re.compile(rb"stream\n(.*?)\nendstream", re.DOTALL)
_PACKED = re.compile(rb"/Length \d+|startxref\n\d+")  # what else hangs on that
_MADE_WITH = (  # programs and fonts that leave other bytes where they are others
    re.compile(rb"tailstack [\w.+-]+, charts by (matplotlib [\w.+-]+)"),
    re.compile(rb"/Producer \(([^()]*)\)"),
    re.compile(rb"/BaseFont /[^\s/<>\[\]()+]+\+([^\s/<>\[\]()]+)"),
)


def pages_question(held: ReportFile, written_by: str, file: str) -> AuditCheck:
    """The file against what its record renders to here."""
    if held.form == "json":
        same = held.content.rstrip(b"\n") == held.result.body
        words = "canonical JSON" if same else "JSON that was laid out anew: the hash is of its canonical form"
        return AuditCheck("bytes", "same", words)
    if written_by != __version__:
        words = f"written by tailstack {written_by}, this is {__version__}: install that version to compare them"
        return AuditCheck("pages", "not compared", words)
    there = _take_apart(held.form, held.content, file)
    try:
        fresh = render(held.result.kind, held.result.body, held.form, summary=held.form == "pdf" and _is_summary(there))
    except PdfUnavailable as error:
        return AuditCheck("pages", "not compared", f"PDF cannot be rendered here: {error.problems[0].detail}")
    if fresh == held.content:
        return AuditCheck("pages", "same", f"what the record renders to, byte for byte ({len(fresh):,} bytes)")
    here = _take_apart(held.form, fresh, file)
    if there == here:
        return AuditCheck("pages", "same", "what the record renders to, part for part (packed by another zlib)")
    made = [", ".join(_list_tools(parts)) or "unknown programs" for parts in (there, here)]
    if made[0] != made[1]:
        words = f"made with {made[0]}, here with {made[1]}: the same versions and fonts are needed"
        return AuditCheck("pages", "not compared", words)
    names = [name for name in dict.fromkeys([*here, *there]) if there.get(name) != here.get(name)]
    if names == [PLACES]:
        words = f"the same, but packed by another zlib: {PLACES}, the last stream, cannot be compared"
        return AuditCheck("pages", "not compared", words)
    details = [_show_difference(name, there.get(name, b""), here.get(name, b"")) for name in names[:MOST_PARTS]]
    more = [f"... and {len(names) - MOST_PARTS} more"] if len(names) > MOST_PARTS else []
    words = f"{len(names)} parts of the file are not what the record renders to"
    return AuditCheck("pages", "different", words, (*details, *more))


def _take_apart(form: Form, content: bytes, file: str) -> dict[str, bytes]:
    """The parts of a file by name, unpacked: lines of a page, files of a spreadsheet, streams of a PDF and the rest."""
    if form == "html":
        return {f"line {number}": line for number, line in enumerate(content.split(b"\n"), 1)}
    if form == "xlsx":
        return unpack_streams(content, file)
    parts = {f"stream {number}": _unpack(packed) for number, packed in enumerate(_STREAM.findall(content), 1)}
    if parts:
        parts[PLACES] = parts.pop(f"stream {len(parts)}")
    return {**parts, "what is between streams": _PACKED.sub(b"", _STREAM.sub(b"stream", content))}


def _unpack(packed: bytes) -> bytes:
    try:
        return zlib.decompress(packed)
    except zlib.error:
        return packed


def _is_summary(parts: dict[str, bytes]) -> bool:
    """Whether a PDF says of itself that it is the one page of a report."""
    from .report.pdf import SUMMARY_NOTE

    return any(SUMMARY_NOTE.encode() in part for part in parts.values())


def _list_tools(parts: dict[str, bytes]) -> list[str]:
    """Programs and fonts that a file says it was made with."""
    return sorted(
        {tool.decode("latin-1") for pattern in _MADE_WITH for part in parts.values() for tool in pattern.findall(part)}
    )


def _show_difference(name: str, there: bytes, here: bytes) -> str:
    """Where a part differs first, and what stands there."""
    old, new = (part.decode("utf-8", "replace") for part in (there, here))
    start = next((k for k, (a, b) in enumerate(zip(old, new, strict=False)) if a != b), min(len(old), len(new)))
    begin = max(start - BEFORE, 0)
    return f"{name}: the file has {old[begin : begin + LONGEST]!r}, the record gives {new[begin : begin + LONGEST]!r}"


# --- the record that a file holds: JSON itself, or inside HTML, XLSX or PDF ---------------------------

Form = Literal["html", "pdf", "xlsx", "json"]
LARGEST_UNPACKED = 400_000_000  # bytes: a file that grows beyond is no report
RECORD_SHEET = "Record"
_HTML_RECORD = re.compile(rb'<script type="application/json" id="tailstack-record">(.*?)</script>', re.DOTALL)
_PDF_RECORD = re.compile(rb"<<[^<>]*/Type /EmbeddedFile.*?/Length (\d{1,10})>>\nstream\n", re.DOTALL)
_CELL = re.compile(r'<c r="([A-Z]+)(\d{1,7})"([^>]*?)(?:/>|>(.*?)</c>)', re.DOTALL)
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
        of_design = isinstance(error, DesignError)
        raise RequestError([_place_in_file(each, file, first_line, of_design) for each in error.problems]) from None


def _place_in_file(problem: Problem, file: str, first_line: int, of_design: bool) -> Problem:
    """At its line of the file, with what to do: the cures of a design's slips do not help there."""
    line = None if problem.line is None or first_line == 0 else problem.line + first_line - 1
    hint = ("" if of_design else problem.hint) or "give a file that tailstack report wrote, or a result"
    return replace(problem, file=file, line=line, column=None if line is None else problem.column, hint=hint)


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
    """What stands in the first column of its sheet, below the heading."""
    parts = unpack_streams(content, file)
    book = parts.get("xl/workbook.xml", b"").decode("utf-8", "replace")
    names = [unescape(each) for each in re.findall(r'<sheet name="([^"]*)"', book)]  # the first is in sheet1.xml
    if RECORD_SHEET not in names:
        raise _no_record(file, f"a spreadsheet of tailstack has one sheet {RECORD_SHEET!r}", 0)
    shared = [
        _plain("".join(_TEXT.findall(entry)))
        for entry in _SHARED.findall(parts.get("xl/sharedStrings.xml", b"").decode("utf-8", "replace"))
    ]
    page = parts.get(f"xl/worksheets/sheet{names.index(RECORD_SHEET) + 1}.xml", b"").decode("utf-8", "replace")
    rows = {}
    for column, row, attributes, inside in _CELL.findall(page):
        value = re.search(r"<v>(.*?)</v>", inside or "", re.DOTALL)
        text = value.group(1) if value else ""
        if 't="s"' in attributes and len(text) < 10 and text.isdecimal() and int(text) < len(shared):
            text = shared[int(text)]
        if column == "A" and int(row) > 1:
            rows[int(row)] = text
    return "".join(text for _, text in sorted(rows.items())).encode()


def unpack_streams(content: bytes, file: str) -> dict[str, bytes]:
    """The parts of a spreadsheet by their names.  Raises RequestError."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if sum(part.file_size for part in archive.infolist()) > LARGEST_UNPACKED:
                raise zipfile.BadZipFile("it is too large")
            return {part.filename: archive.read(part) for part in archive.infolist()}
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        detail = f"the spreadsheet cannot be unpacked: {error}"
        raise RequestError(Problem("", "bad-result", detail, "", file)) from None


def _plain(text: str) -> str:
    """A text of a spreadsheet without XML's escapes and its own."""
    return _ESCAPED.sub(lambda match: chr(int(match.group(1), 16)), unescape(text))

"""Whether the pages are what their record renders to, byte for byte; where they are not, what differs."""

from __future__ import annotations

import re
import zlib

from tailstack import __version__

from ..operations.rendering import render
from ..problems import PdfUnavailable
from .findings import DIFFERENT, NOT_COMPARED, SAME, AuditCheck
from .holding import Form, ReportFile, unpack_streams

MOST = 5  # differences that are told
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
        return AuditCheck("pages", NOT_COMPARED, words)
    there = _take_apart(held.form, held.content, file)
    try:
        fresh = render(held.result.kind, held.result.body, held.form, summary=held.form == "pdf" and _is_summary(there))
    except PdfUnavailable as error:
        return AuditCheck("pages", NOT_COMPARED, f"PDF cannot be rendered here: {error.problems[0].detail}")
    if fresh == held.content:
        return AuditCheck("pages", SAME, f"what the record renders to, byte for byte ({len(fresh):,} bytes)")
    here = _take_apart(held.form, fresh, file)
    if there == here:
        return AuditCheck("pages", SAME, "what the record renders to, part for part (packed by another zlib)")
    made = [", ".join(_list_tools(parts)) or "unknown programs" for parts in (there, here)]
    if made[0] != made[1]:
        words = f"made with {made[0]}, here with {made[1]}: the same versions and fonts are needed"
        return AuditCheck("pages", NOT_COMPARED, words)
    names = [name for name in dict.fromkeys([*here, *there]) if there.get(name) != here.get(name)]
    if names == [PLACES]:
        words = f"the same, but packed by another zlib: {PLACES}, the last stream, cannot be compared"
        return AuditCheck("pages", NOT_COMPARED, words)
    details = [_show_difference(name, there.get(name, b""), here.get(name, b"")) for name in names[:MOST]]
    more = [f"... and {len(names) - MOST} more"] if len(names) > MOST else []
    words = f"{len(names)} parts of the file are not what the record renders to"
    return AuditCheck("pages", DIFFERENT, words, (*details, *more))


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
    from ..report.pdf import SUMMARY_NOTE

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

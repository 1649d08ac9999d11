"""Whether the pages are what their record renders to, byte for byte; where they are not, what differs."""

from __future__ import annotations

import re
import zlib
from itertools import zip_longest

from tailstack import __version__

from ..operations.rendering import render
from ..problems import PdfUnavailable
from .findings import DIFFERENT, NOT_COMPARED, SAME, AuditCheck
from .holding import ReportFile, sheet_cells, sheet_names, unpack_streams

MOST = 5  # differences that are told
LONGEST = 90
_STREAM = re.compile(rb"stream\n(.*?)\nendstream", re.DOTALL)
_FONT = re.compile(rb"/BaseFont /([^\s/<>\[\]()]+)")
_CHARTS = re.compile(rb"tailstack [\w.+-]+, charts by (matplotlib [\w.+-]+)")
_PACKED = re.compile(rb"/Length \d+|startxref\n\d+")  # what hangs on how streams are packed
_PRODUCER = re.compile(rb"/Producer \(([^()]*)\)")


def pages_question(held: ReportFile, written_by: str, file: str) -> AuditCheck:
    """The file against what its record renders to here."""
    if held.form == "json":
        same = held.content.rstrip(b"\n") == held.result.body
        words = "canonical JSON" if same else "JSON that was laid out anew: the hash is of its canonical form"
        return AuditCheck("bytes", "same", words)
    if written_by != __version__:
        words = f"written by tailstack {written_by}, this is {__version__}: install that version to compare them"
        return AuditCheck("pages", NOT_COMPARED, words)
    try:
        summary = held.form == "pdf" and _is_summary(held.content)
        fresh = render(held.result.kind, held.result.body, held.form, summary=summary)
    except PdfUnavailable as error:
        return AuditCheck("pages", NOT_COMPARED, f"PDF cannot be rendered here: {error.problems[0].detail}")
    if fresh == held.content:
        return AuditCheck("pages", SAME, f"what the record renders to, byte for byte ({len(fresh):,} bytes)")
    if held.form != "xlsx":
        there, here = (_all(_CHARTS, content, _unpacked_streams(content)) for content in (held.content, fresh))
        if there != here:
            drawn = b", ".join(there).decode("latin-1") or "nothing"
            by = b", ".join(here).decode("latin-1") or "nothing"
            return AuditCheck("pages", NOT_COMPARED, f"charts by {drawn}, here by {by}: the same version is needed")
    if held.form == "html":
        return _lines(held.content, fresh)
    return (_cells if held.form == "xlsx" else _streams)(held.content, fresh, file)


def _is_summary(content: bytes) -> bool:
    """Whether a PDF says of itself that it is the one page of a report."""
    from ..report.pdf import SUMMARY_NOTE

    return bool(_all(re.compile(re.escape(SUMMARY_NOTE.encode())), content, _unpacked_streams(content)))


def _different(details: list[str], count: int, what: str) -> AuditCheck:
    more = [f"... and {count - MOST} more"] if count > MOST else []
    return AuditCheck("pages", DIFFERENT, f"{count} {what} not what the record renders to", (*details[:MOST], *more))


def _lines(content: bytes, fresh: bytes) -> AuditCheck:
    there, here = (text.decode("utf-8", "replace").split("\n") for text in (content, fresh))
    details = []
    for number, (old, new) in enumerate(zip_longest(there, here, fillvalue="(no line)"), 1):
        if old != new:
            start = next((k for k, (a, b) in enumerate(zip(old, new, strict=False)) if a != b), min(len(old), len(new)))
            begin = max(start - 20, 0)
            cut = [text[begin : begin + LONGEST] for text in (old, new)]
            details.append(f"line {number}: the file has {cut[0]!r}, the record gives {cut[1]!r}")
    return _different(details, len(details), "lines are")


def _cells(content: bytes, fresh: bytes, file: str) -> AuditCheck:
    there, here = (unpack_streams(book, file) for book in (content, fresh))
    if there == here:
        return AuditCheck("pages", SAME, "what the record renders to, part for part (packed by another zlib)")
    details = []
    for name in dict.fromkeys([*sheet_names(here), *sheet_names(there)]):
        old, new = (sheet_cells(book, name) for book in (there, here))
        if old is None or new is None:
            details.append(f"sheet {name!r} is {'missing' if old is None else 'not of the record'}")
            continue
        for column, row in dict.fromkeys([*new, *old]):
            a, b = old.get((column, row), ""), new.get((column, row), "")
            if a != b:
                difference = f"the file has {a[:LONGEST]!r}, the record gives {b[:LONGEST]!r}"
                details.append(f"sheet {name!r}, cell {column}{row}: {difference}")
    if details:
        return _different(details, len(details), "cells are")
    parts = sorted(name for name in {*there, *here} if there.get(name) != here.get(name))
    return _different([f"part {name}" for name in parts], len(parts), "parts of the spreadsheet are")


def _streams(content: bytes, fresh: bytes, file: str) -> AuditCheck:
    there, here = (_unpacked_streams(document) for document in (content, fresh))
    made = [
        next((match.decode("latin-1") for match in _all(_PRODUCER, document, streams)), "")
        for document, streams in ((content, there), (fresh, here))
    ]
    if made[0] != made[1]:
        words = f"drawn by {made[0] or 'an unknown program'}, here is {made[1]}: the same version is needed"
        return AuditCheck("pages", NOT_COMPARED, words)
    fonts = [sorted(set(_all(_FONT, document, streams))) for document, streams in ((content, there), (fresh, here))]
    families = [{font.partition(b"+")[2] for font in document_fonts} for document_fonts in fonts]
    if families[0] != families[1]:
        names = [", ".join(sorted(name.decode("latin-1") for name in family)) for family in families]
        return AuditCheck("pages", NOT_COMPARED, f"set in {names[0]}, here in {names[1]}: the same fonts are needed")
    between = [_STREAM.sub(b"stream", document) for document in (content, fresh)]
    if there == here and between[0] == between[1]:
        return AuditCheck("pages", SAME, "what the record renders to, stream for stream (packed by another zlib)")
    if there[:-1] == here[:-1] and _PACKED.sub(b"", between[0]) == _PACKED.sub(b"", between[1]):
        words = "the same, but packed by another zlib: its table of places, the last stream, cannot be compared"
        return AuditCheck("pages", NOT_COMPARED, words)
    count = sum(a != b for a, b in zip_longest(there, here))
    return _different([], max(count, 1), "parts of the PDF are")


def _unpacked_streams(document: bytes) -> list[bytes]:
    streams = []
    for packed in _STREAM.findall(document):
        try:
            streams.append(zlib.decompress(packed))
        except zlib.error:
            streams.append(packed)
    return streams


def _all(pattern: re.Pattern[bytes], document: bytes, streams: list[bytes]) -> list[bytes]:
    return [match for text in (document, *streams) for match in pattern.findall(text)]

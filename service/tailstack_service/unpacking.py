"""How much a table may unpack to.  A kilobyte of it can stand for gigabytes, which is refused while it is read.

What is counted is what the cells hold once they are read: the bytes of a text, eight for anything else.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import IO, Any
from xml.parsers.expat import ExpatError, ParserCreate
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile

from tailstack.errors import LimitError, Problem

from .environment import variable
from .problems import RequestError

LARGEST_CELL = 131_072  # characters; that of Python's ``csv``
LARGEST_BLOCK = 64_000_000  # bytes of the texts in a block
NUMBER_BYTES = 8
LARGEST_WORKBOOK = 500_000_000  # bytes of XML
MOST_SHEET_ROWS = 1_048_576  # of a sheet of XLSX, its header included
HARMLESS_XML = 500_000  # bytes; a tree of them takes some 20 MB
DEEPEST_XML = 64  # elements inside one another
MOST_TOGETHER = 200_000  # elements of XML in one row or text, or outside of all of them
LONGEST_TOKEN = 1_000_000  # bytes of a tag or comment
CHUNK = 65_536  # bytes that are unpacked at a time
SHEETS = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
CELL, TEXT = f"{SHEETS} c", f"{SHEETS} si"
UNITS = {f"{SHEETS} worksheet": f"{SHEETS} row", f"{SHEETS} sst": TEXT}  # what is read one at a time, by the root
SHORTEN = "leave the column out, or shorten its texts"


Column = Sequence[Any]


@dataclass(frozen=True, slots=True)
class ColumnBlock:
    """Some rows, as columns."""

    lines: Sequence[int]  # of each row in the file, counted from one
    columns: tuple[Column, ...]


@dataclass(frozen=True, slots=True)
class TableLimits:
    """Of one table.  Every method raises LimitError, or RequestError for what is no table at all."""

    file: str | None = None  # for refusals
    most_bytes: int | None = None  # of all cells; None: any, whoever asks has the memory

    def check(self, header: Sequence[str], blocks: Iterator[ColumnBlock]) -> Iterator[ColumnBlock]:
        """The blocks of a table, as long as they keep within the bounds."""
        held = 0
        for block in blocks:
            for place, column in enumerate(block.columns):
                nested = next((cell for cell in column if type(cell) in (list, dict)), None)
                if nested is not None:
                    self._refuse_nested(header[place], "lists" if isinstance(nested, list) else "objects")
                texts = [len(cell) if isinstance(cell, str) else 0 for cell in column]
                longest = max(texts, default=0)
                if longest > LARGEST_CELL:
                    self._refuse_cell(header[place], longest, block.lines[texts.index(longest)])
                held += sum(texts) + NUMBER_BYTES * texts.count(0)
            self._hold(held)
            yield block

    def check_columns(self, batch: Any) -> None:
        """The columns of a record batch of Arrow, before anything of it is looked at: cells are plain."""
        from pyarrow import types

        for name, kind in zip(batch.schema.names, batch.schema.types, strict=True):
            inner = getattr(kind, "storage_type", kind)
            inner = inner.value_type if types.is_dictionary(inner) else inner
            if types.is_nested(inner) or types.is_run_end_encoded(inner) or types.is_dictionary(inner):
                self._refuse_nested(str(name), str(kind))

    def check_batch(self, batch: Any, line: int) -> None:
        """Some rows of Arrow, the first of them ``line``, before their cells are made."""
        together = 0
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            lengths = _bytes_of_texts(column)
            longest = max(lengths, default=0)
            if longest > LARGEST_CELL:
                self._refuse_cell(str(name), longest, line + lengths.index(longest))
            together += sum(lengths)
        if together > LARGEST_BLOCK:
            detail = f"{batch.num_rows} rows hold {together} bytes of text; at most {LARGEST_BLOCK} are read together"
            raise self._limit(detail, SHORTEN, line)

    def check_workbook(self, stream: IO[bytes]) -> None:
        """A workbook before it is read: its XML is what a table needs, and not a tree that fills the memory."""
        stream.seek(0)
        with ZipFile(stream) as archive:
            entries = archive.infolist()
            unpacked = sum(entry.file_size for entry in entries)
            if unpacked > LARGEST_WORKBOOK:
                detail = f"the workbook unpacks to {unpacked} bytes; at most {LARGEST_WORKBOOK} are read"
                raise self._limit(detail, "save it with the table alone")
            for entry in entries:
                if entry.compress_type not in (ZIP_STORED, ZIP_DEFLATED):
                    raise self._no_workbook(f"{entry.filename[:80]!r} is packed in a way that XLSX does not know")
                if self.most_bytes is not None and entry.file_size > HARMLESS_XML:
                    with archive.open(entry) as content, suppress(ExpatError):  # a picture, or the reader says it
                        self._check_xml(content, entry.filename)
        stream.seek(0)

    def _check_xml(self, content: IO[bytes], name: str) -> None:
        """A part of a workbook: rows and shared texts are read one at a time, everything else is kept as a tree."""
        depth = together = outside = rows = cells = text = at = 0
        unit: str | None = None

        def begin(tag: str, _: list[str]) -> None:
            nonlocal unit, depth, together, outside, rows, cells, text, at
            depth += 1
            together += 1
            if depth > DEEPEST_XML:
                raise self._no_workbook(f"{name[:80]!r} has elements {depth} deep inside one another")
            if together > MOST_TOGETHER:
                raise self._no_workbook(f"{name[:80]!r} has more than {MOST_TOGETHER} elements in one place")
            if tag == CELL:
                text = 0
                cells += 1
                if not cells % 1024:
                    self._hold(cells * NUMBER_BYTES)
            elif not at and tag == unit:
                at, outside, together, text = depth, together, 0, 0
                rows += 1
                if rows > MOST_SHEET_ROWS:
                    raise self._no_workbook(f"{name[:80]!r} has more than {MOST_SHEET_ROWS} rows or texts")
            elif unit is None:
                unit = UNITS.get(tag, "")

        def end(_: str) -> None:
            nonlocal depth, together, at
            if depth == at:
                at, together = 0, outside
            depth -= 1

        def write(more: str) -> None:
            nonlocal text
            text += len(more)
            if unit and text > LARGEST_CELL:
                raise self._limit(f"{name[:80]!r} has a cell of more than {LARGEST_CELL} characters", SHORTEN)

        def refuse_types(*_: object) -> None:
            raise self._no_workbook(f"{name[:80]!r} declares a document type, which XLSX has none of")

        parser = ParserCreate(namespace_separator=" ")
        parser.buffer_text = parser.ordered_attributes = True
        parser.StartElementHandler, parser.EndElementHandler = begin, end
        parser.CharacterDataHandler, parser.StartDoctypeDeclHandler = write, refuse_types
        fed = 0
        while more := content.read(CHUNK):
            fed += len(more)
            parser.Parse(more)
            if fed - parser.CurrentByteIndex > LONGEST_TOKEN:
                raise self._limit(f"{name[:80]!r} has a tag of more than {LONGEST_TOKEN} bytes", SHORTEN)
        parser.Parse(b"", True)

    def _hold(self, held: int) -> None:
        if self.most_bytes is not None and held > self.most_bytes:
            detail = (
                f"the cells of the table hold more than {self.most_bytes} bytes, unpacked: texts, and 8 for a number"
            )
            hint = (
                f"leave columns out, send fewer rows, or start the service with a higher {variable('max_table_bytes')}"
            )
            raise self._limit(detail, hint)

    def _refuse_nested(self, name: str, kind: str) -> None:
        detail = f"column {name[:60]!r} holds {kind[:60]}; a cell is a number, a text, a date or nothing"
        raise RequestError(Problem("", "wrong-type", detail, "leave the column out", self.file))

    def _refuse_cell(self, name: str, length: int, line: int) -> None:
        detail = (
            f"a cell of column {name[:60]!r} in line {line} holds {length} characters; at most {LARGEST_CELL} are read"
        )
        raise self._limit(detail, SHORTEN, line)

    def _limit(self, detail: str, hint: str, line: int | None = None) -> LimitError:
        return LimitError(Problem("", "too-large", detail, hint, self.file, line))

    def _no_workbook(self, reason: str) -> RequestError:
        hint = "save it as .xlsx, the table on the first sheet"
        return RequestError(Problem("", "bad-table", f"this cannot be read as XLSX: {reason}", hint, self.file))


def _bytes_of_texts(column: Any) -> list[int]:
    """Of each row of an array of Arrow; empty where it holds no texts."""
    import numpy as np
    import pyarrow
    from pyarrow import compute, types

    while isinstance(column, pyarrow.ExtensionArray):
        column = column.storage
    indices = None
    if types.is_dictionary(column.type):
        column, indices = column.dictionary, column.indices
    kind = column.type
    if types.is_string_view(kind) or types.is_binary_view(kind):
        views = np.frombuffer(column.buffers()[1], dtype=np.int32).reshape(-1, 4)  # the length comes first
        lengths = pyarrow.array(views[column.offset : column.offset + len(column), 0])
    elif types.is_string(kind) or types.is_large_string(kind) or types.is_binary(kind) or types.is_large_binary(kind):
        lengths = compute.binary_length(column)
    else:
        return []
    if indices is not None:
        lengths = lengths.take(indices)
    return [length or 0 for length in lengths.to_pylist()]

"""Tables in files: CSV, lines of JSON, XLSX, Arrow and Parquet, read and written block by block.

A table is a header and blocks of columns; the whole of it is never in memory.  CSV says its separator by its header
(comma, semicolon or tab), numbers have a decimal point.  The bytes that are written depend on the cells alone.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial
from itertools import chain, islice
from math import isfinite
from typing import IO, Any, Literal, get_args
from zipfile import ZipFile

from tailstack.cures import cure_text
from tailstack.errors import Problem
from tailstack.json_text import write_json

from .problems import RequestError

Format = Literal["csv", "ndjson", "xlsx", "arrow", "parquet"]
FORMATS: tuple[Format, ...] = get_args(Format)
ENDINGS: dict[str, Format] = {
    ".csv": "csv", ".tsv": "csv", ".ndjson": "ndjson", ".jsonl": "ndjson", ".xlsx": "xlsx", ".arrow": "arrow",
    ".arrows": "arrow", ".parquet": "parquet",
}  # fmt: skip
MEDIA_TYPES: dict[Format, str] = {
    "csv": "text/csv",
    "ndjson": "application/x-ndjson",
    "xlsx": "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
    "arrow": "application/vnd.apache.arrow.stream",
    "parquet": "application/vnd.apache.parquet",
}
BLOCK = 1024  # rows
MOST_COLUMNS = 2_000
LARGEST_WORKBOOK = 500_000_000  # bytes, unpacked
MOST_SHEET_ROWS = 1_048_576  # of a sheet of XLSX, its header included
ROW_GROUP = 16  # blocks in a row group of Parquet
EPOCH = datetime(2000, 1, 1)  # when every workbook was made: equal tables have equal bytes

Column = Sequence[Any]


@dataclass(frozen=True, slots=True)
class Block:
    """Some rows, as columns."""

    lines: Sequence[int]  # of each row in the file, counted from one
    columns: tuple[Column, ...]


@dataclass(frozen=True, slots=True)
class Table:
    """A table that is being read."""

    header: tuple[str, ...]
    blocks: Iterator[Block]
    file: str | None = None  # for refusals
    delimiter: str = ","  # of CSV

    def refuse(
        self, code: str, detail: str, hint: str = "", line: int | None = None, column: int | None = None
    ) -> RequestError:
        """What is wrong with it, and where."""
        return RequestError(Problem("", code, detail, hint, self.file, line, column))

    def read_numbers(self, block: Block, column: int) -> list[float]:
        """A column of a block as numbers.  Raises RequestError with the line of what is none."""
        found = []
        for row, cell in enumerate(block.columns[column]):
            value = read_number(cell)
            if value is None:
                said = "is empty" if cell is None or cell == "" else f"is no number: {str(cell)[:40]!r}"
                hint = cure_text(cell, self.header[column]) if isinstance(cell, str) and cell else ""
                line = block.lines[row]
                detail = f"the cell of column {self.header[column]!r} in line {line} {said}"
                raise self.refuse("wrong-type", detail, hint or "every row has a number here", line, column + 1)
            found.append(value)
        return found


def read_number(cell: Any) -> float | None:
    """A finite number that stands in a cell, as a number or as text."""
    if isinstance(cell, str):
        try:
            cell = float(cell) if "_" not in cell else None
        except ValueError:
            return None
    if isinstance(cell, bool) or not isinstance(cell, int | float) or not isfinite(cell):
        return None
    return float(cell)


def format_of(name: str) -> Format:
    """By the ending of a file's name.  Raises RequestError."""
    found = next((form for ending, form in ENDINGS.items() if name.lower().endswith(ending)), None)
    if found is None:
        detail = f"{name!r} has no ending of a table"
        raise RequestError(Problem("", "unknown-format", detail, f"known: {', '.join(ENDINGS)}"))
    return found


# --- reading ----------------------------------------------------------------------------------------


def read_table(stream: IO[bytes], form: Format, file: str | None = None) -> Table:
    """The header now, the blocks as they are asked for.  Raises RequestError, then and there."""
    table = _READERS[form](stream, file)
    header = table.header
    if not header or len(header) > MOST_COLUMNS:
        raise table.refuse("wrong-header", f"a table has 1 to {MOST_COLUMNS} columns; got {len(header)}", line=1)
    for k, name in enumerate(header):
        if not name or name in header[:k]:
            what = f"two columns are called {name!r}" if name else "a column has no name"
            raise table.refuse("wrong-header", what, "the first row names every column, each once", 1, k + 1)
    return table


def _read_csv(stream: IO[bytes], file: str | None) -> Table:
    text = (line.decode("utf-8") for line in stream)
    try:
        head = next(text, "").removeprefix("\ufeff")
        delimiter = max("\t;,", key=head.count)
        header = tuple(cell.strip() for cell in next(csv.reader([head], delimiter=delimiter), []))
    except (UnicodeDecodeError, csv.Error) as error:
        raise RequestError(Problem("", "not-text", f"CSV is text in UTF-8: {error}", file=file, line=1)) from None

    def blocks() -> Iterator[Block]:
        reader, more = csv.reader(text, delimiter=delimiter), True
        while more:
            lines: list[int] = []
            rows: list[list[str]] = []
            try:
                while more and len(rows) < BLOCK:
                    row = next(reader, None)
                    more = row is not None
                    if not row:  # an empty line is none
                        continue
                    lines.append(reader.line_num + 1)
                    rows.append(row)
                    if len(row) != len(header):
                        detail = f"line {lines[-1]} has {len(row)} cells; the header has {len(header)}"
                        hint = f"cells are separated by {delimiter!r}, and one that holds it is quoted"
                        raise table.refuse("ragged", detail, hint, lines[-1])
            except (UnicodeDecodeError, csv.Error) as error:
                raise table.refuse("not-text", f"the table breaks off: {error}", line=reader.line_num + 1) from None
            if rows:
                yield Block(lines, tuple(zip(*rows, strict=True)))

    table = Table(header, blocks(), file, delimiter if delimiter in head else ",")
    return table


def _read_lines(stream: IO[bytes], file: str | None) -> Table:
    def parse(line: int, text: bytes) -> dict[str, Any]:
        try:
            row = json.loads(text)
        except (ValueError, RecursionError) as error:
            detail = f"line {line} is no JSON: {error}"
            raise RequestError(Problem("", "json-syntax", detail, file=file, line=line)) from None
        if not isinstance(row, dict):
            raise RequestError(Problem("", "wrong-type", f"line {line} is no JSON object", file=file, line=line))
        return row

    first = stream.readline()
    header = tuple(parse(1, first)) if first.strip() else ()

    def blocks() -> Iterator[Block]:
        lines = enumerate(chain([first], stream), 1)
        while rows := [(line, parse(line, text)) for line, text in islice(lines, BLOCK) if text.strip()]:
            for line, row in rows:
                if row.keys() != set(header):
                    other = min(row.keys() ^ set(header))
                    raise table.refuse("ragged", f"line {line} has other fields than the first: {other!r}", line=line)
            yield Block([line for line, _ in rows], tuple([row[name] for _, row in rows] for name in header))

    table = Table(header, blocks(), file)
    return table


@contextmanager
def _refusing(form: str, hint: str, file: str | None) -> Iterator[None]:
    """Another's reader says in its own way what is wrong with a file, and of a damaged one anything at all."""
    try:
        yield
    except RequestError:
        raise
    except Exception as error:
        said = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RequestError(
            Problem("", "bad-table", f"this cannot be read as {form}: {said[:200]}", hint, file)
        ) from None


def _read_workbook(stream: IO[bytes], file: str | None) -> Table:
    import openpyxl

    reading = partial(_refusing, "XLSX", "save it as .xlsx, the table on the first sheet", file)
    with reading():
        unpacked = sum(entry.file_size for entry in ZipFile(stream).infolist())
        if unpacked > LARGEST_WORKBOOK:
            raise ValueError(f"the workbook unpacks to {unpacked} bytes; at most {LARGEST_WORKBOOK} are read")
        stream.seek(0)
        book = openpyxl.load_workbook(stream, read_only=True, data_only=True)
        rows = book.worksheets[0].iter_rows(values_only=True)
        header = tuple("" if cell is None else str(cell).strip() for cell in next(rows, ()))
    while header and not header[-1]:
        header = header[:-1]

    def blocks() -> Iterator[Block]:
        line = 2
        with reading():
            while cells := [row[: len(header)] for row in islice(rows, BLOCK)]:
                while cells and all(cell is None for cell in cells[-1]):  # what was cleared below the table
                    cells.pop()
                if not cells:
                    return
                short = next((k for k, row in enumerate(cells) if len(row) < len(header)), None)
                if short is not None:
                    raise table.refuse(
                        "ragged", f"row {line + short} has fewer cells than the header", line=line + short
                    )
                yield Block(range(line, line + len(cells)), tuple(zip(*cells, strict=True)))
                line += len(cells)

    table = Table(header, blocks(), file)
    return table


def _read_arrow(stream: IO[bytes], file: str | None) -> Table:
    import pyarrow

    def open_batches() -> tuple[Any, Iterator[Any]]:
        magic = stream.read(6)
        stream.seek(0)
        if magic != b"ARROW1":
            reader = pyarrow.ipc.open_stream(stream)
            return reader.schema, iter(reader)
        whole = pyarrow.ipc.open_file(stream)
        return whole.schema, (whole.get_batch(k) for k in range(whole.num_record_batches))

    return _read_batches(open_batches, file)


def _read_parquet(stream: IO[bytes], file: str | None) -> Table:
    from pyarrow import parquet

    def open_batches() -> tuple[Any, Iterator[Any]]:
        reader = parquet.ParquetFile(stream)
        return reader.schema_arrow, reader.iter_batches(BLOCK)

    return _read_batches(open_batches, file)


def _read_batches(open_batches: Callable[[], tuple[Any, Iterator[Any]]], file: str | None) -> Table:
    reading = partial(_refusing, "Arrow or Parquet", "write it as an Arrow stream or as Parquet", file)
    with reading():
        schema, batches = open_batches()
        header = tuple(map(str, schema.names))

    def blocks() -> Iterator[Block]:
        line = 1
        with reading():
            for batch in batches:
                for start in range(0, batch.num_rows, BLOCK):
                    piece = batch.slice(start, BLOCK)
                    lines = range(line, line + piece.num_rows)
                    yield Block(lines, tuple(column.to_pylist() for column in piece.columns))
                    line = lines.stop

    return Table(header, blocks(), file)


_READERS: dict[Format, Callable[[IO[bytes], str | None], Table]] = {
    "csv": _read_csv, "ndjson": _read_lines, "xlsx": _read_workbook, "arrow": _read_arrow, "parquet": _read_parquet,
}  # fmt: skip


# --- writing ----------------------------------------------------------------------------------------


@dataclass(slots=True)
class Writer:
    """A table that is being written; ``numbers`` says of each column whether it holds numbers or texts."""

    stream: IO[bytes]
    header: tuple[str, ...]
    numbers: tuple[bool, ...]
    delimiter: str = ","
    count: int = field(default=0, init=False)

    def write(self, columns: Sequence[Column]) -> None:
        """Some rows, as columns."""
        raise NotImplementedError

    def close(self) -> None:
        """What comes last.  The stream stays open."""


class CsvWriter(Writer):
    """Cells as they came, lines that end with a line feed."""

    def write(self, columns: Sequence[Column]) -> None:
        text = io.StringIO()
        lines = csv.writer(text, delimiter=self.delimiter, lineterminator="\n")
        if not self.count:
            lines.writerow(self.header)
        lines.writerows(zip(*columns, strict=True))
        self.count += len(columns[0])
        self.stream.write(text.getvalue().encode())

    def close(self) -> None:
        if not self.count:
            self.write([[] for _ in self.header])


class LineWriter(Writer):
    """A JSON object a line; a number that is not there is null."""

    def write(self, columns: Sequence[Column]) -> None:
        rows = zip(*map(_values, columns, self.numbers), strict=True)
        self.stream.write(
            b"".join(f"{write_json(dict(zip(self.header, row, strict=True)))}\n".encode() for row in rows)
        )


class WorkbookWriter(Writer):
    """One sheet, its header frozen.  The rows are kept on the disk until it is closed."""

    _book: Any = None
    _sheet: Any = None

    def _open(self) -> None:
        import xlsxwriter

        plain = dict.fromkeys(("strings_to_formulas", "strings_to_urls", "strings_to_numbers"), False)
        self._book = xlsxwriter.Workbook(self.stream, {"constant_memory": True, **plain})
        self._book.set_properties({"author": "tailstack", "created": EPOCH})
        self._sheet = self._book.add_worksheet("scores")
        self._sheet.freeze_panes(1, 0)
        self._sheet.write_row(0, 0, self.header, self._book.add_format({"bold": True}))

    def write(self, columns: Sequence[Column]) -> None:
        if self._book is None:
            self._open()
        rows = list(zip(*map(_values, columns, self.numbers), strict=True))
        if self.count + len(rows) >= MOST_SHEET_ROWS:
            detail = f"a sheet of XLSX has {MOST_SHEET_ROWS} rows, its header included; this table has more"
            raise RequestError(Problem("", "too-many", detail, "write it as .csv or .parquet"))
        for row in rows:
            self.count += 1
            self._sheet.write_row(self.count, 0, row)

    def close(self) -> None:
        if self._book is None:
            self._open()
        self._book.close()


class ArrowWriter(Writer):
    """An Arrow stream; what is not there is null."""

    _sink: Any = None

    def _batch(self, columns: Sequence[Column]) -> Any:
        import pyarrow

        arrays = [
            pyarrow.array(_values(column, number), pyarrow.float64())
            if number
            else pyarrow.array([None if cell is None else str(cell) for cell in column], pyarrow.string())
            for column, number in zip(columns, self.numbers, strict=True)
        ]
        return pyarrow.RecordBatch.from_arrays(arrays, names=list(self.header))

    def _open(self, schema: Any) -> Any:
        import pyarrow

        return pyarrow.ipc.new_stream(self.stream, schema)

    def write(self, columns: Sequence[Column]) -> None:
        batch = self._batch(columns)
        if self._sink is None:
            self._sink = self._open(batch.schema)
        self._sink.write_batch(batch)

    def close(self) -> None:
        if self._sink is None:
            self._sink = self._open(self._batch([[] for _ in self.header]).schema)
        self._sink.close()


class ParquetWriter(ArrowWriter):
    """Parquet, some tens of thousands of rows a group."""

    _waiting: Any = None

    def _open(self, schema: Any) -> Any:
        from pyarrow import parquet

        self._waiting = []
        return parquet.ParquetWriter(self.stream, schema)

    def write(self, columns: Sequence[Column]) -> None:
        batch = self._batch(columns)
        if self._sink is None:
            self._sink = self._open(batch.schema)
        self._waiting.append(batch)
        if len(self._waiting) == ROW_GROUP:
            self._write_group()

    def _write_group(self) -> None:
        import pyarrow

        if self._waiting:
            self._sink.write_table(pyarrow.Table.from_batches(self._waiting))
            self._waiting.clear()

    def close(self) -> None:
        if self._sink is not None:
            self._write_group()
        ArrowWriter.close(self)


WRITERS: dict[Format, type[Writer]] = {
    "csv": CsvWriter, "ndjson": LineWriter, "xlsx": WorkbookWriter, "arrow": ArrowWriter, "parquet": ParquetWriter,
}  # fmt: skip


def _values(column: Column, number: bool) -> list[Any]:
    """Cells of a column of numbers as numbers, or None; of others as they are, or their text."""
    if number:
        return [read_number(cell) for cell in column]
    return [cell if cell is None or isinstance(cell, str | int | float) else str(cell) for cell in column]

"""Tables in files: CSV, lines of JSON, Arrow and Parquet, read and written block by block.

A table is a header and blocks of columns; the whole of it is never in memory.  CSV is read as all tables of people
(``tailstack.people_tables``).  The bytes that are written depend on the cells alone.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from decimal import Decimal
from functools import partial
from itertools import chain, islice
from math import isfinite
from typing import IO, Any, Literal, get_args

from tailstack.cures import cure_text
from tailstack.errors import LimitError, Problem
from tailstack.people_tables import (
    KEPT_ENDS,
    PeopleTable,
    is_missing,
    read_people_table,
    read_plain_number,
    split_heading,
)
from tailstack.results.json_text import find_repeated, write_json

from .problems import RequestError

Format = Literal["csv", "ndjson", "arrow", "parquet"]
FORMATS: tuple[Format, ...] = get_args(Format)
ENDINGS: dict[str, Format] = {
    ".csv": "csv", ".tsv": "csv", ".ndjson": "ndjson", ".jsonl": "ndjson", ".arrow": "arrow", ".arrows": "arrow",
    ".parquet": "parquet",
}  # fmt: skip
MEDIA_TYPES: dict[Format, str] = {"csv": "text/csv", "ndjson": "application/x-ndjson"}  # of those that HTTP takes
BLOCK = 1024  # rows
MOST_COLUMNS = 2_000
LEAST_PLAIN = -1e28  # numbers below it may be a mark of NDI's

Column = Sequence[Any]


@dataclass(frozen=True, slots=True)
class ColumnBlock:
    """Some rows, as columns."""

    lines: Sequence[int]  # of each row in the file, counted from one
    columns: tuple[Column, ...]


@dataclass(frozen=True, slots=True)
class TableReader:
    """A table that is being read."""

    header: tuple[str, ...]
    blocks: Iterator[ColumnBlock]
    file: str | None = None  # for refusals
    delimiter: str = ","  # of CSV
    rows: int = 0  # about how many there are, for the time that is left; 0: nobody knows
    text: PeopleTable | None = None  # of CSV
    floating: frozenset[int] = frozenset()  # columns of which the file itself says that they hold numbers alone

    def refuse(
        self, code: str, detail: str, hint: str = "", line: int | None = None, column: int | None = None
    ) -> RequestError:
        """What is wrong with it, and where."""
        return RequestError(Problem("", code, detail, hint, self.file, line, column))

    def describe(self) -> tuple[str, ...]:
        """What was left out, and what was read in another way than it is written, of the blocks so far."""
        return () if self.text is None else self.text.describe()

    def with_numbers(self, block: ColumnBlock, places: Sequence[int]) -> tuple[ColumnBlock, list[list[float]]]:
        """Columns of a block as numbers, and the block with numbers where a cell is one in its own way of writing.

        Raises RequestError with the line of what is no number.
        """
        columns, numbers = list(block.columns), []
        for place in places:
            values = self._read_plain_column(columns[place], block.lines, place)
            if not values:
                cells = columns[place]
                values = [self._read_cell(cell, line, place) for cell, line in zip(cells, block.lines, strict=True)]
                columns[place] = [
                    value if isinstance(cell, Decimal) or read_number(cell) != value else cell
                    for cell, value in zip(cells, values, strict=True)
                ]
            numbers.append(values)
        return ColumnBlock(block.lines, tuple(columns)), numbers

    def _read_plain_column(self, cells: Column, lines: Sequence[int], place: int) -> list[float]:
        """Cells that all are finite numbers with a decimal point, quickly; nothing where one may be another thing.

        What ``float`` takes beyond that: underscores, digits of other scripts, and words.
        """
        if self.text is None and not all(type(cell) is float or type(cell) is int for cell in cells):
            return []
        try:
            values = list(map(float, cells))
        except ValueError:
            return []
        if self.text is not None:
            together = "".join(cells)
            if not together.isascii() or "_" in together:
                return []
            if self.text.delimiter != "," and self.text.point is None and "." in together:
                at = next(k for k, cell in enumerate(cells) if "." in cell)
                self.text.find_number(cells[at], lines[at], place)
            if self.text.comma is not None:
                return []
        return values if all(map(isfinite, values)) and min(values, default=0.0) > LEAST_PLAIN else []

    def _read_cell(self, cell: Any, line: int, column: int) -> float:
        if self.text is not None and isinstance(cell, str):
            value = self.text.find_number(cell, line, column)
        else:
            value = read_number(cell)
        if value is not None and not is_missing(value):
            return value
        place = f"the cell of column {self.header[column]!r} in line {line}"
        if value is not None:
            detail = f"{place} holds -3.697314e28, by which NDI says that nothing was seen"
            raise self.refuse("missing-value", detail, "leave the row out", line, column + 1)
        reason = "is empty" if cell is None or cell == "" else f"is no number: {str(cell)[:40]!r}"
        hint = cure_text(cell, self.header[column]) if isinstance(cell, str) and cell else ""
        raise self.refuse("wrong-type", f"{place} {reason}", hint or "every row has a number here", line, column + 1)


def read_number(cell: Any) -> float | None:
    """A finite number that stands in a cell, as a number or as text with a decimal point."""
    if isinstance(cell, str):
        return read_plain_number(cell)
    if isinstance(cell, Decimal):
        cell = float(cell)
    if isinstance(cell, bool) or not isinstance(cell, int | float) or not isfinite(cell):
        return None
    return float(cell)


def hold_numbers(width: int, own: Collection[int], names: Sequence[str]) -> tuple[bool, ...]:
    """Which columns of an answer hold numbers: of the ``width`` of its table those at ``own``; of what is added P95 and
    the like, and what requirements limit (``value:``), whatever its unit; the reason behind it is a text."""
    kinds = (name.partition(":")[0] for name in names)
    return (*(k in own for k in range(width)), *(kind.endswith("_mm") or kind == "value" for kind in kinds), False)


def format_of(name: str) -> Format:
    """By the ending of a file's name.  Raises RequestError."""
    form = next((form for ending, form in ENDINGS.items() if name.lower().endswith(ending)), None)
    if form is None:
        hint = f"known: {', '.join(ENDINGS)}; save a sheet as CSV UTF-8"
        raise RequestError(Problem("", "unknown-format", f"{name!r} has no ending of a table", hint))
    return form


# --- reading ----------------------------------------------------------------------------------------


def read_table(stream: IO[bytes], form: Format, file: str | None = None) -> TableReader:
    """The header now, the blocks as they are asked for.  Raises RequestError, then and there."""
    table = _READERS[form](stream, file)
    header = table.header
    if not header or len(header) > MOST_COLUMNS:
        raise table.refuse("wrong-header", f"a table has 1 to {MOST_COLUMNS} columns; got {len(header)}", line=1)
    for k, name in enumerate(header):
        if not name or name in header[:k]:
            what = f"two columns are called {name!r}" if name else "a column has no name"
            hint = "the first row names every column, each once"
            raise table.refuse("wrong-header", what, hint, 1 if table.text is None else table.text.header_line, k + 1)
    return replace(table, blocks=_refuse_nested(table))


def _refuse_nested(table: TableReader) -> Iterator[ColumnBlock]:
    """The blocks of a table whose cells are plain.  Raises RequestError."""
    for block in table.blocks:
        for name, column in zip(table.header, block.columns, strict=True):
            if (nested := next((cell for cell in column if type(cell) in (list, dict)), None)) is not None:
                kind = "lists" if isinstance(nested, list) else "objects"
                detail = f"column {name[:60]!r} holds {kind}; a cell is a number, a text, a date or nothing"
                raise table.refuse("wrong-type", detail, "leave the column out")
        yield block


def _count_lines(stream: IO[bytes]) -> int:
    """Of what is still to be read; 0 where that cannot be read twice."""
    if not stream.seekable():
        return 0
    begin = stream.tell()
    count = sum(part.count(b"\n") for part in iter(partial(stream.read, 1 << 20), b""))
    stream.seek(begin)
    return count


def _read_csv(stream: IO[bytes], file: str | None) -> TableReader:
    count = _count_lines(stream)
    text = read_people_table(stream, file, RequestError)
    _check_units(text)

    def blocks() -> Iterator[ColumnBlock]:
        while block := list(islice(text.rows, BLOCK)):
            lines, rows = zip(*block, strict=True)
            yield ColumnBlock(lines, tuple(zip(*rows, strict=True)))

    return TableReader(text.header, blocks(), file, text.delimiter, max(count - text.header_line, 0), text)


def _check_units(text: PeopleTable) -> None:
    """Units in a row of their own are those of the fields that the columns are called like.  Raises RequestError."""
    for place, (name, unit) in enumerate(zip(text.header, text.units or (), strict=False)):
        fields = [split_heading(part)[1] for part in name.replace(".", "/").split("/")]
        if unit and unit not in fields:
            detail = f"column {name!r} has the unit {unit!r} in the row below; a column of a table of designs is in the"
            detail += " unit of its field"
            hint = "convert the numbers, and delete the row of units"
            raise text.refuse("wrong-header", detail, hint, text.header_line, place + 1)


LINES = 'each line is one object, {"name": "A", "views.AP.fiducial_noise_px": 0.2}, in UTF-8'


def _read_lines(stream: IO[bytes], file: str | None) -> TableReader:
    def collect(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        fields = dict(pairs)
        if len(fields) < len(pairs):
            raise KeyError(find_repeated(pairs))
        return fields

    def parse(line: int, text: bytes) -> dict[str, Any]:
        try:
            row = json.loads(text.rstrip(), object_pairs_hook=collect)
        except (ValueError, RecursionError) as error:
            place = f" from column {error.colno} on" if isinstance(error, json.JSONDecodeError) else ""
            detail = f"line {line} is not JSON{place}; got {text.decode(errors='replace').strip()[:60]!r}"
            hint = LINES
            if isinstance(error, json.JSONDecodeError) and error.msg == "Extra data":
                hint = f"end each object with LF; {KEPT_ENDS}"
            raise RequestError(Problem("", "json-syntax", detail, hint, file, line)) from None
        except KeyError as error:
            detail = f"line {line} has the field {error.args[0]!r} twice"
            raise RequestError(Problem("", "duplicate-key", detail, "leave one", file, line)) from None
        if not isinstance(row, dict):
            raise RequestError(Problem("", "wrong-type", f"line {line} is no JSON object", LINES, file, line))
        return row

    count = _count_lines(stream)
    at, first = next(((k, text) for k, text in enumerate(stream, 1) if text.strip()), (1, b""))
    header = tuple(parse(at, first)) if first else ()

    def blocks() -> Iterator[ColumnBlock]:
        lines = ((line, text) for line, text in enumerate(chain([first], stream), at) if text.strip())
        while rows := [(line, parse(line, text)) for line, text in islice(lines, BLOCK)]:
            for line, row in rows:
                if row.keys() != set(header):
                    other = min(row.keys() ^ set(header))
                    raise table.refuse("ragged", f"line {line} has other fields than the first: {other!r}", line=line)
            yield ColumnBlock([line for line, _ in rows], tuple([row[name] for _, row in rows] for name in header))

    table = TableReader(header, blocks(), file, rows=count)
    return table


@contextmanager
def _refusing(form: str, hint: str, file: str | None) -> Iterator[None]:
    """Another's reader says in its own way what is wrong with a file, and of a damaged one anything at all."""
    try:
        yield
    except (RequestError, LimitError, MemoryError):
        raise
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        detail = f"this cannot be read as {form}: {reason[:200]}"
        raise RequestError(Problem("", "bad-table", detail, hint, file)) from None


def _read_arrow(stream: IO[bytes], file: str | None) -> TableReader:
    import pyarrow

    def open_batches() -> tuple[Any, Iterator[Any], int]:
        alone = pyarrow.ipc.IpcReadOptions(use_threads=False)
        magic = stream.read(6)
        stream.seek(0)
        if magic != b"ARROW1":
            reader = pyarrow.ipc.open_stream(stream, options=alone)
            return reader.schema, iter(reader), 0
        whole = pyarrow.ipc.open_file(stream, options=alone)
        return whole.schema, (whole.get_batch(k) for k in range(whole.num_record_batches)), 0

    return _read_batches(open_batches, file)


def _read_parquet(stream: IO[bytes], file: str | None) -> TableReader:
    from pyarrow import parquet

    def open_batches() -> tuple[Any, Iterator[Any], int]:
        reader = parquet.ParquetFile(stream)
        return reader.schema_arrow, reader.iter_batches(BLOCK, use_threads=False), reader.metadata.num_rows

    return _read_batches(open_batches, file)


def _read_batches(open_batches: Callable[[], tuple[Any, Iterator[Any], int]], file: str | None) -> TableReader:
    reading = partial(_refusing, "Arrow or Parquet", "write it as an Arrow stream or as Parquet", file)
    with reading():
        schema, batches, count = open_batches()
        header = tuple(map(str, schema.names))

    def blocks() -> Iterator[ColumnBlock]:
        line = 1
        with reading():
            for batch in batches:
                if batch.num_rows:
                    batch.validate(full=True)  # an offset beyond its buffer would read what lies there in memory
                for start in range(0, batch.num_rows, BLOCK):
                    piece = batch.slice(start, BLOCK)
                    lines = range(line, line + piece.num_rows)
                    yield ColumnBlock(lines, tuple(column.to_pylist() for column in piece.columns))
                    line = lines.stop

    floating = frozenset(k for k, kind in enumerate(schema.types) if str(kind) in ("halffloat", "float", "double"))
    return TableReader(header, blocks(), file, rows=count, floating=floating)


_READERS: dict[Format, Callable[[IO[bytes], str | None], TableReader]] = {
    "csv": _read_csv, "ndjson": _read_lines, "arrow": _read_arrow, "parquet": _read_parquet,
}  # fmt: skip


# --- writing ----------------------------------------------------------------------------------------


@dataclass(slots=True)
class Writer:
    """A table that is being written; ``numbers`` says of each column whether it holds numbers or texts."""

    stream: IO[bytes]
    header: tuple[str, ...]
    numbers: tuple[bool, ...]
    delimiter: str = ","
    decimal: str = "."  # of CSV
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
        if self.decimal != ".":
            columns = [
                [(repr(cell).replace(".", self.decimal) if isinstance(cell, float) else cell) for cell in column]
                for column in columns
            ]
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
    """Parquet, a block a row group."""

    def _open(self, schema: Any) -> Any:
        from pyarrow import parquet

        return parquet.ParquetWriter(self.stream, schema)


WRITERS: dict[Format, type[Writer]] = {
    "csv": CsvWriter, "ndjson": LineWriter, "arrow": ArrowWriter, "parquet": ParquetWriter,
}  # fmt: skip


def _values(column: Column, number: bool) -> list[Any]:
    """Cells of a column of numbers as numbers, or None; of others as they are, or their text."""
    if number:
        return [read_number(cell) for cell in column]
    return [cell if cell is None or isinstance(cell, str | int | float) else str(cell) for cell in column]

"""Tables that are small as files and vast as tables: what each would be is in its name.

Made by other means than the code under test: zipfile, xlsxwriter, pyarrow's writers.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable

import pyarrow
import xlsxwriter
from pyarrow import parquet

from tailstack_service.tables import Format

NOISE = "views.AP.fiducial_noise_px"


def workbook(inside: bytes = b"", behind: bytes = b"") -> bytes:
    """A sheet of one row, with XML put in at the end of its rows and behind them."""
    plain, packed = io.BytesIO(), io.BytesIO()
    book = xlsxwriter.Workbook(plain)
    sheet = book.add_worksheet()
    sheet.write_row(0, 0, [NOISE, "note"])
    sheet.write_row(1, 0, [0.3, "plain"])
    book.close()
    with (
        zipfile.ZipFile(plain) as source,
        zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as target,
    ):
        for entry in source.infolist():
            content = source.read(entry)
            if entry.filename == "xl/worksheets/sheet1.xml":
                content = content.replace(b"</sheetData>", inside + b"</sheetData>" + behind)
            target.writestr(entry.filename, content)
    return packed.getvalue()


def arrow(rows: int, length: int, *, dictionary: bool) -> bytes:
    """A text of so many characters in every row."""
    texts = pyarrow.array(["x" * length] * (1 if dictionary else rows))
    if dictionary:
        texts = pyarrow.DictionaryArray.from_arrays(pyarrow.array([0] * rows, pyarrow.int32()), texts)
    table = pyarrow.table({NOISE: [0.3] * rows, "note": texts})
    stream = io.BytesIO()
    packed = pyarrow.ipc.IpcWriteOptions(compression="zstd")
    with pyarrow.ipc.new_stream(stream, table.schema, options=packed) as sink:
        sink.write_table(table)
    return stream.getvalue()


def repeated_arrow(times: int) -> bytes:
    """A stream of one batch again and again: 60,000 rows of one text of 1 kB, each cell and each block harmless."""
    rows = 60_000
    table = pyarrow.table({NOISE: [0.3] * rows, "note": pyarrow.array(["x" * 1_000] * rows)})
    packed = pyarrow.ipc.IpcWriteOptions(compression="zstd")
    streams = []
    for some in (table.slice(0, 0), table):
        sink = io.BytesIO()
        with pyarrow.ipc.new_stream(sink, table.schema, options=packed) as stream:
            for batch in some.to_batches():
                stream.write_batch(batch)
        streams.append(sink.getvalue())
    empty, once = streams
    begin, end = empty[:-8], empty[-8:]  # the end of a stream is eight bytes
    return begin + once[len(begin) : -8] * times + end


def parquet_table(rows: int, length: int, times: int = 1) -> bytes:
    """So many groups of rows with one text."""
    stream = io.BytesIO()
    texts = pyarrow.array(["x" * length] * rows, pyarrow.large_string())
    table = pyarrow.table({NOISE: [0.3] * rows, "note": texts})
    with parquet.ParquetWriter(stream, table.schema, compression="zstd") as writer:
        for _ in range(times):
            writer.write_table(table)
    return stream.getvalue()


def csv_columns(columns: int, rows: int) -> bytes:
    header = ",".join([NOISE, *(f"c{k}" for k in range(columns))])
    return f"{header}\n{('0.3' + ',' * columns + chr(10)) * rows}".encode()


BOMBS: dict[str, tuple[Format, Callable[[], bytes]]] = {
    "1 kB of Arrow: 200 rows of one text of 8 MB": ("arrow", lambda: arrow(200, 8_000_000, dictionary=True)),
    "10 kB of Arrow: a cell of 200 MB": ("arrow", lambda: arrow(1, 200_000_000, dictionary=False)),
    "30 kB of Arrow: 200 cells of 1 MB": ("arrow", lambda: arrow(200, 1_000_000, dictionary=False)),
    "1 kB of Arrow: 100,000 rows of one text of 100 kB": ("arrow", lambda: arrow(100_000, 100_000, dictionary=True)),
    "1 kB of Parquet: 50 rows of 4 MB": ("parquet", lambda: parquet_table(50, 4_000_000)),
    "1 kB of Parquet: 50 rows of 400 kB": ("parquet", lambda: parquet_table(50, 400_000)),
    "10 kB of Parquet: a cell of 200 MB": ("parquet", lambda: parquet_table(1, 200_000_000)),
    "1 MB of Arrow: 60,000 rows of 1 kB again and again": ("arrow", lambda: repeated_arrow(5)),
    "1 MB of Parquet: 50 rows of 100 kB again and again": ("parquet", lambda: parquet_table(50, 100_000, 2_000)),
    "10 kB of XLSX: elements a million deep": ("xlsx", lambda: workbook(b"<a>" * 10**6 + b"</a>" * 10**6)),
    "10 kB of XLSX: a million deep, behind": ("xlsx", lambda: workbook(b"", b"<a>" * 10**6 + b"</a>" * 10**6)),
    "10 kB of XLSX: three million elements": ("xlsx", lambda: workbook(b"", b"<a/>" * 3 * 10**6)),
    "10 kB of XLSX: a row of three million cells": (
        "xlsx", lambda: workbook(b"<row>" + b"<c/>" * 3 * 10**6 + b"</row>"),
    ),
    "20 kB of XLSX: three million rows": ("xlsx", lambda: workbook(b"<row/>" * 3 * 10**6)),
    "6 kB of XLSX: a row of the number 10^15": (
        "xlsx", lambda: workbook(b'<row r="1000000000000000"><c><v>1</v></c></row>'),
    ),
    "30 kB of XLSX: a cell of 30 MB": (
        "xlsx", lambda: workbook(b'<row><c t="inlineStr"><is><t>' + b"x" * 30_000_000 + b"</t></is></c></row>"),
    ),
    "600 kB of XLSX: 600 MB of spaces": ("xlsx", lambda: workbook(b" " * 600_000_000)),
    "1 MB of CSV: a cell": ("csv", lambda: f'{NOISE},note\n0.3,"{"x" * 1_000_000}"\n'.encode()),
    "8 MB of CSV: eight million cells": ("csv", lambda: csv_columns(1_900, 4_000)),
    "1 MB of lines: a cell": ("ndjson", lambda: json.dumps({NOISE: 0.3, "note": "x" * 1_000_000}).encode()),
    "1 MB of lines: a cell of 300,000 lists": (
        "ndjson", lambda: b'{"%b": 0.3, "note": [%b[]]}' % (NOISE.encode(), b"[]," * 300_000),
    ),
}  # fmt: skip

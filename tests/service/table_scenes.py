"""Tables of designs in every format, written and read by other means than the code under test."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Sequence
from typing import Any

import pyarrow
from pyarrow import parquet

from tailstack_service.tables import Format


def write_table(form: Format, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> bytes:
    rows, stream = list(rows), io.BytesIO()
    if form == "csv":
        text = io.StringIO()
        csv.writer(text).writerows([header, *rows])
        return text.getvalue().encode()
    if form == "ndjson":
        return b"".join(json.dumps(dict(zip(header, row, strict=True))).encode() + b"\n" for row in rows)
    table = pyarrow.table({name: list(cells) for name, cells in zip(header, zip(*rows, strict=True), strict=True)})
    if form == "parquet":
        parquet.write_table(table, stream)
    else:
        with pyarrow.ipc.new_stream(stream, table.schema) as sink:
            sink.write_table(table)
    return stream.getvalue()


def read_rows(form: Format, content: bytes) -> list[dict[str, Any]]:
    """Rows by the names of their columns; of text, what is a number as a number."""
    if form == "csv":
        lines = csv.DictReader(io.StringIO(content.decode()))
        return [{key: number_or_text(cell) for key, cell in row.items()} for row in lines]
    if form == "ndjson":
        return [json.loads(line) for line in content.splitlines()]
    if form == "parquet":
        return parquet.read_table(io.BytesIO(content)).to_pylist()  # type: ignore[no-any-return]
    return pyarrow.ipc.open_stream(content).read_all().to_pylist()  # type: ignore[no-any-return]


def number_or_text(cell: str | None) -> Any:
    try:
        return float(cell or "")
    except ValueError:
        return cell

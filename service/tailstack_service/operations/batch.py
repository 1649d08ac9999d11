"""A design scored once for each row of a table: numbers of it in the table's columns, P95 and the like beside them."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from io import BytesIO
from math import isfinite
from typing import IO, TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from tailstack.errors import DesignError, IllPosedError, LimitError, Problem
from tailstack.results.batch import ScoredTable

from ..console.answer import NOT_EVALUATED, PASS, Answer
from ..console.arguments import read_design, whole
from ..console.files import write_in_place
from ..console.progress import Progress
from ..names import variable
from ..problems import RequestError
from ..rendering.tables import table, wrap
from ..rendering.verdict import heading, join_blocks, provenance_text
from ..tables import MEDIA_TYPES, WRITERS, Block, Format, Table, format_of, read_table
from .content import canonical
from .effort import admission_seconds
from .operation import Call, JobRequest, LateImport, Operation, Pieces, Reception
from .options import Options
from .patches import NAMED, SHA256

if TYPE_CHECKING:
    from tailstack.batch import Batch
    from tailstack.design import Design

    from ..settings import Settings
    from ..tables import Column
    from .sent import Query, Sent

ColumnName = Literal[
    "p95_mm", "mean_norm_mm", "bias_norm_mm", "localisation_p95_mm", "value_mm", "within_limits", "verdict"
]


class BatchOptions(Options):
    """A table of numbers of the design, and what is wanted of each row."""

    table: Annotated[dict[str, list[float]], Field(min_length=1, max_length=2_000)] = Field(
        description="Columns by the number of the design that they give, in the unit of its field: a JSON pointer, "
        "/views/0/fiducial_noise_px, or a path of names, views.AP.fiducial_noise_px; * stands for every element. All "
        "have one length.",
        examples=[{"/views/0/fiducial_noise_px": [0.1, 0.2, 0.4]}],
    )
    columns: Annotated[list[ColumnName], Field(min_length=1)] = Field(
        ["p95_mm", "mean_norm_mm", "bias_norm_mm", "within_limits"],
        description="What is wanted: p95_mm, mean_norm_mm, bias_norm_mm and localisation_p95_mm of each target; "
        "value_mm, the quantile that each requirement limits; within_limits (yes, no), whether all of these are within "
        "their limits; verdict, which also takes how far the estimate can be trusted, and costs more.",
    )


@dataclass(slots=True)
class TableScores:
    """A table whose rows are scored as it is read."""

    batch: Batch
    table: Table
    places: tuple[int, ...]  # of the column of each pointer
    rows: int = field(default=0, init=False)
    refused: int = field(default=0, init=False)
    ways: dict[str, int] = field(default_factory=dict, init=False)

    @property
    def header(self) -> tuple[str, ...]:
        """The table's own columns, those of the answer, and the reason why a row has none."""
        return (*self.table.header, *self.batch.names, "reason")

    @property
    def numbers(self) -> tuple[bool, ...]:
        """Which columns hold numbers."""
        return hold_numbers(self.header, self.places)

    def blocks(self, threads: int | None = None) -> Iterator[list[Column]]:
        """The rows with their answers, in their order, as columns.  Raises RequestError for what is no table."""
        import numpy as np

        waiting: deque[tuple[Column, ...]] = deque()

        def read() -> Iterator[Any]:
            for block in self.table.blocks:
                waiting.append(block.columns)
                yield np.array([self.table.read_numbers(block, place) for place in self.places]).T

        for found in self.batch.score_blocks(read(), threads):
            self.rows += len(found.reasons)
            self.refused += sum(map(bool, found.reasons))
            self.ways = {way: self.ways.get(way, 0) + count for way, count in found.ways.items()}
            answers = [[None if cell != cell else cell for cell in column.tolist()] for column in found.columns]
            yield [*waiting.popleft(), *answers, found.reasons]

    def summary(self) -> str:
        """How many rows, and how they were computed."""
        ways = ", ".join(f"{count:,} {way}" for way, count in self.ways.items() if count)
        said = f"{self.rows:,} rows: {ways or 'none'}" + (f" ({self.batch.why})" if self.batch.why else "")
        carried = [name for k, name in enumerate(self.table.header) if k not in self.places]
        if carried:
            said += f"; carried along: {', '.join(carried[:8])}" + (", ..." if len(carried) > 8 else "")
        if self.refused:
            said += f"; {self.refused:,} could not be evaluated, the column reason says why"
        return said


def hold_numbers(header: Sequence[str], places: Sequence[int]) -> tuple[bool, ...]:
    """Which columns of an answer hold numbers: those of the table that gave some, and P95 and the like."""
    given = [header[place] for place in places]
    return tuple(name in given or name.partition(":")[0].endswith("_mm") for name in header)


def score_table(
    design: Design, table: Table, settings: Sequence[tuple[str, str]], columns: Sequence[str] | None
) -> TableScores:
    """``settings``: path and column of the table; without them, the columns that are called like paths: ``/a/0/b``, or
    with a dot.  Raises RequestError, SweepError.
    """
    from tailstack.batch import DEFAULT_COLUMNS, Batch

    header = table.header
    for path, name in settings:
        if name not in header:
            from tailstack.cures import ask_meant

            hint = ask_meant(name, header, f"the table has {', '.join(header[:12])}")
            raise table.refuse("wrong-header", f"the table has no column {name!r}, which is to give {path}", hint, 1)
    chosen = list(settings) or [(name, name) for name in header if name.startswith("/") or "." in name]
    if not chosen:
        detail = f"no column is called like a number of the design: {', '.join(header[:12])}"
        hint = "call columns by JSON pointers or paths (views.AP.fiducial_noise_px), or say which is which: --set"
        raise table.refuse("wrong-header", detail, hint, 1)
    batch = Batch(design, [path for path, _ in chosen], columns or DEFAULT_COLUMNS)
    taken = sorted({*batch.names, "reason"}.intersection(header))
    if taken:
        detail = f"the table has a column {taken[0]!r} already, which the answer would add"
        raise table.refuse("wrong-header", detail, "rename it or leave it out", 1)
    return TableScores(batch, table, tuple(header.index(name) for _, name in chosen))


# --- tailstack score DESIGN --batch TABLE -----------------------------------------------------------


def add_batch_arguments(parser: argparse.ArgumentParser) -> None:
    """The flags of ``score`` for a table of designs."""
    group = parser.add_argument_group("a table of designs")
    group.add_argument(
        "--batch", metavar="TABLE", help="score the design once for each row of a table (.csv, .ndjson, .xlsx, .arrow, "
        ".parquet; - reads CSV from stdin): columns called by JSON pointers or paths give numbers of it, the others go "
        "along",
    )  # fmt: skip
    group.add_argument(
        "--set", dest="settings", action="append", metavar="PATH=COLUMN", type=_setting, default=[],
        help="the column that gives a number of the design, where it is not called like it; once for each",
    )  # fmt: skip
    group.add_argument(
        "--columns", metavar="A,B", help="what is added: p95_mm, mean_norm_mm, bias_norm_mm, localisation_p95_mm, "
        "value_mm (of each requirement), within_limits, verdict (much slower); default the first three and "
        "within_limits",
    )  # fmt: skip
    group.add_argument("-o", "--output", metavar="FILE", help="a table; its ending decides the format (default stdout)")
    group.add_argument("--threads", type=whole(1, 256), metavar="N", help="threads; the answer does not depend on it")


def _setting(text: str) -> tuple[str, str]:
    path, found, column = text.partition("=")
    if not (path and found and column):
        raise argparse.ArgumentTypeError(f"expected PATH=COLUMN like views.AP.fiducial_noise_px=noise; got {text!r}")
    return path, column


def refuse_beside_batch(arguments: argparse.Namespace) -> None:
    """Flags that mean nothing together.  Raises RequestError."""
    alone = {"--set": arguments.settings, "--columns": arguments.columns, "-o": arguments.output,
             "--threads": arguments.threads}  # fmt: skip
    single = {"--json": arguments.json, "--second-order": arguments.second_order, "--target": arguments.target}
    for flag, value in (alone if arguments.batch is None else single).items():
        if value:
            said = "is of --batch TABLE, which is not there" if arguments.batch is None else "is not of --batch"
            raise RequestError(Problem("", "unused-option", f"{flag} {said}", "leave it out"))


def run_batch(arguments: argparse.Namespace) -> Answer:
    """Score the rows of a table.  Raises RequestError, SweepError, DesignError, OSError."""
    design = read_design(arguments.design)

    arguments.verb = "score --batch"  # which kernels are compiled ahead, if any are missing
    name = arguments.batch
    if name == "-" == arguments.design:
        raise RequestError(Problem("", "given-twice", "stdin gives the design or the table, not both", "name a file"))
    form = "csv" if name == "-" else format_of(name)
    target = form if arguments.output is None else format_of(arguments.output)
    if arguments.output is None and target not in ("csv", "ndjson"):
        detail = f"a table as {target} is not written to stdout"
        raise RequestError(Problem("", "no-output", detail, "name a file: -o scores." + target))
    columns = None if arguments.columns is None else [part.strip() for part in arguments.columns.split(",")]
    with ExitStack() as stack:
        stream = sys.stdin.buffer if name == "-" else stack.enter_context(open(name, "rb"))
        scores = score_table(design, read_table(stream, form, name), arguments.settings, columns)
        begun = time.monotonic()
        progress = stack.enter_context(Progress("score"))
        if arguments.output is None:
            _write(scores, sys.stdout.buffer, target, arguments.threads, progress)
        else:
            with write_in_place(arguments.output) as file:
                _write(scores, file, target, arguments.threads, progress)
        seconds = time.monotonic() - begun
    print(f"{scores.summary()}; {scores.rows / max(seconds, 1e-9):,.0f} rows/s", file=sys.stderr)
    return Answer("", NOT_EVALUATED if scores.refused else PASS)


def _write(scores: TableScores, stream: IO[bytes], form: Format, threads: int | None, progress: Progress) -> None:
    writer = WRITERS[form](stream, scores.header, scores.numbers, scores.table.delimiter)
    for columns in scores.blocks(threads):
        writer.write(columns)
        progress.report(0, 0, f"{scores.rows:,} rows")
    writer.close()
    stream.flush()


# --- over HTTP --------------------------------------------------------------------------------------

MOST_ROWS = 10_000_000  # of a call in Python, which has them in memory anyway
SECONDS_A_ROW = {"compiled": 3e-5, "linearised": 4e-3, "in full": 0.03}  # and target, on a slow core
ROWS_A_UNIT = {"compiled": 4096, "linearised": 128, "in full": 32}
QUERY = {
    NAMED: {
        "type": "string", "pattern": "^[0-9a-f]{64}$",
        "description": "The design: the SHA-256 of one that was sent whole before.",
    },
    "set": {
        "type": "array", "items": {"type": "string", "pattern": "^[^=]+=.+$"},
        "description": "PATH=COLUMN: the column that gives a number of the design, where it is not called like it.",
    },
    "columns": {"type": "string", "description": "What is wanted, with commas between: p95_mm,verdict."},
}  # fmt: skip


def receive(sent: Sent, settings: Settings) -> Reception:
    """A table that is read whole and can be scored.  Raises RequestError, LimitError, MalformedError, Placed."""
    from tailstack.design.reading import Source

    from .sent import BaseNeeded, Request, load, read_request

    form: Format | Literal["json"] = "json"
    try:
        if sent.form == "json":
            request = read_request(sent, OPERATION, settings)
            table = _table_of(request.options.table)
            given = [(name, name) for name in table.header]
            columns: Sequence[str] | None = request.options.columns
        else:
            name, given, columns = _read_query(sent.query)
            if sent.base is None:
                raise BaseNeeded(name)
            design = load(Source(json.loads(sent.base), None, None), settings, "")
            request = Request(None, (design,), {}, ("",), False)
            sent_as = next(each for each, media in MEDIA_TYPES.items() if media == sent.form)
            form, table = sent_as, read_table(BytesIO(sent.body), sent_as)
    except BaseNeeded as needed:
        return Reception(base_sha256=needed.sha256)
    try:
        scores = score_table(request.design, table, given, columns)
    except (DesignError, IllPosedError) as error:
        raise request.place(error) from None
    cells = _read_cells(scores, settings.max_batch_rows)
    way = scores.batch.way
    seconds = SECONDS_A_ROW[way] * len(scores.batch.system.targets)
    return Reception(
        job=JobRequest("batch", _content(scores, cells), request.design.name),
        pieces=Pieces(form, len(cells[0]) * seconds, ROWS_A_UNIT[way] * seconds),
        designs=request.nameable if form == "json" and request.partial is None else (),
    )


def _read_cells(scores: TableScores, most: int) -> list[list[Any]]:
    """Every column of a table, as JSON can hold it.  Raises RequestError, LimitError."""
    table = scores.table
    cells: list[list[Any]] = [[] for _ in table.header]
    for block in table.blocks:
        for place in scores.places:
            table.read_numbers(block, place)
        for column, more in zip(cells, block.columns, strict=True):
            column += [cell if cell is None or isinstance(cell, str | int) else _plain(cell) for cell in more]
        if len(cells[0]) > most:
            detail = f"at most {most} rows are scored in one request; this table has more"
            hint = f"send fewer, or start the service with a higher {variable('max_batch_rows')}"
            raise LimitError(Problem("/table", "too-many", detail, hint))
    if not cells[0]:
        raise table.refuse("too-short", "the table has no rows", "each row is a design")
    return cells


def _content(scores: TableScores, cells: list[list[Any]]) -> bytes:
    """The request of a job."""
    batch = scores.batch
    return canonical({
        "design": batch.design.source.data, "header": scores.table.header, "cells": cells, "places": scores.places,
        "pointers": batch.pointers, "columns": batch.columns, "rows_a_unit": ROWS_A_UNIT[batch.way],
    })  # fmt: skip


def _plain(cell: Any) -> float | str | None:
    if isinstance(cell, float):
        return cell if isfinite(cell) else None
    return str(cell)


def _table_of(columns: Mapping[str, Sequence[float]]) -> Table:
    """Raises RequestError for columns of unequal length."""
    lengths = {name: len(cells) for name, cells in columns.items()}
    if len(set(lengths.values())) != 1:
        said = ", ".join(f"{name} has {length}" for name, length in list(lengths.items())[:6])
        raise RequestError(Problem("/table", "ragged", f"columns have one length; {said}", "one number for each row"))
    return Table(tuple(columns), iter([Block(range(1, 1 + max(lengths.values())), tuple(columns.values()))]))


def _read_query(query: Query) -> tuple[str, list[tuple[str, str]], list[str] | None]:
    """The design's hash, the columns that are set, and those that are wanted.  Raises RequestError."""
    from .sent import refuse_query, single

    refuse_query(query, tuple(QUERY))
    name = single(query, NAMED)
    if name is None or not SHA256.fullmatch(name):
        detail = f"a table alone says which design it is about by {NAMED}=, 64 hexadecimal digits"
        hint = f"send the design to /v1/validations or /v1/scores first: {NAMED} of the answer is it"
        raise RequestError(Problem(f"/{NAMED}", "missing-parameter" if name is None else "bad-text", detail, hint))
    given = []
    for text in (value for key, value in query if key == "set"):
        path, found, column = text.partition("=")
        if not (path and found and column):
            raise RequestError(Problem("/set", "bad-parameter", f"set is PATH=COLUMN; got {text[:80]!r}"))
        given.append((path, column))
    columns = single(query, "columns")
    return name, given, None if columns is None else columns.split(",")


def _run(call: Call) -> ScoredTable:
    from .units.batch import score_whole

    table = _table_of(call.options.table)
    scores = score_table(call.design, table, [(name, name) for name in table.header], call.options.columns)
    return score_whole(json.loads(_content(scores, _read_cells(scores, MOST_ROWS))))


def _text(record: ScoredTable) -> str:
    names = [name for name in record.columns if name not in (*record.pointers, "reason")]
    shown = [
        [str(row + 1), *(_cell(record.columns[name][row]) for name in names)] for row in range(min(record.rows, 40))
    ]
    more = f"{record.rows - len(shown):,} further rows are in the record (--json)." if record.rows > len(shown) else ""
    refused = f"{record.refused:,} rows could not be scored; the column reason says why." if record.refused else ""
    return join_blocks(
        heading(record.provenance, f"{record.rows:,} designs of a table, each estimated.", "first order"),
        table(["row", *names], shown),
        "\n".join(wrap(part) for part in (more, refused) if part),
        provenance_text(record.provenance),
    )


def _cell(cell: float | str | None) -> str:
    return f"{cell:.4f}" if isinstance(cell, float) else str(cell or "")


OPERATION = Operation(
    name="batch",
    verb="score",
    path="/v1/scores/batch",
    summary="Score a design once for each row of a table",
    description="The design with the numbers of each row in it, scored; the table comes back with columns beside it. "
    "A table as CSV, lines of JSON, XLSX, Arrow or Parquet names its design in the query and comes back in its own "
    "format, or in one that Accept asks for: CSV and lines of JSON as they are computed, the others when they are "
    "complete. A table in JSON comes back as the record. A row that cannot be scored keeps its place and says why. "
    "With Prefer: respond-async or wait=N it becomes a job, whose result is the record.",
    title="answer of score --batch over HTTP: a table of designs, scored",
    options=BatchOptions,
    example={"table": {"/views/0/fiducial_noise_px": [0.1, 0.2, 0.4]}},
    example_title="Three levels of noise",
    record=lambda: ScoredTable,
    run=_run,
    cut=True,
    receive=receive,
    media=tuple(MEDIA_TYPES.values()),
    media_limit="max_step_bytes",
    answers=tuple(MEDIA_TYPES.values()),
    query=tuple(QUERY),
    query_schemas=lambda: QUERY,
    hint="table and columns go into the body, beside the design",
    yaml=False,
    at_once="unless Prefer asks for a job",
    seconds=admission_seconds,
    text=_text,
    document=LateImport("..report.chapters.batch", "batch_document"),
    exit_code=lambda record: NOT_EVALUATED if record.refused else PASS,
)

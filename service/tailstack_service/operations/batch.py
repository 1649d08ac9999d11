"""A design scored once for each row of a table: numbers of it in the table's columns, P95 and the like beside them."""

from __future__ import annotations

import argparse
import json
import sys
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import lru_cache, partial
from io import BytesIO
from math import isfinite
from typing import IO, TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from tailstack.cures import ask_label
from tailstack.errors import DesignError, IllPosedError, LimitError, Problem
from tailstack.people_tables import Rows
from tailstack.results.batch import ScoredTable

from ..console.command_line import NOT_EVALUATED, PASS, Answer, read_design, whole
from ..console.files import keep_inputs, write_in_place
from ..console.flags import NO_FLAG, Flag, add_flags, list_options
from ..console.progress import Progress
from ..environment import variable
from ..problems import RequestError
from ..processes.task import NAMED, Estimated, Query, RawRequest
from ..tables import (
    MEDIA_TYPES,
    WRITERS,
    Column,
    ColumnBlock,
    CsvWriter,
    Format,
    TableReader,
    format_of,
    hold_numbers,
    read_table,
)
from .content import canonical
from .operation import Body, JobRequest, LateImport, Operation, Options, Pieces, Reception, score_seconds, size_of

if TYPE_CHECKING:
    from tailstack.batch import Batch
    from tailstack.design import Design

    from ..settings import Settings
    from .request import Request

ColumnName = Literal[
    "p95_mm", "mean_norm_mm", "bias_norm_mm", "localisation_p95_mm", "value", "within_limits", "verdict"
]

TABLE = "a table of designs"  # heading of flags
COLUMNS = Flag(
    "what is added: p95_mm, mean_norm_mm, bias_norm_mm, localisation_p95_mm, value (of each requirement), "
    "within_limits, verdict (much slower); default the first three and within_limits",
    metavar="A,B",
    heading=TABLE,
)


class BatchOptions(Options):
    """A table of numbers of the design, and what is wanted of each row."""

    table: Annotated[dict[str, list[float]], Field(min_length=1, max_length=2_000), NO_FLAG] = Field(
        examples=[{"/views/0/fiducial_noise_px": [0.1, 0.2, 0.4]}]
    )
    """Columns by the number of the design that they give, in the unit of its field: a JSON pointer,
    /views/0/fiducial_noise_px, or a path of names, views.AP.fiducial_noise_px; * stands for every element. All have one
    length."""
    columns: Annotated[list[ColumnName], Field(min_length=1), COLUMNS] = Field(
        ["p95_mm", "mean_norm_mm", "bias_norm_mm", "within_limits"]
    )
    """What is wanted: p95_mm, mean_norm_mm, bias_norm_mm and localisation_p95_mm of each target; value, the quantile
    that each requirement limits; within_limits (yes, no, or open: not known), whether all of these are within theirs;
    verdict, which also takes how far the estimate can be trusted, and costs more."""


@dataclass(slots=True)
class TableScores:
    """A table whose rows are scored as it is read."""

    batch: Batch
    table: TableReader
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
        """Which columns hold numbers: of what is carried along those alone of which the file says so."""
        return hold_numbers(len(self.table.header), {*self.places, *self.table.floating}, self.batch.names)

    def blocks(self, threads: int | None = None) -> Iterator[list[Column]]:
        """The rows with their answers, in their order, as columns.  Raises RequestError for what is no table."""
        import numpy as np

        waiting: deque[tuple[Column, ...]] = deque()
        together = rows_a_unit(self.batch)  # so that what takes long says how far it is

        def read() -> Iterator[Any]:
            for block in self.table.blocks:
                block, columns = self.table.with_numbers(block, self.places)
                numbers = np.array(columns).T
                for first in range(0, len(numbers), together):
                    span = slice(first, first + together)
                    waiting.append(tuple(column[span] for column in block.columns))
                    yield numbers[span]

        for scored_block in self.batch.score_blocks(read(), threads):
            self.rows += len(scored_block.reasons)
            self.refused += sum(map(bool, scored_block.reasons))
            self.ways = {way: self.ways.get(way, 0) + count for way, count in scored_block.ways.items()}
            answers = [[None if cell != cell else cell for cell in column.tolist()] for column in scored_block.columns]
            yield [*waiting.popleft(), *answers, scored_block.reasons]

    def summary(self) -> str:
        """How many rows, and how they were computed."""
        ways = ", ".join(f"{count:,} {way}" for way, count in self.ways.items() if count)
        text = f"{self.rows:,} rows: {ways or 'none'}" + (f" ({self.batch.why})" if self.batch.why else "")
        carried = [name for k, name in enumerate(self.table.header) if k not in self.places]
        if carried:
            text += f"; carried along: {', '.join(carried[:8])}" + (", ..." if len(carried) > 8 else "")
        if self.refused:
            text += f"; {self.refused:,} could not be evaluated, the column reason says why"
        return text


def score_table(
    design: Design, table: TableReader, settings: Sequence[tuple[str, str]], columns: Sequence[str] | None
) -> TableScores:
    """``settings``: path and column of the table; without them, the columns that are called like paths: ``/a/0/b``, or
    with a dot.  Raises RequestError, SweepError.
    """
    from tailstack.batch import DEFAULT_COLUMNS, Batch

    header = table.header
    for path, name in settings:
        if name not in header:
            hint = ask_label(name, header, f"the table has {', '.join(header[:12])}")
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
    group = parser.add_argument_group(TABLE)
    words = (
        "score the design once for each row of a table (.csv, .ndjson, .arrow, .parquet; - reads CSV from "
        "stdin): columns called by JSON pointers or paths give numbers of it, the others go along"
    )
    group.add_argument("--batch", metavar="TABLE", help=words)
    words = "the column that gives a number of the design, where it is not called like it; once for each"
    kind: dict[str, Any] = {"action": "append", "metavar": "PATH=COLUMN", "type": _setting, "default": []}
    group.add_argument("--set", dest="settings", help=words, **kind)
    add_flags(parser, BatchOptions)
    group.add_argument("-o", "--output", metavar="FILE", help="a table; its ending decides the format (default stdout)")
    group.add_argument("--threads", type=whole(1, 1024), metavar="N", help="threads; the answer does not depend on it")


def _setting(text: str) -> tuple[str, str]:
    path, separator, column = text.partition("=")
    if not (path and separator and column):
        raise argparse.ArgumentTypeError(f"expected PATH=COLUMN like views.AP.fiducial_noise_px=noise; got {text!r}")
    return path, column


def refuse_beside_batch(arguments: argparse.Namespace, options: type[Options]) -> None:
    """Flags that mean nothing together; ``options``: of a score without a table.  Raises RequestError."""
    alone = {"--set": arguments.settings or None, "-o": arguments.output, "--threads": arguments.threads}
    single = {"--json": arguments.json or None, "--target": arguments.target}
    for flags, kind in ((alone, BatchOptions), (single, options)):
        flags |= {each.spelling: getattr(arguments, each.name) for each in list_options(kind) if each.has_flag}
    for flag, value in (alone if arguments.batch is None else single).items():
        if value is not None:
            reason = "is of --batch TABLE, which is not there" if arguments.batch is None else "is not of --batch"
            raise RequestError(Problem("", "unused-option", f"{flag} {reason}", "leave it out"))


def run_batch(arguments: argparse.Namespace) -> Answer:
    """Score the rows of a table.  Raises RequestError, SweepError, DesignError, OSError."""
    design = read_design(arguments.design)

    arguments.verb = "score --batch"  # which kernels are compiled ahead, if any are missing
    name = arguments.batch
    if name == "-" == arguments.design:
        raise RequestError(Problem("", "given-twice", "stdin gives the design or the table, not both", "name a file"))
    form = "csv" if name == "-" else format_of(name)
    if arguments.output is not None:
        keep_inputs(arguments.output, (name, arguments.design))
    target = form if arguments.output is None else format_of(arguments.output)
    if arguments.output is None and target not in ("csv", "ndjson"):
        detail = f"a table as {target} is not written to stdout"
        raise RequestError(Problem("", "no-output", detail, "name a file: -o scores." + target))
    with ExitStack() as stack:
        stream = sys.stdin.buffer if name == "-" else stack.enter_context(open(name, "rb"))
        scores = score_table(design, read_table(stream, form, name), arguments.settings, arguments.columns)
        progress = stack.enter_context(Progress("score"))
        if arguments.output is None:
            _write(scores, sys.stdout.buffer, target, arguments.threads, progress)
        else:
            with write_in_place(arguments.output) as file:
                _write(scores, file, target, arguments.threads, progress)
        pace = f"; {scores.rows / max(progress.elapsed_seconds, 1e-9):,.0f} rows/s" if sys.stderr.isatty() else ""
    print(scores.summary() + pace, file=sys.stderr)
    for remark in scores.table.describe():
        print(f"note: {remark}", file=sys.stderr)
    return Answer("", NOT_EVALUATED if scores.refused else PASS)


def _write(scores: TableScores, stream: IO[bytes], form: Format, threads: int | None, progress: Progress) -> None:
    writer = WRITERS[form](stream, scores.header, scores.numbers, scores.table.delimiter)
    for columns in scores.blocks(threads):
        text = scores.table.text
        if isinstance(writer, CsvWriter) and text is not None and text.comma is not None:
            writer.decimal = ","
        writer.write(columns)
        progress.report(scores.rows, max(scores.table.rows, scores.rows), f"{scores.rows:,} rows")
    writer.close()
    stream.flush()


# --- over HTTP --------------------------------------------------------------------------------------

MOST_CELLS = 2_000_000  # of a table that was sent
SECONDS_A_ROW = {"compiled": 3e-5, "in full": 0.03}  # and target, on a slow core
SECONDS_ON_LATTICE, SECONDS_TOGETHER = 6e-4, 1e-3  # more, under other laws than normal, and where images move together
SECONDS_A_UNIT, ROWS_A_UNIT = 0.5, (32, 4096)
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


def row_seconds(batch: Batch) -> float:
    """How long a row takes, about."""
    more = SECONDS_ON_LATTICE * batch.on_lattice + SECONDS_TOGETHER * batch.moves_together
    return (SECONDS_A_ROW[batch.way] + more) * len(batch.system.targets)


def rows_a_unit(batch: Batch) -> int:
    """How many rows are computed in one go."""
    least, most = ROWS_A_UNIT
    return min(max(int(SECONDS_A_UNIT / row_seconds(batch)), least), most)


def receive(sent: RawRequest, settings: Settings) -> Reception | Estimated:
    """A table whose design was read.  Raises what ``_open`` raises."""
    request, *_ = _open(sent, settings)
    return Estimated(score_seconds([size_of(request.design)], losses=False), partial(_receive, sent, settings))


def _receive(sent: RawRequest, settings: Settings) -> Reception:
    """A table that is read whole and can be scored.  Raises RequestError, LimitError, MalformedError, RefusedAt."""
    from .units.batch import plan

    table = read_sent(sent, settings)
    if sent.as_job:
        return Reception(job=JobRequest("batch", canonical(table.content), table.name), designs=table.nameable)
    pieces = Pieces(table.form, table.seconds, table.unit_seconds, plan(table.content, ()).more)
    return Reception(pieces=pieces, designs=table.nameable)


@dataclass(frozen=True, slots=True)
class SentTable:
    """A table that was sent, read whole."""

    content: dict[str, Any]  # of the job that it could be
    name: str  # of the design
    form: Format | Literal["json"]
    seconds: float  # expected, of all rows
    unit_seconds: float  # and of those that are computed in one go
    nameable: tuple[tuple[str, bytes], ...]


@lru_cache(maxsize=2)
def read_sent(sent: RawRequest, settings: Settings) -> SentTable:
    """The last ones are kept: units of a table come to a process one after the other.

    Raises what ``receive`` raises.
    """
    request, given, columns, form = _open(sent, settings)
    table = _table_of(request.options.table) if form == "json" else read_table(BytesIO(sent.body), form)
    given = [(name, name) for name in table.header] if given is None else given
    try:
        scores = score_table(request.design, table, given, columns)
    except (DesignError, IllPosedError) as error:
        raise request.place(error) from None
    cells = _read_cells(scores, settings.max_batch_rows)
    batch = scores.batch
    row, together = row_seconds(batch), rows_a_unit(batch)
    content = canonical({
        "design": batch.design.source.data, "header": table.header, "cells": cells, "places": scores.places,
        "pointers": batch.pointers, "columns": batch.columns, "rows_a_unit": together,
    })  # fmt: skip
    nameable = request.nameable if form == "json" and not request.patched else ()
    name, count = request.design.name, len(cells[0])
    return SentTable(json.loads(content), name, form, count * row, together * row, nameable)


@lru_cache(maxsize=1)
def _open(
    sent: RawRequest, settings: Settings
) -> tuple[Request, list[tuple[str, str]] | None, Sequence[str] | None, Format | Literal["json"]]:
    """Of a table before it is read: its design, paths with their columns (None: every one), what is wanted, its form.

    Kept, because ``receive`` opens what is then read.

    Raises RequestError, LimitError, MalformedError, RefusedAt, DesignReferenceUnresolved.
    """
    from tailstack.design.reading import DocumentSource

    from .request import DesignReferenceUnresolved, Request, load

    if sent.form == "json":
        request = OPERATION.read(sent, settings)
        return request, None, request.options.columns, "json"
    name, given, columns = _read_query(sent.query)
    if sent.base is None:
        raise DesignReferenceUnresolved(name)
    design = load(DocumentSource(json.loads(sent.base), None, None), settings, "")
    form = next(each for each, media in MEDIA_TYPES.items() if media == sent.form)
    return Request(None, (design,), {}, ("",), False), given, columns, form


def _read_cells(scores: TableScores, most: int) -> list[list[Any]]:
    """Every column of a table, as JSON can hold it.  Raises RequestError, LimitError."""
    table = scores.table
    cells: list[list[Any]] = [[] for _ in table.header]
    for block in table.blocks:
        block, _ = table.with_numbers(block, scores.places)
        for column, more in zip(cells, block.columns, strict=True):
            column += [cell if cell is None or isinstance(cell, str | int) else _plain(cell) for cell in more]
        if len(cells) * len(cells[0]) > MOST_CELLS:
            detail = f"at most {MOST_CELLS} cells are read; this table has more"
            raise LimitError(Problem("/table", "too-many", detail, "leave columns out, or send fewer rows"))
        if len(cells[0]) > most:
            detail = f"at most {most} rows are scored in one request; this table has more"
            hint = f"send fewer, or start the service with a higher {variable('max_batch_rows')}"
            raise LimitError(Problem("/table", "too-many", detail, hint))
    counts = Rows() if table.text is None else table.text.counts
    if not cells[0]:
        reason = "; ".join(("the table has no rows", *counts.describe()))
        raise table.refuse("too-short", reason, "each row is a design")
    if {"remark", "title"} & counts.left_out.keys():  # an answer has no place to say it
        raise table.refuse("left-out", "; ".join(counts.describe()), "leave only the header and its rows")
    return cells


def _plain(cell: Any) -> float | str | None:
    if isinstance(cell, float):
        return cell if isfinite(cell) else None
    return str(cell)


def _table_of(columns: Mapping[str, Sequence[float]]) -> TableReader:
    """Raises RequestError for columns of unequal length."""
    lengths = {name: len(cells) for name, cells in columns.items()}
    if len(set(lengths.values())) != 1:
        listed = ", ".join(f"{name} has {length}" for name, length in list(lengths.items())[:6])
        raise RequestError(Problem("/table", "ragged", f"columns have one length; {listed}", "one number for each row"))
    return TableReader(
        tuple(columns), iter([ColumnBlock(range(1, 1 + max(lengths.values())), tuple(columns.values()))])
    )


def _read_query(query: Query) -> tuple[str, list[tuple[str, str]], list[str] | None]:
    """The design's hash, the columns that are set, and those that are wanted.  Raises RequestError."""
    from .request import SHA256, refuse_query, single

    refuse_query(query, tuple(QUERY))
    name = single(query, NAMED)
    if name is None or not SHA256.fullmatch(name):
        detail = f"a table alone says which design it is about by {NAMED}=, 64 hexadecimal digits"
        hint = f"send the design to /v1/validations or /v1/scores first: {NAMED} of the answer is it"
        raise RequestError(Problem(f"/{NAMED}", "missing-parameter" if name is None else "bad-text", detail, hint))
    given = []
    for text in (value for key, value in query if key == "set"):
        path, separator, column = text.partition("=")
        if not (path and separator and column):
            raise RequestError(Problem("/set", "bad-parameter", f"set is PATH=COLUMN; got {text[:80]!r}"))
        given.append((path, column))
    columns = single(query, "columns")
    return name, given, None if columns is None else columns.split(",")


OPERATION = Operation(
    name="batch",
    verb="score",
    path="/v1/scores/batch",
    summary="Score a design once for each row of a table",
    description="The design with the numbers of each row in it, scored; the table comes back with columns beside it. "
    "A table as CSV or lines of JSON names its design in the query and comes back as it is computed, in its own format "
    "or in the one that Accept asks for. A table in JSON comes back as the record. A row that cannot be scored keeps "
    "its place and says why. "
    "With Prefer: respond-async or wait=N it becomes a job, whose result is the record.",
    title="answer of score --batch over HTTP: a table of designs, scored",
    options=BatchOptions,
    example={"table": {"/views/0/fiducial_noise_px": [0.1, 0.2, 0.4]}},
    example_title="Three levels of noise",
    record=lambda: ScoredTable,
    cut=True,
    body=Body(
        receive=receive,
        query=lambda: QUERY,
        media=tuple(MEDIA_TYPES.values()),
        hint="table and columns go into the body, beside the design",
        at_once="unless Prefer asks for a job",
    ),
    document=LateImport("..report.chapters.batch", "batch_document"),
    exit_code=lambda record: NOT_EVALUATED if record.refused else PASS,
)

"""A design scored once for each row of a table: numbers of it in the table's columns, P95 and the like beside them."""

from __future__ import annotations

import argparse
import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import IO, TYPE_CHECKING, Any

from ..console.answer import NOT_EVALUATED, PASS, Answer
from ..console.arguments import read_design, whole
from ..console.files import write_in_place
from ..console.progress import Progress

if TYPE_CHECKING:
    from tailstack.batch import Batch
    from tailstack.design import Design

    from ..tables import Column, Format, Table


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
        own = tuple(k in self.places for k in range(len(self.table.header)))
        return (*own, *(name not in ("within_limits", "verdict") for name in self.batch.names), False)

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
    from tailstack.errors import Problem

    from ..problems import RequestError

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

    from tailstack.errors import Problem

    from ..problems import RequestError
    from ..tables import format_of, read_table

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
    from ..tables import WRITERS

    writer = WRITERS[form](stream, scores.header, scores.numbers, scores.table.delimiter)
    for columns in scores.blocks(threads):
        writer.write(columns)
        progress.report(0, 0, f"{scores.rows:,} rows")
    writer.close()
    stream.flush()

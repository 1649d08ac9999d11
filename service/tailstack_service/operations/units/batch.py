"""A table of designs in units: some of its rows each."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from functools import lru_cache
from io import BytesIO
from typing import Any

import numpy as np

from tailstack.batch import Batch
from tailstack.results.batch import ScoredTable
from tailstack.scoring import provenance

from ...documents import to_json
from ...processes.task import Outcome, UnitResult
from ...tables import WRITERS, Format, hold_numbers, read_number
from ..content import canonical, loaded_design
from .parts import plan_spans


def plan(request: dict[str, Any], results: Iterable[UnitResult]) -> Outcome:
    """Every row at once, then the record."""
    spans = plan_spans("rows", len(request["cells"][0]), request["rows_a_unit"], results)
    if isinstance(spans, Outcome):
        return spans
    return Outcome(answer=to_json(_record(request, [json.loads(span) for span in spans])))


def compute(request: dict[str, Any], spec: dict[str, Any]) -> bytes:
    """Some rows: their first, their columns, reasons and ways, as JSON."""
    batch = _batch(request)
    span = slice(spec["first"], spec["first"] + spec["count"])
    numbers = [[read_number(cell) for cell in request["cells"][place][span]] for place in request["places"]]
    block = batch.score_rows(np.array(numbers, dtype=float).T)
    columns = [[None if cell != cell else cell for cell in column.tolist()] for column in block.columns]
    return canonical({"first": spec["first"], "columns": columns, "reasons": block.reasons, "ways": block.ways})


def encode(request: dict[str, Any], result: bytes, form: Format, *, first: bool) -> bytes:
    """A unit as lines of CSV or JSON; ``first``: below the header."""
    batch, stream = _batch(request), BytesIO()
    header = (*request["header"], *batch.names, "reason")
    numbers = hold_numbers(len(request["header"]), request["places"], batch.names)
    writer = WRITERS[form](stream, header, numbers)
    writer.count = 0 if first else 1  # CSV has its header in front of the first row
    unit = json.loads(result)
    span = slice(unit["first"], unit["first"] + len(unit["reasons"]))
    writer.write([*(column[span] for column in request["cells"]), *unit["columns"], unit["reasons"]])
    return stream.getvalue()


def _record(request: dict[str, Any], units: Sequence[dict[str, Any]]) -> ScoredTable:
    batch = _batch(request)
    answers = {name: [cell for unit in units for cell in unit["columns"][k]] for k, name in enumerate(batch.names)}
    reasons = [reason for unit in units for reason in unit["reasons"]]
    own = dict(zip(request["header"], request["cells"], strict=True))
    for place in request["places"]:
        own[request["header"][place]] = [read_number(cell) for cell in request["cells"][place]]
    columns = {**own, **answers, "reason": reasons}
    return ScoredTable(
        schema="tailstack/batch/1",
        pointers={request["header"][k]: pointer for k, pointer in zip(request["places"], batch.pointers, strict=True)},
        columns={name: tuple(cells) for name, cells in columns.items()},
        rows=len(reasons),
        refused=sum(map(bool, reasons)),
        ways={way: sum(unit["ways"][way] for unit in units) for way in units[0]["ways"]},
        why=batch.why,
        provenance=provenance(batch.system),
    )


def _batch(request: dict[str, Any]) -> Batch:
    return compile_batch(canonical(request["design"]), tuple(request["pointers"]), tuple(request["columns"]))


@lru_cache(maxsize=4)
def compile_batch(design: bytes, pointers: tuple[str, ...], columns: tuple[str, ...]) -> Batch:
    """The last few are kept: units of a table come to a process one after the other."""
    return Batch(loaded_design(design), pointers, columns)

"""Results as files: read strictly, refused with line and reason where they are not whole."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain
from math import isfinite
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from tailstack.design.loading import read_source
from tailstack.design.reading import DocumentSource, show
from tailstack.design.refusals import place, refuse
from tailstack.errors import DesignError, LimitError, Problem, escape

from ..documents import from_plain, plain, to_json
from ..gate.reading import LIMITS
from ..problems import RequestError
from .registry import OPERATIONS
from .rendering import list_reported_names

SCHEMA = "tailstack/"
DESIGN = "tailstack/design/1"
EXIT_CODES = (0, 1, 2, 3, 4, 130)  # of a gate
HINT = "write it anew with --json (tailstack report: --format json)"


@dataclass(frozen=True, slots=True, eq=False)
class ReadResult:
    """A result of tailstack."""

    kind: str  # as schemas call it: score, report, ...
    record: Any  # the record itself
    body: bytes  # canonical JSON: what a report is made of, and what its hash is of


def read_document(given: bytes | Path | Mapping[str, Any], file: str) -> ReadResult | DocumentSource:
    """A result, or what is to be read as a design.  Raises RequestError, LimitError."""
    try:
        source = read_source(given, limits=LIMITS)
    except DesignError as error:
        raise RequestError([_in_file(problem, file) for problem in error.problems]) from None
    data = source.data
    schema = data.get("schema") if isinstance(data, dict) else None
    if not isinstance(schema, str) or not schema.startswith(SCHEMA) or schema == DESIGN:
        return source
    return result_of(source, schema, file)


def result_of(source: DocumentSource, schema: str, file: str) -> ReadResult:
    """The result in plain data.  Raises RequestError that says at which field, and in which line if that is known."""
    kind = schema.removeprefix(SCHEMA).partition("/")[0]
    if kind not in list_reported_names() or schema != f"{SCHEMA}{kind}/1":
        detail = f"no report is made of {show(schema)}"
        problem = Problem("/schema", "unsupported-schema", detail, f"results: {', '.join(list_reported_names())}")
        raise RequestError(_in_file(place(problem, source), file))
    try:
        record: Any = from_plain(OPERATIONS[kind].record(), source.data)
    except ValidationError as error:
        refused = refuse(error, source, LIMITS, BaseModel)
        raise RequestError([_in_file(_of_result(problem, schema), file) for problem in refused.problems]) from None
    stray = next(chain(_strays(source.data, plain(record), ""), _gaps(source.data, "")), None)
    if stray is not None:
        raise RequestError(_in_file(place(_of_result(stray, schema), source.with_places()), file))
    try:
        return ReadResult(kind, record, to_json(record))
    except ValueError as error:
        raise RequestError(_in_file(Problem("", "bad-result", str(error), HINT), file)) from None


def _strays(given: Any, recorded: Any, at: str) -> Iterator[Problem]:
    """Where a file says something that its record does not: fields nobody knows, texts for numbers, no numbers."""
    if isinstance(given, float) and not isfinite(given):
        yield Problem(at, "not-finite", f"must be a finite number; got {given}")
    elif isinstance(given, dict) and isinstance(recorded, dict):
        for key in given.keys() - recorded.keys():
            yield Problem(f"{at}/{escape(key)}", "unknown-field", "there is no such field")
        for key in given.keys() & recorded.keys():
            yield from _strays(given[key], recorded[key], f"{at}/{escape(key)}")
    elif isinstance(given, list) and isinstance(recorded, list | tuple):
        for index, (given_item, recorded_item) in enumerate(zip(given, recorded, strict=True)):
            yield from _strays(given_item, recorded_item, f"{at}/{index}")
    elif isinstance(given, bool) != isinstance(recorded, bool) or given != recorded:
        yield Problem(at, "wrong-type", f"{show(given)} does not belong here")


def _gaps(given: Any, at: str) -> Iterator[Problem]:
    """Where a result lacks what its fields promise: a target, an exit code of a gate."""
    if isinstance(given, dict):
        schema = given.get("schema")
        if schema in (f"{SCHEMA}score/1", f"{SCHEMA}verification/1") and not given.get("targets"):
            yield Problem(f"{at}/targets", "too-short", "there is one target at least")
        if schema == f"{SCHEMA}gate/1" and given.get("exit_code") not in EXIT_CODES:
            yield Problem(f"{at}/exit_code", "unknown-value", f"a gate leaves with {', '.join(map(str, EXIT_CODES))}")
        for key, inside in given.items():
            yield from _gaps(inside, f"{at}/{escape(key)}")


def _of_result(problem: Problem, schema: str) -> Problem:
    detail = f"this is not a whole {schema}: {problem.detail}"
    return replace(problem, code="bad-result", detail=detail, hint=HINT, fix=())


def _in_file(problem: Problem, file: str) -> Problem:
    return replace(problem, file=problem.file or file)


__all__ = ["DESIGN", "HINT", "LimitError", "ReadResult", "read_document", "result_of"]

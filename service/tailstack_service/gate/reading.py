"""What a gate judges by - policy, waivers, baseline - read and checked, hashed, and able to say where a value stands.

These documents go through the reader of designs, so they are refused in the same words: pointer, line, what arrived,
what to type instead.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from tailstack.design import Design
from tailstack.design.loading import read_source
from tailstack.design.reading import DEFAULT_LIMITS, DocumentSource, show
from tailstack.design.refusals import place, refuse
from tailstack.errors import DesignError, LimitError, Problem, TailstackError
from tailstack.results.json_text import write_json

from .records import GateFinding

# A gate record of hundreds of designs is longer than any design.
LIMITS = replace(DEFAULT_LIMITS, document_bytes=20_000_000, nodes=1_000_000)
Given = str | bytes | Path | Mapping[str, Any]
_Document = TypeVar("_Document", bound=BaseModel)


class GateError(
    TailstackError, slug="invalid-policy", title="The policy, waivers or baseline cannot be used", exit_code=2
):
    """The policy, the waivers or the baseline cannot be read, or breaks a rule."""


@dataclass(frozen=True, slots=True, eq=False)
class GateInput:
    """A document that a gate was given beside its designs, and where it came from."""

    source: DocumentSource
    file: str  # how findings call it
    sha256: str


@dataclass(frozen=True, slots=True, eq=False)
class GateDesign:
    """A design handed to the gate: read, or the reason why it could not be."""

    file: str  # how findings call it
    design: Design | None
    refusal: TailstackError | None = None
    design_class: str | None = None  # None: the policy's patterns decide
    names: tuple[str, ...] = ()  # of the file, that patterns see; none: ``file`` is the only one
    earlier: tuple[str, ...] = ()  # names that a baseline may have for the file, from where it lies

    @property
    def known_as(self) -> tuple[str, ...]:
        """The names that patterns of files are held against."""
        return self.names or (self.file,)


def read_document(
    given: Given, model: type[_Document], schema: str, prefix: str, hint: str
) -> tuple[DocumentSource, _Document]:
    """A document of one schema from a path, text or data.  Raises GateError.

    prefix: pointer to the document inside the request that it came in.  hint: what to do about an empty document.
    """
    source = read_data(given, schema, prefix, hint)
    try:
        return source, model.model_validate(source.data)
    except ValidationError as error:
        raise GateError(add_prefix(refuse(error, source, LIMITS, model).problems, prefix)) from None


def read_data(given: Given, schema: str, prefix: str, hint: str) -> DocumentSource:
    """Plain data that says it follows ``schema``.  Raises GateError."""
    try:
        source = read_source(given, limits=LIMITS)
    except (DesignError, LimitError) as error:
        problems = tuple(replace(p, hint=hint) if p.code == "empty-document" else p for p in error.problems)
        raise GateError(add_prefix(problems, prefix)) from None
    data = source.data
    if not isinstance(data, dict):
        problem = Problem("", "wrong-type", f"expected a mapping of fields; got {show(data)}", hint)
    elif data.get("schema") != schema:
        arrived = show(data["schema"]) if "schema" in data else "no schema"
        pointer = "/schema" if "schema" in data else ""
        detail = f"this is read as {schema}; got {arrived}"
        problem = Problem(pointer, "unsupported-schema", detail, f"schema: {schema}")
    else:
        return source
    raise GateError(add_prefix((place(problem, source),), prefix))


def add_prefix(problems: tuple[Problem, ...], prefix: str) -> list[Problem]:
    """Problems of a document with pointers into the request that the document came in."""
    return [replace(problem, pointer=prefix + problem.pointer) for problem in problems]


def hash_content(content: Any) -> str:
    """SHA-256 of plain data in its canonical text."""
    return hashlib.sha256(write_json(content, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class Remark:
    """What a rule says about a document."""

    pointer: str  # into the document
    message: str
    value: float | None = None
    limit: float | None = None
    target: str | None = None
    bound: float | None = None  # the end of the value's interval that a waiver must cover; None: the value itself
    about: str | None = None  # the rule whose waivers cover it, where that is another one
    unbounded: bool = False  # no end of the interval is known: no waiver covers it
    note: bool = False  # said for information, whatever the rule's severity


def place_finding(
    source: DocumentSource, file: str, rule: str, severity: str, remark: Remark, suppressed_by: str | None = None
) -> GateFinding:
    """What a rule says about a document, at the line and column that it is about."""
    problem = place(Problem(remark.pointer, rule, remark.message), source)
    finding = make_finding(rule, "note" if remark.note else severity, file, problem)
    return replace(finding, value=remark.value, limit=remark.limit, suppressed_by=suppressed_by)


def make_finding(rule: str, severity: str, file: str, problem: Problem) -> GateFinding:
    """A finding that says what a problem says, with its hint, where the problem stands."""
    message = problem.detail + (f" — {problem.hint}" if problem.hint else "")
    return GateFinding(
        rule, severity, message, problem.pointer, None, None,  # type: ignore[arg-type]
        file, problem.line, problem.column,
    )  # fmt: skip

"""Policy, waivers and baseline as they were read: checked, hashed, and able to say where a value stands.

They go through the reader of designs, so they are refused in the same words: pointer, line, what arrived, what to
type instead.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import date, timedelta
from difflib import get_close_matches
from fnmatch import fnmatchcase
from math import isfinite
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from tailstack.design.loading import read_source
from tailstack.design.reading import DEFAULT_LIMITS, Limits, Source, shown
from tailstack.design.refusals import escape, place, refuse
from tailstack.errors import DesignError, LimitError, Problem
from tailstack.json_text import write_json

from .case import ClassOfName
from .errors import GateError
from .policy_document import POLICY_SCHEMA, DesignClass, Policy, Rules
from .records import GateRecord
from .rules import RULES
from .waiver_document import LONGEST_DAYS, WAIVERS_SCHEMA, Waiver, Waivers

# A gate record of hundreds of designs is longer than any design.
LIMITS = replace(DEFAULT_LIMITS, document_bytes=20_000_000, nodes=1_000_000)
Given = str | bytes | Path | Mapping[str, Any]
_Document = TypeVar("_Document", bound=BaseModel)


@dataclass(frozen=True, slots=True, eq=False)
class ReadPolicy:
    """A policy and where it came from."""

    document: Policy
    source: Source
    file: str
    sha256: str

    def class_of(self, file: str, name: str, given: str | None) -> str | None:
        """The class of a design: the one that is given, or the first whose patterns match its file; its name counts
        only for a class that says so."""
        if given is not None:
            return given
        for entry in self.document.classes:
            by_file = any(fnmatchcase(file, pattern) for pattern in entry.files or ())
            if by_file or (entry.by_name and _pattern(entry, name) is not None):
                return entry.name
        return None

    def class_of_name(self, file: str, name: str, given: str | None) -> ClassOfName | None:
        """The class that the design's own name would choose before the one that it is in."""
        found = self.class_of(file, name, given)
        for entry in self.document.classes if given is None else ():
            if entry.name == found:
                return None
            if not entry.by_name and (pattern := _pattern(entry, name)) is not None:
                return ClassOfName(entry.name, pattern)
        return None

    def rules_for(self, design_class: str | None) -> Rules:
        """The rules of a class: its own fields before the policy's."""
        rules = self.document.rules
        own = next((entry.rules for entry in self.document.classes if entry.name == design_class), None)
        if own is None:
            return rules
        changed = {}
        for name in own.model_fields_set:
            entry = getattr(own, name)
            given = {field: getattr(entry, field) for field in entry.model_fields_set}
            changed[name] = getattr(rules, name).model_copy(update=given)
        return rules.model_copy(update=changed)


@dataclass(frozen=True, slots=True, eq=False)
class ReadWaivers:
    """Waivers and where they came from."""

    entries: tuple[Waiver, ...]
    source: Source
    file: str
    sha256: str


@dataclass(frozen=True, slots=True, eq=False)
class ReadBaseline:
    """An earlier gate, to compare with."""

    record: GateRecord
    source: Source
    file: str
    sha256: str


def _pattern(entry: DesignClass, name: str) -> str | None:
    return next((pattern for pattern in entry.designs or () if fnmatchcase(name, pattern)), None)


def read_policy(given: Given | None, *, name: str = "policy", prefix: str = "") -> ReadPolicy:
    """A policy from a path, text or data; None is the default policy.  Raises GateError.

    ``prefix`` is the pointer to the policy inside the request that it came in.
    """
    if given is None:
        given = {"schema": POLICY_SCHEMA, "name": "default"}
    source, document = _read(given, Policy, POLICY_SCHEMA, prefix, "the rules: tailstack schema policy")
    return ReadPolicy(document, source, source.file or name, _digest(document.model_dump(mode="json", by_alias=True)))


def read_waivers(given: Given, today: date, *, name: str = "waivers", prefix: str = "") -> ReadWaivers:
    """Waivers from a path, text or data.  Raises GateError, also for a date too far ahead of ``today``."""
    source, document = _read(given, Waivers, WAIVERS_SCHEMA, prefix, "the rules: tailstack schema waivers")
    problems = [problem for k, waiver in enumerate(document.waivers) for problem in _wrong(waiver, k, today)]
    if problems:
        placed = source.placed()
        raise GateError([_prefixed(place(problem, placed), prefix) for problem in problems])
    content = document.model_dump(mode="json", by_alias=True)
    return ReadWaivers(tuple(document.waivers), source, source.file or name, _digest(content))


def read_baseline(given: Given, *, name: str = "baseline", prefix: str = "") -> ReadBaseline:
    """The record of an earlier gate from a path, text or data.  Raises GateError."""
    from ..documents import from_plain

    hint = "write one with: tailstack gate DESIGN... --format json=baseline.json"
    source = _sourced(given, prefix, hint)
    _check_schema(source, "tailstack/gate/1", prefix, hint)
    try:
        record: GateRecord = from_plain("gate", source.data)
    except ValidationError as error:
        raise _refused(refuse(error, source, LIMITS, BaseModel), prefix) from None
    if (problem := _beyond_numbers(source.data, record.seed)) is not None:
        raise GateError(_prefixed(place(problem, source), prefix))
    if not any(design.targets for design in record.designs):
        detail = f"nothing was judged by this gate (verdict: {record.verdict}): it has no numbers to compare with"
        raise GateError(_prefixed(place(Problem("/designs", "no-numbers", detail, hint), source), prefix))
    return ReadBaseline(record, source, source.file or name, _digest(source.data))


def _beyond_numbers(data: Any, seed: int) -> Problem | None:
    """A number that no record holds, if there is one: a baseline is written by tailstack, but read from anywhere."""
    if not 0 <= seed < 2**63:
        return Problem("/seed", "out-of-range", f"a seed is a whole number from 0 to {2**63 - 1}; got {shown(seed)}")
    open_ends: list[tuple[str, Any]] = [("", data)]
    while open_ends:
        at, item = open_ends.pop()
        if isinstance(item, float) and not isfinite(item):
            return Problem(at, "not-finite", "the number is too large")
        if at.endswith("p95_mm") and item is not None and (not isinstance(item, int | float) or item < 0):
            return Problem(at, "wrong-type", f"expected a number of 0 or more; got {shown(item)}")
        children = item.items() if isinstance(item, dict) else enumerate(item) if isinstance(item, list) else ()
        open_ends += [(f"{at}/{escape(step)}", child) for step, child in children]
    return None


def _read(given: Given, model: type[_Document], schema: str, prefix: str, hint: str) -> tuple[Source, _Document]:
    source = _sourced(given, prefix, hint)
    _check_schema(source, schema, prefix, hint)
    try:
        return source, model.model_validate(source.data)
    except ValidationError as error:
        raise _refused(refuse(error, source, LIMITS, model), prefix) from None


def _sourced(given: Given, prefix: str, hint: str) -> Source:
    try:
        return read_source(given, limits=LIMITS)
    except (DesignError, LimitError) as error:
        problems = [replace(p, hint=hint) if p.code == "empty-document" else p for p in error.problems]
        raise _refused(DesignError(problems), prefix) from None


def _check_schema(source: Source, schema: str, prefix: str, hint: str) -> None:
    data = source.data
    got = data.get("schema") if isinstance(data, dict) else None
    if got == schema:
        return
    if not isinstance(data, dict):
        problem = Problem("", "wrong-type", f"expected a mapping of fields; got {shown(data)}", hint)
    else:
        arrived = shown(data["schema"]) if "schema" in data else "no schema"
        pointer = "/schema" if "schema" in data else ""
        problem = Problem(
            pointer, "unsupported-schema", f"this is read as {schema}; got {arrived}", f"schema: {schema}"
        )
    raise GateError(_prefixed(place(problem, source), prefix))


def _refused(error: DesignError, prefix: str) -> GateError:
    return GateError([_prefixed(problem, prefix) for problem in error.problems])


def _prefixed(problem: Problem, prefix: str) -> Problem:
    return replace(problem, pointer=prefix + problem.pointer)


def _digest(content: Any) -> str:
    return hashlib.sha256(write_json(content, sort_keys=True).encode()).hexdigest()


def _wrong(waiver: Waiver, index: int, today: date) -> list[Problem]:
    """What the schema cannot say of a waiver."""
    at = f"/waivers/{index}"
    rule = RULES.get(waiver.rule)
    if rule is None or rule.worse == "fixed":
        known = [name for name, entry in RULES.items() if entry.worse != "fixed"]
        close = get_close_matches(waiver.rule, known, 1)
        detail = f"no rule is called {shown(waiver.rule)}" if rule is None else f"{waiver.rule} cannot be waived"
        hint = f"did you mean {close[0]}?" if close else f"rules: {', '.join(known)}"
        return [Problem(f"{at}/rule", "unknown-value", detail, hint)]
    problems = []
    wanted, other = ("max_value", "min_value") if rule.worse == "more" else ("min_value", "max_value")
    if getattr(waiver, other) is not None:
        detail = f"of {waiver.rule}, {rule.worse} is worse: a waiver of it has {wanted}, not {other}"
        problems.append(Problem(f"{at}/{other}", "unused-field", detail, f"{wanted}: ..."))
    elif getattr(waiver, wanted) is None:
        detail = f"a waiver of {waiver.rule} says up to which value it holds ({rule.unit or 'no unit'})"
        problems.append(Problem(f"{at}/{wanted}", "missing-field", detail, f"{wanted}: ..."))
    latest = today + timedelta(days=LONGEST_DAYS)
    if waiver.expires > latest:
        detail = f"a waiver holds for {LONGEST_DAYS} days at most; {waiver.expires} is after {latest}"
        problems.append(Problem(f"{at}/expires", "out-of-range", detail, f"expires: {latest} or earlier"))
    return problems


__all__ = [
    "LIMITS",
    "Given",
    "Limits",
    "ReadBaseline",
    "ReadPolicy",
    "ReadWaivers",
    "read_baseline",
    "read_policy",
    "read_waivers",
]

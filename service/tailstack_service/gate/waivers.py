"""Waivers, ``tailstack/waivers/1``: findings that somebody accepts, for a reason, up to a value and a date."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import date, timedelta
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator

from tailstack.cures import ask_meant
from tailstack.design.document import without_null
from tailstack.design.reading import show
from tailstack.design.refusals import place
from tailstack.errors import Problem
from tailstack.fields import Name, Record, refusal

from .case import Case
from .file_names import match_names
from .policy import Patterns, WideWaiverRule
from .reading import GateError, GateInput, Given, Remark, add_prefix, hash_content, read_document
from .rules import RULES, Rule

WAIVERS_SCHEMA = "tailstack/waivers/1"
LONGEST_DAYS = 180
FEWEST_LETTERS = 3  # beside wildcards and an ending, for a pattern to name something
_WILD = re.compile(r"[*?]")
_ENDING = re.compile(r"\.\w{0,5}")


def _read_day(value: Any) -> date:
    if not isinstance(value, str) or not re.fullmatch(r"\d{4}-\d{2}-\d{2}", value):
        raise refusal("bad-date", "a date is written YYYY-MM-DD", "expires: 2027-01-31")
    try:
        return date.fromisoformat(value)
    except ValueError as error:
        raise refusal("bad-date", f"there is no such day: {error}") from None


Day = Annotated[date, BeforeValidator(_read_day, json_schema_input_type=str)]


class Waiver(Record):
    """One accepted finding."""

    rule: Name = Field(examples=["p95"])
    """Id of the rule."""
    designs: Patterns | None = Field(default=None, examples=[["waived.yaml"]])
    """Patterns (* and ?) of files, from the root of the repository or from a folder between that and this document.
    Absent: every design."""
    target: Name | None = Field(default=None, examples=["tip"])
    """Only at this target. Absent: at all."""
    owner: Name = Field(examples=["J. Doe, systems"])
    """Who answers for it."""
    reason: Annotated[str, Field(min_length=1, max_length=2000)] = Field(
        examples=["first article only; seat is reworked in rev C"]
    )
    """Why it is accepted."""
    max_value: float | None = Field(default=None, examples=[1.2])
    """Accepted up to this value of the finding (for an error, the upper end of its interval); for rules where more is
    worse."""
    min_value: float | None = Field(default=None, examples=[0.9])
    """Accepted down to this value; for rules where less is worse."""
    expires: Day = Field(
        description=f"Last day on which it counts, YYYY-MM-DD, at most {LONGEST_DAYS} days ahead.",
        examples=["2027-01-31"],
    )

    @field_validator("owner", "reason")
    @classmethod
    def _says_something(cls, text: str) -> str:
        if not text.strip():
            raise refusal("too-short", "somebody answers for a waiver, for a reason; this is blank")
        return text


class Waivers(Record):
    """What is accepted for now."""

    schema_: Literal["tailstack/waivers/1"] = Field(alias="schema", examples=["tailstack/waivers/1"])
    """Version of this document."""
    waivers: Annotated[list[Waiver], Field(max_length=1000)]
    """The waivers."""


def waivers_json_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of ``tailstack/waivers/1``."""
    head = {
        "title": "tailstack waivers, version 1",
        "description": f"Findings that a gate accepts for now, each by somebody, for a reason, up to a value and a day "
        f"at most {LONGEST_DAYS} days ahead.",
    }
    return {**without_null(Waivers.model_json_schema(by_alias=True)), **head}


@dataclass(frozen=True, slots=True, eq=False)
class GateWaivers(GateInput):
    """Waivers, where they came from, and the day by which they are judged."""

    entries: tuple[Waiver, ...]
    today: date


def read_waivers(given: Given, today: date, *, prefix: str = "") -> GateWaivers:
    """Waivers from a path, text or data.  Raises GateError, also for a date too far ahead of ``today``."""
    source, document = read_document(given, Waivers, WAIVERS_SCHEMA, prefix, "the rules: tailstack schema waivers")
    problems = [problem for k, waiver in enumerate(document.waivers) for problem in _check_waiver(waiver, k, today)]
    if problems:
        placed = source.with_places()
        raise GateError(add_prefix(tuple(place(problem, placed) for problem in problems), prefix))
    content = document.model_dump(mode="json", by_alias=True)
    return GateWaivers(source, source.file or "waivers", hash_content(content), tuple(document.waivers), today)


def _check_waiver(waiver: Waiver, index: int, today: date) -> Iterator[Problem]:
    """What the schema cannot say of a waiver."""
    at = f"/waivers/{index}"
    rule = RULES.get(waiver.rule)
    if rule is None or rule.worse == "fixed":
        known = [name for name, entry in RULES.items() if entry.worse != "fixed"]
        detail = f"no rule is called {show(waiver.rule)}" if rule is None else f"{waiver.rule} cannot be waived"
        hint = ask_meant(waiver.rule, known, f"rules: {', '.join(known)}")
        yield Problem(f"{at}/rule", "unknown-value", detail, hint)
        return
    wanted, other = ("max_value", "min_value") if rule.worse == "more" else ("min_value", "max_value")
    if getattr(waiver, other) is not None:
        detail = f"of {waiver.rule}, {rule.worse} is worse: a waiver of it has {wanted}, not {other}"
        yield Problem(f"{at}/{other}", "unused-field", detail, f"{wanted}: ...")
    elif getattr(waiver, wanted) is None:
        detail = f"a waiver of {waiver.rule} says up to which value it holds ({rule.unit or 'no unit'})"
        yield Problem(f"{at}/{wanted}", "missing-field", detail, f"{wanted}: ...")
    latest = today + timedelta(days=LONGEST_DAYS)
    if waiver.expires > latest:
        detail = f"a waiver holds for {LONGEST_DAYS} days at most; {waiver.expires} is after {latest}"
        yield Problem(f"{at}/expires", "out-of-range", detail, f"expires: {latest} or earlier")


# --- what a waiver accepts ----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Acceptance:
    """A finding that a waiver accepts."""

    waiver: int
    remark: Remark


def find_waiver(waivers: GateWaivers | None, rule: str, remark: Remark, names: Sequence[str]) -> int | None:
    """Index of the first waiver in force that accepts what a rule says of a design called ``names``."""
    rule = remark.about or rule
    value = _value_of(remark)
    if value is None or remark.note or remark.unbounded:
        return None
    more = RULES[rule].worse == "more"
    values = list_waiver_values(waivers, rule, remark.target, names)
    return next((index for index, bound in values.items() if (value <= bound if more else value >= bound)), None)


def list_waiver_values(
    waivers: GateWaivers | None, rule: str, target: str | None, names: Sequence[str]
) -> dict[int, float]:
    """Up to where (down to where) waivers in force accept a rule at a target of a design called ``names``."""
    values = {}
    for index, waiver in enumerate(() if waivers is None else waivers.entries):
        assert waivers is not None
        value = waiver.max_value if RULES[rule].worse == "more" else waiver.min_value
        if waiver.rule != rule or waiver.expires < waivers.today or waiver.target not in (None, target):
            continue
        if value is not None and _names(waiver, names):
            values[index] = value
    return values


def _names(waiver: Waiver, names: Sequence[str]) -> bool:
    return waiver.designs is None or any(match_names(names, pattern) for pattern in waiver.designs)


def _value_of(remark: Remark) -> float | None:
    return remark.value if remark.bound is None else remark.bound


def describe_waiver(waivers: GateWaivers, index: int) -> str:
    """How a suppressed finding names its waiver."""
    waiver = waivers.entries[index]
    line, _ = waivers.source.locate(("waivers", index))
    where = f"{waivers.file}:{line}" if line else f"{waivers.file}#/waivers/{index}"
    return f"{where}, {waiver.owner}, until {waiver.expires}: {waiver.reason}"


# --- whether a waiver should be there -----------------------------------------------------------------


def review_waivers(
    waivers: GateWaivers,
    wide: WideWaiverRule,
    accepted: Sequence[Acceptance],
    cases: Sequence[Case],
    names: Sequence[Sequence[str]],
) -> Iterator[tuple[str, Remark]]:
    """Rules waiver-expired, waiver-unused and waiver-wide.

    names: of the file of each design that is judged; empty if one could not be read.
    """
    for index, waiver in enumerate(waivers.entries):
        at, what = f"/waivers/{index}", f"waiver of {waiver.rule} by {waiver.owner}"
        own = [entry for entry in accepted if entry.waiver == index]
        if waiver.expires < waivers.today:
            message = (
                f"{what}: expired on {waiver.expires}, today is {waivers.today}; remove it or let its owner renew it"
            )
            yield "waiver-expired", Remark(f"{at}/expires", message)
            continue
        if not own:
            yield "waiver-unused", Remark(at, f"{what}: accepts nothing here")
        for number, pattern in enumerate(waiver.designs or ()):
            if names and not any(match_names(known, pattern) for known in names):
                yield "waiver-unused", Remark(f"{at}/designs/{number}", f"{what}: {pattern!r} matches no design here")
        for field, words in (*_find_wide_patterns(waiver), *_find_wide_values(waiver, own, cases, wide)):
            yield "waiver-wide", Remark(at + field, f"{what}: {words}")


def _find_wide_patterns(waiver: Waiver) -> Iterator[tuple[str, str]]:
    """Field and words: what names no design."""
    if waiver.designs is None:
        yield "", "it names no design, so it accepts this of every design; name the files"
    for index, pattern in enumerate(waiver.designs or ()):
        if _is_vague(pattern):
            yield f"/designs/{index}", f"{pattern!r} names no design; name the files"


def _is_vague(pattern: str) -> bool:
    """Whether hardly anything but wildcards and an ending is left of the last part of a pattern."""
    letters = _WILD.sub("", pattern.rpartition("/")[2])
    stem = _ENDING.sub("", letters) if letters.startswith(".") else letters.partition(".")[0]
    return _WILD.search(pattern) is not None and len(stem) < FEWEST_LETTERS


def _find_wide_values(
    waiver: Waiver, own: list[Acceptance], cases: Sequence[Case], wide: WideWaiverRule
) -> Iterator[tuple[str, str]]:
    """Field and words: what is far beyond the limit, and far beyond what is accepted now."""
    rule = RULES[waiver.rule]
    more = rule.worse == "more"
    field, value = ("max_value", waiver.max_value) if more else ("min_value", waiver.min_value)
    if value is None:
        return
    unit = f" {rule.unit}" if rule.unit in ("mm", "%", "px") else ""
    limits = [entry.remark.limit for entry in own if entry.remark.limit is not None]
    for case in cases:
        if _names(waiver, case.names):
            numbers = [comparison.number for comparison in case.comparisons]
            limits += [n.limit for n in numbers if n.rule == rule.id and waiver.target in (None, n.target)]
    if any(_exceeds(value, limit, rule, wide.max_limit_ratio) for limit in limits):
        nearest = (min if more else max)(limits)
        words = f"{field} {value:g}{unit} is beyond {wide.max_limit_ratio:g} times the limit, {nearest:g}{unit}"
        yield f"/{field}", words
    ends = [end for entry in own if (end := _value_of(entry.remark)) is not None]
    if ends and all(_exceeds(value, end, rule, wide.max_value_ratio) for end in ends):
        times = f"{wide.max_value_ratio:g} times what it accepts now"
        yield f"/{field}", f"{field} {value:g}{unit} is beyond {times}, {(max if more else min)(ends):.4g}{unit}"


def _exceeds(value: float, reference: float, rule: Rule, ratio: float) -> bool:
    """Whether a waiver's value is more than ``ratio`` times as bad as a reference."""
    if rule.unit == "%":  # of a P95: 100 % more is twice as bad
        return 1 + value / 100 > ratio * (1 + reference / 100)
    if rule.unit == "fraction":  # of good units: the others are what is bad
        return 1 - value > ratio * (1 - reference)
    return value > ratio * reference if rule.worse == "more" else value < reference / ratio

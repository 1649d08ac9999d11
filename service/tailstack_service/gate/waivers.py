"""Waivers, ``tailstack/waivers/1``: findings that somebody accepts, for a reason, up to a value and a date."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import date, timedelta
from difflib import get_close_matches
from fnmatch import fnmatchcase
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator

from tailstack.design.document import without_null
from tailstack.design.fields import Name, Record, refusal
from tailstack.design.reading import shown
from tailstack.design.refusals import place
from tailstack.errors import Problem

from .case import Case, Remark
from .policy import Patterns, Rules, WideWaiverRule
from .reading import GateError, GateInput, Given, add_prefix, hash_content, place_finding, read_document
from .records import GateFinding
from .rules import RULES, Rule

WAIVERS_SCHEMA = "tailstack/waivers/1"
LONGEST_DAYS = 180


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

    rule: Name = Field(description="Id of the rule.", examples=["p95"])
    designs: Patterns | None = Field(
        default=None,
        description="Patterns (* and ?) of file names or of designs' names. Absent: every design.",
        examples=[["waived.yaml"]],
    )
    target: Name | None = Field(default=None, description="Only at this target. Absent: at all.", examples=["tip"])
    owner: Name = Field(description="Who answers for it.", examples=["J. Doe, systems"])
    reason: Annotated[str, Field(min_length=1, max_length=2000)] = Field(
        description="Why it is accepted.", examples=["first article only; seat is reworked in rev C"]
    )
    max_value: float | None = Field(
        default=None,
        description="Accepted up to this value of the finding (for an error, the upper end of its interval); for "
        "rules where more is worse.",
        examples=[1.2],
    )
    min_value: float | None = Field(
        default=None, description="Accepted down to this value; for rules where less is worse.", examples=[0.9]
    )
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

    schema_: Literal["tailstack/waivers/1"] = Field(
        alias="schema", description="Version of this document.", examples=["tailstack/waivers/1"]
    )
    waivers: Annotated[list[Waiver], Field(max_length=1000)] = Field(description="The waivers.")


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
    """Waivers and where they came from."""

    entries: tuple[Waiver, ...]


def read_waivers(given: Given, today: date, *, name: str = "waivers", prefix: str = "") -> GateWaivers:
    """Waivers from a path, text or data.  Raises GateError, also for a date too far ahead of ``today``."""
    source, document = read_document(given, Waivers, WAIVERS_SCHEMA, prefix, "the rules: tailstack schema waivers")
    problems = [problem for k, waiver in enumerate(document.waivers) for problem in _check_waiver(waiver, k, today)]
    if problems:
        placed = source.placed()
        raise GateError(add_prefix(tuple(place(problem, placed) for problem in problems), prefix))
    content = document.model_dump(mode="json", by_alias=True)
    return GateWaivers(source, source.file or name, hash_content(content), tuple(document.waivers))


def _check_waiver(waiver: Waiver, index: int, today: date) -> list[Problem]:
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


_WILD = re.compile(r"\[[^\]]*\]|[*?]")
_ENDING = re.compile(r"\.\w{0,5}")
FEWEST_LETTERS = 3  # beside wildcards and an ending, for a pattern to name something


@dataclass(frozen=True, slots=True)
class Acceptance:
    """A finding that a waiver accepts."""

    waiver: int
    rule: str
    remark: Remark
    file: str


def find_waiver(
    waivers: GateWaivers | None, today: date, rule: str, remark: Remark, names: Sequence[str]
) -> int | None:
    """Index of the first waiver in force that accepts what a rule says of a design called ``names``."""
    if waivers is None or remark.note or remark.unbounded:
        return None
    rule = remark.about or rule
    value = remark.value if remark.bound is None else remark.bound
    for index, waiver in enumerate(waivers.entries):
        if waiver.rule != rule or waiver.expires < today or not _concerns(waiver, remark, names) or value is None:
            continue
        accepted = waiver.max_value if RULES[rule].worse == "more" else waiver.min_value
        if accepted is not None and (value <= accepted if RULES[rule].worse == "more" else value >= accepted):
            return index
    return None


def list_waiver_values(
    waivers: GateWaivers | None, today: date, rule: str, target: str, names: Sequence[str]
) -> tuple[float, ...]:
    """Up to where (down to where) waivers in force accept a rule at a target of a design called ``names``."""
    about = Remark("", "", target=target)
    values = []
    for waiver in () if waivers is None else waivers.entries:
        value = waiver.max_value if RULES[rule].worse == "more" else waiver.min_value
        if waiver.rule == rule and waiver.expires >= today and value is not None and _concerns(waiver, about, names):
            values.append(value)
    return tuple(values)


def _concerns(waiver: Waiver, remark: Remark, names: Sequence[str]) -> bool:
    if waiver.target is not None and waiver.target != remark.target:
        return False
    return waiver.designs is None or any(fnmatchcase(n, pattern) for pattern in waiver.designs for n in names)


def describe_waiver(waivers: GateWaivers, index: int) -> str:
    """How a suppressed finding names its waiver."""
    waiver = waivers.entries[index]
    line, _ = waivers.source.locate(("waivers", index))
    where = f"{waivers.file}:{line}" if line else f"{waivers.file}#/waivers/{index}"
    return f"{where}, {waiver.owner}, until {waiver.expires}: {waiver.reason}"


def review_waivers(
    waivers: GateWaivers | None, today: date, rules: Rules, accepted: Sequence[Acceptance], cases: Sequence[Case]
) -> list[GateFinding]:
    """Expired, wide and unused waivers, at their place; the policy's rules say how much each counts."""
    findings: list[GateFinding] = []
    used = {entry.waiver for entry in accepted}
    wide = rules.waiver_wide
    for index, waiver in enumerate(() if waivers is None else waivers.entries):
        assert waivers is not None
        what = f"waiver of {waiver.rule} by {waiver.owner}"
        if waiver.expires < today:
            message = f"{what}: expired on {waiver.expires}, today is {today}; remove it or let its owner renew it"
            findings.append(place_finding(waivers, f"/waivers/{index}/expires", "waiver-expired", "error", message))
            continue
        if index not in used and rules.waiver_unused.severity != "off":
            findings.append(
                place_finding(
                    waivers, f"/waivers/{index}", "waiver-unused", rules.waiver_unused.severity,
                    f"{what}: accepts nothing here",
                )
            )  # fmt: skip
        if wide.severity != "off":
            own = [entry for entry in accepted if entry.waiver == index]
            findings += [
                place_finding(waivers, f"/waivers/{index}{field}", "waiver-wide", wide.severity, f"{what}: {words}")
                for field, words in (*_find_wide_patterns(waiver, own), *_find_wide_values(waiver, own, cases, wide))
            ]
    return findings


def _find_wide_patterns(waiver: Waiver, own: Sequence[Acceptance]) -> Iterator[tuple[str, str]]:
    """Field and words: what names no design, and what a design got by its own name."""
    if waiver.designs is None:
        yield "", "it names no design, so it accepts this of every design; name the files"
    for index, pattern in enumerate(waiver.designs or ()):
        if _is_vague(pattern):
            yield f"/designs/{index}", f"{pattern!r} names no design; name the files"
    by_name = [
        entry.file
        for entry in own
        if waiver.designs is not None and not any(fnmatchcase(entry.file, pattern) for pattern in waiver.designs)
    ]
    for file in dict.fromkeys(by_name):
        yield "/designs", f"{file} has it by the name that the design gives itself, not by its file; name the file"


def _is_vague(pattern: str) -> bool:
    """Whether hardly anything but wildcards and an ending is left of the last part of a pattern."""
    letters = _WILD.sub("", pattern.rpartition("/")[2])
    stem = _ENDING.sub("", letters) if letters.startswith(".") else letters.partition(".")[0]
    return _WILD.search(pattern) is not None and len(stem) < FEWEST_LETTERS


def _find_wide_values(
    waiver: Waiver, own: Sequence[Acceptance], cases: Sequence[Case], wide: WideWaiverRule
) -> Iterator[tuple[str, str]]:
    """Field and words: what is far beyond the limit, and far beyond what is accepted now."""
    rule = RULES[waiver.rule]
    field, value = ("max_value", waiver.max_value) if rule.worse == "more" else ("min_value", waiver.min_value)
    if value is None:
        return
    limits = [entry.remark.limit for entry in own if entry.remark.limit is not None]
    limits += [
        number.limit
        for case in cases
        for number in case.numbers
        if number.rule == waiver.rule
        and _concerns(waiver, Remark("", "", target=number.target), (case.file, case.design.name))
    ]
    unit = f" {rule.unit}" if rule.unit in ("mm", "%", "px") else ""
    if any(_exceeds(value, limit, rule, wide.max_limit_ratio) for limit in limits):
        nearest = (min if rule.worse == "more" else max)(limits)
        words = f"{field} {value:g}{unit} is beyond {wide.max_limit_ratio:g} times the limit, {nearest:g}{unit}"
        yield f"/{field}", words
    ends = [entry.remark.value if entry.remark.bound is None else entry.remark.bound for entry in own]
    found = [end for end in ends if end is not None]
    if found and all(_exceeds(value, end, rule, wide.max_value_ratio) for end in found):
        worst = (max if rule.worse == "more" else min)(found)
        words = (
            f"{field} {value:g}{unit} is beyond {wide.max_value_ratio:g} times what it accepts now, {worst:.4g}{unit}"
        )
        yield f"/{field}", words


def _exceeds(value: float, reference: float, rule: Rule, ratio: float) -> bool:
    """Whether a waiver's value is more than ``ratio`` times as bad as a reference."""
    if rule.unit == "%":  # of a P95: 100 % more is twice as bad
        return 1 + value / 100 > ratio * (1 + reference / 100)
    if rule.unit == "fraction":  # of good units: the others are what is bad
        return 1 - value > ratio * (1 - reference)
    return value > ratio * reference if rule.worse == "more" else value < reference / ratio

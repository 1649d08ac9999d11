"""Which findings a waiver accepts."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import date
from fnmatch import fnmatchcase

from .case import Case, Remark
from .finding_place import finding_at
from .policy_document import Rules, WideWaiverRule
from .reading import ReadWaivers
from .records import GateFinding
from .rules import RULES, Rule
from .waiver_document import Waiver

_WILD = re.compile(r"\[[^\]]*\]|[*?]")
_ENDING = re.compile(r"\.\w{0,5}")
FEWEST_LETTERS = 3  # beside wildcards and an ending, for a pattern to name something


@dataclass(frozen=True, slots=True)
class Accepted:
    """A finding that a waiver accepts."""

    waiver: int
    rule: str
    remark: Remark
    file: str


def accepting(waivers: ReadWaivers | None, today: date, rule: str, remark: Remark, names: Sequence[str]) -> int | None:
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


def accepted_values(
    waivers: ReadWaivers | None, today: date, rule: str, target: str, names: Sequence[str]
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


def in_words(waivers: ReadWaivers, index: int) -> str:
    """How a suppressed finding names its waiver."""
    waiver = waivers.entries[index]
    line, _ = waivers.source.locate(("waivers", index))
    where = f"{waivers.file}:{line}" if line else f"{waivers.file}#/waivers/{index}"
    return f"{where}, {waiver.owner}, until {waiver.expires}: {waiver.reason}"


def remarks_on_waivers(
    waivers: ReadWaivers | None, today: date, rules: Rules, accepted: Sequence[Accepted], cases: Sequence[Case]
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
            findings.append(finding_at(waivers, f"/waivers/{index}/expires", "waiver-expired", "error", message))
            continue
        if index not in used and rules.waiver_unused.severity != "off":
            findings.append(
                finding_at(
                    waivers, f"/waivers/{index}", "waiver-unused", rules.waiver_unused.severity,
                    f"{what}: accepts nothing here",
                )
            )  # fmt: skip
        if wide.severity != "off":
            own = [entry for entry in accepted if entry.waiver == index]
            findings += [
                finding_at(waivers, f"/waivers/{index}{field}", "waiver-wide", wide.severity, f"{what}: {words}")
                for field, words in (*_wide_patterns(waiver, own), *_wide_values(waiver, own, cases, wide))
            ]
    return findings


def _wide_patterns(waiver: Waiver, own: Sequence[Accepted]) -> Iterator[tuple[str, str]]:
    """Field and words: what names no design, and what a design got by its own name."""
    if waiver.designs is None:
        yield "", "it names no design, so it accepts this of every design; name the files"
    for place, pattern in enumerate(waiver.designs or ()):
        if _names_nothing(pattern):
            yield f"/designs/{place}", f"{pattern!r} names no design; name the files"
    by_name = [
        entry.file
        for entry in own
        if waiver.designs is not None and not any(fnmatchcase(entry.file, pattern) for pattern in waiver.designs)
    ]
    for file in dict.fromkeys(by_name):
        yield "/designs", f"{file} has it by the name that the design gives itself, not by its file; name the file"


def _names_nothing(pattern: str) -> bool:
    """Whether hardly anything but wildcards and an ending is left of the last part of a pattern."""
    letters = _WILD.sub("", pattern.rpartition("/")[2])
    stem = _ENDING.sub("", letters) if letters.startswith(".") else letters.partition(".")[0]
    return _WILD.search(pattern) is not None and len(stem) < FEWEST_LETTERS


def _wide_values(
    waiver: Waiver, own: Sequence[Accepted], cases: Sequence[Case], wide: WideWaiverRule
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
    if any(_beyond(value, limit, rule, wide.max_limit_ratio) for limit in limits):
        nearest = (min if rule.worse == "more" else max)(limits)
        words = f"{field} {value:g}{unit} is beyond {wide.max_limit_ratio:g} times the limit, {nearest:g}{unit}"
        yield f"/{field}", words
    ends = [entry.remark.value if entry.remark.bound is None else entry.remark.bound for entry in own]
    found = [end for end in ends if end is not None]
    if found and all(_beyond(value, end, rule, wide.max_value_ratio) for end in found):
        worst = (max if rule.worse == "more" else min)(found)
        words = (
            f"{field} {value:g}{unit} is beyond {wide.max_value_ratio:g} times what it accepts now, {worst:.4g}{unit}"
        )
        yield f"/{field}", words


def _beyond(value: float, reference: float, rule: Rule, ratio: float) -> bool:
    """Whether a waiver's value is more than ``ratio`` times as bad as a reference."""
    if rule.unit == "%":  # of a P95: 100 % more is twice as bad
        return 1 + value / 100 > ratio * (1 + reference / 100)
    if rule.unit == "fraction":  # of good units: the others are what is bad
        return 1 - value > ratio * (1 - reference)
    return value > ratio * reference if rule.worse == "more" else value < reference / ratio

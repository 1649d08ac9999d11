"""Which findings a waiver accepts."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date
from fnmatch import fnmatchcase

from .case import Remark
from .finding_place import finding_at
from .reading import ReadWaivers
from .records import GateFinding
from .rules import RULES
from .waiver_document import Waiver


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


def remarks_on_waivers(waivers: ReadWaivers | None, today: date, used: set[int], unused: str) -> list[GateFinding]:
    """Expired and unused waivers, at their place.  ``unused`` is the severity of the latter, or "off"."""
    findings: list[GateFinding] = []
    for index, waiver in enumerate(() if waivers is None else waivers.entries):
        assert waivers is not None
        what = f"waiver of {waiver.rule} by {waiver.owner}"
        if waiver.expires < today:
            message = f"{what}: expired on {waiver.expires}, today is {today}; remove it or let its owner renew it"
            findings.append(finding_at(waivers, f"/waivers/{index}/expires", "waiver-expired", "error", message))
        elif index not in used and unused != "off":
            findings.append(
                finding_at(waivers, f"/waivers/{index}", "waiver-unused", unused, f"{what}: accepts nothing here")
            )
    return findings

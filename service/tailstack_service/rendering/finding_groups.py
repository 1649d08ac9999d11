"""Findings in groups: those that are alike become one sentence with its cure, and where else it holds."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Iterator, Sequence
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from tailstack.results import Finding

T = TypeVar("T")
FEWEST = 3  # two are still read one by one
MOST_PLACES = 8


def group_alike(items: Sequence[T], key: Callable[[T], Hashable | None]) -> list[list[T]]:
    """Items of one key together, where the first of them stands; those with the key None, and pairs, by themselves."""
    groups: dict[Hashable, list[T]] = {}
    for number, item in enumerate(items):
        group_key = key(item)
        groups.setdefault(("alone", number) if group_key is None else ("alike", group_key), []).append(item)
    few = {id(item) for group in groups.values() if len(group) < FEWEST for item in group}
    gathered = {id(group[0]): group for group in groups.values() if len(group) >= FEWEST}
    return [
        [item] if id(item) in few else gathered[id(item)] for item in items if id(item) in few or id(item) in gathered
    ]


def name_field(pointer: str) -> str:
    """The last field of a pointer, whatever entry of a list it leads to: what alike findings share."""
    return next((step for step in reversed(pointer.split("/")) if step and not step.isdecimal()), "")


def name_rule(sentence: str) -> str:
    """What a sentence says before what arrived, whatever its numbers are."""
    return re.sub(r"-?\d+(\.\d+)?", "#", sentence.partition("; got ")[0])


def list_others(lines: Sequence[int | None], pointers: Sequence[str]) -> str:
    """``and 9 more like it: lines 12, 13, ...``, by pointers where there are no lines."""
    known = [line for line in lines if line is not None]
    if len(known) == len(lines):
        places = [str(line) for line in dict.fromkeys(known)]
        word = "lines" if len(places) > 1 else "line"
    else:
        places, word = list(dict.fromkeys(pointers)), "at"
    more = ", ..." if len(places) > MOST_PLACES else ""
    return f"and {len(lines)} more like it: {word} {', '.join(places[:MOST_PLACES])}{more}"


def group_findings(findings: Sequence[Finding]) -> Iterator[tuple[Finding, str]]:
    """Findings with their sentences; three and more of the same words, each about another thing, are one."""
    for first, *others in group_alike(findings, _name_remark):
        fields = [name_field(item.pointer) for item in (first, *others)]
        # what a remark is about stands before its colon; its value does not count
        names = ", ".join(
            other.message.partition(": ")[0].partition(" is ")[0] + (f" ({field})" if len(set(fields)) > 1 else "")
            for other, field in zip(others, fields[1:], strict=True)
        )
        yield (first, first.message + (f" The same holds for {names}." if names else ""))


def _name_remark(finding: Finding) -> Hashable | None:
    """What it says, whatever it says it of: two fields of one view are alike."""
    remark = finding.message.partition(": ")[2].replace(name_field(finding.pointer) or ":", "#")
    return (finding.rule, finding.severity, remark) if remark else None

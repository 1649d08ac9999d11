"""A walk over what people write wrongly, and the hints of the refusals obeyed: each helps, or leads on, never back.

A hint with a number or a line that nothing here can obey fails, so that none is left out.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Callable, Iterator
from datetime import date
from functools import partial
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError

from plain_data import replaced, value_at
from records import fields_of, records_below, words_of
from tailstack.design.reading import DEFAULT_LIMITS, DocumentSource
from tailstack.design.refusals import refuse
from tailstack.errors import Problem

NUMBER = r"(-?[0-9.]+(?:e[-+]?[0-9]+)?)"
MATRIX = r"(\[\[.*?\]\])"
READ = [  # where a hint says what is to stand there; two of them, where it may be either
    rf"write {NUMBER} or {NUMBER}$", rf"write {NUMBER}(?:;|$)", rf"with a point(?:: |, ){NUMBER}$",
    rf" is {NUMBER}(?: mm)?$", rf"has the half-width {NUMBER}$", r"without quotes: (\d+)$",
    rf"it is {MATRIX}; .* it is {MATRIX}$", rf"it is {MATRIX}$",
]  # fmt: skip
NOT_OBEYED = (  # hints with digits that leave the number to a person
    "the middle of the zone into bias", "its mean, 0.8 sigma", "with coverage_factor: 3 a share", "more give a margin",
    "whose place is a half-width", "a rotation goes under rotation", "a projection has three rows of four",
    "if it is the decimals",
)  # fmt: skip
EXPLAINED = r"^\w+(?: \(default\))?: [^.]*\. \w+(?: \(default\))?: "  # what each word of a choice means


def slips_of(value: Any) -> Iterator[Any]:
    """What somebody may write instead of an example."""
    if isinstance(value, bool):
        yield from ("yes", 1, "True")
    elif isinstance(value, int | float):
        point = f"{value}".replace(".", ",")
        yield from (
            point,
            f"{100 * value:g} %",
            f"{value}",
            f"±{value}",
            f"+{value}/-0",
            f"{value} ± 0.01",
            f"Ø {value}",
        )
        yield from (
            "1,234.5",
            "1.234,5",
            "0,05",
            "1,050",
            f"max {value}",
            "half",
            True,
            None,
            [value],
            {"value": value},
        )
        yield from (
            f"{value} {unit}" for unit in ("mm", "um", "in", "mil", "deg", "rad", "mrad", "px", "n", "kgf", "c", "s")
        )
        yield from (-value, 100 * value, 1e3 * value, 1e6 * value, 1e9 * value, value / 1e3, value / 1e6, value + 0.5)
    elif isinstance(value, str):
        yield from (
            value.upper(),
            value.replace("_", " "),
            value[:-1],
            value + "s",
            3,
            "half_" + value,
            "",
            [value],
            None,
        )
        yield from ("gaussian", "rectangular", "half_normal", "lognormal", "optimize", "per unit", "PA")
    elif isinstance(value, list) and value:
        yield from (value[:-1], [*value, value[0]], [value], "x", None, {"points": value}, value * 2)
        if all(isinstance(row, list) for row in value):
            yield [entry for row in value for entry in row]
            yield [list(column) for column in zip(*value, strict=True)]
            yield [[*row, 0] for row in value]
        elif isinstance(value[0], int | float):
            yield from ([slip, *value[1:]] for slip in slips_of(value[0]))
            yield [whole for entry in value for whole in (int(entry), 5)]
            yield " ".join(map(str, value))


def refused(record: type[BaseModel], data: dict[str, Any]) -> tuple[Problem, ...]:
    try:
        record.model_validate(data)
    except ValidationError as error:
        return refuse(error, DocumentSource(data, None, None), DEFAULT_LIMITS, record).problems
    return ()


def steps_of(pointer: str) -> list[str | int]:
    return [int(step) if step.isdecimal() else step for step in pointer.split("/")[1:]]


def apply_fix(data: Any, problem: Problem) -> Any:
    """RFC 6902, as far as fixes use it."""
    data = copy.deepcopy(data)
    for edit in problem.fix:
        *way, last = steps_of(edit.path)
        node = value_at(data, way)
        if edit.op == "remove":
            del node[last]
        else:
            assert edit.op == "add" or last in node or isinstance(last, int)
            node[last] = edit.value
    return data


def ways_to_obey(data: Any, problem: Problem) -> list[Any]:
    """The documents that a hint leads to; empty: it names no value."""
    if problem.fix:
        return [apply_fix(data, problem)]
    steps = steps_of(problem.pointer)
    for pattern in READ:
        if found := re.search(pattern, problem.hint):
            return [replaced(data, steps, yaml.safe_load(each)) for each in found.groups()]
    if row := re.search(r"add (\[0, 0, 0, 1\])$", problem.hint):
        return [replaced(data, steps, [*value_at(data, steps), yaml.safe_load(row[1])])]
    line = re.fullmatch(r"(?:did you mean \w+\? .*: )?(\w+): ([^ ].*)", problem.hint, re.DOTALL)
    if line and line[1] == "known":
        return [replaced(data, steps, line[2].split(", ")[0])]
    if line and line[1] != "fields" and not re.search(EXPLAINED, problem.hint):
        at = steps[:-1] if steps and (steps[-1] == line[1] or problem.code == "unknown-field") else steps
        changed = copy.deepcopy(data)
        node = value_at(changed, at)
        if problem.code == "unknown-field":
            del node[steps[-1]]
        assert isinstance(node, dict), problem
        value = yaml.safe_load(line[2])
        node[line[1]] = line[2] if isinstance(value, date) else value  # which is a text in our documents
        return [changed]
    return []


def check_obeyed(data: Any, problem: Problem, judge: Callable[[Any], tuple[Problem, ...]]) -> int:
    """That what the hint leads to is no longer refused for this; 1 where it was obeyed."""
    ways = ways_to_obey(data, problem)
    for way in ways:
        again = [(each.pointer, each.hint, each.detail) for each in judge(way)]
        assert (problem.pointer, problem.hint) not in [each[:2] for each in again], (problem, again)
    if not ways and re.search(r"[0-9]", problem.hint):
        known = re.search(EXPLAINED, problem.hint) or any(words in problem.hint for words in NOT_OBEYED)
        assert known or not re.search(NUMBER + r"(?:$|;)", problem.hint), f"nothing here obeys {problem.hint!r}"
    return bool(ways)


def walk_slips(root: type[BaseModel]) -> tuple[int, int]:
    """Each example of each field of each record, and all ways to write it wrongly: hints that were obeyed, and all."""
    obeyed = total = 0
    for record in records_below(root):
        for field, info in fields_of(record).items():
            for example in info.examples or words_of(info.annotation)[:1]:
                for slip in slips_of(example):
                    data = {field: slip}
                    for problem in refused(record, data):
                        if problem.hint and problem.pointer.startswith(f"/{field}"):
                            total += 1
                            obeyed += check_obeyed(data, problem, partial(refused, record))
    return obeyed, total

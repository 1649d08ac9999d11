"""Plain data: the demonstration, every place in data, a value of it changed, and what is said of what is wrong."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
import yaml

from tailstack.errors import Problem, TailstackError

EXAMPLES = Path(__file__).parents[1] / "examples"
# By libyaml: what is in plain Python takes a second for them, in every process that collects
EVERY: dict[str, Any] = {
    path.stem: yaml.load(path.read_text(encoding="utf-8"), yaml.CSafeLoader) for path in sorted(EXAMPLES.glob("*.yaml"))
}
DEMO: dict[str, Any] = EVERY["demo"]
REMOVED = object()  # in place of a value: the field is left out
CASES = Path(__file__).parent / "data" / "cases"


def read_cases(subject: str, table: str) -> list[list[Any]]:
    """A table of cases: a row for each, as the head of data/cases/SUBJECT.yaml says."""
    return yaml.load((CASES / f"{subject}.yaml").read_text(encoding="utf-8"), yaml.CSafeLoader)[table]


def replaced(data: Any, path: Sequence[str | int], value: Any) -> Any:
    """A copy of ``data`` with ``value`` at ``path``; an empty path is the whole."""
    if not path:
        return value
    data = copy.deepcopy(data)
    node = data
    for step in path[:-1]:
        node = node[step]
    if value is REMOVED:
        del node[path[-1]]
    else:
        node[path[-1]] = value
    return data


def places_of(node: Any, here: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Every place in plain data, the whole first."""
    yield here
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, child in items:
        yield from places_of(child, (*here, key))


def value_at(data: Any, path: Sequence[str | int]) -> Any:
    for step in path:
        data = data[step]
    return data


def problems_of(
    call: Callable[..., Any], *given: Any, error: type[TailstackError] = TailstackError, **named: Any
) -> tuple[Problem, ...]:
    """What a call says that has to be refused."""
    with pytest.raises(error) as caught:
        call(*given, **named)
    return caught.value.problems

"""The demonstration as plain data, a value of it changed, and what is said of what is wrong."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
import yaml

from tailstack.errors import Problem, TailstackError

EXAMPLES = Path(__file__).parents[1] / "examples"
DEMO: dict[str, Any] = yaml.safe_load((EXAMPLES / "demo.yaml").read_text(encoding="utf-8"))
REMOVED = object()  # in place of a value: the field is left out


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


def problems_of(
    call: Callable[..., Any], *given: Any, error: type[TailstackError] = TailstackError, **named: Any
) -> tuple[Problem, ...]:
    """What a call says that has to be refused."""
    with pytest.raises(error) as caught:
        call(*given, **named)
    return caught.value.problems

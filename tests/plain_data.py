"""Plain data with one value changed."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any


def replaced(data: Any, path: Sequence[str | int], value: Any) -> Any:
    """A copy of ``data`` with ``value`` at ``path``; an empty path is the whole."""
    if not path:
        return value
    data = copy.deepcopy(data)
    node = data
    for step in path[:-1]:
        node = node[step]
    node[path[-1]] = value
    return data

"""What differs between two documents, field by field; elements of lists are told by their names if they have any."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from tailstack.design.refusals import escape
from tailstack.units import unit_label

from .records import Change

MOST = 500
SAYINGS = ("name", "label", "component")  # what tells an element of a list from the others
LONGEST = 400  # characters of a value
APART = ("schema", "review")


def changes_of(first: Any, second: Any) -> tuple[tuple[Change, ...], int]:
    """Fields that differ, in the order of the second document, at most MOST of them; and how many are left out."""
    changes = list(_changes(first, second, "", "", ""))
    return tuple(changes[:MOST]), max(len(changes) - MOST, 0)


def _changes(first: Any, second: Any, old: str, new: str, name: str) -> Iterator[Change]:
    if isinstance(first, dict) and isinstance(second, dict):
        yield from _of_mappings(first, second, old, new, name)
    elif _list_values(first) and _list_values(second):
        yield from _of_lists(first, second, old, new, name)
    elif first != second:
        yield Change(new, name.strip(), unit_label(new), "changed", _value(first), _value(second))


def _of_mappings(first: dict[str, Any], second: dict[str, Any], old: str, new: str, name: str) -> Iterator[Change]:
    for key, value in second.items():
        if new == "" and key in APART:
            continue
        ways = (f"{old}/{escape(key)}", f"{new}/{escape(key)}", f"{name} {key}")
        if key in first:
            yield from _changes(first[key], value, *ways)
        elif value is not None:
            yield Change(ways[1], ways[2].strip(), unit_label(ways[1]), "added", None, _value(value))
    for key, value in first.items():
        if key not in second and value is not None and not (old == "" and key in APART):
            at = f"{old}/{escape(key)}"
            yield Change(at, f"{name} {key}".strip(), unit_label(at), "removed", _value(value), None)


def _of_lists(first: list[Any], second: list[Any], old: str, new: str, name: str) -> Iterator[Change]:
    before, after = _describe(first), _describe(second)
    for key, place in after.items():
        ways = (f"{old}/{before.get(key, 0)}", f"{new}/{place}", f"{name} {key}")
        if key in before:
            yield from _changes(first[before[key]], second[place], *ways)
        else:
            yield Change(ways[1], ways[2].strip(), "", "added", None, _value(second[place]))
    for key, place in before.items():
        if key not in after:
            yield Change(f"{old}/{place}", f"{name} {key}".strip(), "", "removed", _value(first[place]), None)


def _list_values(node: Any) -> bool:
    """A list of mappings: a position, a matrix are values."""
    return isinstance(node, list) and all(isinstance(item, dict) for item in node)


def _describe(items: list[Any]) -> dict[str, int]:
    """Places by what tells an element: its name, if all have one and no two the same, or else its number."""
    for saying in SAYINGS:
        names = [item.get(saying) for item in items]
        if all(isinstance(name, str) and name for name in names) and len(set(names)) == len(names):
            return {str(name): place for place, name in enumerate(names)}
    return {str(place): place for place in range(len(items))}


def _value(node: Any) -> str:
    text = json.dumps(node, ensure_ascii=False, separators=(", ", ": "))  # noqa: TID251 - words in a table
    return text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"

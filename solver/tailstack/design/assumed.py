"""What nobody stated: the list ``assumed`` of a design, JSON pointers into the same document.

A pointer to a mapping, or to a list of mappings, covers every number below it.  A value is a number or a vector or
matrix of numbers; a text (a preset, a law) counts where a pointer names it itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from ..cures import find_nearest
from ..errors import Problem
from ..field_names import is_numeric
from .pointers import EVERY, find_places, pointer_of, value_at
from .refusals import pointer as write_pointer

FIELD = "assumed"
_NO_VALUES = ("schema", "document", FIELD)  # fields of a design that say nothing of what is computed


def list_assumed(data: dict[str, Any]) -> tuple[str, ...]:
    """A pointer to each assumed value of a document whose list is in order, in the order of the list."""
    found: list[str] = []
    for pointer in data.get(FIELD, ()):
        found += [*_numbers_below(value_at(data, find_places(data, pointer)[0]), pointer)] or [pointer]
    return tuple(dict.fromkeys(found))


def check_assumed(data: dict[str, Any]) -> Iterator[Problem]:
    """Every pointer of the list leads to something that the document says."""
    for index, pointer in enumerate(data.get(FIELD, ())):
        steps = pointer.split("/")
        if not (find_places(data, pointer) and EVERY not in steps and steps[1] not in _NO_VALUES):
            detail = f"the design as it was written has no value at {pointer or 'an empty pointer'}"
            yield Problem(f"/{FIELD}/{index}", "not-found", detail, _suggest(data, pointer))


def _suggest(data: dict[str, Any], pointer: str) -> str:
    written = pointer_of(data, pointer)
    places = [write_pointer(place) for place in find_places(data, written)] if written != "" else []
    places = [place for place in places if place.split("/")[1] not in _NO_VALUES]
    if not places and pointer.split("/")[1:2] and pointer.split("/")[1] not in _NO_VALUES:
        places = find_nearest(pointer, _all_pointers(data, ""))
    cure = "take it off the list: what the design leaves to its default is not listed"
    return f"did you mean {', '.join(places[:8])}?" if places else cure


def _all_pointers(node: Any, pointer: str) -> Iterator[str]:
    for child, way in _children(node, pointer):
        if way.split("/")[1] not in _NO_VALUES:
            yield way
            yield from _all_pointers(child, way)


def follow_changes(before: dict[str, Any], after: dict[str, Any], stated: str = "") -> dict[str, Any]:
    """The changed document, in which what is not as it was before is assumed no longer, and so is a value at a pointer
    that somebody ``stated``, as it was or not.  What else a pointer of the list covers stays on it."""
    if FIELD not in before:
        return after
    left = list(before[FIELD])
    for pointer in list_assumed(before):
        place, there = find_places(before, pointer)[0], find_places(after, pointer)
        if not there or value_at(after, there[0]) != value_at(before, place):
            left = _leave(before, left, pointer)
    if (places := find_places(before, stated)) and _is_value(value_at(before, places[0])):
        left = _leave(before, left, stated)
    rest = {name: value for name, value in after.items() if name != FIELD}
    return {**rest, FIELD: left} if left else rest


def _leave(data: Any, pointers: Iterable[str], stated: str) -> list[str]:
    left = []
    for pointer in pointers:
        if _covers(stated, pointer):
            continue
        node = value_at(data, find_places(data, pointer)[0])
        if not _covers(pointer, stated):
            left.append(pointer)
        elif not _is_value(node):
            inner = [way for child, way in _children(node, pointer) if any(_numbers_below(child, way))]
            left += _leave(data, inner, stated)
    return left


def _covers(pointer: str, other: str) -> bool:
    return other == pointer or other.startswith(f"{pointer}/")


def _numbers_below(node: Any, pointer: str) -> Iterator[str]:
    if _is_value(node):
        if is_numeric(node):
            yield pointer
        return
    for child, way in _children(node, pointer):
        yield from _numbers_below(child, way)


def _children(node: Any, pointer: str) -> list[tuple[Any, str]]:
    if isinstance(node, dict):
        return [(child, pointer + write_pointer([key])) for key, child in node.items()]
    return [(child, f"{pointer}/{k}") for k, child in enumerate(node)] if isinstance(node, list) else []


def _is_value(node: Any) -> bool:
    """Whether it is stated as a whole: neither a mapping nor a list of mappings."""
    return not isinstance(node, dict) and not (isinstance(node, list) and any(isinstance(each, dict) for each in node))

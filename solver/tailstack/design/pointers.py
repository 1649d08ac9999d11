"""Places in a design document as people write them, and the document with another value at one of them.

A place is a JSON pointer (RFC 6901), ``/views/0/fiducial_noise_px``, or fields with dots between them,
``views.AP.fiducial_noise_px``, in which an element goes by its number or field, its ``name`` or its ``label``.  A step
``*`` stands for every element of a list or mapping.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from ..cures import find_nearest
from ..errors import Problem, TailstackError, escape, read_pointer, write_pointer
from ..field_names import Renaming, find_renamings, is_numeric, say_renaming
from .refusals import records_on

EVERY = "*"
Place = tuple[str | int, ...]  # the steps to a value


def pointer_of(data: Any, path: str) -> str:
    """The pointer of a path in a document.  A path that leads nowhere is returned as the pointer that does neither."""
    if path.startswith("/"):
        return path
    node, steps = data, []
    for word in path.split("."):
        step: str | int = word
        if isinstance(node, list | dict) and word not in node and not word.isdecimal() and word != EVERY:
            items = node.items() if isinstance(node, dict) else enumerate(node)  # an interface has a label, too
            called = [key for key, item in items if isinstance(item, dict) and word in _names(item)]
            step = called[0] if len(called) == 1 else word
        steps.append(step)
        node = _child(node, int(word) if isinstance(node, list) and word.isdecimal() else step)
    return write_pointer(steps)


def find_places(data: Any, pointer: str, *, make: bool = False) -> list[Place]:
    """Where a pointer leads; empty: nowhere.  ``make``: a mapping that has no such field could get it."""
    if not pointer.startswith("/"):
        return []
    ways: list[tuple[Place, Any]] = [((), data)]
    steps = read_pointer(pointer)
    for step, following in zip(steps, [*steps[1:], ""], strict=True):
        makes = make and not following.isdecimal()  # a list that is not there has no first element
        ways = [((*place, key), child) for place, node in ways for key, child in children_at(node, step, makes)]
    return [place for place, _ in ways]


def value_at(data: Any, place: Place) -> Any:
    """What stands at a place."""
    for step in place:
        data = data[step]
    return data


def replace_value(data: Any, place: Place, value: Any) -> Any:
    """The document with another value at a place; what is not on the way to it is shared with the first."""
    if not place:
        return value
    step, rest = place[0], place[1:]
    if isinstance(data, dict):
        return {**data, step: replace_value(data.get(step, {}), rest, value)}
    changed = list(data)
    changed[int(step)] = replace_value(data[int(step)], rest, value)
    return changed


def locate_numbers(data: Any, pointer: str, where: str, refusal: type[TailstackError]) -> tuple[Place, ...]:
    """The places of every number that a pointer leads to.  Raises the refusal, which points at ``where``."""
    places = find_places(data, pointer)
    cure = "what the design leaves to its default is written out to be varied"
    if not places:
        hint = "; ".join(filter(None, (suggest(data, pointer), cure)))
        raise refusal(Problem(where, "not-found", f"the design as it was written has nothing at {pointer}", hint))
    for place in places:
        value = value_at(data, place)
        if isinstance(value, list) or not is_numeric(value):
            reason, hint = f"{pointer} is not a number", suggest(data, pointer) or cure
            if isinstance(value, str):
                reason, hint = f"{pointer} is a text", "write a design for each text, and score them one by one"
            raise refusal(Problem(where, "not-a-number", f"only numbers can be varied; {reason}", hint))
    return tuple(places)


def set_numbers(data: Any, places: Sequence[Sequence[Place]], values: Sequence[float]) -> Any:
    """The document with a new number at all places of each list; what is not on the way to them is shared."""
    for each, value in zip(places, values, strict=True):
        for place in each:
            # A whole number stays one: fields that count do not take 8.0.
            counts = isinstance(value_at(data, place), int) and value.is_integer()
            data = replace_value(data, place, int(value) if counts else value)
    return data


def name_of(data: Any, pointer: str) -> str:
    """A pointer as people write it: fields with dots between them, elements of lists by their names or labels."""
    node, words = data, []
    step: str | int
    for step in read_pointer(pointer):
        if isinstance(node, list) and str(step).isdecimal() and int(step) < len(node):
            step = int(step)
            item = node[step]
            called = next((word for word in _names(item) if word), None) if isinstance(item, dict) else None
            alike = sum(isinstance(element, dict) and called in _names(element) for element in node)
            words.append(str(called) if called is not None and alike == 1 and "." not in str(called) else str(step))
        else:
            words.append(str(step))
        node = _child(node, step)
    return ".".join(words)


def suggest(data: Any, pointer: str) -> str:
    """Which number may have been meant, as a hint, or what there is at the step that leads nowhere."""
    steps = read_pointer(pointer)
    node, way = data, ""
    for place, step in enumerate(steps):
        children = children_at(node, step)
        if not children:
            return _suggest_step(data, node, way, steps[place:])
        node, way = children[0][1], f"{way}/{escape(step)}"
    inside = sorted(find_numbers(node, ()), key=lambda place: not any("half_width" in str(step) for step in place))
    listed = " or ".join(name_of(data, way + write_pointer(place)) for place in inside[:3] if place)
    return f"did you mean {listed}?" if listed else ""


def _suggest_step(data: Any, node: Any, way: str, steps: Sequence[str]) -> str:
    """What may have been meant by the first of these steps, which ``node`` at ``way`` does not have."""
    known: dict[str, str] = {}
    found: list[Renaming] = []
    if isinstance(node, dict):
        known = {str(key): str(key) for key in node}
        place = find_places(data, way) if way else [()]
        found = find_renamings(steps[0], known, beside=records_on(data, place[0] if place else ())[1])
    elif isinstance(node, list):
        for k in range(len(node)):
            known[name_of(data, f"{way}/{k}").rpartition(".")[2]] = str(k)
        found = [Renaming(nearest, "") for nearest in find_nearest(steps[0], known)]
    for each in found[:1]:
        meant = way + write_pointer([known[each.field], *steps[1:]])
        if find_places(data, meant):
            return say_renaming(each, name_of(data, meant))
        return suggest(data, meant)
    listed = ", ".join(list(known)[:MOST_LISTED]) + (", ..." if len(known) > MOST_LISTED else "")
    where = name_of(data, way) or "the design"
    return f"in {where} there is {listed}." if known else ""


MOST_LISTED = 10


def children_at(node: Any, step: str, make: bool = False) -> list[tuple[str | int, Any]]:
    """What one step leads to, each with its key."""
    if isinstance(node, list):
        if step == EVERY:
            return list(enumerate(node))
        return [(int(step), node[int(step)])] if step.isdecimal() and int(step) < len(node) else []
    if isinstance(node, dict):
        if step == EVERY:
            return list(node.items())
        return [(step, node.get(step, {}))] if step in node or make else []
    return []


def find_numbers(node: Any, place: Place) -> Iterator[Place]:
    """Where the document has numbers, in its order; ``place``: the way to ``node``, ``()`` for the whole."""
    for key, child in children_at(node, EVERY):
        yield from find_numbers(child, (*place, key))
    if not isinstance(node, list) and is_numeric(node):
        yield place


def _names(item: dict[str, Any]) -> tuple[Any, Any]:
    return item.get("name"), item.get("label")


def _child(node: Any, step: str | int) -> Any:
    if step == EVERY and isinstance(node, list | dict):
        return next(iter(node.values() if isinstance(node, dict) else node), None)
    try:
        return node[step]
    except (KeyError, IndexError, TypeError):
        return None

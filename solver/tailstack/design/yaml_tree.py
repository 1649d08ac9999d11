"""YAML into plain data and the place of every value, from libyaml's *events* and without recursion.

Building the tree here is what makes a bomb of nesting or aliases an error message instead of a crash:
depth and values are counted on the way, an alias at the size of what it stands for.

Plain scalars follow the core schema of YAML 1.2: ``yes``, ``no``, ``on``, ``off``, ``1:30`` and ``1_000``
are text, ``1e3`` is a number.  Integers with leading zeros mean different numbers in YAML 1.1 and 1.2,
so they stay text and a field that wants a number refuses them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import yaml

from ..errors import DesignError, LimitError
from .wording import Limits, Vast, problem, shown, size_problem

LONGEST_KEY = 100  # characters; keys end up in pointers
_INTEGER = re.compile(r"[-+]?(0|[1-9][0-9]*)\Z")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|(0|[1-9][0-9]*)(\.[0-9]*)?)([eE][-+]?[0-9]+)?\Z")
_OTHER = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), float("nan")),
    **{sign + word: float(sign + "inf") for sign in ("", "+", "-") for word in (".inf", ".Inf", ".INF")},
}


@dataclass(frozen=True, slots=True)
class Place:
    """Where a value stands in its file (1-based), and where its children do."""

    line: int
    column: int
    children: dict[str, tuple[Place, Place]] | list[Place] | None = None  # mapping: key, value

    def find(self, path: Iterable[str | int], *, key: bool = False) -> Place:
        """The place of a path of keys and indices, or of its nearest ancestor; ``key``: of the key itself."""
        here = self
        at_key = self
        for step in path:
            if isinstance(here.children, dict) and str(step) in here.children:
                at_key, here = here.children[str(step)]
            elif isinstance(here.children, list) and isinstance(step, int) and step < len(here.children):
                at_key = here = here.children[step]
            else:
                return here
        return at_key if key else here


def integer(text: str) -> int | float:
    """An integer of the document; JSON's and YAML's alike."""
    return int(text) if len(text) < 20 else Vast(text)


def scalar(text: str) -> Any:
    """A plain scalar by the core schema of YAML 1.2, integers with leading zeros excepted."""
    if text in _OTHER:
        return _OTHER[text]
    if _INTEGER.match(text):
        return integer(text)
    if _FLOAT.match(text):
        return float(text)
    return text


def _loader(text: str) -> Any:
    return yaml.CSafeLoader(text) if yaml.__with_libyaml__ else yaml.SafeLoader(text)


class _Open:
    """A collection whose end has not been read yet."""

    __slots__ = ("anchor", "children", "data", "key", "mark", "start")

    def __init__(self, data: Any, children: Any, mark: Any, anchor: str | None, start: int) -> None:
        self.data, self.children, self.mark, self.anchor, self.start = data, children, mark, anchor, start
        self.key: tuple[str, Place] | None = None


def read_yaml(text: str, file: str | None, limits: Limits) -> tuple[Any, Place]:
    """Data and places of one YAML document.  Raises DesignError, LimitError."""
    try:
        loader = _loader(text)
        try:
            return _build(loader, file, limits)
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        detail = ", ".join(part for part in (error.context, error.problem) if part)
        mark = error.problem_mark or error.context_mark
        hint = "indent with spaces, not tabs" if mark and _at_tab(text, mark.line, mark.column) else ""
        raise DesignError(problem("yaml-syntax", f"this is not YAML: {detail}", hint, file=file, mark=mark)) from None
    except (yaml.YAMLError, RecursionError) as error:
        detail = str(error).split("\n")[0][:120]
        raise DesignError(problem("yaml-syntax", f"this is not YAML: {detail}", file=file)) from None


def _at_tab(text: str, line: int, column: int) -> bool:
    lines = text.splitlines()
    return line < len(lines) and lines[line][: column + 1].strip(" ").startswith("\t")


def _build(loader: Any, file: str | None, limits: Limits) -> tuple[Any, Place]:
    stack: list[_Open] = []
    anchors: dict[str, tuple[Any, Place, int]] = {}
    root: tuple[Any, Place] | None = None
    count = 0

    def refuse(code: str, detail: str, hint: str, mark: Any) -> DesignError:
        return DesignError(problem(code, detail, hint, file=file, mark=mark))

    def add(value: Any, place: Place, mark: Any) -> None:
        nonlocal root
        if not stack:
            if root is not None:
                raise refuse("several-documents", "the file holds more than one YAML document", "split it", mark)
            root = (value, place)
            return
        top = stack[-1]
        if isinstance(top.data, list):
            top.data.append(value)
            top.children.append(place)
        elif top.key is None:
            if not isinstance(value, str):
                raise refuse("bad-key", f"keys are texts; got {shown(value)}", "put it in quotes", mark)
            if len(value) > LONGEST_KEY:
                raise refuse("bad-key", f"no field has a name of {len(value)} characters", "", mark)
            if value in top.data:
                first = top.children[value][0]
                raise refuse(
                    "duplicate-key",
                    f"the field {value[:60]!r} is given twice (first in line {first.line})",
                    "keep one of them",
                    mark,
                )
            top.key = (value, place)
        else:
            name, at_key = top.key
            top.data[name] = value
            top.children[name] = (at_key, place)
            top.key = None

    while True:
        event = loader.get_event()
        mark = event.start_mark
        if isinstance(event, yaml.StreamEndEvent):
            break
        if isinstance(event, yaml.ScalarEvent | yaml.CollectionStartEvent | yaml.AliasEvent):
            count += 1
            if count > limits.nodes or len(stack) > limits.depth:
                raise LimitError(size_problem(limits, file, mark))
            tag = getattr(event, "tag", None)
            if tag is not None:
                raise refuse("yaml-tag", f"YAML tags are not accepted; got {tag[:60]!r}", "remove the tag", mark)
        if isinstance(event, yaml.ScalarEvent):
            # implicit[0] is true for plain scalars only: quoted and block scalars are text whatever they hold
            value = scalar(event.value) if event.implicit[0] else event.value
            place = Place(mark.line + 1, mark.column + 1)
            if event.anchor:
                anchors[event.anchor] = (value, place, 1)
            add(value, place, mark)
        elif isinstance(event, yaml.AliasEvent):
            alias = event.anchor or ""
            if alias not in anchors:
                raise refuse("yaml-alias", f"no finished value is called {alias[:60]!r}", "", mark)
            value, target, size = anchors[alias]
            count += size
            if count > limits.nodes:
                raise LimitError(size_problem(limits, file, mark))
            add(value, target, mark)
        elif isinstance(event, yaml.MappingStartEvent):
            stack.append(_Open({}, {}, mark, event.anchor, count))
        elif isinstance(event, yaml.SequenceStartEvent):
            stack.append(_Open([], [], mark, event.anchor, count))
        elif isinstance(event, yaml.CollectionEndEvent):
            done = stack.pop()
            place = Place(done.mark.line + 1, done.mark.column + 1, done.children)
            if done.anchor:
                anchors[done.anchor] = (done.data, place, count - done.start + 1)
            add(done.data, place, done.mark)
    if root is None:
        raise DesignError(
            problem("empty-document", "the document is empty", "start from examples/demo.yaml", file=file)
        )
    return root

"""The text of a YAML document with some of its values changed, and every other character as its author wrote it.

The parser's events say where each value stands.  What differs between the old data and the new is replaced at its own
place: a number by a number, an item of a list by its line.  Comments, order, anchors, spaces and the way in which
numbers are written stay, so that a version control system shows what was changed and nothing else.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from itertools import takewhile
from typing import Any

from .reading import DEFAULT_LIMITS, TextPosition, read_yaml
from .write import dump_block, dump_flow

IDENTITIES = ("label", "name")  # fields by which an item of a list is known again


def revise_yaml(text: str, old: Any, new: Any) -> str:
    """The text, which holds ``old``, so that it holds ``new``.

    Where the text says something in another way than ``old`` does, it is left as it is; a caller reads the outcome
    again and compares.  Raises DesignError for a text that is no YAML document.
    """
    text = text.removeprefix("\ufeff")
    editor = _Editor(text)
    editor.revise(read_yaml(text, None, DEFAULT_LIMITS)[1], old, new)
    return editor.finish()


@dataclass(slots=True)
class _Editor:
    """Replacements in a text, collected and then made."""

    text: str
    replacements: list[tuple[int, int, str]] = field(default_factory=list)
    anchors: dict[str, Any] = field(default_factory=dict)  # the values that aliases will stand for

    def finish(self) -> str:
        """The text with the replacements made; lines end as its first one does."""
        text, crlf = self.text, self.text.partition("\n")[0].endswith("\r")
        for start, end, replacement in sorted(self.replacements, key=lambda item: item[:2], reverse=True):
            text = text[:start] + (replacement.replace("\n", "\r\n") if crlf else replacement) + text[end:]
        return text

    def revise(self, node: TextPosition, old: Any, new: Any) -> None:
        """Make a value the new one."""
        if node.alias:
            if self.anchors.get(node.anchor or "") != new:
                self._replace(node, new)
            return
        if node.anchor:
            self.anchors[node.anchor] = new
        if isinstance(node.children, dict) and isinstance(old, dict) and isinstance(new, dict) and new:
            self._revise_mapping(node, old, new)
        elif isinstance(node.children, list) and isinstance(old, list) and isinstance(new, list) and old and new:
            self._revise_sequence(node, old, new)
        elif old != new:
            self._replace(node, new)

    def _replace(self, node: TextPosition, new: Any) -> None:
        """A value written anew in its place, its anchor before it."""
        start = node.start
        if not node.alias and (anchor := re.match(r"&\S+\s+", self.text[start : node.end])):
            start += anchor.end()
        before = self.text[start : node.end]
        replacement = _number(new, before) or self._dump(new, before)
        if isinstance(node.children, list) and not node.flow:
            replacement = "  " + replacement  # dashes may stand in the column of the key above, nothing else may
        ending = "\n" if node.children is None and not node.flow else ""
        self.replacements.append((start, node.end, replacement + ending))

    def _dump(self, value: Any, like: str) -> str:
        return dump_flow(value, spaced=not like.startswith("{") or like.startswith("{ "))

    # --- mappings ---------------------------------------------------------------------------------------------

    def _revise_mapping(self, node: TextPosition, old: dict[str, Any], new: dict[str, Any]) -> None:
        fields = node.children
        assert isinstance(fields, dict)
        names = list(fields)
        added = {name: value for name, value in new.items() if name not in old and name not in names}
        gone = [name for name in names if name in old and name not in new]
        if not node.flow and added and gone:  # what comes in place of something stands in its place
            key, part = fields[gone.pop(0)]
            indent = self._column(key.start)
            lines = dump_block(added, indent)[indent:].removesuffix("\n")
            self.replacements.append((key.start, self._end_of_line(part.end), lines))
            added = {}
        if (added or gone) and node.flow:
            self._replace(node, new)
            return
        if added:
            indent = self._column(fields[names[0]][0].start)
            self._insert_after(node.end, dump_block(added, indent))
        leading = len(list(takewhile(gone.__contains__, names)))
        if 0 < leading < len(names):
            first, left = fields[names[0]][0].start, fields[names[leading]][0].start
            if self.text[self._start_of_line(first) : first].strip():  # a dash, to which what is left comes
                self.replacements.append((first, left, ""))
                gone = gone[leading:]
        for name, (key, part) in fields.items():
            if name in gone:
                self._drop_lines(key.start, part.end)
            elif name in old and name in new:
                self.revise(part, old[name], new[name])

    # --- lists ------------------------------------------------------------------------------------------------

    def _revise_sequence(self, node: TextPosition, old: list[Any], new: list[Any]) -> None:
        parts = node.children
        assert isinstance(parts, list)
        pairs = _pair(old, new) if len(parts) == len(old) else None
        matched = {at: new[to] for at, to in pairs or ()}
        added = new[len(matched) :]
        starts = [self._dash(part.start) for part in parts]
        if (added or len(matched) < len(old)) and (pairs is None or node.flow or None in starts):
            if old != new:
                self._replace_items(node, parts[0], new, starts[0])
            return
        if added:  # before what the last item gets, which ends at the same place and comes to stand above
            like = self.text[parts[-1].start : parts[-1].end]
            indent = " " * self._column(starts[0] or 0)
            self._insert_after(node.end, "".join(f"{indent}- {self._dump(item, like)}\n" for item in added))
        for position, part in enumerate(parts):
            if position in matched:
                self.revise(part, old[position], matched[position])
            else:
                self._drop_lines(starts[position] or 0, part.end)

    def _replace_items(self, node: TextPosition, first_part: TextPosition, new: list[Any], first: int | None) -> None:
        """A list written anew, an item on each line if it was so."""
        if node.flow or first is None:
            self._replace(node, new)
            return
        like = self.text[first_part.start : first_part.end]
        indent = "\n" + " " * self._column(first)
        self.replacements.append((first, node.end, indent.join(f"- {self._dump(item, like)}" for item in new)))

    def _dash(self, start: int) -> int | None:
        """Where the dash before an item is; None if it is not the first of its line."""
        line = self.text[self._start_of_line(start) : start]
        return None if re.fullmatch(r" *- +", line) is None else start - len(line.lstrip(" "))

    # --- lines ------------------------------------------------------------------------------------------------

    def _start_of_line(self, at: int) -> int:
        return self.text.rfind("\n", 0, at) + 1

    def _end_of_line(self, at: int) -> int:
        """Before the line break of the line in which a value ends; a value that ends with its line is in that line."""
        if at and self.text[at - 1] == "\n":
            return at - 1
        end = self.text.find("\n", at)
        end = len(self.text) if end < 0 else end
        return end - (self.text[end - 1] == "\r")

    def _column(self, at: int) -> int:
        return at - self._start_of_line(at)

    def _drop_lines(self, start: int, end: int) -> None:
        """From the line of one place to that of another, with their comments."""
        last = self.text.find("\n", self._end_of_line(end))
        self.replacements.append((self._start_of_line(start), len(self.text) if last < 0 else last + 1, ""))

    def _insert_after(self, at: int, lines: str) -> None:
        """Lines below the one of a place."""
        end = self.text.find("\n", self._end_of_line(at))
        if end < 0:
            self.replacements.append((len(self.text), len(self.text), "\n" + lines))
        else:
            self.replacements.append((end + 1, end + 1, lines))


def _pair(old: list[Any], new: list[Any]) -> list[tuple[int, int]] | None:
    """Which item became which: those that are left first and in their order.  None if they are not."""
    if len(old) == len(new) and [_identity(item) for item in old] == [_identity(item) for item in new]:
        return [(index, index) for index in range(len(old))]
    known = {_identity(item): index for index, item in enumerate(old)}
    if None in known or len(known) < len(old) or any(_identity(item) is None for item in new):
        return None
    pairs = [(known[_identity(item)], to) for to, item in enumerate(new) if _identity(item) in known]
    in_order = [at for at, _ in pairs] == sorted(at for at, _ in pairs)
    return pairs if in_order and [to for _, to in pairs] == list(range(len(pairs))) else None


def _identity(item: Any) -> Any:
    """What an item is called, if it is called something."""
    if isinstance(item, dict):
        return next((item[name] for name in IDENTITIES if isinstance(item.get(name), str | int | float)), None)
    return None


def _number(value: Any, before: str) -> str | None:
    """A whole number without a point where one stood without it."""
    if isinstance(value, float) and value.is_integer() and re.fullmatch(r"[-+]?\d+", before):
        return str(int(value))
    return None

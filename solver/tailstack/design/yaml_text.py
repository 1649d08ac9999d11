"""The text of a YAML document with some of its values changed, and every other character as its author wrote it.

The parser's events say where each value stands.  What differs between the old data and the new is replaced at its own
place: a number by a number, an item of a list by its line.  Comments, order, anchors, spaces and the way in which
numbers are written stay, so that a version control system shows what was changed and nothing else.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

import yaml

from .write import dump_block, dump_flow

IDENTITIES = ("label", "name")  # fields by which an item of a list is known again


@dataclass(slots=True)
class Node:
    """A value of the document: which characters it is, and its parts."""

    start: int
    end: int
    kind: str  # scalar, mapping, sequence or alias
    flow: bool = True
    anchor: str | None = None
    parts: list[Node] = field(default_factory=list)
    keys: list[tuple[str, int]] = field(default_factory=list)  # of a mapping: key and where it begins


def revise_yaml(text: str, old: Any, new: Any) -> str:
    """The text, which holds ``old``, so that it holds ``new``.

    Where the text says something in another way than ``old`` does, it is left as it is; a caller reads the outcome
    again and compares.  Raises yaml.YAMLError for a text that is no YAML document.
    """
    text = text.removeprefix("\ufeff")
    editor = _Editor(text)
    editor.revise(_read_nodes(text), old, new)
    return editor.finish()


def _read_nodes(text: str) -> Node:
    """The tree of a document."""
    loader: Any = yaml.CSafeLoader(text) if yaml.__with_libyaml__ else yaml.SafeLoader(text)
    stack: list[Node] = []
    awaiting: list[tuple[str, int] | None] = []  # of each open mapping: the key whose value is to come
    try:
        while not isinstance(event := loader.get_event(), yaml.StreamEndEvent):
            start, end = event.start_mark.index, event.end_mark.index
            match event:
                case yaml.ScalarEvent():
                    if stack and stack[-1].kind == "mapping" and awaiting[-1] is None:
                        awaiting[-1] = (event.value, start)
                        continue
                    done = Node(start, end, "scalar", flow=event.style not in ("|", ">"), anchor=event.anchor)
                case yaml.AliasEvent():
                    done = Node(start, end, "alias", anchor=event.anchor)
                case yaml.CollectionStartEvent():
                    kind = "mapping" if isinstance(event, yaml.MappingStartEvent) else "sequence"
                    stack.append(Node(start, end, kind, flow=bool(event.flow_style), anchor=event.anchor))
                    awaiting.append(None)
                    continue
                case yaml.CollectionEndEvent():
                    done = stack.pop()
                    awaiting.pop()
                    # a block ends where its last value does, not where the parser notices that
                    done.end = end if done.flow else done.parts[-1].end
                case _:
                    continue
            if not stack:
                return done
            stack[-1].parts.append(done)
            if stack[-1].kind == "mapping":
                key = awaiting[-1]
                assert key is not None
                stack[-1].keys.append(key)
                awaiting[-1] = None
    finally:
        loader.dispose()
    raise yaml.YAMLError("the document is empty")


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

    def revise(self, node: Node, old: Any, new: Any) -> None:
        """Make a value the new one."""
        if node.kind == "alias":
            if self.anchors.get(node.anchor or "") != new:
                self._replace(node, new)
            return
        if node.anchor:
            self.anchors[node.anchor] = new
        if node.kind == "mapping" and isinstance(old, dict) and isinstance(new, dict) and new:
            self._revise_mapping(node, old, new)
        elif node.kind == "sequence" and isinstance(old, list) and isinstance(new, list) and new:
            self._revise_sequence(node, old, new)
        elif old != new:
            self._replace(node, new)

    def _replace(self, node: Node, new: Any) -> None:
        """A value written anew in its place, its anchor before it."""
        start = node.start
        if node.kind != "alias" and (anchor := re.match(r"&\S+\s+", self.text[start : node.end])):
            start += anchor.end()
        before = self.text[start : node.end]
        replacement = _number(new, before) or self._dump(new, before)
        if node.kind == "sequence" and not node.flow:
            replacement = "  " + replacement  # dashes may stand in the column of the key above, nothing else may
        self.replacements.append((start, node.end, replacement + ("" if node.flow or node.kind != "scalar" else "\n")))

    def _dump(self, value: Any, like: str) -> str:
        return dump_flow(value, spaced=not like.startswith("{") or like.startswith("{ "))

    # --- mappings ---------------------------------------------------------------------------------------------

    def _revise_mapping(self, node: Node, old: dict[str, Any], new: dict[str, Any]) -> None:
        names = [name for name, _ in node.keys]
        added = {name: value for name, value in new.items() if name not in old and name not in names}
        gone = [name in old and name not in new for name in names]
        if not node.flow and added and any(gone):  # what comes in place of something stands in its place
            first = gone.index(True)
            self._put_lines(node, first, added)
            gone[first], added = False, {}
        if (added or any(gone)) and node.flow:
            self._replace(node, new)
            return
        if added:
            indent = self._column(node.keys[0][1])
            self._insert_after(node.end, dump_block(added, indent))
        for position, (name, part) in enumerate(zip(names, node.parts, strict=True)):
            if gone[position]:
                self._drop_lines(node.keys[position][1], part.end)
            elif name in old and name in new:
                self.revise(part, old[name], new[name])

    def _put_lines(self, node: Node, position: int, added: dict[str, Any]) -> None:
        """Fields in the place of another one."""
        start, end = node.keys[position][1], node.parts[position].end
        indent = self._column(start)
        written = dump_block(added, indent)
        self.replacements.append((start, self._end_of_line(end), written[indent:].removesuffix("\n")))

    # --- lists ------------------------------------------------------------------------------------------------

    def _revise_sequence(self, node: Node, old: list[Any], new: list[Any]) -> None:
        pairs = _pair(old, new) if len(node.parts) == len(old) else None
        matched = {at: new[to] for at, to in pairs or ()}
        added = new[len(matched) :]
        starts = [self._dash(part.start) for part in node.parts]
        if (added or len(matched) < len(old)) and (pairs is None or node.flow or None in starts):
            if old != new:
                self._replace_items(node, new, starts)
            return
        if added:  # before what the last item gets, which ends at the same place and comes to stand above
            like = self.text[node.parts[-1].start : node.parts[-1].end]
            indent = " " * self._column(starts[0] or 0)
            self._insert_after(node.end, "".join(f"{indent}- {self._dump(item, like)}\n" for item in added))
        for position, part in enumerate(node.parts):
            if position in matched:
                self.revise(part, old[position], matched[position])
            else:
                self._drop_lines(starts[position] or 0, part.end)

    def _replace_items(self, node: Node, new: list[Any], starts: list[int | None]) -> None:
        """A list written anew, an item on each line if it was so."""
        first = starts[0]
        if node.flow or first is None:
            self._replace(node, new)
            return
        like = self.text[node.parts[0].start : node.parts[0].end]
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

"""ISO 10303-21, the text encoding of STEP files: instances by number, each parsed when it is asked for.

Files arrive from strangers.  One anchored pass notes where each instance stands; its expressions are possessive, so
that no text makes it go back.  What is parsed later is counted against a budget of bytes, so that references which
lead round in circles, or to one long list from everywhere, end in a refusal instead of taking for ever.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...design.reading import MOST_STEP_BYTES
from ...errors import LimitError, Problem, StepError

MOST_INSTANCES = 1_000_000
MOST_INSTANCE_BYTES = 2_000_000  # of one instance: a shell of a quarter of a million faces
MOST_NESTING = 16  # of lists in an instance
LEAST_BUDGET = 5_000_000  # bytes that may be parsed however short the file is; a longer one may be parsed twice
ACCESS_BYTES = 40  # what asking for an instance is counted as, beside its own length

_SPACE = rb"(?:\s++|/\*.*?\*/)*+"
_BODY = rb"(?:[^;'/]++|'[^']*+'|/\*.*?\*/|/(?!\*))*+;"
_INSTANCE = re.compile(_SPACE + rb"#(\d{1,18})\s*+=\s*+(\w*+)" + _BODY, re.DOTALL)
_SECTION = re.compile(_SPACE + rb"(ENDSEC|DATA|END-ISO-10303-21|[A-Z]\w*+)\b" + _BODY, re.DOTALL)
_TEXTS = re.compile(rb"'[^']*+'|/\*.*?\*/", re.DOTALL)  # and comments: no keyword stands in them
_KEYWORDS = re.compile(rb"(\w++)\s*+\(")  # also of typed values
_TOKEN = re.compile(
    _SPACE + rb"(?:#(\d{1,18})"
    rb"|([-+]?+\d++\.?+\d*+(?:[eE][-+]?+\d++)?+)(?![\w.])"
    rb"|'((?:[^']++|'')*+)'"
    rb"|\.([A-Za-z0-9_]++)\."
    rb"|([$*])"
    rb"|([(),])"
    rb"|([A-Za-z_]\w*+)"
    rb"|(\"[0-9A-F]*+\"))",
    re.DOTALL,
)
_COMPLEX = (b"REPRESENTATION_RELATIONSHIP", b"GEOMETRIC_TOLERANCE", b"DIMENSIONAL_LOCATION", b"DIMENSIONAL_SIZE")
_STARTS = {
    b"PK\x03\x04": "it is a ZIP archive (.stpz, .FCStd): unpack it, or export STEP",
    b"\x1f\x8b": "it is compressed: unpack it with gunzip",
    b"<?xml": "it is XML (.stpx): export AP242 as a STEP file in text form",
    b"\xff\xfe": "it is UTF-16: save it as plain text, in UTF-8",
    b"\xfe\xff": "it is UTF-16: save it as plain text, in UTF-8",
    b"solid": "it is STL, which holds triangles and no spheres: export STEP",
}


class Reference(int):
    """The number of another instance."""


class Word(str):
    """A value of an enumeration, such as T, F or MILLI."""


@dataclass(frozen=True, slots=True)
class Typed:
    """A value with its type, such as LENGTH_MEASURE(25.4); one part of a complex instance."""

    keyword: str
    values: list[Any]


@dataclass(frozen=True, slots=True)
class Instance:
    """One instance: its number and its values by keyword, several for a complex one.

    A value is a float, bytes (a text as it stands in the file), a Word, a Reference, a Typed, a list, or None for what
    is left out.
    """

    number: int
    parts: dict[str, list[Any]]


@dataclass(slots=True)
class _List:
    """A list that is being read: of parts, with spaces between them, or of values, with commas."""

    items: list[Any]
    keyword: str | None
    of_parts: bool


class Part21:
    """The instances of a file.

    ``wanted``: keywords whose instances can be listed.  Raises StepError with the line for what is not Part 21 and
    for numbers that stand twice, LimitError for what is too large.
    """

    def __init__(self, content: bytes, name: str, wanted: Iterable[str]) -> None:
        if len(content) > MOST_STEP_BYTES:
            detail = f"{name} is longer than {MOST_STEP_BYTES} bytes"
            hint = "export the reference structure alone, without the rest of the assembly"
            raise LimitError(Problem("", "too-large", detail, hint, name))
        self.name, self.schemas = name, tuple[str, ...]()
        self._content = content
        self._listed: dict[str, list[int]] = {keyword: [] for keyword in wanted}
        self._budget = max(LEAST_BUDGET, 2 * len(content))
        numbers, starts, ends = self._index()
        order = np.argsort(numbers, kind="stable")
        self._numbers, self._starts, self._ends = numbers[order], starts[order], ends[order]
        twice = np.flatnonzero(np.diff(self._numbers) == 0)
        if twice.size:
            number, start = int(self._numbers[twice[0]]), int(self._starts[twice[0] + 1])
            raise self._refuse_at(start, "duplicate-instance", f"#{number} is given twice", "export it anew")

    def list_numbers(self, keyword: str) -> list[int]:
        """Numbers of the instances of a wanted keyword; a complex one is listed by each of its own."""
        return self._listed[keyword]

    def list_values(self, keyword: str, count: int) -> Iterator[tuple[int, list[Any]]]:
        """Number and values of each instance of a wanted keyword, of which there are ``count``.  Raises StepError."""
        return ((number, self.part(self.read(number), keyword, count)) for number in self.list_numbers(keyword))

    def describe_encoding(self) -> str:
        """What to know of texts that are not UTF-8, in words; empty where all are."""
        begin = max(self._content.find(b"DATA;"), 0)
        try:
            self._content[begin:].decode("utf-8")
        except UnicodeDecodeError as error:
            line = self._line(begin + error.start)
            return (
                f"names are not UTF-8 from line {line} on (Shift-JIS, Windows-1252?): letters beyond ASCII are lost or "
                "others; export it in UTF-8, or rename the bodies"
            )
        return ""

    def is_by(self, program: str) -> bool:
        """Whether the header names a program."""
        return program.encode() in self._content[: max(self._content.find(b"DATA;"), 0)]

    def line_of(self, number: int) -> int | None:
        """The line where an instance begins."""
        at = self._find(number)
        return None if at is None else self._line(int(self._starts[at]))

    def keyword_of(self, number: Any, referrer: int | None) -> str:
        """The keyword of an instance; empty for a complex one, and for what is no reference.

        Raises DesignError for a reference to what is not there.
        """
        if not isinstance(number, Reference):
            return ""
        start, _ = self._span(number, referrer)
        self._spend(ACCESS_BYTES, number)
        match = re.compile(rb"\w*").match(self._content, start)
        return "" if match is None else match[0].decode("ascii", "replace").upper()

    def read(self, number: int, referrer: int | None = None) -> Instance:
        """Parse an instance.  Raises StepError if it is not there or is none, LimitError when that was too much."""
        start, end = self._span(number, referrer)
        self._spend(ACCESS_BYTES + end - start, number)
        values = self._parse(number, start, end)
        return Instance(number, {part.keyword: part.values for part in values})

    def values(self, number: Any, keyword: str, count: int, referrer: int) -> list[Any]:
        """The values of an instance of this keyword; there are ``count`` of them.  Raises StepError."""
        if not isinstance(number, Reference):
            detail = f"#{referrer} holds {_show(number)} where an instance of {keyword} belongs"
            raise self.refuse(referrer, "wrong-type", detail, "export it anew")
        return self.part(self.read(number, referrer), keyword, count)

    def part(self, instance: Instance, keyword: str, count: int) -> list[Any]:
        """The values of an instance that has this keyword; it has ``count`` of them.  Raises StepError."""
        values = instance.parts.get(keyword)
        if values is None:
            detail = f"#{instance.number} is {' '.join(instance.parts)[:80]} where {keyword} is wanted"
            raise self.refuse(instance.number, "wrong-type", detail, "export it anew")
        if len(values) != count:
            detail = f"{keyword} has {count} values; #{instance.number} has {len(values)}"
            raise self.refuse(instance.number, "wrong-count", detail, "export it anew")
        return values

    def references(self, value: Any, referrer: int) -> list[Reference]:
        """A list of references.  Raises StepError."""
        if not isinstance(value, list) or not all(isinstance(item, Reference) for item in value):
            detail = f"#{referrer} holds {_show(value)} where a list of instances belongs"
            raise self.refuse(referrer, "wrong-type", detail, "export it anew")
        return value

    def number(self, value: Any, referrer: int) -> float:
        """A number that geometry can be computed with.  Raises StepError."""
        value = value.values[0] if isinstance(value, Typed) and len(value.values) == 1 else value
        if not isinstance(value, float) or not abs(value) < 1e9:
            detail = f"#{referrer} holds {_show(value)} where a number below 1e9 belongs"
            raise self.refuse(referrer, "wrong-type", detail, "export it anew")
        return value

    def refuse(self, number: int | None, code: str, detail: str, hint: str = "") -> StepError:
        """A refusal at the line of an instance."""
        line = None if number is None else self.line_of(number)
        return StepError(Problem("", code, detail, hint, self.name, line))

    # --- the index ---------------------------------------------------------------------------------------

    def _index(self) -> tuple[Any, Any, Any]:
        """Numbers of the instances, where the text after = begins, where it ends."""
        content = self._content
        if not content.lstrip(b"\xef\xbb\xbf \t\r\n")[:12].startswith(b"ISO-10303-21"):
            hint = next((hint for start, hint in _STARTS.items() if content.startswith(start)), "export it as STEP")
            detail = "a STEP file begins with ISO-10303-21;"
            raise StepError(Problem("", "not-step", f"{detail} {self.name} does not", hint, self.name, 1))
        numbers, starts, ends = array("q"), array("q"), array("q")
        position, in_data, ended = content.index(b"ISO-10303-21"), False, False
        while not ended:
            match = _INSTANCE.match(content, position) if in_data else None
            if match is not None:
                start, position = match.start(2), match.end()
                if position - start > MOST_INSTANCE_BYTES:
                    detail = f"an instance has at most {MOST_INSTANCE_BYTES} bytes; #{int(match[1])} has more"
                    raise LimitError(Problem("", "too-large", detail, "", self.name, self._line(start)))
                numbers.append(int(match[1]))
                starts.append(start)
                ends.append(position - 1)
                self._list(match, int(match[1]))
                if len(numbers) > MOST_INSTANCES:
                    detail = f"a file has at most {MOST_INSTANCES} instances; {self.name} has more"
                    raise LimitError(Problem("", "too-many", detail, "export the structure alone", self.name))
                continue
            section = _SECTION.match(content, position)
            if section is None:
                shown = content[position : position + 400].split()[:1]
                detail = f"expected an instance such as #1=...; or ENDSEC; got {_show(b' '.join(shown))}"
                hint = "the file is cut off or damaged: export it anew"
                raise self._refuse_at(position + _count_space(content, position), "step-syntax", detail, hint)
            word, position = section[1], section.end()
            if word == b"FILE_SCHEMA":
                self.schemas = tuple(text.decode("latin-1") for text in re.findall(rb"'([^']{0,200})'", section[0]))
            in_data = word == b"DATA" or (in_data and word != b"ENDSEC")
            ended = word == b"END-ISO-10303-21"
        return tuple(
            np.frombuffer(part, dtype=np.int64) if part else np.zeros(0, np.int64) for part in (numbers, starts, ends)
        )  # type: ignore[return-value]

    def _list(self, match: re.Match[bytes], number: int) -> None:
        keyword = match[2]
        if keyword:
            listed = self._listed.get(keyword.decode("ascii", "replace").upper())
            if listed is not None:
                listed.append(number)
        elif any(word in match[0] for word in _COMPLEX):  # the only complex ones that are listed
            keywords = _KEYWORDS.findall(_TEXTS.sub(b" ", match[0]))
            for each, listed in self._listed.items():
                if each.encode() in keywords:
                    listed.append(number)

    def _span(self, number: int, referrer: int | None) -> tuple[int, int]:
        """Where an instance begins and ends.  Raises DesignError if it is not there."""
        at = self._find(number)
        if at is None:
            detail = f"#{referrer} names #{number}, which is not in the file"
            raise self.refuse(referrer, "missing-instance", detail, "export it anew")
        return int(self._starts[at]), int(self._ends[at])

    def _find(self, number: int) -> int | None:
        at = int(np.searchsorted(self._numbers, number))
        return at if at < self._numbers.size and int(self._numbers[at]) == number else None

    def _line(self, position: int) -> int:
        return self._content.count(b"\n", 0, position) + 1

    def _refuse_at(self, position: int, code: str, detail: str, hint: str) -> StepError:
        return StepError(Problem("", code, detail, hint, self.name, self._line(position)))

    def _spend(self, size: int, number: int) -> None:
        self._budget -= size
        if self._budget < 0:
            detail = "what the file refers to, again and again, is many times longer than the file itself"
            line = self.line_of(number)
            raise LimitError(Problem("", "too-much", detail, "export the structure alone", self.name, line))

    # --- one instance ------------------------------------------------------------------------------------

    def _parse(self, number: int, start: int, end: int) -> list[Typed]:
        """The parts of an instance: KEYWORD(...), or (KEYWORD(...) KEYWORD(...))."""
        lists: list[_List] = [_List([], None, True)]
        keyword: str | None = None  # read, and its list to come
        full = False  # a value was read, a comma or the end of its list is to come
        position = start
        while position < end:
            token = _TOKEN.match(self._content, position, end)
            if token is None:
                if position + _count_space(self._content, position) >= end:
                    break
                raise self._refuse_text(number, position)
            position, kind, mark, inner = token.end(), token.lastindex, token[6], lists[-1]
            if mark == b"(":
                first = len(lists) == 1 and not inner.items
                if keyword is None and (full or (inner.of_parts and not first)):
                    raise self._refuse_text(number, token.start())
                lists.append(_List([], keyword, first and keyword is None))
                keyword, full = None, False
                if len(lists) > MOST_NESTING:
                    raise self.refuse(number, "too-deep", f"lists are nested at most {MOST_NESTING} deep")
            elif keyword is not None:
                raise self._refuse_text(number, token.start())
            elif mark == b")":
                if len(lists) == 1 or (inner.items and not inner.of_parts and not full):
                    raise self._refuse_text(number, token.start())
                lists.pop()
                lists[-1].items.append(inner.items if inner.keyword is None else Typed(inner.keyword, inner.items))
                full = not lists[-1].of_parts
            elif mark == b",":
                if not full:
                    raise self._refuse_text(number, token.start())
                full = False
            elif full or (inner.of_parts and kind != 7):
                raise self._refuse_text(number, token.start())
            elif kind == 7:
                keyword = token[7].decode("ascii", "replace").upper()
            else:
                inner.items.append(_value(token, kind))
                full = True
        parts = lists[0].items
        parts = parts[0] if len(parts) == 1 and isinstance(parts[0], list) else parts
        if len(lists) != 1 or keyword is not None or not parts or not all(isinstance(part, Typed) for part in parts):
            raise self._refuse_text(number, start)
        return parts

    def _refuse_text(self, number: int, position: int) -> StepError:
        detail = f"#{number} cannot be read from {_show(self._content[position : position + 20])} on"
        return self._refuse_at(position, "step-syntax", detail, "the file is damaged: export it anew")


def _value(token: re.Match[bytes], kind: int | None) -> Any:
    text = token[kind or 0]
    if kind == 1:
        return Reference(text)
    if kind == 2:
        return float(text)
    if kind == 4:
        return Word(text.decode("ascii").upper())
    return text if kind == 3 else None


def _count_space(content: bytes, position: int) -> int:
    match = re.compile(_SPACE, re.DOTALL).match(content, position)
    return 0 if match is None else len(match[0])


def _show(value: Any) -> str:
    if isinstance(value, Reference):
        return f"#{int(value)}"
    if isinstance(value, bytes):
        return repr(value[:40].decode("latin-1"))
    return "nothing" if value is None else repr(value)[:40]


# --- texts ------------------------------------------------------------------------------------------------

_ESCAPE = re.compile(
    r"\\X2\\((?:[0-9A-F]{4})*)\\X0\\|\\X4\\((?:[0-9A-F]{8})*)\\X0\\|\\X\\([0-9A-F]{2})"
    r"|\\S\\(.)|\\P[A-I]\\|\\\\|''",
    re.DOTALL,
)


def decode_text(value: Any) -> str:
    """A text of the file, its escapes resolved, on one line; empty for what is none."""
    if not isinstance(value, bytes):
        return ""
    try:
        text = value.decode("utf-8")
    except UnicodeDecodeError:
        text = value.decode("latin-1")
    text = _ESCAPE.sub(_resolve, text).replace("\N{REPLACEMENT CHARACTER}", "?")
    return " ".join("".join(each if each.isprintable() else " " for each in text).split())


def _resolve(match: re.Match[str]) -> str:
    wide, wider, byte, shifted = match.groups()
    if wide is not None:
        return bytes.fromhex(wide).decode("utf-16-be", "replace")
    if wider is not None:
        return bytes.fromhex(wider).decode("utf-32-be", "replace")
    if byte is not None:
        return chr(int(byte, 16))
    if shifted is not None:
        return chr((ord(shifted) + 128) % 256) if ord(shifted) < 128 else shifted
    return {"\\\\": "\\", "''": "'"}.get(match[0], "")

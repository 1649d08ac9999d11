"""A document into plain data: files, encodings, YAML or JSON, and data that a caller hands over.

A design arrives from strangers, so the reader is small and closed: text is decoded strictly, duplicate
keys and tags are refused, nesting, values and bytes are bounded, and every refusal has a line.

YAML becomes plain data, with the place of every value, from libyaml's *events* and without recursion.  Building the
tree here is what makes a bomb of nesting or aliases an error message instead of a crash: depth and values are counted
on the way, an alias at the size of what it stands for.

Plain scalars follow the core schema of YAML 1.2: ``yes``, ``no``, ``on``, ``off``, ``1:30`` and ``1_000``
are text, ``1e3`` is a number.  Integers with leading zeros mean different numbers in YAML 1.1 and 1.2,
so they stay text and a field that wants a number refuses them.

A line ends where YAML 1.2 and Git end it: at LF, CRLF or CR.  libyaml, of YAML 1.1, ends it at U+0085, U+2028 and
U+2029 too, so it is given other characters in their place.  Outside quoted texts they are refused, as is all else by
which a reader sees another document than the parser does.

A zero has no sign, in whatever form it arrives: ``-0.0`` is 0.0, since not every writer of JSON keeps the sign, and a
design has one hash.  Adding 0.0 takes it away.
"""

from __future__ import annotations

import json
import os
import re
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, Literal, NamedTuple, NoReturn

import numpy as np
import yaml

from ..cures import find_nearest
from ..errors import DesignError, LimitError, Problem, write_pointer
from ..people_tables import encoding_of
from ..results.json_text import find_repeated, write_json
from .numbers import plain_array

Format = Literal["auto", "yaml", "json"]
DOCUMENTS = (".yaml", ".yml", ".json")  # how files of documents end
STEP_FILES = (".step", ".stp", ".p21")
MOST_STEP_BYTES = 32_000_000

_NESTING = frozenset({dict, list})


@dataclass(frozen=True, slots=True)
class DocumentSource:
    """A document as it was read: plain data, and the places of its values when it came as text."""

    data: Any
    file: str | None  # how the user calls the file
    directory: Path | None  # what file references are relative to
    place: TextPosition | None = None
    json_text: str | None = None  # JSON is located only when an error asks for it

    def with_places(self) -> DocumentSource:
        """The same source with places, if its text can be located; ask before locating several paths."""
        if self.place is not None or self.json_text is None:
            return self
        try:
            return replace(self, place=read_yaml(self.json_text, self.file, DEFAULT_LIMITS)[1])
        except (DesignError, LimitError):  # JSON that is not YAML (pairs of surrogate escapes)
            return replace(self, json_text=None)

    def locate(self, path: Iterable[str | int], *, key: bool = False) -> tuple[int | None, int | None]:
        """Line and column of a path, (None, None) when the document did not come as text."""
        place = self.with_places().place
        if place is None:
            return None, None
        position = place.find(path, key=key)
        return position.line, position.column


def read_bytes(path: Path, limit: int, name: str, *, document: bool = False, whole: bool = True) -> bytes:
    """The bytes of a regular file of at most ``limit`` bytes; of a ``document`` what is no text is refused by its kind.

    Not ``whole``: of a longer one its beginning.

    Raises DesignError or LimitError.
    """
    try:
        if not path.exists():
            hint = name_neighbours(path, name) or "check the path"
            raise DesignError(problem("file-not-found", f"no such file: {name}", hint, file=name))
        if not path.is_file():
            kind = "a directory" if path.is_dir() else "not a regular file"
            raise DesignError(problem("not-a-file", f"{name} is {kind}", "give a file", file=name))
        with path.open("rb") as stream:
            content = stream.read(limit + 1)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        reason = getattr(error, "strerror", None) or str(error)
        raise DesignError(problem("file-unreadable", f"cannot read {name}: {reason}", file=name)) from None
    if document:
        refuse_foreign(content, name)
    if len(content) > limit and whole:
        raise LimitError(problem("too-large", f"{name} is longer than {limit} bytes", "make it smaller", file=name))
    return content


MOST_NEIGHBOURS = 2000  # entries of a folder that are looked through


def name_neighbours(path: Path, given: str, endings: tuple[str, ...] = ()) -> str:
    """What may have been meant by a file that is missing: one beside it or a folder below; else what is there.

    ``given``: how the caller calls the file, and a name in the hint is one that can be typed in its place.
    ``endings``: of files that can be meant; none: those of documents for a document, else that of the missing one.
    """
    folder, prefix = path.parent, os.path.dirname(given)
    while prefix and not folder.is_dir():
        folder, prefix = folder.parent, os.path.dirname(prefix)
    ending = path.suffix.lower()
    wanted = endings or (DOCUMENTS if ending in DOCUMENTS else (ending,))
    folders = [each for each in _list_folder(folder, ()) if (folder / each).is_dir()][:50]
    names = {name: name for name in _list_folder(folder, wanted)}  # each with its place below the folder
    for each in folders:
        names = {name: f"{each}/{name}" for name in _list_folder(folder / each, wanted)} | names
    stems = {_cut_ending(name, wanted): place for name, place in names.items()}  # endings alone make names alike
    if nearest := find_nearest(_cut_ending(path.name, wanted), stems):
        return f"did you mean {os.path.join(prefix, stems[nearest[0]])}?"
    listed = [os.path.join(prefix, name) for name in sorted(names.values())[:6]]
    return f"there is {', '.join(listed)}" if listed and endings else ""


def _cut_ending(name: str, endings: tuple[str, ...]) -> str:
    return next((name[: -len(end)] for end in endings if end and name.lower().endswith(end)), name)


def _list_folder(folder: Path, endings: tuple[str, ...]) -> list[str]:
    """Names in a folder that end so, none of them hidden, in their order; an unreadable folder holds none."""
    try:
        with os.scandir(folder) as entries:
            names = [entry.name for entry in islice(entries, MOST_NEIGHBOURS)]
    except OSError:
        return []
    shown = [name for name in names if name.isprintable() and not name.startswith(".")]
    return sorted(name for name in shown if not endings or name.lower().endswith(endings))


_CONVERTED = "tailstack convert {file} -o design.yaml makes a design of its balls"
_CHECKED = "if it is a report, tailstack report --verify {file} checks it"
_EXPORTED = f"{_CHECKED}; a CAD project is exported as STEP first"
_FOREIGN = (  # files of other kinds by their first bytes: code, what it is, what it is for
    (b"ISO-10303-21", "step-file", "a STEP file", _CONVERTED),
    (b"%PDF-", "report-file", "a PDF", _CHECKED),
    (b"PK\x03\x04", "report-file", "a ZIP archive (a spreadsheet, a CAD project)", _EXPORTED),
    (b"<!doctype html", "report-file", "a web page", _CHECKED),
)


def refuse_foreign(content: bytes, name: str | None) -> None:
    """Raises DesignError for a file of another kind, with what can be done with it."""
    begin = content[:200].lstrip()
    for mark, code, what, hint in _FOREIGN:
        if begin[: len(mark)].lower() == mark.lower():
            message = f"this is {what}; a design is a text in YAML or JSON"
            raise DesignError(problem(code, message, hint.format(file=name or "FILE"), file=name))


def decode(content: bytes, name: str | None) -> str:
    """Strict UTF-8, or UTF-16/32 with a byte order mark.  Raises DesignError."""
    encoding = encoding_of(content)
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError as error:
        detail = f"byte {error.start} is not valid {error.encoding.upper()}: this is not a text file"
        raise DesignError(problem("not-text", detail, "save it as UTF-8", file=name)) from None
    if "\0" in text:
        detail = f"character {text.index(chr(0))} is NUL: a binary file, or UTF-16 without a byte order mark"
        raise DesignError(problem("not-text", detail, "save it as UTF-8", file=name))
    return text


def read_text(text: str, limits: Limits, *, file: str | None, directory: Path | None, form: Format) -> DocumentSource:
    """Parse a document.  Raises DesignError (syntax, tags, duplicate keys) or LimitError (size, long keys)."""
    if len(text) > limits.document_bytes:
        detail = f"the document is longer than {limits.document_bytes} characters"
        raise LimitError(problem("too-large", detail, file=file))
    _refuse_surrogates(text, (), file)
    text = text.removeprefix("\ufeff")
    if (file or form != "json") and (found := _REORDERS.search(text)):  # JSON without a file is between programs
        raise DesignError(_unseen_problem(text, found.start(), file, IN_QUOTES))
    if not text.strip():
        detail = "the document is empty"
        raise DesignError(problem("empty-document", detail, "start from `tailstack example demo`", file=file))
    if form == "json" or (form == "auto" and text.lstrip()[:1] == "{"):
        try:
            return DocumentSource(_from_json(text, limits, file), file, directory, json_text=text)
        except json.JSONDecodeError as error:
            if form == "json":
                hint, detail = LOOKS_LIKE_YAML if _YAML.match(text) else "", f"this is not JSON: {error.msg}"
                raise DesignError(Problem("", "json-syntax", detail, hint, file, error.lineno, error.colno)) from None
    try:
        data, place = read_yaml(text, file, limits)
    except DesignError:
        if _POINTS.match(text):
            raise DesignError(point_list_problem(file)) from None
        raise
    if isinstance(data, str) and _POINTS.match(text):
        raise DesignError(point_list_problem(file))
    return DocumentSource(data, file, directory, place=place)


LOOKS_LIKE_YAML = "it looks like YAML: call the file .yaml instead of .json"
_YAML = re.compile(r"(\s*(#[^\n]*|---[^\n]*)?\n)*\s*[A-Za-z_]+[ ]*:(\s|$)")  # a first line that is a field
# What the files of fiducials begin with: a header of CSV, or what 3D Slicer writes into .fcsv.
_POINTS = re.compile(
    r"(\s*#[^\n]*\n)*\s*((label|name)\s*[,;\t]\s*)?x\b[^\n]*[,;\t]\s*y\b|\s*# *Markups fiducial file|"
    r"(\s*#[^\n]*\n)*\s*((label|name)\s*[,;\t]\s*)?x_\w+\s*[,;\t]\s*y_",
    re.IGNORECASE,
)


def point_list_problem(file: str | None) -> Problem:
    """A list of fiducials where a document is wanted."""
    if file is None:
        hint = "put the points under fiducials.points of a design: [{label: F1, position_mm: [x, y, z]}, ...]"
        return Problem("", "point-list", "this is a list of points, not a design", hint)
    own, known = Path(file), (".csv", ".tsv", ".fcsv", ".json")  # endings that fiducial files have
    name, first = (own.name, "") if own.name.lower().endswith(known) else (f"{own.stem}.csv", "name it so and ")
    hint = f"{first}put it under fiducials.file of a design: fiducials: {{file: {name}}}"
    return Problem("", "point-list", "this is a list of points, not a design", hint, file, 1, 1)


def plain_data(value: Any, limits: Limits) -> Any:
    """A copy of data that a caller handed over, with nothing in it but JSON's types; what is frozen is shared.

    Raises DesignError for other types and keys, LimitError for nesting (cycles included), size and long keys.
    """
    count = 0

    def copy(item: Any, path: tuple[str | int, ...]) -> Any:
        nonlocal count
        count += 1
        if len(path) > limits.depth or count > limits.nodes:
            raise LimitError(size_problem(limits, None, None))
        if isinstance(item, np.generic | np.ndarray):
            item = plain_array(item, write_pointer(path))
        kind = type(item)
        if kind is float:
            return item + 0.0
        if kind is FrozenMapping or kind is FrozenList:  # of a design: plain already
            return item
        if kind is dict or isinstance(item, Mapping):
            for key in item:
                if not isinstance(key, str):
                    raise DesignError(Problem(write_pointer(path), "bad-key", f"keys are texts; got {show(key)}"))
                if len(key) > LONGEST_KEY:
                    raise LimitError(replace(_long_key_problem(key, None, None), pointer=write_pointer(path)))
                _refuse_surrogates(key, path)
            return {key: copy(child, (*path, key)) for key, child in item.items()}
        if kind is list or isinstance(item, list | tuple):
            return [copy(child, (*path, index)) for index, child in enumerate(item)]
        if kind is str:
            _refuse_surrogates(item, path)
        elif kind is int and item.bit_length() > 64:
            return _vast(item)
        if item is None or kind in (str, int, bool, Vast):
            return item
        detail = f"a document holds texts, numbers, lists and mappings; got {show(item)}"
        raise DesignError(Problem(write_pointer(path), "unsupported-value", detail))

    return copy(value, ())


def _vast(number: int) -> Vast:
    try:
        return Vast(str(number))
    except ValueError:  # more digits than Python writes down
        return Vast("-" if number < 0 else "+")


def _refuse_surrogates(text: str, path: tuple[str | int, ...], file: str | None = None) -> None:
    """Half a surrogate pair is not text: it can be neither written nor hashed."""
    try:
        text.encode()
    except UnicodeEncodeError:
        detail = "the text holds half a surrogate pair"
        raise DesignError(Problem(write_pointer(path), "not-text", detail, file=file)) from None


def _from_json(text: str, limits: Limits, file: str | None) -> Any:
    mappings: list[dict[str, Any]] = []

    def pairs(items: list[tuple[str, Any]]) -> dict[str, Any]:
        result = dict(items)
        mappings.append(result)
        if len(result) < len(items):
            key = find_repeated(items)
            at = text.rfind(write_json(key))  # the last time
            line, what = text.count("\n", 0, at) + 1 if at >= 0 else None, f"the field {key[:60]!r} is given twice"
            raise DesignError(Problem("", "duplicate-key", what, "keep one of them", file, line))
        return result

    try:
        signed = "-0" in text  # a zero with a sign may be among the numbers
        data = json.loads(text, object_pairs_hook=pairs, parse_int=integer, parse_float=_number if signed else None)
    except RecursionError:
        raise LimitError(size_problem(limits, file, None)) from None
    # json makes nothing but JSON's types, halves of surrogate pairs only of escapes, and fewer values than characters
    longest = max(map(len, set().union(*mappings)), default=0)
    if "\\u" in text or len(text) > limits.nodes or longest > LONGEST_KEY or not _shallow(data, limits.depth):
        return plain_data(data, limits)
    return data


def _shallow(data: Any, depth: int) -> bool:
    """Whether data that json made has no mappings and lists but on its first ``depth`` levels."""
    level: list[Any] = [[data]]
    for _ in range(depth + 1):
        inside = [item.values() if type(item) is dict else item for item in level]
        level = [child for items in inside for child in items if type(child) in _NESTING]
        if not level:
            return True
    return False


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


class TextPosition(NamedTuple):
    """Where a value stands in its file (1-based), which of its characters it is, and where its children stand."""

    line: int
    column: int
    start: int
    end: int
    children: dict[str, tuple[TextPosition, TextPosition]] | list[TextPosition] | None = None  # mapping: key, value
    flow: bool = True  # false: a block, which ends with its line
    anchor: str | None = None
    alias: bool = False  # whether the anchor is that of another value, which stands here

    def find(self, path: Iterable[str | int], *, key: bool = False) -> TextPosition:
        """The place of a path of keys and indices, or of its nearest ancestor; ``key``: of the key itself."""
        here = at_key = self
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


def _number(text: str) -> float:
    return float(text) + 0.0


def scalar(text: str) -> Any:
    """A plain scalar by the core schema of YAML 1.2, integers with leading zeros excepted."""
    if text in _OTHER:
        return _OTHER[text]
    if _INTEGER.match(text):
        return integer(text)
    if _FLOAT.match(text):
        return _number(text)
    return text


class _Open:
    """A collection whose end has not been read yet."""

    __slots__ = ("begin", "children", "count", "data", "key")

    def __init__(self, data: Any, children: Any, begin: Any, count: int) -> None:
        self.data, self.children, self.begin, self.count = data, children, begin, count  # begin: its event
        self.key: tuple[str, TextPosition] | None = None


_YAML_CURES = {  # by what the parser says
    "did not find expected": "fields of one mapping, and items of one list, begin in the same column; "
    "every bracket and quote that is opened is closed",
    "mapping values are not allowed": "a text that holds a colon stands in quotes; fields of one mapping begin in the "
    "same column",
}


def read_yaml(text: str, file: str | None, limits: Limits) -> tuple[Any, TextPosition]:
    """Data and places of one YAML document.  Raises DesignError, LimitError."""
    if found := _FORBIDDEN.search(text) or ("\n" in text and _RETURN.search(text)):
        raise DesignError(_unseen_problem(text, found.start(), file, "remove it"))
    unseen = _Unseen(text, file)
    try:
        loader = yaml.CSafeLoader(unseen.text) if yaml.__with_libyaml__ else yaml.SafeLoader(unseen.text)
        try:
            return _build(loader, file, limits, unseen)
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        detail = ", ".join(part for part in (error.context, error.problem) if part)
        mark = error.problem_mark or error.context_mark
        if mark:
            unseen.refuse_before(mark.index)  # which is why it is no YAML, as likely as not
        hint = next((cure for words, cure in _YAML_CURES.items() if words in detail), "")
        hint = "indent with spaces, not tabs" if mark and _at_tab(text, mark.line, mark.column) else hint
        raise DesignError(problem("yaml-syntax", f"this is not YAML: {detail}", hint, file=file, mark=mark)) from None
    except (yaml.YAMLError, RecursionError) as error:
        detail = str(error).split("\n")[0][:120]
        raise DesignError(problem("yaml-syntax", f"this is not YAML: {detail}", file=file)) from None


_LINE = re.compile(r"\r\n|\r|\n")


def _at_tab(text: str, line: int, column: int) -> bool:
    lines = _LINE.split(text)
    return line < len(lines) and lines[line][: column + 1].strip(" ").startswith("\t")


# --- what a reader does not see as the parser does --------------------------------------------------------------

# Turns the order in which what follows is shown, up to the end of the line and out of quotes
_REORDERS = re.compile("[\u202a-\u202e\u2066-\u2069]")
# No characters of YAML at all: libyaml refuses them without a line
_FORBIDDEN = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x84\x86-\x9f\ufffe\uffff]")
# A line of YAML 1.2 that Git, diffs and terminals do not show as one; where all lines end so, none hides behind others
_RETURN = re.compile(r"\r(?!\n)")
_FOREIGN_BREAKS = "\x85\u2028\u2029"  # lines of YAML 1.1 and of some editors, not of YAML 1.2 and Git
_UNSEEN = re.compile(f"[{_FOREIGN_BREAKS}\u061c\u200e\u200f\ufeff]")  # the last: marks of direction and of byte order
IN_QUOTES = 'remove it, or write it as an escape in double quotes: "\\u{0:04x}"'
OUTSIDE_QUOTES = "remove it; only a text in quotes can hold it"
_NAMES = {"\x85": "NEXT LINE", "\r": "CARRIAGE RETURN without LINE FEED"}


def _unseen_problem(text: str, at: int, file: str | None, hint: str) -> Problem:
    sign = text[at]
    name = _NAMES.get(sign) or unicodedata.name(sign, "a control character")
    lines = _LINE.split(text[:at])
    detail = f"U+{ord(sign):04X} ({name}) is not shown as what it is, so a reader sees another document than is read"
    return Problem("", "unseen-character", detail, hint.format(ord(sign)), file, len(lines), len(lines[-1]) + 1)


class _Unseen:
    """The text for the parser, and what of it may stand in quoted texts only."""

    def __init__(self, text: str, file: str | None) -> None:
        self.text, self._given, self._file = text, text, file
        self._places = (found.start() for found in _UNSEEN.finditer(text))
        self._next = next(self._places, None)
        self._back: dict[int, str] = {}
        if self._next is not None:
            known, private = set(text), (*range(0xE000, 0xF900), *range(0xF0000, 0xFFFFE), *range(0x100000, 0x10FFFE))
            spare = (number for number in private if chr(number) not in known)
            there = {ord(sign): next(spare) for sign in _FOREIGN_BREAKS}
            self.text = text.translate(there)
            self._back = {own: chr(sign) for sign, own in there.items()}

    def restore(self, text: str) -> str:
        """A text of the document, from what the parser was given."""
        return text.translate(self._back) if self._back else text

    def refuse_before(self, end: int) -> None:
        """Raises DesignError where one stands before this character, outside of the quoted texts that were passed."""
        if self._next is not None and self._next < end:
            raise DesignError(_unseen_problem(self._given, self._next, self._file, OUTSIDE_QUOTES))

    def pass_quoted(self, event: Any) -> None:
        """Let those in a quoted text be."""
        self.refuse_before(event.start_mark.index)
        while self._next is not None and self._next < event.end_mark.index:
            self._next = next(self._places, None)


class _Builder:
    """Data and places of one document, put together from the events of the parser."""

    def __init__(self, file: str | None, limits: Limits) -> None:
        self.file, self.limits = file, limits
        self.root: tuple[Any, TextPosition] | None = None
        self._stack: list[_Open] = []  # collections that have begun and not ended
        self._anchors: dict[str, tuple[Any, TextPosition, int]] = {}  # finished values with their numbers of nodes
        self._count = 0  # nodes, those behind aliases counted each time

    def take(self, event: Any) -> None:
        """Raises DesignError, LimitError."""
        mark = event.start_mark
        if isinstance(event, yaml.ScalarEvent | yaml.CollectionStartEvent | yaml.AliasEvent):
            self._count_nodes(1, mark)
            tag = getattr(event, "tag", None)
            if tag is not None:
                raise self._refuse("yaml-tag", f"YAML tags are not accepted; got {tag[:60]!r}", "remove the tag", mark)
        if isinstance(event, yaml.ScalarEvent):
            # implicit[0] is true for plain scalars only: quoted and block scalars are text whatever they hold
            value = scalar(event.value) if event.implicit[0] else event.value
            self._finish(value, _place(event, event, flow=event.style not in ("|", ">")), event, 1)
        elif isinstance(event, yaml.AliasEvent):
            alias = event.anchor or ""
            if alias not in self._anchors:
                raise self._refuse("yaml-alias", f"no finished value is called {alias[:60]!r}", "", mark)
            value, place, size = self._anchors[alias]
            self._count_nodes(size, mark)
            own = _place(event, event)
            self._add(value, place._replace(start=own.start, end=own.end, alias=True), mark)
        elif isinstance(event, yaml.MappingStartEvent):
            self._stack.append(_Open({}, {}, event, self._count))
        elif isinstance(event, yaml.SequenceStartEvent):
            self._stack.append(_Open([], [], event, self._count))
        elif isinstance(event, yaml.CollectionEndEvent):
            done = self._stack.pop()
            place = _place(done.begin, event, done.children, bool(done.begin.flow_style))
            self._finish(done.data, place, done.begin, self._count - done.count + 1)

    def _refuse(self, code: str, detail: str, hint: str, mark: Any) -> DesignError:
        return DesignError(problem(code, detail, hint, file=self.file, mark=mark))

    def _count_nodes(self, more: int, mark: Any) -> None:
        self._count += more
        if self._count > self.limits.nodes or len(self._stack) > self.limits.depth:
            raise LimitError(size_problem(self.limits, self.file, mark))

    def _finish(self, value: Any, place: TextPosition, begin: Any, size: int) -> None:
        """A value that is complete; under its anchor it can be named again."""
        if place.anchor:
            self._anchors[place.anchor] = (value, place, size)
        self._add(value, place, begin.start_mark)

    def _add(self, value: Any, place: TextPosition, mark: Any) -> None:
        """A value to the collection that is open: an element, a key, or the value of the key before."""
        if not self._stack:
            if self.root is not None:
                raise self._refuse("several-documents", "the file holds more than one YAML document", "split it", mark)
            self.root = (value, place)
            return
        top = self._stack[-1]
        if isinstance(top.data, list):
            top.data.append(value)
            top.children.append(place)
        elif top.key is None:
            self._check_key(value, top, mark)
            top.key = (value, place)
        else:
            name, at_key = top.key
            top.data[name] = value
            top.children[name] = (at_key, place)
            top.key = None

    def _check_key(self, key: Any, mapping: _Open, mark: Any) -> None:
        if type(key) is int and mapping.data:
            field, value = list(mapping.data.items())[-1]
            self._refuse_decimals(key, field, value, mark)
        if not isinstance(key, str):
            raise self._refuse("bad-key", f"keys are texts; got {show(key)}", "put it in quotes", mark)
        if len(key) > LONGEST_KEY:
            raise LimitError(_long_key_problem(key, self.file, mark))
        if key in mapping.data:
            line = mapping.children[key][0].line
            detail = f"the field {key[:60]!r} is given twice (first in line {line})"
            raise self._refuse("duplicate-key", detail, "keep one of them", mark)

    def _refuse_decimals(self, key: int, field: str, value: Any, mark: Any) -> None:
        """In ``{ a: 1,5 }`` the comma ends the value 1, and 5 is the next key."""
        if type(value) is not int:
            return
        # of every collection that is open, the element or field that is being read; of the last, the one before
        steps = [len(item.data) if isinstance(item.data, list) else (item.key or ("",))[0] for item in self._stack[:-1]]
        at = write_pointer((*steps, field))
        hint = f"if {value},{key} is one number, write it with a point: {value}.{key}"
        where = Problem(at, "bad-key", f"keys are texts; got {show(key)}", hint)
        raise DesignError(replace(where, file=self.file, line=mark.line + 1, column=mark.column + 1))


def _place(begin: Any, end: Any, children: Any = None, flow: bool = True) -> TextPosition:
    """Of a value from one event to another; a block ends where its last value does, not where the parser notices it."""
    mark, last = begin.start_mark, end.end_mark.index
    if children and not flow:
        values = children if isinstance(children, list) else [value for _, value in children.values()]
        last = values[-1].end
    return TextPosition(mark.line + 1, mark.column + 1, mark.index, last, children, flow, begin.anchor)


def _build(loader: Any, file: str | None, limits: Limits, unseen: _Unseen) -> tuple[Any, TextPosition]:
    builder = _Builder(file, limits)
    while not isinstance(event := loader.get_event(), yaml.StreamEndEvent):
        if isinstance(event, yaml.ScalarEvent) and event.style in ("'", '"'):
            unseen.pass_quoted(event)
            event.value = unseen.restore(event.value)
        builder.take(event)
    unseen.refuse_before(len(unseen.text))
    if builder.root is None:
        detail = "the document is empty"
        raise DesignError(problem("empty-document", detail, "start from `tailstack example demo`", file=file))
    return builder.root


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds on what is read.  Everything beyond them is refused, and the refusal states them."""

    document_bytes: int = 1_000_000  # of a design
    fiducial_file_bytes: int = 1_000_000  # of a fiducial file
    nodes: int = 50_000  # values in a document, aliases counted at the size of what they stand for
    depth: int = 24  # of nesting
    fiducials: int = 1000  # of a design
    targets: int = 200  # of a design, regions expanded
    views: int = 16  # of a design
    problems: int = 25  # how many problems are listed before "and more"


DEFAULT_LIMITS = Limits()


class Vast(float):
    """A whole number beyond any field's range: infinite, so that it is refused where it stands, but told as it came."""

    __slots__ = ("written",)
    written: str

    def __new__(cls, written: str) -> Vast:
        made = super().__new__(cls, "-inf" if written.startswith("-") else "inf")
        made.written = written
        return made


def problem(code: str, detail: str, hint: str = "", *, file: str | None = None, mark: Any = None) -> Problem:
    """A problem of the document as a whole, at a YAML mark if there is one."""
    line = None if mark is None else mark.line + 1
    column = None if mark is None else mark.column + 1
    return Problem("", code, detail, hint, file, line, column)


def hide_nothing(text: str) -> str:
    """YAML with escapes, in its double quotes, for what is not shown as what it is."""
    return re.sub(f"{_UNSEEN.pattern}|{_REORDERS.pattern}", lambda found: f"\\u{ord(found.group()):04X}", text)


def is_unseen(text: str) -> bool:
    """Whether a text holds what is seen in double quotes only, as an escape."""
    return hide_nothing(text) != text


def show(value: Any, length: int = 60) -> str:
    """What arrived, short enough for a message."""
    if isinstance(value, str):
        body = value if len(value) <= length else value[: length - 3] + "..."
        return "the text " + write_json(body)
    if value is None:
        return "nothing (null)"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Vast):
        digits = value.written.lstrip("+-")
        if not digits:
            return "an integer of more than 4300 digits"
        cut = digits if len(digits) <= length // 2 else f"{digits[:24]}... ({len(digits)} digits)"
        return "-" * (value < 0) + cut
    if isinstance(value, int | float):
        try:
            text = repr(value)
        except ValueError:  # an integer of more digits than Python prints
            text = "an integer of more than 4300 digits"
        return text if len(text) <= length else text[: length - 3] + "..."
    if isinstance(value, Mapping):
        names = ", ".join([str(key)[:20] for key in list(value)[:4]] + (["..."] if len(value) > 4 else []))
        return f"a mapping with {len(value)} field{'s' * (len(value) != 1)}" + (f" ({names})" if names else "")
    if isinstance(value, list | tuple):
        if not value:
            return "an empty list"
        scalars = all(isinstance(item, int | float | str) and len(str(item)) < 20 for item in value[:7])
        body = f" {list(value)!r}" if scalars and len(value) <= 6 else ""
        return f"a list of {len(value)}" + body
    return f"a {type(value).__name__}"


def size_problem(limits: Limits, file: str | None, mark: Any) -> Problem:
    """Too many values, or nested too deep."""
    detail = f"the document has more than {limits.nodes} values (aliases counted where they are used) "
    return problem("too-complex", f"{detail}or is nested deeper than {limits.depth}", file=file, mark=mark)


def _long_key_problem(key: str, file: str | None, mark: Any) -> Problem:
    """The name of a field that no schema could have."""
    detail = f"no field has a name of {len(key)} characters: {LONGEST_KEY} at most"
    return problem("key-too-long", detail, file=file, mark=mark)


# --- plain data that does not change -------------------------------------------------------------------
# The document behind a design, whose hash would otherwise speak of another one.


def _refuse_change(self: Any, *_: Any, **__: Any) -> NoReturn:
    raise TypeError("a design does not change: design.with_value(path, value) is one with another value at a place")


class FrozenMapping(dict[str, Any]):
    """A mapping that reads like a dict; a deep copy is an ordinary dict."""

    __slots__ = ()
    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse_change

    def __deepcopy__(self, memo: Any) -> Any:
        return thaw(self)

    def __reduce__(self) -> Any:
        return FrozenMapping, (dict(self),)


class FrozenList(list[Any]):
    """A list that reads like one; a deep copy is an ordinary list."""

    __slots__ = ()
    __setitem__ = __delitem__ = __iadd__ = __imul__ = _refuse_change
    append = clear = extend = insert = pop = remove = reverse = sort = _refuse_change

    def __deepcopy__(self, memo: Any) -> Any:
        return thaw(self)

    def __reduce__(self) -> Any:
        return FrozenList, (list(self),)


def freeze(data: Any) -> Any:
    """Plain data that cannot be changed, what is frozen already as it is."""
    kind = type(data)
    if kind is dict:
        return FrozenMapping({key: freeze(value) for key, value in data.items()})
    return FrozenList(map(freeze, data)) if kind is list else data


def thaw(data: Any) -> Any:
    """A copy of plain data that can be changed."""
    if isinstance(data, dict):
        return {key: thaw(value) for key, value in data.items()}
    return [thaw(value) for value in data] if isinstance(data, list) else data

"""A document into plain data: files, encodings, YAML or JSON, and data that a caller hands over.

A design arrives from strangers, so the reader is small and closed: text is decoded strictly, duplicate
keys and tags are refused, nesting, values and bytes are bounded, and every refusal has a line.
"""

from __future__ import annotations

import codecs
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ..errors import DesignError, LimitError, Problem
from ..json_text import write_json
from .wording import DEFAULT_LIMITS, Limits, Vast, problem, shown, size_problem
from .yaml_tree import LONGEST_KEY, Place, integer, read_yaml

__all__ = [
    "DEFAULT_LIMITS",
    "Format",
    "Limits",
    "Source",
    "Vast",
    "decode",
    "plain_data",
    "read_bytes",
    "read_text",
    "shown",
]

Format = Literal["auto", "yaml", "json"]


_BOMS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),  # before UTF-16 LE, whose mark it begins with
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_MARKS = tuple(mark for mark, _ in _BOMS)
_NESTING = frozenset({dict, list})


@dataclass(frozen=True, slots=True)
class Source:
    """A document as it was read: plain data, and the places of its values when it came as text."""

    data: Any
    file: str | None  # how the user calls the file
    directory: Path | None  # what file references are relative to
    place: Place | None = None
    json_text: str | None = None  # JSON is located only when an error asks for it

    def placed(self) -> Source:
        """The same source with places, if its text can be located; ask before locating several paths."""
        if self.place is not None or self.json_text is None:
            return self
        try:
            return replace(self, place=read_yaml(self.json_text, self.file, DEFAULT_LIMITS)[1])
        except (DesignError, LimitError):  # JSON that is not YAML (pairs of surrogate escapes)
            return replace(self, json_text=None)

    def locate(self, path: Iterable[str | int], *, key: bool = False) -> tuple[int | None, int | None]:
        """Line and column of a path, (None, None) when the document did not come as text."""
        place = self.placed().place
        if place is None:
            return None, None
        found = place.find(path, key=key)
        return found.line, found.column


def read_bytes(path: Path, limit: int, name: str) -> bytes:
    """The bytes of a regular file of at most ``limit`` bytes.  Raises DesignError or LimitError."""
    try:
        if not path.exists():
            raise DesignError(problem("file-not-found", f"no such file: {name}", "check the path", file=name))
        if not path.is_file():
            kind = "a directory" if path.is_dir() else "not a regular file"
            raise DesignError(problem("not-a-file", f"{name} is {kind}", "give a file", file=name))
        with path.open("rb") as stream:
            content = stream.read(limit + 1)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        reason = getattr(error, "strerror", None) or str(error)
        raise DesignError(problem("file-unreadable", f"cannot read {name}: {reason}", file=name)) from None
    if len(content) > limit:
        raise LimitError(problem("too-large", f"{name} is longer than {limit} bytes", "make it smaller", file=name))
    return content


def decode(content: bytes, name: str | None) -> str:
    """Strict UTF-8, or UTF-16/32 with a byte order mark.  Raises DesignError."""
    marked = content.startswith(_MARKS)
    encoding = next(codec for mark, codec in _BOMS if content.startswith(mark)) if marked else "utf-8"
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError as error:
        raise DesignError(
            problem(
                "not-text",
                f"byte {error.start} is not valid {error.encoding.upper()}: this is not a text file",
                "save it as UTF-8",
                file=name,
            )
        ) from None
    if "\0" in text:
        raise DesignError(
            problem(
                "not-text",
                f"character {text.index(chr(0))} is NUL: a binary file, or UTF-16 without a byte order mark",
                "save it as UTF-8",
                file=name,
            )
        )
    return text


def read_text(text: str, limits: Limits, *, file: str | None, directory: Path | None, form: Format) -> Source:
    """Parse a document.  Raises DesignError (syntax, tags, duplicate keys) or LimitError (size)."""
    if len(text) > limits.document_bytes:
        raise LimitError(
            problem("too-large", f"the document is longer than {limits.document_bytes} characters", file=file)
        )
    _refuse_surrogates(text, "", file)
    text = text.removeprefix("\ufeff")
    if not text.strip():
        raise DesignError(
            problem("empty-document", "the document is empty", "start from examples/demo.yaml", file=file)
        )
    if form == "json" or (form == "auto" and text.lstrip()[:1] == "{"):
        try:
            return Source(_from_json(text, limits, file), file, directory, json_text=text)
        except json.JSONDecodeError as error:
            if form == "json":
                where = Problem(
                    "", "json-syntax", f"this is not JSON: {error.msg}", "", file, error.lineno, error.colno
                )
                raise DesignError(where) from None
    data, place = read_yaml(text, file, limits)
    return Source(data, file, directory, place=place)


def plain_data(value: Any, limits: Limits) -> Any:
    """A copy of data that a caller handed over, with nothing in it but JSON's types.

    Raises DesignError for other types and keys, LimitError for nesting (cycles included) and size.
    """
    try:
        return _quick_copy(value, limits)
    except _Unusual:
        return _careful_copy(value, limits)


class _Unusual(Exception):
    """Something to look at value by value, most likely to refuse it."""


def _quick_copy(value: Any, limits: Limits) -> Any:
    """A copy of data of JSON's own types within the limits.  Raises _Unusual for anything else."""
    count = 1
    keys: list[str] = []
    texts: list[str] = []

    def copy(item: Any, depth: int) -> Any:
        nonlocal count
        kind = type(item)
        if kind is dict or kind is list or kind is tuple:
            count += len(item)
            if depth >= limits.depth or count > limits.nodes:
                raise _Unusual
            if kind is dict:
                keys.extend(item)
                return {key: v if type(v) is float else copy(v, depth + 1) for key, v in item.items()}
            return [v if type(v) is float else copy(v, depth + 1) for v in item]
        if kind is str:
            texts.append(item)
        elif not (item is None or kind is bool or kind is float or (kind is int and item.bit_length() <= 64)):
            raise _Unusual
        return item

    copied = copy(value, 0)
    try:
        "".join(keys).encode()
        "".join(texts).encode()
    except (TypeError, UnicodeEncodeError):
        raise _Unusual from None
    if keys and max(map(len, keys)) > LONGEST_KEY:
        raise _Unusual
    return copied


def _careful_copy(value: Any, limits: Limits) -> Any:
    """:func:`plain_data` value by value, each with its path."""
    count = 0

    def copy(item: Any, path: str, depth: int) -> Any:
        nonlocal count
        count += 1
        if depth > limits.depth or count > limits.nodes:
            raise LimitError(size_problem(limits, None, None))
        if isinstance(item, np.generic | np.ndarray):
            item = item.tolist()
        if isinstance(item, Mapping):
            for key in item:
                if not isinstance(key, str):
                    raise DesignError(Problem(path, "bad-key", f"keys are texts; got {shown(key)}"))
                if len(key) > LONGEST_KEY:
                    raise DesignError(Problem(path, "bad-key", f"no field has a name of {len(key)} characters"))
                _refuse_surrogates(key, path, None)
            return {
                key: copy(child, f"{path}/{key.replace('~', '~0').replace('/', '~1')}", depth + 1)
                for key, child in item.items()
            }
        if isinstance(item, list | tuple):
            return [copy(child, f"{path}/{index}", depth + 1) for index, child in enumerate(item)]
        if isinstance(item, int) and not isinstance(item, bool) and item.bit_length() > 64:
            return _vast(item)
        if isinstance(item, str):
            _refuse_surrogates(item, path, None)
        if item is None or type(item) in (str, int, float, bool, Vast):
            return item
        raise DesignError(
            Problem(
                path, "unsupported-value", f"a document holds texts, numbers, lists and mappings; got {shown(item)}"
            )
        )

    return copy(value, "", 0)


def _vast(number: int) -> Vast:
    try:
        return Vast(str(number))
    except ValueError:  # more digits than Python writes down
        return Vast("-" if number < 0 else "+")


def _refuse_surrogates(text: str, path: str, file: str | None) -> None:
    """Half a surrogate pair is not text: it can be neither written nor hashed."""
    try:
        text.encode()
    except UnicodeEncodeError:
        raise DesignError(Problem(path, "not-text", "the text holds half a surrogate pair", file=file)) from None


def _from_json(text: str, limits: Limits, file: str | None) -> Any:
    mappings: list[dict[str, Any]] = []

    def pairs(items: list[tuple[str, Any]]) -> dict[str, Any]:
        result = dict(items)
        mappings.append(result)
        if len(result) < len(items):
            seen: set[str] = set()
            twice = next(key for key, _ in items if key in seen or seen.add(key))  # type: ignore[func-returns-value]
            raise DesignError(_duplicate(twice, text, file))
        return result

    try:
        data = json.loads(text, object_pairs_hook=pairs, parse_int=integer)
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


def _duplicate(key: str, text: str, file: str | None) -> Problem:
    """Find the line of a JSON key that occurs twice (its last occurrence)."""
    at = text.rfind(write_json(key))
    line = text.count("\n", 0, at) + 1 if at >= 0 else None
    return Problem("", "duplicate-key", f"the field {key[:60]!r} is given twice", "keep one of them", file, line, None)

"""Limits of what is read, and the words for what arrived."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..errors import Problem
from ..json_text import write_json


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds on what is read.  Everything beyond them is refused, and the refusal states them."""

    document_bytes: int = 1_000_000
    fiducial_file_bytes: int = 1_000_000
    nodes: int = 50_000
    depth: int = 24
    fiducials: int = 1000
    targets: int = 200
    views: int = 16
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


def shown(value: Any, length: int = 60) -> str:
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
        return f"a mapping with {len(value)} field(s)" + (f" ({names})" if names else "")
    if isinstance(value, list | tuple):
        if not value:
            return "an empty list"
        scalars = all(isinstance(item, int | float | str) and len(str(item)) < 20 for item in value[:7])
        body = f" {list(value)!r}" if scalars and len(value) <= 6 else ""
        return f"a list of {len(value)}" + body
    return f"a {type(value).__name__}"


def size_problem(limits: Limits, file: str | None, mark: Any) -> Problem:
    """Too many values, or nested too deep."""
    return problem(
        "too-complex",
        f"the document has more than {limits.nodes} values (aliases counted where they are used) "
        f"or is nested deeper than {limits.depth}",
        file=file,
        mark=mark,
    )

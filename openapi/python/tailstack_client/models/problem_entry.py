from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="ProblemEntry")


@_attrs_define
class ProblemEntry:
    """One thing that is wrong.  ``file``, ``line`` and ``column`` are null when the document came without a file.

    Attributes:
        pointer (str): JSON pointer (RFC 6901) into the document that was sent; empty for the whole, /NAME for a query
            parameter.
        code (str): What kind of mistake it is, kebab-case.
        detail (str): What is wrong, with what arrived.
        hint (str): What to do; may be empty.
        file (None | str): File that the document came from; null when it came without one.
        line (int | None): Line in that file or text, from 1; null when it came without one.
        column (int | None): Column in the line, from 1; null when it came without one.
    """

    pointer: str
    code: str
    detail: str
    hint: str
    file: None | str
    line: int | None
    column: int | None

    def to_dict(self) -> dict[str, Any]:
        pointer = self.pointer

        code = self.code

        detail = self.detail

        hint = self.hint

        file: None | str
        file = self.file

        line: int | None
        line = self.line

        column: int | None
        column = self.column

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "pointer": pointer,
                "code": code,
                "detail": detail,
                "hint": hint,
                "file": file,
                "line": line,
                "column": column,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        pointer = d.pop("pointer")

        code = d.pop("code")

        detail = d.pop("detail")

        hint = d.pop("hint")

        def _parse_file(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        file = _parse_file(d.pop("file"))

        def _parse_line(data: object) -> int | None:
            if data is None:
                return data
            return cast(int | None, data)

        line = _parse_line(d.pop("line"))

        def _parse_column(data: object) -> int | None:
            if data is None:
                return data
            return cast(int | None, data)

        column = _parse_column(d.pop("column"))

        problem_entry = cls(
            pointer=pointer,
            code=code,
            detail=detail,
            hint=hint,
            file=file,
            line=line,
            column=column,
        )

        return problem_entry

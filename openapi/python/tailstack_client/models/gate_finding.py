from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.gate_finding_severity import check_gate_finding_severity
from ..models.gate_finding_severity import GateFindingSeverity
from typing import cast


T = TypeVar("T", bound="GateFinding")


@_attrs_define
class GateFinding:
    """One remark, at the place of the offending value.

    Attributes:
        rule (str): Stable id of the rule, see `tailstack gate --explain ID`.
        severity (GateFindingSeverity): Severity under the policy.
        file (str): Name given with the design; of the policy, waivers or baseline where it is about them.
        line (int | None): Line in the file, from 1; null where the document did not come as text.
        column (int | None): Column in the line, from 1; null where the document did not come as text.
        pointer (str): JSON pointer (RFC 6901) into the file's document.
        message (str): The finding, in a sentence.
        value (float | None): The number it rests on, in the unit that the message says; null without one.
        limit (float | None): What that was held against, in the same unit; null without one.
        suppressed_by (None | str): The waiver that accepts it, so that it does not count; otherwise null.
    """

    rule: str
    severity: GateFindingSeverity
    file: str
    line: int | None
    column: int | None
    pointer: str
    message: str
    value: float | None
    limit: float | None
    suppressed_by: None | str

    def to_dict(self) -> dict[str, Any]:
        rule = self.rule

        severity: str = self.severity

        file = self.file

        line: int | None
        line = self.line

        column: int | None
        column = self.column

        pointer = self.pointer

        message = self.message

        value: float | None
        value = self.value

        limit: float | None
        limit = self.limit

        suppressed_by: None | str
        suppressed_by = self.suppressed_by

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "rule": rule,
                "severity": severity,
                "file": file,
                "line": line,
                "column": column,
                "pointer": pointer,
                "message": message,
                "value": value,
                "limit": limit,
                "suppressed_by": suppressed_by,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        rule = d.pop("rule")

        severity = check_gate_finding_severity(d.pop("severity"))

        file = d.pop("file")

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

        pointer = d.pop("pointer")

        message = d.pop("message")

        def _parse_value(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        value = _parse_value(d.pop("value"))

        def _parse_limit(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        limit = _parse_limit(d.pop("limit"))

        def _parse_suppressed_by(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        suppressed_by = _parse_suppressed_by(d.pop("suppressed_by"))

        gate_finding = cls(
            rule=rule,
            severity=severity,
            file=file,
            line=line,
            column=column,
            pointer=pointer,
            message=message,
            value=value,
            limit=limit,
            suppressed_by=suppressed_by,
        )

        return gate_finding

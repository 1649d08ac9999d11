from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.finding_severity import check_finding_severity
from ..models.finding_severity import FindingSeverity
from typing import cast


T = TypeVar("T", bound="Finding")


@_attrs_define
class Finding:
    """One remark about the design, with the number it rests on.

    Attributes:
        rule (str): Stable id of the rule, kebab-case.
        severity (FindingSeverity): error: the design should not be used so; warning: it should be looked at; note: it
            is worth knowing.
        message (str): The remark, in a sentence.
        pointer (str): JSON pointer (RFC 6901) into the design document; empty for the whole. Default: ''.
        value (float | None): The number that the remark rests on, in the unit that the message says; null without one.
        limit (float | None): What that number was held against, in the same unit; null without one.
    """

    rule: str
    severity: FindingSeverity
    message: str
    value: float | None
    limit: float | None
    pointer: str = ""

    def to_dict(self) -> dict[str, Any]:
        rule = self.rule

        severity: str = self.severity

        message = self.message

        pointer = self.pointer

        value: float | None
        value = self.value

        limit: float | None
        limit = self.limit

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "rule": rule,
                "severity": severity,
                "message": message,
                "pointer": pointer,
                "value": value,
                "limit": limit,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        rule = d.pop("rule")

        severity = check_finding_severity(d.pop("severity"))

        message = d.pop("message")

        pointer = d.pop("pointer")

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

        finding = cls(
            rule=rule,
            severity=severity,
            message=message,
            pointer=pointer,
            value=value,
            limit=limit,
        )

        return finding

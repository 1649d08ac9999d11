from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="Loss")


@_attrs_define
class Loss:
    """The worst of all ways to lose some fiducials.

    Attributes:
        lost (list[str]): Labels of the fiducials that are lost.
        target (str): Target at which the error is then largest.
        value_mm (float | None): The quantile of the error's norm there without them, mm; null where nothing can be
            estimated any more.
        reason (str): Why nothing can be estimated any more; empty otherwise. Default: ''.
    """

    lost: list[str]
    target: str
    value_mm: float | None
    reason: str = ""

    def to_dict(self) -> dict[str, Any]:
        lost = self.lost

        target = self.target

        value_mm: float | None
        value_mm = self.value_mm

        reason = self.reason

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "lost": lost,
                "target": target,
                "value_mm": value_mm,
                "reason": reason,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        lost = cast(list[str], d.pop("lost"))

        target = d.pop("target")

        def _parse_value_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        value_mm = _parse_value_mm(d.pop("value_mm"))

        reason = d.pop("reason")

        loss = cls(
            lost=lost,
            target=target,
            value_mm=value_mm,
            reason=reason,
        )

        return loss

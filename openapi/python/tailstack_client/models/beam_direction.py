from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="BeamDirection")


@_attrs_define
class BeamDirection:
    """A direction that a view may have, and what comes of it.

    Attributes:
        right_deg (float): Towards the right of the image as it is designed, deg: with up_deg the angle of the turn and
            where it goes.
        up_deg (float): Towards the top of the image as it is designed, deg.
        beam_direction (list[float]): Of the turned view, from the source to the detector, in con; as a design takes it.
        up_direction (list[float]): Of the turned view, in con; as a design takes it.
        p95_mm (float | None): P95 of the error, at the target where it is largest, mm; null where the direction is not
            allowed.
        target (None | str): That target; null where the direction is not allowed.
        reason (None | str): Why the direction is not allowed: what it hides, mostly; null where it is.
    """

    right_deg: float
    up_deg: float
    beam_direction: list[float]
    up_direction: list[float]
    p95_mm: float | None
    target: None | str
    reason: None | str

    def to_dict(self) -> dict[str, Any]:
        right_deg = self.right_deg

        up_deg = self.up_deg

        beam_direction = []
        for beam_direction_item_data in self.beam_direction:
            beam_direction_item: float
            beam_direction_item = beam_direction_item_data
            beam_direction.append(beam_direction_item)

        up_direction = []
        for up_direction_item_data in self.up_direction:
            up_direction_item: float
            up_direction_item = up_direction_item_data
            up_direction.append(up_direction_item)

        p95_mm: float | None
        p95_mm = self.p95_mm

        target: None | str
        target = self.target

        reason: None | str
        reason = self.reason

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "right_deg": right_deg,
                "up_deg": up_deg,
                "beam_direction": beam_direction,
                "up_direction": up_direction,
                "p95_mm": p95_mm,
                "target": target,
                "reason": reason,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        right_deg = d.pop("right_deg")

        up_deg = d.pop("up_deg")

        beam_direction = []
        _beam_direction = d.pop("beam_direction")
        for beam_direction_item_data in _beam_direction:

            def _parse_beam_direction_item(data: object) -> float:
                return cast(float, data)

            beam_direction_item = _parse_beam_direction_item(beam_direction_item_data)

            beam_direction.append(beam_direction_item)

        up_direction = []
        _up_direction = d.pop("up_direction")
        for up_direction_item_data in _up_direction:

            def _parse_up_direction_item(data: object) -> float:
                return cast(float, data)

            up_direction_item = _parse_up_direction_item(up_direction_item_data)

            up_direction.append(up_direction_item)

        def _parse_p95_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        p95_mm = _parse_p95_mm(d.pop("p95_mm"))

        def _parse_target(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        target = _parse_target(d.pop("target"))

        def _parse_reason(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        reason = _parse_reason(d.pop("reason"))

        beam_direction = cls(
            right_deg=right_deg,
            up_deg=up_deg,
            beam_direction=beam_direction,
            up_direction=up_direction,
            p95_mm=p95_mm,
            target=target,
            reason=reason,
        )

        return beam_direction

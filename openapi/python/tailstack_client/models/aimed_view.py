from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="AimedView")


@_attrs_define
class AimedView:
    """A view that was free to be aimed otherwise, or that was added: what it was before is then that of its model.

    Attributes:
        view (str): Name of the view.
        turn_deg (float): Angle between its beam before and after, deg.
        beam_direction_before (list[float]): From the source to the detector, in con, as it was.
        beam_direction (list[float]): The same in the new design.
        source_isocentre_before_mm (float): From the source to the isocentre as it was, mm.
        source_isocentre_mm (float): The same in the new design, mm.
    """

    view: str
    turn_deg: float
    beam_direction_before: list[float]
    beam_direction: list[float]
    source_isocentre_before_mm: float
    source_isocentre_mm: float

    def to_dict(self) -> dict[str, Any]:
        view = self.view

        turn_deg = self.turn_deg

        beam_direction_before = []
        for beam_direction_before_item_data in self.beam_direction_before:
            beam_direction_before_item: float
            beam_direction_before_item = beam_direction_before_item_data
            beam_direction_before.append(beam_direction_before_item)

        beam_direction = []
        for beam_direction_item_data in self.beam_direction:
            beam_direction_item: float
            beam_direction_item = beam_direction_item_data
            beam_direction.append(beam_direction_item)

        source_isocentre_before_mm = self.source_isocentre_before_mm

        source_isocentre_mm = self.source_isocentre_mm

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "view": view,
                "turn_deg": turn_deg,
                "beam_direction_before": beam_direction_before,
                "beam_direction": beam_direction,
                "source_isocentre_before_mm": source_isocentre_before_mm,
                "source_isocentre_mm": source_isocentre_mm,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        view = d.pop("view")

        turn_deg = d.pop("turn_deg")

        beam_direction_before = []
        _beam_direction_before = d.pop("beam_direction_before")
        for beam_direction_before_item_data in _beam_direction_before:

            def _parse_beam_direction_before_item(data: object) -> float:
                return cast(float, data)

            beam_direction_before_item = _parse_beam_direction_before_item(beam_direction_before_item_data)

            beam_direction_before.append(beam_direction_before_item)

        beam_direction = []
        _beam_direction = d.pop("beam_direction")
        for beam_direction_item_data in _beam_direction:

            def _parse_beam_direction_item(data: object) -> float:
                return cast(float, data)

            beam_direction_item = _parse_beam_direction_item(beam_direction_item_data)

            beam_direction.append(beam_direction_item)

        source_isocentre_before_mm = d.pop("source_isocentre_before_mm")

        source_isocentre_mm = d.pop("source_isocentre_mm")

        aimed_view = cls(
            view=view,
            turn_deg=turn_deg,
            beam_direction_before=beam_direction_before,
            beam_direction=beam_direction,
            source_isocentre_before_mm=source_isocentre_before_mm,
            source_isocentre_mm=source_isocentre_mm,
        )

        return aimed_view

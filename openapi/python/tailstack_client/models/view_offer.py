from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="ViewOffer")


@_attrs_define
class ViewOffer:
    """A view that could be added at a price: the cheapest designs with it and without it, both verified.

    Attributes:
        view (str): Name of the view.
        like (str): The view that it is a copy of, but for its direction and distance.
        price (float): What it costs.
        added (bool): Whether the new design has it.
        cost_without (float | None): Least cost found without it; null: no design keeps the limits, or none was found.
        cost_with (float | None): Least cost found with it, its price not included; null as above.
        worth (float | None): The price below which it pays: what it saves; null where one of the costs is.
        beam_direction (list[float] | None): From its source to its detector, in con, where it was aimed best; null
            without a design with it.
        up_direction (list[float] | None): The direction in con that is up in its image then.
        source_isocentre_mm (float | None): From its source to its isocentre then, mm.
        p95_without_mm (float | None): First-order P95 of the worst target of the design as it stood, mm; null: its
            layout does not determine it.
        p95_with_mm (float | None): The same with this view so aimed and all else as it stood, mm; null without such a
            view.
        sentence (str): What was decided, and why.
    """

    view: str
    like: str
    price: float
    added: bool
    cost_without: float | None
    cost_with: float | None
    worth: float | None
    beam_direction: list[float] | None
    up_direction: list[float] | None
    source_isocentre_mm: float | None
    p95_without_mm: float | None
    p95_with_mm: float | None
    sentence: str

    def to_dict(self) -> dict[str, Any]:
        view = self.view

        like = self.like

        price = self.price

        added = self.added

        cost_without: float | None
        cost_without = self.cost_without

        cost_with: float | None
        cost_with = self.cost_with

        worth: float | None
        worth = self.worth

        beam_direction: list[float] | None
        if isinstance(self.beam_direction, list):
            beam_direction = []
            for beam_direction_type_0_item_data in self.beam_direction:
                beam_direction_type_0_item: float
                beam_direction_type_0_item = beam_direction_type_0_item_data
                beam_direction.append(beam_direction_type_0_item)

        else:
            beam_direction = self.beam_direction

        up_direction: list[float] | None
        if isinstance(self.up_direction, list):
            up_direction = []
            for up_direction_type_0_item_data in self.up_direction:
                up_direction_type_0_item: float
                up_direction_type_0_item = up_direction_type_0_item_data
                up_direction.append(up_direction_type_0_item)

        else:
            up_direction = self.up_direction

        source_isocentre_mm: float | None
        source_isocentre_mm = self.source_isocentre_mm

        p95_without_mm: float | None
        p95_without_mm = self.p95_without_mm

        p95_with_mm: float | None
        p95_with_mm = self.p95_with_mm

        sentence = self.sentence

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "view": view,
                "like": like,
                "price": price,
                "added": added,
                "cost_without": cost_without,
                "cost_with": cost_with,
                "worth": worth,
                "beam_direction": beam_direction,
                "up_direction": up_direction,
                "source_isocentre_mm": source_isocentre_mm,
                "p95_without_mm": p95_without_mm,
                "p95_with_mm": p95_with_mm,
                "sentence": sentence,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        view = d.pop("view")

        like = d.pop("like")

        price = d.pop("price")

        added = d.pop("added")

        def _parse_cost_without(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        cost_without = _parse_cost_without(d.pop("cost_without"))

        def _parse_cost_with(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        cost_with = _parse_cost_with(d.pop("cost_with"))

        def _parse_worth(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        worth = _parse_worth(d.pop("worth"))

        def _parse_beam_direction(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                beam_direction_type_0 = []
                _beam_direction_type_0 = data
                for beam_direction_type_0_item_data in _beam_direction_type_0:

                    def _parse_beam_direction_type_0_item(data: object) -> float:
                        return cast(float, data)

                    beam_direction_type_0_item = _parse_beam_direction_type_0_item(beam_direction_type_0_item_data)

                    beam_direction_type_0.append(beam_direction_type_0_item)

                return beam_direction_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        beam_direction = _parse_beam_direction(d.pop("beam_direction"))

        def _parse_up_direction(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                up_direction_type_0 = []
                _up_direction_type_0 = data
                for up_direction_type_0_item_data in _up_direction_type_0:

                    def _parse_up_direction_type_0_item(data: object) -> float:
                        return cast(float, data)

                    up_direction_type_0_item = _parse_up_direction_type_0_item(up_direction_type_0_item_data)

                    up_direction_type_0.append(up_direction_type_0_item)

                return up_direction_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        up_direction = _parse_up_direction(d.pop("up_direction"))

        def _parse_source_isocentre_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        source_isocentre_mm = _parse_source_isocentre_mm(d.pop("source_isocentre_mm"))

        def _parse_p95_without_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        p95_without_mm = _parse_p95_without_mm(d.pop("p95_without_mm"))

        def _parse_p95_with_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        p95_with_mm = _parse_p95_with_mm(d.pop("p95_with_mm"))

        sentence = d.pop("sentence")

        view_offer = cls(
            view=view,
            like=like,
            price=price,
            added=added,
            cost_without=cost_without,
            cost_with=cost_with,
            worth=worth,
            beam_direction=beam_direction,
            up_direction=up_direction,
            source_isocentre_mm=source_isocentre_mm,
            p95_without_mm=p95_without_mm,
            p95_with_mm=p95_with_mm,
            sentence=sentence,
        )

        return view_offer

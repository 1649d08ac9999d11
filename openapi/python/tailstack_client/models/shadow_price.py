from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset


T = TypeVar("T", bound="ShadowPrice")


@_attrs_define
class ShadowPrice:
    """What one unit of a limit or bound is worth, from the multipliers: a derivative, good for small steps.

    Attributes:
        name (str): The limit or bound.
        unit (str): Unit of the limit or bound.
        cost_per_unit (float): Change of the objective for one unit more: of cost, or of mm of the quantile where that
            is minimised.
        sentence (str): The same as a sentence.
    """

    name: str
    unit: str
    cost_per_unit: float
    sentence: str

    def to_dict(self) -> dict[str, Any]:
        name = self.name

        unit = self.unit

        cost_per_unit = self.cost_per_unit

        sentence = self.sentence

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "name": name,
                "unit": unit,
                "cost_per_unit": cost_per_unit,
                "sentence": sentence,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        name = d.pop("name")

        unit = d.pop("unit")

        cost_per_unit = d.pop("cost_per_unit")

        sentence = d.pop("sentence")

        shadow_price = cls(
            name=name,
            unit=unit,
            cost_per_unit=cost_per_unit,
            sentence=sentence,
        )

        return shadow_price

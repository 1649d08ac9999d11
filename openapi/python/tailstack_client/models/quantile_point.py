from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="QuantilePoint")


@_attrs_define
class QuantilePoint:
    """One ordered error norm against the same place in simulated benches.

    Attributes:
        probability (float): Place in the ordered error norms, 0 to 1.
        measured_mm (float): Measured norm there, mm.
        predicted_mm (float): Median over simulated benches, mm.
        envelope_mm (list[float]): Where 95 % of benches are, at this place alone, mm.
        outside (bool): Whether the measured norm is outside of it.
    """

    probability: float
    measured_mm: float
    predicted_mm: float
    envelope_mm: list[float]
    outside: bool

    def to_dict(self) -> dict[str, Any]:
        probability = self.probability

        measured_mm = self.measured_mm

        predicted_mm = self.predicted_mm

        envelope_mm = []
        for envelope_mm_item_data in self.envelope_mm:
            envelope_mm_item: float
            envelope_mm_item = envelope_mm_item_data
            envelope_mm.append(envelope_mm_item)

        outside = self.outside

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "probability": probability,
                "measured_mm": measured_mm,
                "predicted_mm": predicted_mm,
                "envelope_mm": envelope_mm,
                "outside": outside,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        probability = d.pop("probability")

        measured_mm = d.pop("measured_mm")

        predicted_mm = d.pop("predicted_mm")

        envelope_mm = []
        _envelope_mm = d.pop("envelope_mm")
        for envelope_mm_item_data in _envelope_mm:

            def _parse_envelope_mm_item(data: object) -> float:
                return cast(float, data)

            envelope_mm_item = _parse_envelope_mm_item(envelope_mm_item_data)

            envelope_mm.append(envelope_mm_item)

        outside = d.pop("outside")

        quantile_point = cls(
            probability=probability,
            measured_mm=measured_mm,
            predicted_mm=predicted_mm,
            envelope_mm=envelope_mm,
            outside=outside,
        )

        return quantile_point

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="NormCompared")


@_attrs_define
class NormCompared:
    """Mean error norm of all trials, mm.

    Attributes:
        measured_mm (float): Measured mean of the error's norm, mm.
        interval_mm (list[float] | None): Confidence interval of it, of this installation or of installations, mm; null
            for summary statistics without n.
        predicted_mm (float): Predicted mean, mm.
        predicted_range_mm (list[float]): Where the mean of 95 % of such benches would be, mm.
    """

    measured_mm: float
    interval_mm: list[float] | None
    predicted_mm: float
    predicted_range_mm: list[float]

    def to_dict(self) -> dict[str, Any]:
        measured_mm = self.measured_mm

        interval_mm: list[float] | None
        if isinstance(self.interval_mm, list):
            interval_mm = []
            for interval_mm_type_0_item_data in self.interval_mm:
                interval_mm_type_0_item: float
                interval_mm_type_0_item = interval_mm_type_0_item_data
                interval_mm.append(interval_mm_type_0_item)

        else:
            interval_mm = self.interval_mm

        predicted_mm = self.predicted_mm

        predicted_range_mm = []
        for predicted_range_mm_item_data in self.predicted_range_mm:
            predicted_range_mm_item: float
            predicted_range_mm_item = predicted_range_mm_item_data
            predicted_range_mm.append(predicted_range_mm_item)

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "measured_mm": measured_mm,
                "interval_mm": interval_mm,
                "predicted_mm": predicted_mm,
                "predicted_range_mm": predicted_range_mm,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        measured_mm = d.pop("measured_mm")

        def _parse_interval_mm(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                interval_mm_type_0 = []
                _interval_mm_type_0 = data
                for interval_mm_type_0_item_data in _interval_mm_type_0:

                    def _parse_interval_mm_type_0_item(data: object) -> float:
                        return cast(float, data)

                    interval_mm_type_0_item = _parse_interval_mm_type_0_item(interval_mm_type_0_item_data)

                    interval_mm_type_0.append(interval_mm_type_0_item)

                return interval_mm_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        interval_mm = _parse_interval_mm(d.pop("interval_mm"))

        predicted_mm = d.pop("predicted_mm")

        predicted_range_mm = []
        _predicted_range_mm = d.pop("predicted_range_mm")
        for predicted_range_mm_item_data in _predicted_range_mm:

            def _parse_predicted_range_mm_item(data: object) -> float:
                return cast(float, data)

            predicted_range_mm_item = _parse_predicted_range_mm_item(predicted_range_mm_item_data)

            predicted_range_mm.append(predicted_range_mm_item)

        norm_compared = cls(
            measured_mm=measured_mm,
            interval_mm=interval_mm,
            predicted_mm=predicted_mm,
            predicted_range_mm=predicted_range_mm,
        )

        return norm_compared

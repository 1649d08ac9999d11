from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.bias_compared_interval_of import BiasComparedIntervalOf
from ..models.bias_compared_interval_of import check_bias_compared_interval_of
from typing import cast


T = TypeVar("T", bound="BiasCompared")


@_attrs_define
class BiasCompared:
    """Mean error vector of all trials, mm, in the frame of the error.

    Attributes:
        measured_mm (list[float]): Measured mean error vector, in the frame of the error, mm.
        interval_mm (list[list[float]]): Confidence interval of each component by itself, mm.
        interval_of (BiasComparedIntervalOf): What the interval is of: this installation's mean, or that of
            installations of this kind.
        predicted_mm (list[float]): Predicted mean error vector, mm.
        predicted_range_mm (list[list[float]]): Where the mean of 95 % of such benches would be, each component by
            itself, mm.
    """

    measured_mm: list[float]
    interval_mm: list[list[float]]
    interval_of: BiasComparedIntervalOf
    predicted_mm: list[float]
    predicted_range_mm: list[list[float]]

    def to_dict(self) -> dict[str, Any]:
        measured_mm = []
        for measured_mm_item_data in self.measured_mm:
            measured_mm_item: float
            measured_mm_item = measured_mm_item_data
            measured_mm.append(measured_mm_item)

        interval_mm = []
        for interval_mm_item_data in self.interval_mm:
            interval_mm_item: list[float]
            if isinstance(interval_mm_item_data, list):
                interval_mm_item = []
                for interval_mm_item_type_0_item_data in interval_mm_item_data:
                    interval_mm_item_type_0_item: float
                    interval_mm_item_type_0_item = interval_mm_item_type_0_item_data
                    interval_mm_item.append(interval_mm_item_type_0_item)

            interval_mm.append(interval_mm_item)

        interval_of: str = self.interval_of

        predicted_mm = []
        for predicted_mm_item_data in self.predicted_mm:
            predicted_mm_item: float
            predicted_mm_item = predicted_mm_item_data
            predicted_mm.append(predicted_mm_item)

        predicted_range_mm = []
        for predicted_range_mm_item_data in self.predicted_range_mm:
            predicted_range_mm_item: list[float]
            if isinstance(predicted_range_mm_item_data, list):
                predicted_range_mm_item = []
                for predicted_range_mm_item_type_0_item_data in predicted_range_mm_item_data:
                    predicted_range_mm_item_type_0_item: float
                    predicted_range_mm_item_type_0_item = predicted_range_mm_item_type_0_item_data
                    predicted_range_mm_item.append(predicted_range_mm_item_type_0_item)

            predicted_range_mm.append(predicted_range_mm_item)

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "measured_mm": measured_mm,
                "interval_mm": interval_mm,
                "interval_of": interval_of,
                "predicted_mm": predicted_mm,
                "predicted_range_mm": predicted_range_mm,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        measured_mm = []
        _measured_mm = d.pop("measured_mm")
        for measured_mm_item_data in _measured_mm:

            def _parse_measured_mm_item(data: object) -> float:
                return cast(float, data)

            measured_mm_item = _parse_measured_mm_item(measured_mm_item_data)

            measured_mm.append(measured_mm_item)

        interval_mm = []
        _interval_mm = d.pop("interval_mm")
        for interval_mm_item_data in _interval_mm:

            def _parse_interval_mm_item(data: object) -> list[float]:
                if not isinstance(data, list):
                    raise TypeError()
                interval_mm_item_type_0 = []
                _interval_mm_item_type_0 = data
                for interval_mm_item_type_0_item_data in _interval_mm_item_type_0:

                    def _parse_interval_mm_item_type_0_item(data: object) -> float:
                        return cast(float, data)

                    interval_mm_item_type_0_item = _parse_interval_mm_item_type_0_item(
                        interval_mm_item_type_0_item_data
                    )

                    interval_mm_item_type_0.append(interval_mm_item_type_0_item)

                return interval_mm_item_type_0

            interval_mm_item = _parse_interval_mm_item(interval_mm_item_data)

            interval_mm.append(interval_mm_item)

        interval_of = check_bias_compared_interval_of(d.pop("interval_of"))

        predicted_mm = []
        _predicted_mm = d.pop("predicted_mm")
        for predicted_mm_item_data in _predicted_mm:

            def _parse_predicted_mm_item(data: object) -> float:
                return cast(float, data)

            predicted_mm_item = _parse_predicted_mm_item(predicted_mm_item_data)

            predicted_mm.append(predicted_mm_item)

        predicted_range_mm = []
        _predicted_range_mm = d.pop("predicted_range_mm")
        for predicted_range_mm_item_data in _predicted_range_mm:

            def _parse_predicted_range_mm_item(data: object) -> list[float]:
                if not isinstance(data, list):
                    raise TypeError()
                predicted_range_mm_item_type_0 = []
                _predicted_range_mm_item_type_0 = data
                for predicted_range_mm_item_type_0_item_data in _predicted_range_mm_item_type_0:

                    def _parse_predicted_range_mm_item_type_0_item(data: object) -> float:
                        return cast(float, data)

                    predicted_range_mm_item_type_0_item = _parse_predicted_range_mm_item_type_0_item(
                        predicted_range_mm_item_type_0_item_data
                    )

                    predicted_range_mm_item_type_0.append(predicted_range_mm_item_type_0_item)

                return predicted_range_mm_item_type_0

            predicted_range_mm_item = _parse_predicted_range_mm_item(predicted_range_mm_item_data)

            predicted_range_mm.append(predicted_range_mm_item)

        bias_compared = cls(
            measured_mm=measured_mm,
            interval_mm=interval_mm,
            interval_of=interval_of,
            predicted_mm=predicted_mm,
            predicted_range_mm=predicted_range_mm,
        )

        return bias_compared

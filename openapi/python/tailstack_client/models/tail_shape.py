from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="TailShape")


@_attrs_define
class TailShape:
    """How far the P95 of the error norm stands above its mean, of summary statistics; no test, as n is not enough.

    Attributes:
        p95_over_mean (float): Measured P95 of the error's norm over its mean.
        standard_deviations (float | None): Measured P95 less the mean, over the standard deviation; a normal law has
            1.645. Null: nothing varies.
        predicted_p95_over_mean (float): The first ratio, median of simulated benches.
        predicted_standard_deviations (float | None): The second ratio, median of simulated benches; null: nothing
            varies from trial to trial.
    """

    p95_over_mean: float
    standard_deviations: float | None
    predicted_p95_over_mean: float
    predicted_standard_deviations: float | None

    def to_dict(self) -> dict[str, Any]:
        p95_over_mean = self.p95_over_mean

        standard_deviations: float | None
        standard_deviations = self.standard_deviations

        predicted_p95_over_mean = self.predicted_p95_over_mean

        predicted_standard_deviations: float | None
        predicted_standard_deviations = self.predicted_standard_deviations

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "p95_over_mean": p95_over_mean,
                "standard_deviations": standard_deviations,
                "predicted_p95_over_mean": predicted_p95_over_mean,
                "predicted_standard_deviations": predicted_standard_deviations,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        p95_over_mean = d.pop("p95_over_mean")

        def _parse_standard_deviations(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        standard_deviations = _parse_standard_deviations(d.pop("standard_deviations"))

        predicted_p95_over_mean = d.pop("predicted_p95_over_mean")

        def _parse_predicted_standard_deviations(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        predicted_standard_deviations = _parse_predicted_standard_deviations(d.pop("predicted_standard_deviations"))

        tail_shape = cls(
            p95_over_mean=p95_over_mean,
            standard_deviations=standard_deviations,
            predicted_p95_over_mean=predicted_p95_over_mean,
            predicted_standard_deviations=predicted_standard_deviations,
        )

        return tail_shape

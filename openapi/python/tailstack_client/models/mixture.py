from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="Mixture")


@_attrs_define
class Mixture:
    """A quantile over shots in each of which fiducials are lost at random, as often as the design says, in all views at
    once and independently of one another; over all units together.

        Attributes:
            quantile (float): Fraction of shots within the value: that of the requirement, otherwise 0.95.
            value_mm (float | None): The quantile of the error's norm over shots with and without losses, mm, what is not
                accounted for beyond it; null where that alone is more than the quantile leaves.
            target (str): Target at which it is largest.
            smallest_loss_probability (float): Smallest probability of a fiducial to be lost in a shot.
            largest_loss_probability (float): Largest probability of a fiducial to be lost in a shot.
            probability_of_none (float): Probability of a shot in which no fiducial is lost.
            probability_unaccounted (float): Probability of a shot in which more are lost than was evaluated (two; one with
                more than 30 fiducials), or in which what is left determines nothing: each counts as beyond every limit.
    """

    quantile: float
    value_mm: float | None
    target: str
    smallest_loss_probability: float
    largest_loss_probability: float
    probability_of_none: float
    probability_unaccounted: float

    def to_dict(self) -> dict[str, Any]:
        quantile = self.quantile

        value_mm: float | None
        value_mm = self.value_mm

        target = self.target

        smallest_loss_probability = self.smallest_loss_probability

        largest_loss_probability = self.largest_loss_probability

        probability_of_none = self.probability_of_none

        probability_unaccounted = self.probability_unaccounted

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "quantile": quantile,
                "value_mm": value_mm,
                "target": target,
                "smallest_loss_probability": smallest_loss_probability,
                "largest_loss_probability": largest_loss_probability,
                "probability_of_none": probability_of_none,
                "probability_unaccounted": probability_unaccounted,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        quantile = d.pop("quantile")

        def _parse_value_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        value_mm = _parse_value_mm(d.pop("value_mm"))

        target = d.pop("target")

        smallest_loss_probability = d.pop("smallest_loss_probability")

        largest_loss_probability = d.pop("largest_loss_probability")

        probability_of_none = d.pop("probability_of_none")

        probability_unaccounted = d.pop("probability_unaccounted")

        mixture = cls(
            quantile=quantile,
            value_mm=value_mm,
            target=target,
            smallest_loss_probability=smallest_loss_probability,
            largest_loss_probability=largest_loss_probability,
            probability_of_none=probability_of_none,
            probability_unaccounted=probability_unaccounted,
        )

        return mixture

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset


T = TypeVar("T", bound="LocalOptimum")


@_attrs_define
class LocalOptimum:
    """A distinct optimum among the starts, by the closed form that ranks them.

    Attributes:
        objective (float): Its objective by the closed form: cost, or the largest quantile over its limit.
        starts (int): How many starts ended there.
        first_start (int): Number of the first of them.
        rms_distance_mm (float): RMS distance of its fiducials from those of the best one, matched to the nearest, mm.
    """

    objective: float
    starts: int
    first_start: int
    rms_distance_mm: float

    def to_dict(self) -> dict[str, Any]:
        objective = self.objective

        starts = self.starts

        first_start = self.first_start

        rms_distance_mm = self.rms_distance_mm

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "objective": objective,
                "starts": starts,
                "first_start": first_start,
                "rms_distance_mm": rms_distance_mm,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        objective = d.pop("objective")

        starts = d.pop("starts")

        first_start = d.pop("first_start")

        rms_distance_mm = d.pop("rms_distance_mm")

        local_optimum = cls(
            objective=objective,
            starts=starts,
            first_start=first_start,
            rms_distance_mm=rms_distance_mm,
        )

        return local_optimum

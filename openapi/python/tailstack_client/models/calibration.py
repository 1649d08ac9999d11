from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset


T = TypeVar("T", bound="Calibration")


@_attrs_define
class Calibration:
    """How the validity statement did on this grid, one line for each thing it may say.

    Attributes:
        promise (str): What the validity statement says.
        points (int): Points at which it says so.
        kept (int): Points within what it promises, with the whole interval; of not valid: beyond 20 %.
        broken (int): Points beyond what it promises, with the whole interval; of not valid: none.
        open_ (int): Points whose interval reaches across the limit.
        lowest_ratio (float): Smallest ratio of first order to Monte Carlo.
        highest_ratio (float): Largest ratio of first order to Monte Carlo.
    """

    promise: str
    points: int
    kept: int
    broken: int
    open_: int
    lowest_ratio: float
    highest_ratio: float

    def to_dict(self) -> dict[str, Any]:
        promise = self.promise

        points = self.points

        kept = self.kept

        broken = self.broken

        open_ = self.open_

        lowest_ratio = self.lowest_ratio

        highest_ratio = self.highest_ratio

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "promise": promise,
                "points": points,
                "kept": kept,
                "broken": broken,
                "open": open_,
                "lowest_ratio": lowest_ratio,
                "highest_ratio": highest_ratio,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        promise = d.pop("promise")

        points = d.pop("points")

        kept = d.pop("kept")

        broken = d.pop("broken")

        open_ = d.pop("open")

        lowest_ratio = d.pop("lowest_ratio")

        highest_ratio = d.pop("highest_ratio")

        calibration = cls(
            promise=promise,
            points=points,
            kept=kept,
            broken=broken,
            open_=open_,
            lowest_ratio=lowest_ratio,
            highest_ratio=highest_ratio,
        )

        return calibration

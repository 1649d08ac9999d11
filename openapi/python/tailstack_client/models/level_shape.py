from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset


T = TypeVar("T", bound="LevelShape")


@_attrs_define
class LevelShape:
    """Where the P95 of the error stands at a level with 2 px of noise: S4 beside this says what its tail is.

    Attributes:
        level (str): Installation level of S4.
        p95_over_mean (float): P95 of the error's norm over its mean.
        standard_deviations (float): P95 less the mean, over the standard deviation; a normal law has 1.645.
    """

    level: str
    p95_over_mean: float
    standard_deviations: float

    def to_dict(self) -> dict[str, Any]:
        level = self.level

        p95_over_mean = self.p95_over_mean

        standard_deviations = self.standard_deviations

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "level": level,
                "p95_over_mean": p95_over_mean,
                "standard_deviations": standard_deviations,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        level = d.pop("level")

        p95_over_mean = d.pop("p95_over_mean")

        standard_deviations = d.pop("standard_deviations")

        level_shape = cls(
            level=level,
            p95_over_mean=p95_over_mean,
            standard_deviations=standard_deviations,
        )

        return level_shape

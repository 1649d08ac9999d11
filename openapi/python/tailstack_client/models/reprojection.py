from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset


T = TypeVar("T", bound="Reprojection")


@_attrs_define
class Reprojection:
    """RMS over fiducials and views of the distance between measured and reprojected images.

    Attributes:
        trials (int): Trials that it was sampled with.
        mean_px (float): Mean, px.
        p95_px (float): 95 % quantile, px.
    """

    trials: int
    mean_px: float
    p95_px: float

    def to_dict(self) -> dict[str, Any]:
        trials = self.trials

        mean_px = self.mean_px

        p95_px = self.p95_px

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "trials": trials,
                "mean_px": mean_px,
                "p95_px": p95_px,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        trials = d.pop("trials")

        mean_px = d.pop("mean_px")

        p95_px = d.pop("p95_px")

        reprojection = cls(
            trials=trials,
            mean_px=mean_px,
            p95_px=p95_px,
        )

        return reprojection

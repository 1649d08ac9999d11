from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset


T = TypeVar("T", bound="Bounds")


@_attrs_define
class Bounds:
    """Upper bounds of the quantile under ever weaker assumptions on the law of the error.

    Attributes:
        gaussian (float): 95 % quantile if the error were Gaussian with this mean and covariance, mm.
        unimodal (float): Upper bound of it for any law that is symmetric and unimodal about its mean, mm.
        moments (float): Upper bound of it for any law with this mean and covariance, mm.
    """

    gaussian: float
    unimodal: float
    moments: float

    def to_dict(self) -> dict[str, Any]:
        gaussian = self.gaussian

        unimodal = self.unimodal

        moments = self.moments

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "gaussian": gaussian,
                "unimodal": unimodal,
                "moments": moments,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        gaussian = d.pop("gaussian")

        unimodal = d.pop("unimodal")

        moments = d.pop("moments")

        bounds = cls(
            gaussian=gaussian,
            unimodal=unimodal,
            moments=moments,
        )

        return bounds

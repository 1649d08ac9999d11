from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="Contributor")


@_attrs_define
class Contributor:
    """One line of the budget.

    Attributes:
        name (str):
        component (str):
        law (str):
        half_width (float | None):
        unit (str):
        std (float | None):
        sensitivity_mm_per_unit (float | None):
        variance_share (float):
        dp95_per_unit (float | None):
        p95_without_mm (float):
    """

    name: str
    component: str
    law: str
    half_width: float | None
    unit: str
    std: float | None
    sensitivity_mm_per_unit: float | None
    variance_share: float
    dp95_per_unit: float | None
    p95_without_mm: float

    def to_dict(self) -> dict[str, Any]:
        name = self.name

        component = self.component

        law = self.law

        half_width: float | None
        half_width = self.half_width

        unit = self.unit

        std: float | None
        std = self.std

        sensitivity_mm_per_unit: float | None
        sensitivity_mm_per_unit = self.sensitivity_mm_per_unit

        variance_share = self.variance_share

        dp95_per_unit: float | None
        dp95_per_unit = self.dp95_per_unit

        p95_without_mm = self.p95_without_mm

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "name": name,
                "component": component,
                "law": law,
                "half_width": half_width,
                "unit": unit,
                "std": std,
                "sensitivity_mm_per_unit": sensitivity_mm_per_unit,
                "variance_share": variance_share,
                "dp95_per_unit": dp95_per_unit,
                "p95_without_mm": p95_without_mm,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        name = d.pop("name")

        component = d.pop("component")

        law = d.pop("law")

        def _parse_half_width(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        half_width = _parse_half_width(d.pop("half_width"))

        unit = d.pop("unit")

        def _parse_std(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        std = _parse_std(d.pop("std"))

        def _parse_sensitivity_mm_per_unit(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        sensitivity_mm_per_unit = _parse_sensitivity_mm_per_unit(d.pop("sensitivity_mm_per_unit"))

        variance_share = d.pop("variance_share")

        def _parse_dp95_per_unit(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        dp95_per_unit = _parse_dp95_per_unit(d.pop("dp95_per_unit"))

        p95_without_mm = d.pop("p95_without_mm")

        contributor = cls(
            name=name,
            component=component,
            law=law,
            half_width=half_width,
            unit=unit,
            std=std,
            sensitivity_mm_per_unit=sensitivity_mm_per_unit,
            variance_share=variance_share,
            dp95_per_unit=dp95_per_unit,
            p95_without_mm=p95_without_mm,
        )

        return contributor

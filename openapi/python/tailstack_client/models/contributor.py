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
        name (str): Source of error: fiducial_noise:VIEW, target_noise:VIEW, fiducial_manufacturing,
            structure_connector, connector_flange, hand_eye, execution, assumed_intrinsics:VIEW, motion:VIEW,
            image_field:VIEW, temperature or ball_images.
        component (str): Its component: rx ... tz, repeatability.x, load.x, the name of a locator, or all for the source
            as a whole; known for what does not vary.
        law (str): Declared law: normal, uniform, triangular or bounded; mixed for a line of several; known for what
            does not vary.
        half_width (float | None): Half-width of the tolerance (standard deviation of noise), in `unit`; null for a line
            of several.
        unit (str): Unit of half-width and standard deviation: deg, mm, px, N or K; empty for a line of several.
        std (float | None): Standard deviation, in `unit`; null where the law has none.
        sensitivity_mm_per_unit (float | None): Length of the error at the tool for one unit, mm per `unit`; null for a
            line of several.
        variance_share (float): Share of the trace of the covariance, 0 to 1.
        dp95_per_unit (float | None): Slope of P95 by the half-width (of noise: by its standard deviation), mm per
            `unit`; null where there is none.
        p95_without_mm (float): P95 with this contributor removed, mm.
        label (str): What people call the source: the label that the design gives an interface, otherwise its name or
            words for it. Default: ''.
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
    label: str = ""

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

        label = self.label

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
                "label": label,
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

        label = d.pop("label")

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
            label=label,
        )

        return contributor

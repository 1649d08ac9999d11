from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="PerUnit")


@_attrs_define
class PerUnit:
    """The second reading of risk: the installation is drawn once per unit and stays.

    Attributes:
        limit_mm (float | None):
        yield_fraction (float | None):
        yield_standard_error (float | None):
        p95_of_units_mm (float):
        p95_of_units_standard_error_mm (float):
    """

    limit_mm: float | None
    yield_fraction: float | None
    yield_standard_error: float | None
    p95_of_units_mm: float
    p95_of_units_standard_error_mm: float

    def to_dict(self) -> dict[str, Any]:
        limit_mm: float | None
        limit_mm = self.limit_mm

        yield_fraction: float | None
        yield_fraction = self.yield_fraction

        yield_standard_error: float | None
        yield_standard_error = self.yield_standard_error

        p95_of_units_mm = self.p95_of_units_mm

        p95_of_units_standard_error_mm = self.p95_of_units_standard_error_mm

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "limit_mm": limit_mm,
                "yield_fraction": yield_fraction,
                "yield_standard_error": yield_standard_error,
                "p95_of_units_mm": p95_of_units_mm,
                "p95_of_units_standard_error_mm": p95_of_units_standard_error_mm,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)

        def _parse_limit_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        limit_mm = _parse_limit_mm(d.pop("limit_mm"))

        def _parse_yield_fraction(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        yield_fraction = _parse_yield_fraction(d.pop("yield_fraction"))

        def _parse_yield_standard_error(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        yield_standard_error = _parse_yield_standard_error(d.pop("yield_standard_error"))

        p95_of_units_mm = d.pop("p95_of_units_mm")

        p95_of_units_standard_error_mm = d.pop("p95_of_units_standard_error_mm")

        per_unit = cls(
            limit_mm=limit_mm,
            yield_fraction=yield_fraction,
            yield_standard_error=yield_standard_error,
            p95_of_units_mm=p95_of_units_mm,
            p95_of_units_standard_error_mm=p95_of_units_standard_error_mm,
        )

        return per_unit

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
        limit_mm (float | None): Limit of the tightest requirement on each unit, mm; without one, the target's.
        yield_fraction (float | None): Fraction of units whose own quantile over shots meets the limit; null without a
            limit.
        yield_standard_error (float | None): Standard error of that fraction; null without a limit.
        p95_of_units_mm (float): 95 % quantile over units of each unit's own P95, mm.
        p95_of_units_standard_error_mm (float): Standard error of it, mm.
        quantile (float): Quantile over a unit's own shots: that of the requirement. Default: 0.95.
        units_fraction (float): Fraction of units that must keep it: the requirement's min_yield. Default: 0.95.
        value_mm (float | None): What this fraction of units keep their own quantile within, mm; null where it was not
            computed.
        standard_error_mm (float | None): Standard error of it, mm; null where it was not computed.
    """

    limit_mm: float | None
    yield_fraction: float | None
    yield_standard_error: float | None
    p95_of_units_mm: float
    p95_of_units_standard_error_mm: float
    value_mm: float | None
    standard_error_mm: float | None
    quantile: float = 0.95
    units_fraction: float = 0.95

    def to_dict(self) -> dict[str, Any]:
        limit_mm: float | None
        limit_mm = self.limit_mm

        yield_fraction: float | None
        yield_fraction = self.yield_fraction

        yield_standard_error: float | None
        yield_standard_error = self.yield_standard_error

        p95_of_units_mm = self.p95_of_units_mm

        p95_of_units_standard_error_mm = self.p95_of_units_standard_error_mm

        quantile = self.quantile

        units_fraction = self.units_fraction

        value_mm: float | None
        value_mm = self.value_mm

        standard_error_mm: float | None
        standard_error_mm = self.standard_error_mm

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "limit_mm": limit_mm,
                "yield_fraction": yield_fraction,
                "yield_standard_error": yield_standard_error,
                "p95_of_units_mm": p95_of_units_mm,
                "p95_of_units_standard_error_mm": p95_of_units_standard_error_mm,
                "quantile": quantile,
                "units_fraction": units_fraction,
                "value_mm": value_mm,
                "standard_error_mm": standard_error_mm,
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

        quantile = d.pop("quantile")

        units_fraction = d.pop("units_fraction")

        def _parse_value_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        value_mm = _parse_value_mm(d.pop("value_mm"))

        def _parse_standard_error_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        standard_error_mm = _parse_standard_error_mm(d.pop("standard_error_mm"))

        per_unit = cls(
            limit_mm=limit_mm,
            yield_fraction=yield_fraction,
            yield_standard_error=yield_standard_error,
            p95_of_units_mm=p95_of_units_mm,
            p95_of_units_standard_error_mm=p95_of_units_standard_error_mm,
            quantile=quantile,
            units_fraction=units_fraction,
            value_mm=value_mm,
            standard_error_mm=standard_error_mm,
        )

        return per_unit

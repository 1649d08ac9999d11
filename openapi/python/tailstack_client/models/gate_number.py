from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.gate_number_status import check_gate_number_status
from ..models.gate_number_status import GateNumberStatus
from typing import cast


T = TypeVar("T", bound="GateNumber")


@_attrs_define
class GateNumber:
    """One number that was held against a limit.

    Attributes:
        rule (str): Id of the rule that judged it.
        requirement (str): Name of the requirement; of a limit that the policy sets, the rule's id.
        target (str): Name of the target.
        unit (str): Unit of value, interval and limit: mm, or fraction for a yield.
        value (float): The number, in `unit`.
        interval (list[float | None] | None): Its lower and upper end, in `unit`; null: of a yield. A null end is not
            known.
        limit (float): What it was held against, in `unit`.
        status (GateNumberStatus): pass: surely within the limit; fail: surely beyond; otherwise inconclusive.
        error_rate (float | None): By Monte Carlo: largest probability that pass is said of a fail, or fail of a pass;
            null: first order.
        headline (str): What the value is, in words: "P95 that 90 % of units keep". Default: ''.
        value_mm (float | None): What decided, mm; of a yield, what the required fraction of units keep.
        interval_mm (list[float | None] | None): Its lower and upper end, mm; a null upper end is not known.
        limit_mm (float | None): The limit that it was held against, mm.
        margin_mm (float | None): Limit less the upper end of the interval, mm; null where that end is not known.
    """

    rule: str
    requirement: str
    target: str
    unit: str
    value: float
    interval: list[float | None] | None
    limit: float
    status: GateNumberStatus
    error_rate: float | None
    value_mm: float | None
    interval_mm: list[float | None] | None
    limit_mm: float | None
    margin_mm: float | None
    headline: str = ""

    def to_dict(self) -> dict[str, Any]:
        rule = self.rule

        requirement = self.requirement

        target = self.target

        unit = self.unit

        value = self.value

        interval: list[float | None] | None
        if isinstance(self.interval, list):
            interval = []
            for interval_type_0_item_data in self.interval:
                interval_type_0_item: float | None
                interval_type_0_item = interval_type_0_item_data
                interval.append(interval_type_0_item)

        else:
            interval = self.interval

        limit = self.limit

        status: str = self.status

        error_rate: float | None
        error_rate = self.error_rate

        headline = self.headline

        value_mm: float | None
        value_mm = self.value_mm

        interval_mm: list[float | None] | None
        if isinstance(self.interval_mm, list):
            interval_mm = []
            for interval_mm_type_0_item_data in self.interval_mm:
                interval_mm_type_0_item: float | None
                interval_mm_type_0_item = interval_mm_type_0_item_data
                interval_mm.append(interval_mm_type_0_item)

        else:
            interval_mm = self.interval_mm

        limit_mm: float | None
        limit_mm = self.limit_mm

        margin_mm: float | None
        margin_mm = self.margin_mm

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "rule": rule,
                "requirement": requirement,
                "target": target,
                "unit": unit,
                "value": value,
                "interval": interval,
                "limit": limit,
                "status": status,
                "error_rate": error_rate,
                "headline": headline,
                "value_mm": value_mm,
                "interval_mm": interval_mm,
                "limit_mm": limit_mm,
                "margin_mm": margin_mm,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        rule = d.pop("rule")

        requirement = d.pop("requirement")

        target = d.pop("target")

        unit = d.pop("unit")

        value = d.pop("value")

        def _parse_interval(data: object) -> list[float | None] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                interval_type_0 = []
                _interval_type_0 = data
                for interval_type_0_item_data in _interval_type_0:

                    def _parse_interval_type_0_item(data: object) -> float | None:
                        if data is None:
                            return data
                        return cast(float | None, data)

                    interval_type_0_item = _parse_interval_type_0_item(interval_type_0_item_data)

                    interval_type_0.append(interval_type_0_item)

                return interval_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float | None] | None, data)

        interval = _parse_interval(d.pop("interval"))

        limit = d.pop("limit")

        status = check_gate_number_status(d.pop("status"))

        def _parse_error_rate(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        error_rate = _parse_error_rate(d.pop("error_rate"))

        headline = d.pop("headline")

        def _parse_value_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        value_mm = _parse_value_mm(d.pop("value_mm"))

        def _parse_interval_mm(data: object) -> list[float | None] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                interval_mm_type_0 = []
                _interval_mm_type_0 = data
                for interval_mm_type_0_item_data in _interval_mm_type_0:

                    def _parse_interval_mm_type_0_item(data: object) -> float | None:
                        if data is None:
                            return data
                        return cast(float | None, data)

                    interval_mm_type_0_item = _parse_interval_mm_type_0_item(interval_mm_type_0_item_data)

                    interval_mm_type_0.append(interval_mm_type_0_item)

                return interval_mm_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float | None] | None, data)

        interval_mm = _parse_interval_mm(d.pop("interval_mm"))

        def _parse_limit_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        limit_mm = _parse_limit_mm(d.pop("limit_mm"))

        def _parse_margin_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        margin_mm = _parse_margin_mm(d.pop("margin_mm"))

        gate_number = cls(
            rule=rule,
            requirement=requirement,
            target=target,
            unit=unit,
            value=value,
            interval=interval,
            limit=limit,
            status=status,
            error_rate=error_rate,
            headline=headline,
            value_mm=value_mm,
            interval_mm=interval_mm,
            limit_mm=limit_mm,
            margin_mm=margin_mm,
        )

        return gate_number

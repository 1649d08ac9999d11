from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.check_status import check_check_status
from ..models.check_status import CheckStatus
from typing import cast


T = TypeVar("T", bound="Check")


@_attrs_define
class Check:
    """One requirement at one target: a value, its interval, and the limit that the interval is held against.

    The status is read off the interval alone: ``pass`` if its upper end is within the limit, so if the margin is not
    negative; ``fail`` if its lower end is beyond.  The yield stands beside: it is at least what is required just where
    the value is within the limit.

        Attributes:
            requirement (str): Name of the requirement.
            target (str): Name of the target, or of one sample of a region (zone[3]).
            error (str): Which error is limited: tcp (at the tool) or localisation (of the target, in con).
            risk (str): pooled: over installations and shots together; per_unit: of each unit by itself.
            quantile (float): Quantile of the error's norm that is limited, 0.95 for P95.
            value_mm (float): What decides, mm. pooled: the quantile; per_unit: what `min_yield` of units keep their own
                quantile within.
            interval_mm (list[float | None]): Lower and upper end, mm. Monte Carlo: confidence interval; first order:
                calibrated error of the linearisation. A null upper end: not known, as first order is not valid.
            limit_mm (float): Limit of the requirement, mm.
            yield_fraction (float | None): per_unit: fraction of units whose own quantile is within the limit; null for
                pooled.
            min_yield (float | None): per_unit: fraction of units that must keep the limit; null for pooled.
            status (CheckStatus): pass: the upper end of the interval is within the limit; fail: the lower end is beyond;
                otherwise inconclusive.
            headline (str): What the value is, in words: "P95 that 90 % of units keep". Default: ''.
            margin_mm (float | None): Limit less the upper end of the interval, mm: not negative just where the status is
                pass. Null where that end is not known.
    """

    requirement: str
    target: str
    error: str
    risk: str
    quantile: float
    value_mm: float
    interval_mm: list[float | None]
    limit_mm: float
    yield_fraction: float | None
    min_yield: float | None
    status: CheckStatus
    margin_mm: float | None
    headline: str = ""

    def to_dict(self) -> dict[str, Any]:
        requirement = self.requirement

        target = self.target

        error = self.error

        risk = self.risk

        quantile = self.quantile

        value_mm = self.value_mm

        interval_mm = []
        for interval_mm_item_data in self.interval_mm:
            interval_mm_item: float | None
            interval_mm_item = interval_mm_item_data
            interval_mm.append(interval_mm_item)

        limit_mm = self.limit_mm

        yield_fraction: float | None
        yield_fraction = self.yield_fraction

        min_yield: float | None
        min_yield = self.min_yield

        status: str = self.status

        headline = self.headline

        margin_mm: float | None
        margin_mm = self.margin_mm

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "requirement": requirement,
                "target": target,
                "error": error,
                "risk": risk,
                "quantile": quantile,
                "value_mm": value_mm,
                "interval_mm": interval_mm,
                "limit_mm": limit_mm,
                "yield_fraction": yield_fraction,
                "min_yield": min_yield,
                "status": status,
                "headline": headline,
                "margin_mm": margin_mm,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        requirement = d.pop("requirement")

        target = d.pop("target")

        error = d.pop("error")

        risk = d.pop("risk")

        quantile = d.pop("quantile")

        value_mm = d.pop("value_mm")

        interval_mm = []
        _interval_mm = d.pop("interval_mm")
        for interval_mm_item_data in _interval_mm:

            def _parse_interval_mm_item(data: object) -> float | None:
                if data is None:
                    return data
                return cast(float | None, data)

            interval_mm_item = _parse_interval_mm_item(interval_mm_item_data)

            interval_mm.append(interval_mm_item)

        limit_mm = d.pop("limit_mm")

        def _parse_yield_fraction(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        yield_fraction = _parse_yield_fraction(d.pop("yield_fraction"))

        def _parse_min_yield(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        min_yield = _parse_min_yield(d.pop("min_yield"))

        status = check_check_status(d.pop("status"))

        headline = d.pop("headline")

        def _parse_margin_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        margin_mm = _parse_margin_mm(d.pop("margin_mm"))

        check = cls(
            requirement=requirement,
            target=target,
            error=error,
            risk=risk,
            quantile=quantile,
            value_mm=value_mm,
            interval_mm=interval_mm,
            limit_mm=limit_mm,
            yield_fraction=yield_fraction,
            min_yield=min_yield,
            status=status,
            headline=headline,
            margin_mm=margin_mm,
        )

        return check

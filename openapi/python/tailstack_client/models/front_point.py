from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.front_point_status import check_front_point_status
from ..models.front_point_status import FrontPointStatus
from typing import cast


T = TypeVar("T", bound="FrontPoint")


@_attrs_define
class FrontPoint:
    """One limit of the front of cost and limit; with a design that was verified like the one returned, or without.

    Every requirement's limit is scaled by the same factor; limit, quantile and upper limit are those of the first.

        Attributes:
            factor (float): Factor on the limit of every requirement.
            limit_mm (float): The first requirement's limit so scaled, mm.
            status (FrontPointStatus): verified: checked by Monte Carlo; dominated: another point costs no more at a tighter
                limit; out of reach: no design keeps it; not tried.
            note (str): Why there is no design, or what costs less.
            cost (float | None): Cost of the design; null without one.
            quantile_mm (float | None): Largest first-order quantile over the first requirement's targets, mm; null without
                a design.
            verified_upper_mm (float | None): Largest upper confidence limit of the check, mm; null without one.
            half_widths (list[float]): Half-widths, in the order and units of `tolerances`.
            pivots_mm (list[list[float]]): Pivots, con, mm, in the order of `pivots`.
            locator_scales (list[float]): Factors on locators' spacing, in the order of `spacings`.
            fiducials_mm (list[list[float]]): Fiducials, con, mm.
    """

    factor: float
    limit_mm: float
    status: FrontPointStatus
    note: str
    cost: float | None
    quantile_mm: float | None
    verified_upper_mm: float | None
    half_widths: list[float]
    pivots_mm: list[list[float]]
    locator_scales: list[float]
    fiducials_mm: list[list[float]]

    def to_dict(self) -> dict[str, Any]:
        factor = self.factor

        limit_mm = self.limit_mm

        status: str = self.status

        note = self.note

        cost: float | None
        cost = self.cost

        quantile_mm: float | None
        quantile_mm = self.quantile_mm

        verified_upper_mm: float | None
        verified_upper_mm = self.verified_upper_mm

        half_widths = self.half_widths

        pivots_mm = []
        for pivots_mm_item_data in self.pivots_mm:
            pivots_mm_item = []
            for pivots_mm_item_item_data in pivots_mm_item_data:
                pivots_mm_item_item: float
                pivots_mm_item_item = pivots_mm_item_item_data
                pivots_mm_item.append(pivots_mm_item_item)

            pivots_mm.append(pivots_mm_item)

        locator_scales = self.locator_scales

        fiducials_mm = []
        for fiducials_mm_item_data in self.fiducials_mm:
            fiducials_mm_item = []
            for fiducials_mm_item_item_data in fiducials_mm_item_data:
                fiducials_mm_item_item: float
                fiducials_mm_item_item = fiducials_mm_item_item_data
                fiducials_mm_item.append(fiducials_mm_item_item)

            fiducials_mm.append(fiducials_mm_item)

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "factor": factor,
                "limit_mm": limit_mm,
                "status": status,
                "note": note,
                "cost": cost,
                "quantile_mm": quantile_mm,
                "verified_upper_mm": verified_upper_mm,
                "half_widths": half_widths,
                "pivots_mm": pivots_mm,
                "locator_scales": locator_scales,
                "fiducials_mm": fiducials_mm,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        factor = d.pop("factor")

        limit_mm = d.pop("limit_mm")

        status = check_front_point_status(d.pop("status"))

        note = d.pop("note")

        def _parse_cost(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        cost = _parse_cost(d.pop("cost"))

        def _parse_quantile_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        quantile_mm = _parse_quantile_mm(d.pop("quantile_mm"))

        def _parse_verified_upper_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        verified_upper_mm = _parse_verified_upper_mm(d.pop("verified_upper_mm"))

        half_widths = cast(list[float], d.pop("half_widths"))

        pivots_mm = []
        _pivots_mm = d.pop("pivots_mm")
        for pivots_mm_item_data in _pivots_mm:
            pivots_mm_item = []
            _pivots_mm_item = pivots_mm_item_data
            for pivots_mm_item_item_data in _pivots_mm_item:

                def _parse_pivots_mm_item_item(data: object) -> float:
                    return cast(float, data)

                pivots_mm_item_item = _parse_pivots_mm_item_item(pivots_mm_item_item_data)

                pivots_mm_item.append(pivots_mm_item_item)

            pivots_mm.append(pivots_mm_item)

        locator_scales = cast(list[float], d.pop("locator_scales"))

        fiducials_mm = []
        _fiducials_mm = d.pop("fiducials_mm")
        for fiducials_mm_item_data in _fiducials_mm:
            fiducials_mm_item = []
            _fiducials_mm_item = fiducials_mm_item_data
            for fiducials_mm_item_item_data in _fiducials_mm_item:

                def _parse_fiducials_mm_item_item(data: object) -> float:
                    return cast(float, data)

                fiducials_mm_item_item = _parse_fiducials_mm_item_item(fiducials_mm_item_item_data)

                fiducials_mm_item.append(fiducials_mm_item_item)

            fiducials_mm.append(fiducials_mm_item)

        front_point = cls(
            factor=factor,
            limit_mm=limit_mm,
            status=status,
            note=note,
            cost=cost,
            quantile_mm=quantile_mm,
            verified_upper_mm=verified_upper_mm,
            half_widths=half_widths,
            pivots_mm=pivots_mm,
            locator_scales=locator_scales,
            fiducials_mm=fiducials_mm,
        )

        return front_point

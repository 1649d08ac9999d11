from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.second_order_status import check_second_order_status
from ..models.second_order_status import SecondOrderStatus
from typing import cast


T = TypeVar("T", bound="SecondOrder")


@_attrs_define
class SecondOrder:
    """Correction of the TCP error by the Hessian of the chain; see its own range of validity.

    Attributes:
        status (SecondOrderStatus): applied, refused where it does not hold, or not requested.
        reason (str): Why it was refused, or what it rests on.
        mean_shift_mm (list[float] | None): What it adds to the mean of the TCP error x, y, z in tcp, mm; null unless
            applied.
        std_mm (list[float] | None): Standard deviations with it along x, y, z in tcp, mm; null unless applied.
        p95_mm (float | None): 95 % quantile of the TCP error's norm with it, mm; null unless applied.
    """

    status: SecondOrderStatus
    reason: str
    mean_shift_mm: list[float] | None
    std_mm: list[float] | None
    p95_mm: float | None

    def to_dict(self) -> dict[str, Any]:
        status: str = self.status

        reason = self.reason

        mean_shift_mm: list[float] | None
        if isinstance(self.mean_shift_mm, list):
            mean_shift_mm = []
            for mean_shift_mm_type_0_item_data in self.mean_shift_mm:
                mean_shift_mm_type_0_item: float
                mean_shift_mm_type_0_item = mean_shift_mm_type_0_item_data
                mean_shift_mm.append(mean_shift_mm_type_0_item)

        else:
            mean_shift_mm = self.mean_shift_mm

        std_mm: list[float] | None
        if isinstance(self.std_mm, list):
            std_mm = []
            for std_mm_type_0_item_data in self.std_mm:
                std_mm_type_0_item: float
                std_mm_type_0_item = std_mm_type_0_item_data
                std_mm.append(std_mm_type_0_item)

        else:
            std_mm = self.std_mm

        p95_mm: float | None
        p95_mm = self.p95_mm

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "status": status,
                "reason": reason,
                "mean_shift_mm": mean_shift_mm,
                "std_mm": std_mm,
                "p95_mm": p95_mm,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        status = check_second_order_status(d.pop("status"))

        reason = d.pop("reason")

        def _parse_mean_shift_mm(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                mean_shift_mm_type_0 = []
                _mean_shift_mm_type_0 = data
                for mean_shift_mm_type_0_item_data in _mean_shift_mm_type_0:

                    def _parse_mean_shift_mm_type_0_item(data: object) -> float:
                        return cast(float, data)

                    mean_shift_mm_type_0_item = _parse_mean_shift_mm_type_0_item(mean_shift_mm_type_0_item_data)

                    mean_shift_mm_type_0.append(mean_shift_mm_type_0_item)

                return mean_shift_mm_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        mean_shift_mm = _parse_mean_shift_mm(d.pop("mean_shift_mm"))

        def _parse_std_mm(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                std_mm_type_0 = []
                _std_mm_type_0 = data
                for std_mm_type_0_item_data in _std_mm_type_0:

                    def _parse_std_mm_type_0_item(data: object) -> float:
                        return cast(float, data)

                    std_mm_type_0_item = _parse_std_mm_type_0_item(std_mm_type_0_item_data)

                    std_mm_type_0.append(std_mm_type_0_item)

                return std_mm_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        std_mm = _parse_std_mm(d.pop("std_mm"))

        def _parse_p95_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        p95_mm = _parse_p95_mm(d.pop("p95_mm"))

        second_order = cls(
            status=status,
            reason=reason,
            mean_shift_mm=mean_shift_mm,
            std_mm=std_mm,
            p95_mm=p95_mm,
        )

        return second_order

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="EstimatorCase")


@_attrs_define
class EstimatorCase:
    """The design under one estimator.

    Attributes:
        estimator (str): What each view is estimated as: dlt, reprojection, pose_with_prior or pose.
        needs (str): What has to be known for it.
        reason (str): Why the design has no answer under it; empty: it has one.
        target (None | str): Target with the largest P95; null without an answer.
        p95_mm (float | None): P95 of the error at the tool there by first order, intrinsics as far off as is stated,
            mm.
        p95_exact_mm (float | None): The same with intrinsics that are exact, mm.
        validity (str): How far first order can be trusted here.
        simulated_p95_mm (float | None): P95 there by simulation, mm; null where none was asked for.
        simulated_interval_mm (list[float] | None): Its two-sided interval of 95 %, mm.
        same_size_mm (float | None): Extent of a structure of this shape that would do as well under this estimator as
            the design does under dlt, mm; null of dlt itself, and where no smaller structure would.
    """

    estimator: str
    needs: str
    reason: str
    target: None | str
    p95_mm: float | None
    p95_exact_mm: float | None
    validity: str
    simulated_p95_mm: float | None
    simulated_interval_mm: list[float] | None
    same_size_mm: float | None

    def to_dict(self) -> dict[str, Any]:
        estimator = self.estimator

        needs = self.needs

        reason = self.reason

        target: None | str
        target = self.target

        p95_mm: float | None
        p95_mm = self.p95_mm

        p95_exact_mm: float | None
        p95_exact_mm = self.p95_exact_mm

        validity = self.validity

        simulated_p95_mm: float | None
        simulated_p95_mm = self.simulated_p95_mm

        simulated_interval_mm: list[float] | None
        if isinstance(self.simulated_interval_mm, list):
            simulated_interval_mm = []
            for simulated_interval_mm_type_0_item_data in self.simulated_interval_mm:
                simulated_interval_mm_type_0_item: float
                simulated_interval_mm_type_0_item = simulated_interval_mm_type_0_item_data
                simulated_interval_mm.append(simulated_interval_mm_type_0_item)

        else:
            simulated_interval_mm = self.simulated_interval_mm

        same_size_mm: float | None
        same_size_mm = self.same_size_mm

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "estimator": estimator,
                "needs": needs,
                "reason": reason,
                "target": target,
                "p95_mm": p95_mm,
                "p95_exact_mm": p95_exact_mm,
                "validity": validity,
                "simulated_p95_mm": simulated_p95_mm,
                "simulated_interval_mm": simulated_interval_mm,
                "same_size_mm": same_size_mm,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        estimator = d.pop("estimator")

        needs = d.pop("needs")

        reason = d.pop("reason")

        def _parse_target(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        target = _parse_target(d.pop("target"))

        def _parse_p95_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        p95_mm = _parse_p95_mm(d.pop("p95_mm"))

        def _parse_p95_exact_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        p95_exact_mm = _parse_p95_exact_mm(d.pop("p95_exact_mm"))

        validity = d.pop("validity")

        def _parse_simulated_p95_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        simulated_p95_mm = _parse_simulated_p95_mm(d.pop("simulated_p95_mm"))

        def _parse_simulated_interval_mm(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                simulated_interval_mm_type_0 = []
                _simulated_interval_mm_type_0 = data
                for simulated_interval_mm_type_0_item_data in _simulated_interval_mm_type_0:

                    def _parse_simulated_interval_mm_type_0_item(data: object) -> float:
                        return cast(float, data)

                    simulated_interval_mm_type_0_item = _parse_simulated_interval_mm_type_0_item(
                        simulated_interval_mm_type_0_item_data
                    )

                    simulated_interval_mm_type_0.append(simulated_interval_mm_type_0_item)

                return simulated_interval_mm_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        simulated_interval_mm = _parse_simulated_interval_mm(d.pop("simulated_interval_mm"))

        def _parse_same_size_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        same_size_mm = _parse_same_size_mm(d.pop("same_size_mm"))

        estimator_case = cls(
            estimator=estimator,
            needs=needs,
            reason=reason,
            target=target,
            p95_mm=p95_mm,
            p95_exact_mm=p95_exact_mm,
            validity=validity,
            simulated_p95_mm=simulated_p95_mm,
            simulated_interval_mm=simulated_interval_mm,
            same_size_mm=same_size_mm,
        )

        return estimator_case

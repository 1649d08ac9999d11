from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.difference_basis import check_difference_basis
from ..models.difference_basis import DifferenceBasis
from ..models.difference_conclusion import check_difference_conclusion
from ..models.difference_conclusion import DifferenceConclusion
from typing import cast


T = TypeVar("T", bound="Difference")


@_attrs_define
class Difference:
    """P95 of the TCP error at one target that both designs have: second minus first.

    Both designs are drawn with the same random numbers, so that what they share cancels.

        Attributes:
            target (str): Name of the target that both designs have.
            basis (DifferenceBasis): What the P95 rest on.
            first_p95_mm (float): P95 of the TCP error of the first design, mm: of the check, or first order where nothing
                was drawn.
            second_p95_mm (float): P95 of the TCP error of the second design, mm.
            difference_mm (float): Second minus first, mm.
            interval_mm (list[float] | None): Confidence interval of the difference, from trials that both designs share,
                mm; null: first order.
            confidence (float | None): Confidence of that interval, 0 to 1; null: first order.
            conclusion (DifferenceConclusion): Of the second: smaller or larger where the interval says so, otherwise not
                decided; computed: first order.
    """

    target: str
    basis: DifferenceBasis
    first_p95_mm: float
    second_p95_mm: float
    difference_mm: float
    interval_mm: list[float] | None
    confidence: float | None
    conclusion: DifferenceConclusion

    def to_dict(self) -> dict[str, Any]:
        target = self.target

        basis: str = self.basis

        first_p95_mm = self.first_p95_mm

        second_p95_mm = self.second_p95_mm

        difference_mm = self.difference_mm

        interval_mm: list[float] | None
        if isinstance(self.interval_mm, list):
            interval_mm = []
            for interval_mm_type_0_item_data in self.interval_mm:
                interval_mm_type_0_item: float
                interval_mm_type_0_item = interval_mm_type_0_item_data
                interval_mm.append(interval_mm_type_0_item)

        else:
            interval_mm = self.interval_mm

        confidence: float | None
        confidence = self.confidence

        conclusion: str = self.conclusion

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "target": target,
                "basis": basis,
                "first_p95_mm": first_p95_mm,
                "second_p95_mm": second_p95_mm,
                "difference_mm": difference_mm,
                "interval_mm": interval_mm,
                "confidence": confidence,
                "conclusion": conclusion,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        target = d.pop("target")

        basis = check_difference_basis(d.pop("basis"))

        first_p95_mm = d.pop("first_p95_mm")

        second_p95_mm = d.pop("second_p95_mm")

        difference_mm = d.pop("difference_mm")

        def _parse_interval_mm(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                interval_mm_type_0 = []
                _interval_mm_type_0 = data
                for interval_mm_type_0_item_data in _interval_mm_type_0:

                    def _parse_interval_mm_type_0_item(data: object) -> float:
                        return cast(float, data)

                    interval_mm_type_0_item = _parse_interval_mm_type_0_item(interval_mm_type_0_item_data)

                    interval_mm_type_0.append(interval_mm_type_0_item)

                return interval_mm_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        interval_mm = _parse_interval_mm(d.pop("interval_mm"))

        def _parse_confidence(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        confidence = _parse_confidence(d.pop("confidence"))

        conclusion = check_difference_conclusion(d.pop("conclusion"))

        difference = cls(
            target=target,
            basis=basis,
            first_p95_mm=first_p95_mm,
            second_p95_mm=second_p95_mm,
            difference_mm=difference_mm,
            interval_mm=interval_mm,
            confidence=confidence,
            conclusion=conclusion,
        )

        return difference

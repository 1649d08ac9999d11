from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.comparison_request_parts_item import check_comparison_request_parts_item
from ..models.comparison_request_parts_item import ComparisonRequestPartsItem
from ..types import UNSET, Unset
from typing import cast

if TYPE_CHECKING:
    from ..models.design import Design


T = TypeVar("T", bound="ComparisonRequest")


@_attrs_define
class ComparisonRequest:
    """
    Attributes:
        first (Design): A reference structure on a robot, seen by two or more X-ray views. Lengths in mm, angles in
            degrees, images in px: the unit is in every field name. Frames: con (connector: fiducials, targets, interface
            pivots, views; LPS), flange, tcp. T_ab maps coordinates in b to coordinates in a. Tolerances are half-widths.
            Unknown fields, NaN and infinities are refused.
        second (Design): A reference structure on a robot, seen by two or more X-ray views. Lengths in mm, angles in
            degrees, images in px: the unit is in every field name. Frames: con (connector: fiducials, targets, interface
            pivots, views; LPS), flange, tcp. T_ab maps coordinates in b to coordinates in a. Tolerances are half-widths.
            Unknown fields, NaN and infinities are refused.
        trials (int | None | Unset): Number of trials. Either this or precision; neither: the solver's own precision.
        precision (float | None | Unset): Half-width of the confidence interval of P95, relative, at which sampling
            stops.
        seed (int | Unset): Seed; one seed is one answer, whatever workers and threads. Default: 0.
        parts (list[ComparisonRequestPartsItem] | Unset): What is computed of both; score alone: to first order.
    """

    first: Design
    second: Design
    trials: int | None | Unset = UNSET
    precision: float | None | Unset = UNSET
    seed: int | Unset = 0
    parts: list[ComparisonRequestPartsItem] | Unset = UNSET

    def to_dict(self) -> dict[str, Any]:
        from ..models.design import Design  # noqa: PLC0415

        first = self.first.to_dict()

        second = self.second.to_dict()

        trials: int | None | Unset
        if isinstance(self.trials, Unset):
            trials = UNSET
        else:
            trials = self.trials

        precision: float | None | Unset
        if isinstance(self.precision, Unset):
            precision = UNSET
        else:
            precision = self.precision

        seed = self.seed

        parts: list[str] | Unset = UNSET
        if not isinstance(self.parts, Unset):
            parts = []
            for parts_item_data in self.parts:
                parts_item: str = parts_item_data
                parts.append(parts_item)

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "first": first,
                "second": second,
            }
        )
        if trials is not UNSET:
            field_dict["trials"] = trials
        if precision is not UNSET:
            field_dict["precision"] = precision
        if seed is not UNSET:
            field_dict["seed"] = seed
        if parts is not UNSET:
            field_dict["parts"] = parts

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.design import Design  # noqa: PLC0415

        d = dict(src_dict)
        first = Design.from_dict(d.pop("first"))

        second = Design.from_dict(d.pop("second"))

        def _parse_trials(data: object) -> int | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            return cast(int | None | Unset, data)

        trials = _parse_trials(d.pop("trials", UNSET))

        def _parse_precision(data: object) -> float | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            return cast(float | None | Unset, data)

        precision = _parse_precision(d.pop("precision", UNSET))

        seed = d.pop("seed", UNSET)

        _parts = d.pop("parts", UNSET)
        parts: list[ComparisonRequestPartsItem] | Unset = UNSET
        if _parts is not UNSET:
            parts = []
            for parts_item_data in _parts:
                parts_item = check_comparison_request_parts_item(parts_item_data)

                parts.append(parts_item)

        comparison_request = cls(
            first=first,
            second=second,
            trials=trials,
            precision=precision,
            seed=seed,
            parts=parts,
        )

        return comparison_request

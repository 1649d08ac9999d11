from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..types import UNSET, Unset
from typing import cast

if TYPE_CHECKING:
    from ..models.design import Design


T = TypeVar("T", bound="ScoreRequest")


@_attrs_define
class ScoreRequest:
    """
    Attributes:
        design (Design): A reference structure on a robot, seen by two or more X-ray views. Lengths in mm, angles in
            degrees, images in px: the unit is in every field name. Frames: con (connector: fiducials, targets, interface
            pivots, views; LPS), flange, tcp. T_ab maps coordinates in b to coordinates in a. Tolerances are half-widths.
            Unknown fields, NaN and infinities are refused.
        second_order (bool | Unset): Add the second-order correction where it holds. Default: False.
    """

    design: Design
    second_order: bool | Unset = False

    def to_dict(self) -> dict[str, Any]:
        from ..models.design import Design  # noqa: PLC0415

        design = self.design.to_dict()

        second_order = self.second_order

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "design": design,
            }
        )
        if second_order is not UNSET:
            field_dict["second_order"] = second_order

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.design import Design  # noqa: PLC0415

        d = dict(src_dict)
        design = Design.from_dict(d.pop("design"))

        second_order = d.pop("second_order", UNSET)

        score_request = cls(
            design=design,
            second_order=second_order,
        )

        return score_request

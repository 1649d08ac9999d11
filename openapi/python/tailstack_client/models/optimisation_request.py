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


T = TypeVar("T", bound="OptimisationRequest")


@_attrs_define
class OptimisationRequest:
    """
    Attributes:
        design (Design): A reference structure on a robot, seen by two or more X-ray views. Lengths in mm, angles in
            degrees, images in px: the unit is in every field name. Frames: con (connector: fiducials, targets, interface
            pivots, views; LPS), flange, tcp. T_ab maps coordinates in b to coordinates in a. Tolerances are half-widths.
            Unknown fields, NaN and infinities are refused.
        seed (int | None | Unset): Seed of the starts; absent: optimise/seed of the design.
        starts (int | None | Unset): Number of starts; absent: optimise/starts of the design.
    """

    design: Design
    seed: int | None | Unset = UNSET
    starts: int | None | Unset = UNSET

    def to_dict(self) -> dict[str, Any]:
        from ..models.design import Design  # noqa: PLC0415

        design = self.design.to_dict()

        seed: int | None | Unset
        if isinstance(self.seed, Unset):
            seed = UNSET
        else:
            seed = self.seed

        starts: int | None | Unset
        if isinstance(self.starts, Unset):
            starts = UNSET
        else:
            starts = self.starts

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "design": design,
            }
        )
        if seed is not UNSET:
            field_dict["seed"] = seed
        if starts is not UNSET:
            field_dict["starts"] = starts

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.design import Design  # noqa: PLC0415

        d = dict(src_dict)
        design = Design.from_dict(d.pop("design"))

        def _parse_seed(data: object) -> int | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            return cast(int | None | Unset, data)

        seed = _parse_seed(d.pop("seed", UNSET))

        def _parse_starts(data: object) -> int | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            return cast(int | None | Unset, data)

        starts = _parse_starts(d.pop("starts", UNSET))

        optimisation_request = cls(
            design=design,
            seed=seed,
            starts=starts,
        )

        return optimisation_request

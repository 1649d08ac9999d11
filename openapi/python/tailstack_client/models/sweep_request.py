from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.sweep_request_check import check_sweep_request_check
from ..models.sweep_request_check import SweepRequestCheck
from ..types import UNSET, Unset
from typing import cast

if TYPE_CHECKING:
    from ..models.axis import Axis
    from ..models.design import Design


T = TypeVar("T", bound="SweepRequest")


@_attrs_define
class SweepRequest:
    """
    Attributes:
        design (Design): A reference structure on a robot, seen by two or more X-ray views. Lengths in mm, angles in
            degrees, images in px: the unit is in every field name. Frames: con (connector: fiducials, targets, interface
            pivots, views; LPS), flange, tcp. T_ab maps coordinates in b to coordinates in a. Tolerances are half-widths.
            Unknown fields, NaN and infinities are refused.
        axes (list[Axis]): Numbers of the design that vary; every combination of their values is a point.
        check (SweepRequestCheck | Unset): What is computed at each point. Default: 'score'.
        trials (int | None | Unset): Trials at each point, for check verification; absent: to the solver's own
            precision.
        seed (int | Unset): Seed of every check: one for all points, which then differ by their designs alone. Default:
            0.
    """

    design: Design
    axes: list[Axis]
    check: SweepRequestCheck | Unset = "score"
    trials: int | None | Unset = UNSET
    seed: int | Unset = 0

    def to_dict(self) -> dict[str, Any]:
        from ..models.axis import Axis  # noqa: PLC0415
        from ..models.design import Design  # noqa: PLC0415

        design = self.design.to_dict()

        axes = []
        for axes_item_data in self.axes:
            axes_item = axes_item_data.to_dict()
            axes.append(axes_item)

        check: str | Unset = UNSET
        if not isinstance(self.check, Unset):
            check = self.check

        trials: int | None | Unset
        if isinstance(self.trials, Unset):
            trials = UNSET
        else:
            trials = self.trials

        seed = self.seed

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "design": design,
                "axes": axes,
            }
        )
        if check is not UNSET:
            field_dict["check"] = check
        if trials is not UNSET:
            field_dict["trials"] = trials
        if seed is not UNSET:
            field_dict["seed"] = seed

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.axis import Axis  # noqa: PLC0415
        from ..models.design import Design  # noqa: PLC0415

        d = dict(src_dict)
        design = Design.from_dict(d.pop("design"))

        axes = []
        _axes = d.pop("axes")
        for axes_item_data in _axes:
            axes_item = Axis.from_dict(axes_item_data)

            axes.append(axes_item)

        _check = d.pop("check", UNSET)
        check: SweepRequestCheck | Unset
        if isinstance(_check, Unset):
            check = UNSET
        else:
            check = check_sweep_request_check(_check)

        def _parse_trials(data: object) -> int | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            return cast(int | None | Unset, data)

        trials = _parse_trials(d.pop("trials", UNSET))

        seed = d.pop("seed", UNSET)

        sweep_request = cls(
            design=design,
            axes=axes,
            check=check,
            trials=trials,
            seed=seed,
        )

        return sweep_request

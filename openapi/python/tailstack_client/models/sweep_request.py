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
    from ..models.design_patch import DesignPatch


T = TypeVar("T", bound="SweepRequest")


@_attrs_define
class SweepRequest:
    """
    Attributes:
        axes (list[Axis]): Numbers of the design that vary; every combination of their values is a point.
        design (Design | Unset): A reference structure on a robot, seen by two or more X-ray views. Lengths in mm,
            angles in degrees, images in px: the unit is in every field name. Frames: con (connector: fiducials, targets,
            interface pivots, views; LPS), flange, tcp. T_ab maps coordinates in b to coordinates in a. Tolerances are half-
            widths. Unknown fields, NaN and infinities are refused.
        design_sha256 (str | Unset): Instead of `design`: the SHA-256 of one that was sent whole before (`design_sha256`
            of its answer). 404 `unknown-design` where it is no longer kept.
        patch (DesignPatch | Unset): What differs from a design: a JSON merge patch (RFC 7396). Objects are merged, null
            removes a field, lists are replaced whole.
        check (SweepRequestCheck | Unset): What is computed at each point. Default: 'score'.
        trials (int | None | Unset): Trials at each point, for check verification; absent: to the solver's own
            precision.
        seed (int | Unset): Seed of every check: one for all points, which then differ by their designs alone. Default:
            0.
    """

    axes: list[Axis]
    design: Design | Unset = UNSET
    design_sha256: str | Unset = UNSET
    patch: DesignPatch | Unset = UNSET
    check: SweepRequestCheck | Unset = "score"
    trials: int | None | Unset = UNSET
    seed: int | Unset = 0

    def to_dict(self) -> dict[str, Any]:
        from ..models.axis import Axis  # noqa: PLC0415
        from ..models.design import Design  # noqa: PLC0415
        from ..models.design_patch import DesignPatch  # noqa: PLC0415

        axes = []
        for axes_item_data in self.axes:
            axes_item = axes_item_data.to_dict()
            axes.append(axes_item)

        design: dict[str, Any] | Unset = UNSET
        if not isinstance(self.design, Unset):
            design = self.design.to_dict()

        design_sha256 = self.design_sha256

        patch: dict[str, Any] | Unset = UNSET
        if not isinstance(self.patch, Unset):
            patch = self.patch.to_dict()

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
                "axes": axes,
            }
        )
        if design is not UNSET:
            field_dict["design"] = design
        if design_sha256 is not UNSET:
            field_dict["design_sha256"] = design_sha256
        if patch is not UNSET:
            field_dict["patch"] = patch
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
        from ..models.design_patch import DesignPatch  # noqa: PLC0415

        d = dict(src_dict)
        axes = []
        _axes = d.pop("axes")
        for axes_item_data in _axes:
            axes_item = Axis.from_dict(axes_item_data)

            axes.append(axes_item)

        _design = d.pop("design", UNSET)
        design: Design | Unset
        if isinstance(_design, Unset):
            design = UNSET
        else:
            design = Design.from_dict(_design)

        design_sha256 = d.pop("design_sha256", UNSET)

        _patch = d.pop("patch", UNSET)
        patch: DesignPatch | Unset
        if isinstance(_patch, Unset):
            patch = UNSET
        else:
            patch = DesignPatch.from_dict(_patch)

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
            axes=axes,
            design=design,
            design_sha256=design_sha256,
            patch=patch,
            check=check,
            trials=trials,
            seed=seed,
        )

        return sweep_request

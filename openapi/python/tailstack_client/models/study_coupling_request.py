from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.study_coupling_request_error import check_study_coupling_request_error
from ..models.study_coupling_request_error import StudyCouplingRequestError
from ..types import UNSET, Unset
from typing import cast

if TYPE_CHECKING:
    from ..models.design import Design
    from ..models.design_patch import DesignPatch
    from ..models.installation_level import InstallationLevel


T = TypeVar("T", bound="StudyCouplingRequest")


@_attrs_define
class StudyCouplingRequest:
    """
    Attributes:
        design (Design | Unset): A reference structure on a robot, seen by two or more X-ray views. Lengths in mm,
            angles in degrees, images in px: the unit is in every field name. Frames: con (connector: fiducials, targets,
            interface pivots, views; LPS), flange, tcp. T_ab maps coordinates in b to coordinates in a. Tolerances are half-
            widths. Unknown fields, NaN and infinities are refused.
        design_sha256 (str | Unset): Instead of `design`: the SHA-256 of one that was sent whole before (`design_sha256`
            of its answer). 404 `unknown-design` where it is no longer kept.
        patch (DesignPatch | Unset): What differs from a design: a JSON merge patch (RFC 7396). Objects are merged, null
            removes a field, lists are replaced whole.
        levels (list[InstallationLevel] | None | Unset): Fixed installation errors beside the design as it is; absent: 1
            deg, 2 mm and 2 deg, 5 mm.
        error (StudyCouplingRequestError | Unset): Which error. Default: 'tcp'.
        trials (int | None | Unset): Trials of each case; absent: 262144, fewer with many targets.
        seed (int | Unset): Seed of every case. Default: 0.
    """

    design: Design | Unset = UNSET
    design_sha256: str | Unset = UNSET
    patch: DesignPatch | Unset = UNSET
    levels: list[InstallationLevel] | None | Unset = UNSET
    error: StudyCouplingRequestError | Unset = "tcp"
    trials: int | None | Unset = UNSET
    seed: int | Unset = 0

    def to_dict(self) -> dict[str, Any]:
        from ..models.design import Design  # noqa: PLC0415
        from ..models.design_patch import DesignPatch  # noqa: PLC0415
        from ..models.installation_level import InstallationLevel  # noqa: PLC0415

        design: dict[str, Any] | Unset = UNSET
        if not isinstance(self.design, Unset):
            design = self.design.to_dict()

        design_sha256 = self.design_sha256

        patch: dict[str, Any] | Unset = UNSET
        if not isinstance(self.patch, Unset):
            patch = self.patch.to_dict()

        levels: list[dict[str, Any]] | None | Unset
        if isinstance(self.levels, Unset):
            levels = UNSET
        elif isinstance(self.levels, list):
            levels = []
            for levels_type_0_item_data in self.levels:
                levels_type_0_item = levels_type_0_item_data.to_dict()
                levels.append(levels_type_0_item)

        else:
            levels = self.levels

        error: str | Unset = UNSET
        if not isinstance(self.error, Unset):
            error = self.error

        trials: int | None | Unset
        if isinstance(self.trials, Unset):
            trials = UNSET
        else:
            trials = self.trials

        seed = self.seed

        field_dict: dict[str, Any] = {}

        field_dict.update({})
        if design is not UNSET:
            field_dict["design"] = design
        if design_sha256 is not UNSET:
            field_dict["design_sha256"] = design_sha256
        if patch is not UNSET:
            field_dict["patch"] = patch
        if levels is not UNSET:
            field_dict["levels"] = levels
        if error is not UNSET:
            field_dict["error"] = error
        if trials is not UNSET:
            field_dict["trials"] = trials
        if seed is not UNSET:
            field_dict["seed"] = seed

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.design import Design  # noqa: PLC0415
        from ..models.design_patch import DesignPatch  # noqa: PLC0415
        from ..models.installation_level import InstallationLevel  # noqa: PLC0415

        d = dict(src_dict)
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

        def _parse_levels(data: object) -> list[InstallationLevel] | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                levels_type_0 = []
                _levels_type_0 = data
                for levels_type_0_item_data in _levels_type_0:
                    levels_type_0_item = InstallationLevel.from_dict(levels_type_0_item_data)

                    levels_type_0.append(levels_type_0_item)

                return levels_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[InstallationLevel] | None | Unset, data)

        levels = _parse_levels(d.pop("levels", UNSET))

        _error = d.pop("error", UNSET)
        error: StudyCouplingRequestError | Unset
        if isinstance(_error, Unset):
            error = UNSET
        else:
            error = check_study_coupling_request_error(_error)

        def _parse_trials(data: object) -> int | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            return cast(int | None | Unset, data)

        trials = _parse_trials(d.pop("trials", UNSET))

        seed = d.pop("seed", UNSET)

        study_coupling_request = cls(
            design=design,
            design_sha256=design_sha256,
            patch=patch,
            levels=levels,
            error=error,
            trials=trials,
            seed=seed,
        )

        return study_coupling_request

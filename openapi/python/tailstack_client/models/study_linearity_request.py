from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.study_linearity_request_error import check_study_linearity_request_error
from ..models.study_linearity_request_error import StudyLinearityRequestError
from ..types import UNSET, Unset
from typing import cast

if TYPE_CHECKING:
    from ..models.design import Design
    from ..models.design_patch import DesignPatch


T = TypeVar("T", bound="StudyLinearityRequest")


@_attrs_define
class StudyLinearityRequest:
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
        noises_px (list[float] | None | Unset): Noise of every image coordinate, px; absent: 0.3, 1, 3, 10.
        rotations_deg (list[float] | None | Unset): Standard deviation of each rotation of the structure's mount, deg,
            normal; absent: 0, 1, 5.
        spreads (list[float] | None | Unset): Factors on the layout about its centroid; absent: 1, 0.5, 0.2.
        counts (list[int] | None | Unset): Numbers of fiducials kept, far apart; absent: all, two thirds, 7.
        target (None | str | Unset): Name of the target; absent: the one with the largest P95.
        error (StudyLinearityRequestError | Unset): Which error. Default: 'tcp'.
        trials (int | Unset): Trials of each point. Default: 16384.
        seed (int | Unset): Seed of every point. Default: 0.
    """

    design: Design | Unset = UNSET
    design_sha256: str | Unset = UNSET
    patch: DesignPatch | Unset = UNSET
    noises_px: list[float] | None | Unset = UNSET
    rotations_deg: list[float] | None | Unset = UNSET
    spreads: list[float] | None | Unset = UNSET
    counts: list[int] | None | Unset = UNSET
    target: None | str | Unset = UNSET
    error: StudyLinearityRequestError | Unset = "tcp"
    trials: int | Unset = 16384
    seed: int | Unset = 0

    def to_dict(self) -> dict[str, Any]:
        from ..models.design import Design  # noqa: PLC0415
        from ..models.design_patch import DesignPatch  # noqa: PLC0415

        design: dict[str, Any] | Unset = UNSET
        if not isinstance(self.design, Unset):
            design = self.design.to_dict()

        design_sha256 = self.design_sha256

        patch: dict[str, Any] | Unset = UNSET
        if not isinstance(self.patch, Unset):
            patch = self.patch.to_dict()

        noises_px: list[float] | None | Unset
        if isinstance(self.noises_px, Unset):
            noises_px = UNSET
        elif isinstance(self.noises_px, list):
            noises_px = self.noises_px

        else:
            noises_px = self.noises_px

        rotations_deg: list[float] | None | Unset
        if isinstance(self.rotations_deg, Unset):
            rotations_deg = UNSET
        elif isinstance(self.rotations_deg, list):
            rotations_deg = self.rotations_deg

        else:
            rotations_deg = self.rotations_deg

        spreads: list[float] | None | Unset
        if isinstance(self.spreads, Unset):
            spreads = UNSET
        elif isinstance(self.spreads, list):
            spreads = self.spreads

        else:
            spreads = self.spreads

        counts: list[int] | None | Unset
        if isinstance(self.counts, Unset):
            counts = UNSET
        elif isinstance(self.counts, list):
            counts = self.counts

        else:
            counts = self.counts

        target: None | str | Unset
        if isinstance(self.target, Unset):
            target = UNSET
        else:
            target = self.target

        error: str | Unset = UNSET
        if not isinstance(self.error, Unset):
            error = self.error

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
        if noises_px is not UNSET:
            field_dict["noises_px"] = noises_px
        if rotations_deg is not UNSET:
            field_dict["rotations_deg"] = rotations_deg
        if spreads is not UNSET:
            field_dict["spreads"] = spreads
        if counts is not UNSET:
            field_dict["counts"] = counts
        if target is not UNSET:
            field_dict["target"] = target
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

        def _parse_noises_px(data: object) -> list[float] | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                noises_px_type_0 = cast(list[float], data)

                return noises_px_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None | Unset, data)

        noises_px = _parse_noises_px(d.pop("noises_px", UNSET))

        def _parse_rotations_deg(data: object) -> list[float] | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                rotations_deg_type_0 = cast(list[float], data)

                return rotations_deg_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None | Unset, data)

        rotations_deg = _parse_rotations_deg(d.pop("rotations_deg", UNSET))

        def _parse_spreads(data: object) -> list[float] | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                spreads_type_0 = cast(list[float], data)

                return spreads_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None | Unset, data)

        spreads = _parse_spreads(d.pop("spreads", UNSET))

        def _parse_counts(data: object) -> list[int] | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                counts_type_0 = cast(list[int], data)

                return counts_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[int] | None | Unset, data)

        counts = _parse_counts(d.pop("counts", UNSET))

        def _parse_target(data: object) -> None | str | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            return cast(None | str | Unset, data)

        target = _parse_target(d.pop("target", UNSET))

        _error = d.pop("error", UNSET)
        error: StudyLinearityRequestError | Unset
        if isinstance(_error, Unset):
            error = UNSET
        else:
            error = check_study_linearity_request_error(_error)

        trials = d.pop("trials", UNSET)

        seed = d.pop("seed", UNSET)

        study_linearity_request = cls(
            design=design,
            design_sha256=design_sha256,
            patch=patch,
            noises_px=noises_px,
            rotations_deg=rotations_deg,
            spreads=spreads,
            counts=counts,
            target=target,
            error=error,
            trials=trials,
            seed=seed,
        )

        return study_linearity_request

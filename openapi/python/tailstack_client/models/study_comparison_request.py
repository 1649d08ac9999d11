from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.study_comparison_request_error import check_study_comparison_request_error
from ..models.study_comparison_request_error import StudyComparisonRequestError
from ..types import UNSET, Unset
from typing import cast

if TYPE_CHECKING:
    from ..models.design import Design
    from ..models.design_patch import DesignPatch


T = TypeVar("T", bound="StudyComparisonRequest")


@_attrs_define
class StudyComparisonRequest:
    """
    Attributes:
        measurements (str): The measurements, as CSV whose header names quantity and unit (docs/studies.md).
        design (Design | Unset): A reference structure on a robot, seen by two or more X-ray views. Lengths in mm,
            angles in degrees, images in px: the unit is in every field name. Frames: con (connector: fiducials, targets,
            interface pivots, views; LPS), flange, tcp. T_ab maps coordinates in b to coordinates in a. Tolerances are half-
            widths. Unknown fields, NaN and infinities are refused.
        design_sha256 (str | Unset): Instead of `design`: the SHA-256 of one that was sent whole before (`design_sha256`
            of its answer). 404 `unknown-design` where it is no longer kept.
        patch (DesignPatch | Unset): What differs from a design: a JSON merge patch (RFC 7396). Objects are merged, null
            removes a field, lists are replaced whole.
        name (str | Unset): What the record calls the measurements. Default: 'measurements.csv'.
        error (StudyComparisonRequestError | Unset): Which error was measured. Default: 'tcp'.
        instrument_sd_mm (float | Unset): Standard deviation of the measuring instrument, mm per coordinate; 0: taken as
            exact. Default: 0.0.
        seed (int | Unset): Seed of the prediction. Default: 0.
    """

    measurements: str
    design: Design | Unset = UNSET
    design_sha256: str | Unset = UNSET
    patch: DesignPatch | Unset = UNSET
    name: str | Unset = "measurements.csv"
    error: StudyComparisonRequestError | Unset = "tcp"
    instrument_sd_mm: float | Unset = 0.0
    seed: int | Unset = 0

    def to_dict(self) -> dict[str, Any]:
        from ..models.design import Design  # noqa: PLC0415
        from ..models.design_patch import DesignPatch  # noqa: PLC0415

        measurements = self.measurements

        design: dict[str, Any] | Unset = UNSET
        if not isinstance(self.design, Unset):
            design = self.design.to_dict()

        design_sha256 = self.design_sha256

        patch: dict[str, Any] | Unset = UNSET
        if not isinstance(self.patch, Unset):
            patch = self.patch.to_dict()

        name = self.name

        error: str | Unset = UNSET
        if not isinstance(self.error, Unset):
            error = self.error

        instrument_sd_mm = self.instrument_sd_mm

        seed = self.seed

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "measurements": measurements,
            }
        )
        if design is not UNSET:
            field_dict["design"] = design
        if design_sha256 is not UNSET:
            field_dict["design_sha256"] = design_sha256
        if patch is not UNSET:
            field_dict["patch"] = patch
        if name is not UNSET:
            field_dict["name"] = name
        if error is not UNSET:
            field_dict["error"] = error
        if instrument_sd_mm is not UNSET:
            field_dict["instrument_sd_mm"] = instrument_sd_mm
        if seed is not UNSET:
            field_dict["seed"] = seed

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.design import Design  # noqa: PLC0415
        from ..models.design_patch import DesignPatch  # noqa: PLC0415

        d = dict(src_dict)
        measurements = d.pop("measurements")

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

        name = d.pop("name", UNSET)

        _error = d.pop("error", UNSET)
        error: StudyComparisonRequestError | Unset
        if isinstance(_error, Unset):
            error = UNSET
        else:
            error = check_study_comparison_request_error(_error)

        instrument_sd_mm = d.pop("instrument_sd_mm", UNSET)

        seed = d.pop("seed", UNSET)

        study_comparison_request = cls(
            measurements=measurements,
            design=design,
            design_sha256=design_sha256,
            patch=patch,
            name=name,
            error=error,
            instrument_sd_mm=instrument_sd_mm,
            seed=seed,
        )

        return study_comparison_request

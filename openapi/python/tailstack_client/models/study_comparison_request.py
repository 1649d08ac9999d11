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


T = TypeVar("T", bound="StudyComparisonRequest")


@_attrs_define
class StudyComparisonRequest:
    """
    Attributes:
        design (Design): A reference structure on a robot, seen by two or more X-ray views. Lengths in mm, angles in
            degrees, images in px: the unit is in every field name. Frames: con (connector: fiducials, targets, interface
            pivots, views; LPS), flange, tcp. T_ab maps coordinates in b to coordinates in a. Tolerances are half-widths.
            Unknown fields, NaN and infinities are refused.
        measurements (str): The measurements, as CSV whose header names quantity and unit (docs/studies.md).
        name (str | Unset): What the record calls the measurements. Default: 'measurements.csv'.
        error (StudyComparisonRequestError | Unset): Which error was measured. Default: 'tcp'.
        instrument_sd_mm (float | Unset): Standard deviation of the measuring instrument, mm per coordinate; 0: taken as
            exact. Default: 0.0.
        seed (int | Unset): Seed of the prediction. Default: 0.
    """

    design: Design
    measurements: str
    name: str | Unset = "measurements.csv"
    error: StudyComparisonRequestError | Unset = "tcp"
    instrument_sd_mm: float | Unset = 0.0
    seed: int | Unset = 0

    def to_dict(self) -> dict[str, Any]:
        from ..models.design import Design  # noqa: PLC0415

        design = self.design.to_dict()

        measurements = self.measurements

        name = self.name

        error: str | Unset = UNSET
        if not isinstance(self.error, Unset):
            error = self.error

        instrument_sd_mm = self.instrument_sd_mm

        seed = self.seed

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "design": design,
                "measurements": measurements,
            }
        )
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

        d = dict(src_dict)
        design = Design.from_dict(d.pop("design"))

        measurements = d.pop("measurements")

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
            design=design,
            measurements=measurements,
            name=name,
            error=error,
            instrument_sd_mm=instrument_sd_mm,
            seed=seed,
        )

        return study_comparison_request

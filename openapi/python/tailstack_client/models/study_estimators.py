from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast
from typing import Literal, cast

if TYPE_CHECKING:
    from ..models.estimator_case import EstimatorCase
    from ..models.provenance import Provenance


T = TypeVar("T", bound="StudyEstimators")


@_attrs_define
class StudyEstimators:
    """The same design under each estimator.

    Attributes:
        schema (Literal['tailstack/study-estimators/1']): Name and version of this record's schema.
        focal_rel_sd (float): Standard deviation of the assumed focal length, relative, where a view of the design says
            nothing of its own.
        principal_point_px_sd (float): The same of each coordinate of the assumed principal point, px.
        trials (int): Trials of each simulation; 0: none was asked for.
        seed (int): Seed of the simulations.
        extent_mm (float): Largest distance between two fiducials of the design, mm.
        cases (list[EstimatorCase]): One of each estimator, from the one that knows nothing to the one that knows most.
        conclusions (list[str]): What they say, in sentences.
        provenance (Provenance): Which design, by which version, under which model, and what is not included.
    """

    schema: Literal["tailstack/study-estimators/1"]
    focal_rel_sd: float
    principal_point_px_sd: float
    trials: int
    seed: int
    extent_mm: float
    cases: list[EstimatorCase]
    conclusions: list[str]
    provenance: Provenance

    def to_dict(self) -> dict[str, Any]:
        from ..models.estimator_case import EstimatorCase  # noqa: PLC0415
        from ..models.provenance import Provenance  # noqa: PLC0415

        schema = self.schema

        focal_rel_sd = self.focal_rel_sd

        principal_point_px_sd = self.principal_point_px_sd

        trials = self.trials

        seed = self.seed

        extent_mm = self.extent_mm

        cases = []
        for cases_item_data in self.cases:
            cases_item = cases_item_data.to_dict()
            cases.append(cases_item)

        conclusions = self.conclusions

        provenance = self.provenance.to_dict()

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "schema": schema,
                "focal_rel_sd": focal_rel_sd,
                "principal_point_px_sd": principal_point_px_sd,
                "trials": trials,
                "seed": seed,
                "extent_mm": extent_mm,
                "cases": cases,
                "conclusions": conclusions,
                "provenance": provenance,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.estimator_case import EstimatorCase  # noqa: PLC0415
        from ..models.provenance import Provenance  # noqa: PLC0415

        d = dict(src_dict)
        schema = cast(Literal["tailstack/study-estimators/1"], d.pop("schema"))
        if schema != "tailstack/study-estimators/1":
            raise ValueError(f"schema must match const 'tailstack/study-estimators/1', got '{schema}'")

        focal_rel_sd = d.pop("focal_rel_sd")

        principal_point_px_sd = d.pop("principal_point_px_sd")

        trials = d.pop("trials")

        seed = d.pop("seed")

        extent_mm = d.pop("extent_mm")

        cases = []
        _cases = d.pop("cases")
        for cases_item_data in _cases:
            cases_item = EstimatorCase.from_dict(cases_item_data)

            cases.append(cases_item)

        conclusions = cast(list[str], d.pop("conclusions"))

        provenance = Provenance.from_dict(d.pop("provenance"))

        study_estimators = cls(
            schema=schema,
            focal_rel_sd=focal_rel_sd,
            principal_point_px_sd=principal_point_px_sd,
            trials=trials,
            seed=seed,
            extent_mm=extent_mm,
            cases=cases,
            conclusions=conclusions,
            provenance=provenance,
        )

        return study_estimators

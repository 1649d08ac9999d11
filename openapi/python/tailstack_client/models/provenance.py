from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="Provenance")


@_attrs_define
class Provenance:
    """Which design, by which version, under which model, and what is not included.

    Attributes:
        design_name (str): Name of the design.
        design_sha256 (None | str): SHA-256 of the design's canonical content, fiducials included; null where it could
            not be had.
        tailstack_version (str): Version of the solver.
        reading (str): Reading of the structure's installation error: physical (the structure moves, its images too) or
            eq18 (only the coordinates that the estimator is told).
        rotation_form (str): How small rotations act: full matrices or the small-angle form.
        triangulation (str): How the target's rays are met: normalised (linear, in the fiducials' frame), published
            (linear, in connector mm), weighted (linear, each view by how well its noise lets it know the target) or
            reprojection (least squares).
        notes (list[str]): What was done to the design's numbers on the way, and what it leaves open.
        not_included (list[str]): Errors that no number here includes.
        estimator (str): What each view is estimated as: dlt, reprojection (eleven unknowns), pose or pose_with_prior.
            Default: 'dlt'.
    """

    design_name: str
    design_sha256: None | str
    tailstack_version: str
    reading: str
    rotation_form: str
    triangulation: str
    notes: list[str]
    not_included: list[str]
    estimator: str = "dlt"

    def to_dict(self) -> dict[str, Any]:
        design_name = self.design_name

        design_sha256: None | str
        design_sha256 = self.design_sha256

        tailstack_version = self.tailstack_version

        reading = self.reading

        rotation_form = self.rotation_form

        triangulation = self.triangulation

        notes = self.notes

        not_included = self.not_included

        estimator = self.estimator

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "design_name": design_name,
                "design_sha256": design_sha256,
                "tailstack_version": tailstack_version,
                "reading": reading,
                "rotation_form": rotation_form,
                "triangulation": triangulation,
                "notes": notes,
                "not_included": not_included,
                "estimator": estimator,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        design_name = d.pop("design_name")

        def _parse_design_sha256(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        design_sha256 = _parse_design_sha256(d.pop("design_sha256"))

        tailstack_version = d.pop("tailstack_version")

        reading = d.pop("reading")

        rotation_form = d.pop("rotation_form")

        triangulation = d.pop("triangulation")

        notes = cast(list[str], d.pop("notes"))

        not_included = cast(list[str], d.pop("not_included"))

        estimator = d.pop("estimator")

        provenance = cls(
            design_name=design_name,
            design_sha256=design_sha256,
            tailstack_version=tailstack_version,
            reading=reading,
            rotation_form=rotation_form,
            triangulation=triangulation,
            notes=notes,
            not_included=not_included,
            estimator=estimator,
        )

        return provenance

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast
from typing import Literal, cast

if TYPE_CHECKING:
    from ..models.finding import Finding
    from ..models.view_check import ViewCheck


T = TypeVar("T", bound="Validation")


@_attrs_define
class Validation:
    """A design that was read and checked, and what it holds.  Nothing was computed.

    Attributes:
        schema (Literal['tailstack/validation/1']): Name and version of this record's schema.
        valid (bool): A design that is not valid is answered with a problem document.
        name (str): Name of the design.
        design_sha256 (str): SHA-256 of the design's canonical content, fiducials included.
        views (list[str]): Names of the views.
        fiducials (int): Number of fiducials.
        targets (list[str]): Names of the targets, regions expanded to their samples.
        requirements (list[str]): Names of the requirements.
        visibility (list[ViewCheck]): Visibility of the fiducials in each view.
        findings (list[Finding]): Remarks about the design's geometry.
        notes (list[str]): What was done to the design's numbers on the way, and what it leaves open.
    """

    schema: Literal["tailstack/validation/1"]
    valid: bool
    name: str
    design_sha256: str
    views: list[str]
    fiducials: int
    targets: list[str]
    requirements: list[str]
    visibility: list[ViewCheck]
    findings: list[Finding]
    notes: list[str]

    def to_dict(self) -> dict[str, Any]:
        from ..models.finding import Finding  # noqa: PLC0415
        from ..models.view_check import ViewCheck  # noqa: PLC0415

        schema = self.schema

        valid = self.valid

        name = self.name

        design_sha256 = self.design_sha256

        views = self.views

        fiducials = self.fiducials

        targets = self.targets

        requirements = self.requirements

        visibility = []
        for visibility_item_data in self.visibility:
            visibility_item = visibility_item_data.to_dict()
            visibility.append(visibility_item)

        findings = []
        for findings_item_data in self.findings:
            findings_item = findings_item_data.to_dict()
            findings.append(findings_item)

        notes = self.notes

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "schema": schema,
                "valid": valid,
                "name": name,
                "design_sha256": design_sha256,
                "views": views,
                "fiducials": fiducials,
                "targets": targets,
                "requirements": requirements,
                "visibility": visibility,
                "findings": findings,
                "notes": notes,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.finding import Finding  # noqa: PLC0415
        from ..models.view_check import ViewCheck  # noqa: PLC0415

        d = dict(src_dict)
        schema = cast(Literal["tailstack/validation/1"], d.pop("schema"))
        if schema != "tailstack/validation/1":
            raise ValueError(f"schema must match const 'tailstack/validation/1', got '{schema}'")

        valid = d.pop("valid")

        name = d.pop("name")

        design_sha256 = d.pop("design_sha256")

        views = cast(list[str], d.pop("views"))

        fiducials = d.pop("fiducials")

        targets = cast(list[str], d.pop("targets"))

        requirements = cast(list[str], d.pop("requirements"))

        visibility = []
        _visibility = d.pop("visibility")
        for visibility_item_data in _visibility:
            visibility_item = ViewCheck.from_dict(visibility_item_data)

            visibility.append(visibility_item)

        findings = []
        _findings = d.pop("findings")
        for findings_item_data in _findings:
            findings_item = Finding.from_dict(findings_item_data)

            findings.append(findings_item)

        notes = cast(list[str], d.pop("notes"))

        validation = cls(
            schema=schema,
            valid=valid,
            name=name,
            design_sha256=design_sha256,
            views=views,
            fiducials=fiducials,
            targets=targets,
            requirements=requirements,
            visibility=visibility,
            findings=findings,
            notes=notes,
        )

        return validation

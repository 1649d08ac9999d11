from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.study_views_request_error import check_study_views_request_error
from ..models.study_views_request_error import StudyViewsRequestError
from ..types import UNSET, Unset
from typing import cast

if TYPE_CHECKING:
    from ..models.design import Design
    from ..models.design_patch import DesignPatch


T = TypeVar("T", bound="StudyViewsRequest")


@_attrs_define
class StudyViewsRequest:
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
        cone_deg (float | Unset): How far each view turns from where it is designed, deg. Default: 30.0.
        step_deg (float | Unset): Step of the maps, deg; at most 15 of them from the middle to the edge. Default: 10.0.
        error (StudyViewsRequestError | Unset): Which error. Default: 'tcp'.
    """

    design: Design | Unset = UNSET
    design_sha256: str | Unset = UNSET
    patch: DesignPatch | Unset = UNSET
    cone_deg: float | Unset = 30.0
    step_deg: float | Unset = 10.0
    error: StudyViewsRequestError | Unset = "tcp"

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

        cone_deg = self.cone_deg

        step_deg = self.step_deg

        error: str | Unset = UNSET
        if not isinstance(self.error, Unset):
            error = self.error

        field_dict: dict[str, Any] = {}

        field_dict.update({})
        if design is not UNSET:
            field_dict["design"] = design
        if design_sha256 is not UNSET:
            field_dict["design_sha256"] = design_sha256
        if patch is not UNSET:
            field_dict["patch"] = patch
        if cone_deg is not UNSET:
            field_dict["cone_deg"] = cone_deg
        if step_deg is not UNSET:
            field_dict["step_deg"] = step_deg
        if error is not UNSET:
            field_dict["error"] = error

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

        cone_deg = d.pop("cone_deg", UNSET)

        step_deg = d.pop("step_deg", UNSET)

        _error = d.pop("error", UNSET)
        error: StudyViewsRequestError | Unset
        if isinstance(_error, Unset):
            error = UNSET
        else:
            error = check_study_views_request_error(_error)

        study_views_request = cls(
            design=design,
            design_sha256=design_sha256,
            patch=patch,
            cone_deg=cone_deg,
            step_deg=step_deg,
            error=error,
        )

        return study_views_request

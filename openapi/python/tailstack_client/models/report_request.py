from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.report_request_parts_item import check_report_request_parts_item
from ..models.report_request_parts_item import ReportRequestPartsItem
from ..types import UNSET, Unset
from typing import cast

if TYPE_CHECKING:
    from ..models.design import Design
    from ..models.design_patch import DesignPatch


T = TypeVar("T", bound="ReportRequest")


@_attrs_define
class ReportRequest:
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
        trials (int | None | Unset): Number of trials. Either this or precision; neither: the solver's own precision.
        precision (float | None | Unset): Half-width of the confidence interval of P95, relative, at which sampling
            stops.
        seed (int | Unset): Seed; one seed is one answer, whatever workers and threads. Default: 0.
        parts (list[ReportRequestPartsItem] | Unset): What the record holds, each once; optimisation: before and after.
    """

    design: Design | Unset = UNSET
    design_sha256: str | Unset = UNSET
    patch: DesignPatch | Unset = UNSET
    trials: int | None | Unset = UNSET
    precision: float | None | Unset = UNSET
    seed: int | Unset = 0
    parts: list[ReportRequestPartsItem] | Unset = UNSET

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

        trials: int | None | Unset
        if isinstance(self.trials, Unset):
            trials = UNSET
        else:
            trials = self.trials

        precision: float | None | Unset
        if isinstance(self.precision, Unset):
            precision = UNSET
        else:
            precision = self.precision

        seed = self.seed

        parts: list[str] | Unset = UNSET
        if not isinstance(self.parts, Unset):
            parts = []
            for parts_item_data in self.parts:
                parts_item: str = parts_item_data
                parts.append(parts_item)

        field_dict: dict[str, Any] = {}

        field_dict.update({})
        if design is not UNSET:
            field_dict["design"] = design
        if design_sha256 is not UNSET:
            field_dict["design_sha256"] = design_sha256
        if patch is not UNSET:
            field_dict["patch"] = patch
        if trials is not UNSET:
            field_dict["trials"] = trials
        if precision is not UNSET:
            field_dict["precision"] = precision
        if seed is not UNSET:
            field_dict["seed"] = seed
        if parts is not UNSET:
            field_dict["parts"] = parts

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

        def _parse_trials(data: object) -> int | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            return cast(int | None | Unset, data)

        trials = _parse_trials(d.pop("trials", UNSET))

        def _parse_precision(data: object) -> float | None | Unset:
            if data is None:
                return data
            if isinstance(data, Unset):
                return data
            return cast(float | None | Unset, data)

        precision = _parse_precision(d.pop("precision", UNSET))

        seed = d.pop("seed", UNSET)

        _parts = d.pop("parts", UNSET)
        parts: list[ReportRequestPartsItem] | Unset = UNSET
        if _parts is not UNSET:
            parts = []
            for parts_item_data in _parts:
                parts_item = check_report_request_parts_item(parts_item_data)

                parts.append(parts_item)

        report_request = cls(
            design=design,
            design_sha256=design_sha256,
            patch=patch,
            trials=trials,
            precision=precision,
            seed=seed,
            parts=parts,
        )

        return report_request

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.batch_request_columns_item import BatchRequestColumnsItem
from ..models.batch_request_columns_item import check_batch_request_columns_item
from ..types import UNSET, Unset
from typing import cast

if TYPE_CHECKING:
    from ..models.batch_request_table import BatchRequestTable
    from ..models.design import Design
    from ..models.design_patch import DesignPatch


T = TypeVar("T", bound="BatchRequest")


@_attrs_define
class BatchRequest:
    """
    Attributes:
        table (BatchRequestTable): Columns by the number of the design that they give, in the unit of its field: a JSON
            pointer, /views/0/fiducial_noise_px, or a path of names, views.AP.fiducial_noise_px; * stands for every element.
            All have one length.
        design (Design | Unset): A reference structure on a robot, seen by two or more X-ray views. Lengths in mm,
            angles in degrees, images in px: the unit is in every field name. Frames: con (connector: fiducials, targets,
            interface pivots, views; LPS), flange, tcp. T_ab maps coordinates in b to coordinates in a. Tolerances are half-
            widths. Unknown fields, NaN and infinities are refused.
        design_sha256 (str | Unset): Instead of `design`: the SHA-256 of one that was sent whole before (`design_sha256`
            of its answer). 404 `unknown-design` where it is no longer kept.
        patch (DesignPatch | Unset): What differs from a design: a JSON merge patch (RFC 7396). Objects are merged, null
            removes a field, lists are replaced whole.
        columns (list[BatchRequestColumnsItem] | Unset): What is wanted: p95_mm, mean_norm_mm, bias_norm_mm and
            localisation_p95_mm of each target; value_mm, the quantile that each requirement limits; within_limits (yes,
            no), whether all of these are within their limits; verdict, which also takes how far the estimate can be
            trusted, and costs more.
    """

    table: BatchRequestTable
    design: Design | Unset = UNSET
    design_sha256: str | Unset = UNSET
    patch: DesignPatch | Unset = UNSET
    columns: list[BatchRequestColumnsItem] | Unset = UNSET

    def to_dict(self) -> dict[str, Any]:
        from ..models.batch_request_table import BatchRequestTable  # noqa: PLC0415
        from ..models.design import Design  # noqa: PLC0415
        from ..models.design_patch import DesignPatch  # noqa: PLC0415

        table = self.table.to_dict()

        design: dict[str, Any] | Unset = UNSET
        if not isinstance(self.design, Unset):
            design = self.design.to_dict()

        design_sha256 = self.design_sha256

        patch: dict[str, Any] | Unset = UNSET
        if not isinstance(self.patch, Unset):
            patch = self.patch.to_dict()

        columns: list[str] | Unset = UNSET
        if not isinstance(self.columns, Unset):
            columns = []
            for columns_item_data in self.columns:
                columns_item: str = columns_item_data
                columns.append(columns_item)

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "table": table,
            }
        )
        if design is not UNSET:
            field_dict["design"] = design
        if design_sha256 is not UNSET:
            field_dict["design_sha256"] = design_sha256
        if patch is not UNSET:
            field_dict["patch"] = patch
        if columns is not UNSET:
            field_dict["columns"] = columns

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.batch_request_table import BatchRequestTable  # noqa: PLC0415
        from ..models.design import Design  # noqa: PLC0415
        from ..models.design_patch import DesignPatch  # noqa: PLC0415

        d = dict(src_dict)
        table = BatchRequestTable.from_dict(d.pop("table"))

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

        _columns = d.pop("columns", UNSET)
        columns: list[BatchRequestColumnsItem] | Unset = UNSET
        if _columns is not UNSET:
            columns = []
            for columns_item_data in _columns:
                columns_item = check_batch_request_columns_item(columns_item_data)

                columns.append(columns_item)

        batch_request = cls(
            table=table,
            design=design,
            design_sha256=design_sha256,
            patch=patch,
            columns=columns,
        )

        return batch_request

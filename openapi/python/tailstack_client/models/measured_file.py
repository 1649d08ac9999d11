from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.measured_file_form import check_measured_file_form
from ..models.measured_file_form import MeasuredFileForm
from typing import cast


T = TypeVar("T", bound="MeasuredFile")


@_attrs_define
class MeasuredFile:
    """
    Attributes:
        name (str): Name of the file.
        sha256 (str): SHA-256 of its bytes, hexadecimal.
        form (MeasuredFileForm): What it holds: points, error vectors, error norms, or summary statistics.
        unit (str): Unit of the lengths in it.
        rows (int): Rows that were read.
        notes (list[str]): What was done to the numbers on the way.
    """

    name: str
    sha256: str
    form: MeasuredFileForm
    unit: str
    rows: int
    notes: list[str]

    def to_dict(self) -> dict[str, Any]:
        name = self.name

        sha256 = self.sha256

        form: str = self.form

        unit = self.unit

        rows = self.rows

        notes = self.notes

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "name": name,
                "sha256": sha256,
                "form": form,
                "unit": unit,
                "rows": rows,
                "notes": notes,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        name = d.pop("name")

        sha256 = d.pop("sha256")

        form = check_measured_file_form(d.pop("form"))

        unit = d.pop("unit")

        rows = d.pop("rows")

        notes = cast(list[str], d.pop("notes"))

        measured_file = cls(
            name=name,
            sha256=sha256,
            form=form,
            unit=unit,
            rows=rows,
            notes=notes,
        )

        return measured_file

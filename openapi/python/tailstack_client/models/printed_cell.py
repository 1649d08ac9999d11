from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.printed_cell_table import check_printed_cell_table
from ..models.printed_cell_table import PrintedCellTable
from ..models.printed_cell_unit import check_printed_cell_unit
from ..models.printed_cell_unit import PrintedCellUnit
from typing import cast


T = TypeVar("T", bound="PrintedCell")


@_attrs_define
class PrintedCell:
    """A cell as it stands in its table, beside ours, or with the reason why nothing can stand beside it.

    Attributes:
        table (PrintedCellTable): Table of the paper.
        row (str): Row of the table.
        column (str): Column of the table.
        printed (str): The cell as it is printed.
        value (float): What it says, in `unit`: S1 to S3 are read as metres; S4 as printed.
        unit (PrintedCellUnit): Unit of `value` and `ours`: mm or px.
        ours (list[float | None]): What the chain gives in each geometry, in `unit`; null where nothing can stand beside
            it.
        remark (str): Why nothing stands beside it, or why it is not compared; empty for a cell that is compared.
    """

    table: PrintedCellTable
    row: str
    column: str
    printed: str
    value: float
    unit: PrintedCellUnit
    ours: list[float | None]
    remark: str

    def to_dict(self) -> dict[str, Any]:
        table: str = self.table

        row = self.row

        column = self.column

        printed = self.printed

        value = self.value

        unit: str = self.unit

        ours = []
        for ours_item_data in self.ours:
            ours_item: float | None
            ours_item = ours_item_data
            ours.append(ours_item)

        remark = self.remark

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "table": table,
                "row": row,
                "column": column,
                "printed": printed,
                "value": value,
                "unit": unit,
                "ours": ours,
                "remark": remark,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        table = check_printed_cell_table(d.pop("table"))

        row = d.pop("row")

        column = d.pop("column")

        printed = d.pop("printed")

        value = d.pop("value")

        unit = check_printed_cell_unit(d.pop("unit"))

        ours = []
        _ours = d.pop("ours")
        for ours_item_data in _ours:

            def _parse_ours_item(data: object) -> float | None:
                if data is None:
                    return data
                return cast(float | None, data)

            ours_item = _parse_ours_item(ours_item_data)

            ours.append(ours_item)

        remark = d.pop("remark")

        printed_cell = cls(
            table=table,
            row=row,
            column=column,
            printed=printed,
            value=value,
            unit=unit,
            ours=ours,
            remark=remark,
        )

        return printed_cell

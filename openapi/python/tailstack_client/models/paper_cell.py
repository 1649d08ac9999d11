from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.paper_cell_quantity import check_paper_cell_quantity
from ..models.paper_cell_quantity import PaperCellQuantity
from ..models.paper_cell_table import check_paper_cell_table
from ..models.paper_cell_table import PaperCellTable
from typing import cast


T = TypeVar("T", bound="PaperCell")


@_attrs_define
class PaperCell:
    """One statistic under one condition: what is printed, what the full chain gives, and how far apart they may be.

    Attributes:
        table (PaperCellTable): Table of the paper.
        row (str): Row of the table.
        quantity (PaperCellQuantity): Statistic of the localisation error: mean or P95 of its norm, or a standard
            deviation along an axis of con.
        rotation_deg (float): Installation error of the structure, about each axis, deg.
        translation_mm (float): Installation error of the structure, along (1, 1, 1), mm.
        noise_px (float): Standard deviation of each image coordinate, px.
        value_mm (float): Monte Carlo on the full chain, mm.
        standard_error_mm (float): Standard error of `value_mm`, mm.
        tcp_mm (float): The same statistic of the error at the tool, sampled at the same trials, mm.
        first_order_mm (float): The same statistic to first order, mm.
        other_reading_mm (float): First order in the other reading of the installation error, mm.
        printed_mm (float | None): What is printed, mm: of the localisation error, of the tool's where the table has no
            other. Null: not printed, trivial, or this geometry is not meant to be the paper's.
        rounding_mm (float | None): Half of the last printed decimal, mm; null where nothing is printed.
        published_error_mm (float): Standard deviation of this statistic over experiments of the paper's size, mm.
        band_mm (list[float]): Where 99 % of such experiments would print it, mm.
        z (float | None): Printed less ours, in standard deviations of such experiments, our sampling and the rounding;
            null where nothing is printed.
        outside (bool | None): Whether the printed cell is outside the band; null where nothing is printed.
    """

    table: PaperCellTable
    row: str
    quantity: PaperCellQuantity
    rotation_deg: float
    translation_mm: float
    noise_px: float
    value_mm: float
    standard_error_mm: float
    tcp_mm: float
    first_order_mm: float
    other_reading_mm: float
    printed_mm: float | None
    rounding_mm: float | None
    published_error_mm: float
    band_mm: list[float]
    z: float | None
    outside: bool | None

    def to_dict(self) -> dict[str, Any]:
        table: str = self.table

        row = self.row

        quantity: str = self.quantity

        rotation_deg = self.rotation_deg

        translation_mm = self.translation_mm

        noise_px = self.noise_px

        value_mm = self.value_mm

        standard_error_mm = self.standard_error_mm

        tcp_mm = self.tcp_mm

        first_order_mm = self.first_order_mm

        other_reading_mm = self.other_reading_mm

        printed_mm: float | None
        printed_mm = self.printed_mm

        rounding_mm: float | None
        rounding_mm = self.rounding_mm

        published_error_mm = self.published_error_mm

        band_mm = []
        for band_mm_item_data in self.band_mm:
            band_mm_item: float
            band_mm_item = band_mm_item_data
            band_mm.append(band_mm_item)

        z: float | None
        z = self.z

        outside: bool | None
        outside = self.outside

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "table": table,
                "row": row,
                "quantity": quantity,
                "rotation_deg": rotation_deg,
                "translation_mm": translation_mm,
                "noise_px": noise_px,
                "value_mm": value_mm,
                "standard_error_mm": standard_error_mm,
                "tcp_mm": tcp_mm,
                "first_order_mm": first_order_mm,
                "other_reading_mm": other_reading_mm,
                "printed_mm": printed_mm,
                "rounding_mm": rounding_mm,
                "published_error_mm": published_error_mm,
                "band_mm": band_mm,
                "z": z,
                "outside": outside,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        table = check_paper_cell_table(d.pop("table"))

        row = d.pop("row")

        quantity = check_paper_cell_quantity(d.pop("quantity"))

        rotation_deg = d.pop("rotation_deg")

        translation_mm = d.pop("translation_mm")

        noise_px = d.pop("noise_px")

        value_mm = d.pop("value_mm")

        standard_error_mm = d.pop("standard_error_mm")

        tcp_mm = d.pop("tcp_mm")

        first_order_mm = d.pop("first_order_mm")

        other_reading_mm = d.pop("other_reading_mm")

        def _parse_printed_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        printed_mm = _parse_printed_mm(d.pop("printed_mm"))

        def _parse_rounding_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        rounding_mm = _parse_rounding_mm(d.pop("rounding_mm"))

        published_error_mm = d.pop("published_error_mm")

        band_mm = []
        _band_mm = d.pop("band_mm")
        for band_mm_item_data in _band_mm:

            def _parse_band_mm_item(data: object) -> float:
                return cast(float, data)

            band_mm_item = _parse_band_mm_item(band_mm_item_data)

            band_mm.append(band_mm_item)

        def _parse_z(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        z = _parse_z(d.pop("z"))

        def _parse_outside(data: object) -> bool | None:
            if data is None:
                return data
            return cast(bool | None, data)

        outside = _parse_outside(d.pop("outside"))

        paper_cell = cls(
            table=table,
            row=row,
            quantity=quantity,
            rotation_deg=rotation_deg,
            translation_mm=translation_mm,
            noise_px=noise_px,
            value_mm=value_mm,
            standard_error_mm=standard_error_mm,
            tcp_mm=tcp_mm,
            first_order_mm=first_order_mm,
            other_reading_mm=other_reading_mm,
            printed_mm=printed_mm,
            rounding_mm=rounding_mm,
            published_error_mm=published_error_mm,
            band_mm=band_mm,
            z=z,
            outside=outside,
        )

        return paper_cell

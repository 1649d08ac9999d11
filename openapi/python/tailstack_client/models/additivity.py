from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="Additivity")


@_attrs_define
class Additivity:
    """A cell of S2 against its parts: installation error alone and noise alone.

    Attributes:
        row (str): Row of S2.
        joint_mm (float): P95 of installation error and noise together, mm.
        first_order_mm (float): The same to first order, mm.
        bias_mm (float): Of the installation error alone, mm.
        noise_mm (float): Of the noise alone, mm.
        quadrature_mm (float): Root of the sum of squares of the two, mm.
        sum_mm (float): Sum of the two, mm.
        printed_joint_mm (float | None): What is printed for both together, mm; null where nothing is.
        printed_quadrature_mm (float | None): Root of the sum of squares of the printed parts, mm; null where nothing is
            printed.
    """

    row: str
    joint_mm: float
    first_order_mm: float
    bias_mm: float
    noise_mm: float
    quadrature_mm: float
    sum_mm: float
    printed_joint_mm: float | None
    printed_quadrature_mm: float | None

    def to_dict(self) -> dict[str, Any]:
        row = self.row

        joint_mm = self.joint_mm

        first_order_mm = self.first_order_mm

        bias_mm = self.bias_mm

        noise_mm = self.noise_mm

        quadrature_mm = self.quadrature_mm

        sum_mm = self.sum_mm

        printed_joint_mm: float | None
        printed_joint_mm = self.printed_joint_mm

        printed_quadrature_mm: float | None
        printed_quadrature_mm = self.printed_quadrature_mm

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "row": row,
                "joint_mm": joint_mm,
                "first_order_mm": first_order_mm,
                "bias_mm": bias_mm,
                "noise_mm": noise_mm,
                "quadrature_mm": quadrature_mm,
                "sum_mm": sum_mm,
                "printed_joint_mm": printed_joint_mm,
                "printed_quadrature_mm": printed_quadrature_mm,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        row = d.pop("row")

        joint_mm = d.pop("joint_mm")

        first_order_mm = d.pop("first_order_mm")

        bias_mm = d.pop("bias_mm")

        noise_mm = d.pop("noise_mm")

        quadrature_mm = d.pop("quadrature_mm")

        sum_mm = d.pop("sum_mm")

        def _parse_printed_joint_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        printed_joint_mm = _parse_printed_joint_mm(d.pop("printed_joint_mm"))

        def _parse_printed_quadrature_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        printed_quadrature_mm = _parse_printed_quadrature_mm(d.pop("printed_quadrature_mm"))

        additivity = cls(
            row=row,
            joint_mm=joint_mm,
            first_order_mm=first_order_mm,
            bias_mm=bias_mm,
            noise_mm=noise_mm,
            quadrature_mm=quadrature_mm,
            sum_mm=sum_mm,
            printed_joint_mm=printed_joint_mm,
            printed_quadrature_mm=printed_quadrature_mm,
        )

        return additivity

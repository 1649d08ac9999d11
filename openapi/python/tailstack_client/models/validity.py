from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.validity_status import check_validity_status
from ..models.validity_status import ValidityStatus
from typing import cast


T = TypeVar("T", bound="Validity")


@_attrs_define
class Validity:
    """How far to trust the linearisation: nu and what it was calibrated to mean.

    Attributes:
        nu (float): Validity number: how large what linearising leaves out is, against what it keeps.
        status (ValidityStatus): What the number was calibrated to mean for P95.
        expected_error_percent (float | None): Largest relative error of P95 that is to be expected, %; null where first
            order is not valid.
        statement (str): The same as a sentence.
    """

    nu: float
    status: ValidityStatus
    expected_error_percent: float | None
    statement: str

    def to_dict(self) -> dict[str, Any]:
        nu = self.nu

        status: str = self.status

        expected_error_percent: float | None
        expected_error_percent = self.expected_error_percent

        statement = self.statement

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "nu": nu,
                "status": status,
                "expected_error_percent": expected_error_percent,
                "statement": statement,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        nu = d.pop("nu")

        status = check_validity_status(d.pop("status"))

        def _parse_expected_error_percent(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        expected_error_percent = _parse_expected_error_percent(d.pop("expected_error_percent"))

        statement = d.pop("statement")

        validity = cls(
            nu=nu,
            status=status,
            expected_error_percent=expected_error_percent,
            statement=statement,
        )

        return validity

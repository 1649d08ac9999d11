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
        nu_depth (float): Standard deviation of the relative error of the target's depth, the largest over the views; nu
            is the largest of four such numbers.
        nu_crossing (float): The same of the firmness with which the rays cross.
        nu_disagreement (float): What the views' disagreement moves the point by, over what first order does: standard
            deviations.
        nu_gap (float): The smallest singular value of the rows of triangulation, which noise makes, over the next one.
        layout_class (str): What decides whether the thresholds were calibrated for a design: views, fiducials, form of
            triangulation.
        calibrated (bool): Whether they were. If not, first order is not valid, and only Monte Carlo decides a limit.
    """

    nu: float
    status: ValidityStatus
    expected_error_percent: float | None
    statement: str
    nu_depth: float
    nu_crossing: float
    nu_disagreement: float
    nu_gap: float
    layout_class: str
    calibrated: bool

    def to_dict(self) -> dict[str, Any]:
        nu = self.nu

        status: str = self.status

        expected_error_percent: float | None
        expected_error_percent = self.expected_error_percent

        statement = self.statement

        nu_depth = self.nu_depth

        nu_crossing = self.nu_crossing

        nu_disagreement = self.nu_disagreement

        nu_gap = self.nu_gap

        layout_class = self.layout_class

        calibrated = self.calibrated

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "nu": nu,
                "status": status,
                "expected_error_percent": expected_error_percent,
                "statement": statement,
                "nu_depth": nu_depth,
                "nu_crossing": nu_crossing,
                "nu_disagreement": nu_disagreement,
                "nu_gap": nu_gap,
                "layout_class": layout_class,
                "calibrated": calibrated,
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

        nu_depth = d.pop("nu_depth")

        nu_crossing = d.pop("nu_crossing")

        nu_disagreement = d.pop("nu_disagreement")

        nu_gap = d.pop("nu_gap")

        layout_class = d.pop("layout_class")

        calibrated = d.pop("calibrated")

        validity = cls(
            nu=nu,
            status=status,
            expected_error_percent=expected_error_percent,
            statement=statement,
            nu_depth=nu_depth,
            nu_crossing=nu_crossing,
            nu_disagreement=nu_disagreement,
            nu_gap=nu_gap,
            layout_class=layout_class,
            calibrated=calibrated,
        )

        return validity

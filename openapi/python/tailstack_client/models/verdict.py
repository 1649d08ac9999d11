from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.verdict_status import check_verdict_status
from ..models.verdict_status import VerdictStatus
from typing import cast

if TYPE_CHECKING:
    from ..models.check import Check
    from ..models.finding import Finding


T = TypeVar("T", bound="Verdict")


@_attrs_define
class Verdict:
    """``pass`` only when the upper end of every check's interval is within its limit.

    Attributes:
        status (VerdictStatus): Of all checks together: the worst of them. No requirement: nothing was to be held.
        basis (str): What the checks rest on: first order or Monte Carlo.
        checks (list[Check]): Every requirement at every target that it names.
        findings (list[Finding]): Remarks about the design, requirements that are not held among them.
    """

    status: VerdictStatus
    basis: str
    checks: list[Check]
    findings: list[Finding]

    def to_dict(self) -> dict[str, Any]:
        from ..models.check import Check  # noqa: PLC0415
        from ..models.finding import Finding  # noqa: PLC0415

        status: str = self.status

        basis = self.basis

        checks = []
        for checks_item_data in self.checks:
            checks_item = checks_item_data.to_dict()
            checks.append(checks_item)

        findings = []
        for findings_item_data in self.findings:
            findings_item = findings_item_data.to_dict()
            findings.append(findings_item)

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "status": status,
                "basis": basis,
                "checks": checks,
                "findings": findings,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.check import Check  # noqa: PLC0415
        from ..models.finding import Finding  # noqa: PLC0415

        d = dict(src_dict)
        status = check_verdict_status(d.pop("status"))

        basis = d.pop("basis")

        checks = []
        _checks = d.pop("checks")
        for checks_item_data in _checks:
            checks_item = Check.from_dict(checks_item_data)

            checks.append(checks_item)

        findings = []
        _findings = d.pop("findings")
        for findings_item_data in _findings:
            findings_item = Finding.from_dict(findings_item_data)

            findings.append(findings_item)

        verdict = cls(
            status=status,
            basis=basis,
            checks=checks,
            findings=findings,
        )

        return verdict

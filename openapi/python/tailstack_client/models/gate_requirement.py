from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.gate_requirement_error import check_gate_requirement_error
from ..models.gate_requirement_error import GateRequirementError
from ..models.gate_requirement_origin import check_gate_requirement_origin
from ..models.gate_requirement_origin import GateRequirementOrigin
from ..models.gate_requirement_severity import check_gate_requirement_severity
from ..models.gate_requirement_severity import GateRequirementSeverity
from typing import cast


T = TypeVar("T", bound="GateRequirement")


@_attrs_define
class GateRequirement:
    """What a design was asked for, by itself or by the policy: what a later gate must not ask less than.

    Attributes:
        name (str): Name of the requirement; of a limit that the policy sets, the rule's id.
        origin (GateRequirementOrigin): Who asks: the design or the policy.
        rule (str): Rule under which it is judged.
        severity (GateRequirementSeverity): Severity of that rule for this design.
        error (GateRequirementError): Error that is limited: tcp (at the tool) or localisation (of the target).
        quantile (float): Quantile of the error's norm, 0.95 for P95; of cvar, where the tail begins.
        limit_mm (float): The limit, mm.
        min_yield (float | None): Fraction of units that must keep it; null: the risk is pooled.
        confidence (float): Confidence with which it is judged, 0 to 1.
        targets (list[str]): Targets that it is about.
    """

    name: str
    origin: GateRequirementOrigin
    rule: str
    severity: GateRequirementSeverity
    error: GateRequirementError
    quantile: float
    limit_mm: float
    min_yield: float | None
    confidence: float
    targets: list[str]

    def to_dict(self) -> dict[str, Any]:
        name = self.name

        origin: str = self.origin

        rule = self.rule

        severity: str = self.severity

        error: str = self.error

        quantile = self.quantile

        limit_mm = self.limit_mm

        min_yield: float | None
        min_yield = self.min_yield

        confidence = self.confidence

        targets = self.targets

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "name": name,
                "origin": origin,
                "rule": rule,
                "severity": severity,
                "error": error,
                "quantile": quantile,
                "limit_mm": limit_mm,
                "min_yield": min_yield,
                "confidence": confidence,
                "targets": targets,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        name = d.pop("name")

        origin = check_gate_requirement_origin(d.pop("origin"))

        rule = d.pop("rule")

        severity = check_gate_requirement_severity(d.pop("severity"))

        error = check_gate_requirement_error(d.pop("error"))

        quantile = d.pop("quantile")

        limit_mm = d.pop("limit_mm")

        def _parse_min_yield(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        min_yield = _parse_min_yield(d.pop("min_yield"))

        confidence = d.pop("confidence")

        targets = cast(list[str], d.pop("targets"))

        gate_requirement = cls(
            name=name,
            origin=origin,
            rule=rule,
            severity=severity,
            error=error,
            quantile=quantile,
            limit_mm=limit_mm,
            min_yield=min_yield,
            confidence=confidence,
            targets=targets,
        )

        return gate_requirement

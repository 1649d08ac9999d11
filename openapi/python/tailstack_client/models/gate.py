from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.gate_fail_level import check_gate_fail_level
from ..models.gate_fail_level import GateFailLevel
from ..models.gate_mode import check_gate_mode
from ..models.gate_mode import GateMode
from ..models.gate_on_inconclusive_type_0 import check_gate_on_inconclusive_type_0
from ..models.gate_on_inconclusive_type_0 import GateOnInconclusiveType0
from ..models.gate_verdict import check_gate_verdict
from ..models.gate_verdict import GateVerdict
from typing import cast
from typing import Literal, cast

if TYPE_CHECKING:
    from ..models.gate_finding import GateFinding
    from ..models.gate_provenance import GateProvenance
    from ..models.gated_design import GatedDesign


T = TypeVar("T", bound="Gate")


@_attrs_define
class Gate:
    """Designs held to a policy.

    Attributes:
        schema (Literal['tailstack/gate/1']): Name and version of this record's schema.
        verdict (GateVerdict): The worst verdict of all designs.
        exit_code (int): Exit code of the command: 0 pass, 1 fail, 2 bad input, 3 not evaluated, 4 inconclusive, 130
            interrupted.
        mode (GateMode): analytic: first order; verify: Monte Carlo; auto: Monte Carlo where first order cannot decide.
        seed (int): Seed of the checks.
        fail_level (GateFailLevel): Severity from which a finding fails the gate.
        on_inconclusive (GateOnInconclusiveType0 | None): How inconclusive is counted: fail or warn; null: as it is.
        max_regression_percent (float | None): What P95 at a target may rise by against the baseline, %; null: nothing
            was asked for.
        findings (list[GateFinding]): Remarks, at the places of the offending values.
        designs (list[GatedDesign]): The designs and the numbers that were judged.
        provenance (GateProvenance): What decided, besides the designs.
    """

    schema: Literal["tailstack/gate/1"]
    verdict: GateVerdict
    exit_code: int
    mode: GateMode
    seed: int
    fail_level: GateFailLevel
    on_inconclusive: GateOnInconclusiveType0 | None
    max_regression_percent: float | None
    findings: list[GateFinding]
    designs: list[GatedDesign]
    provenance: GateProvenance

    def to_dict(self) -> dict[str, Any]:
        from ..models.gate_finding import GateFinding  # noqa: PLC0415
        from ..models.gate_provenance import GateProvenance  # noqa: PLC0415
        from ..models.gated_design import GatedDesign  # noqa: PLC0415

        schema = self.schema

        verdict: str = self.verdict

        exit_code = self.exit_code

        mode: str = self.mode

        seed = self.seed

        fail_level: str = self.fail_level

        on_inconclusive: None | str
        if isinstance(self.on_inconclusive, str):
            on_inconclusive = self.on_inconclusive
        else:
            on_inconclusive = self.on_inconclusive

        max_regression_percent: float | None
        max_regression_percent = self.max_regression_percent

        findings = []
        for findings_item_data in self.findings:
            findings_item = findings_item_data.to_dict()
            findings.append(findings_item)

        designs = []
        for designs_item_data in self.designs:
            designs_item = designs_item_data.to_dict()
            designs.append(designs_item)

        provenance = self.provenance.to_dict()

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "schema": schema,
                "verdict": verdict,
                "exit_code": exit_code,
                "mode": mode,
                "seed": seed,
                "fail_level": fail_level,
                "on_inconclusive": on_inconclusive,
                "max_regression_percent": max_regression_percent,
                "findings": findings,
                "designs": designs,
                "provenance": provenance,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.gate_finding import GateFinding  # noqa: PLC0415
        from ..models.gate_provenance import GateProvenance  # noqa: PLC0415
        from ..models.gated_design import GatedDesign  # noqa: PLC0415

        d = dict(src_dict)
        schema = cast(Literal["tailstack/gate/1"], d.pop("schema"))
        if schema != "tailstack/gate/1":
            raise ValueError(f"schema must match const 'tailstack/gate/1', got '{schema}'")

        verdict = check_gate_verdict(d.pop("verdict"))

        exit_code = d.pop("exit_code")

        mode = check_gate_mode(d.pop("mode"))

        seed = d.pop("seed")

        fail_level = check_gate_fail_level(d.pop("fail_level"))

        def _parse_on_inconclusive(data: object) -> GateOnInconclusiveType0 | None:
            if data is None:
                return data
            try:
                if not isinstance(data, str):
                    raise TypeError()
                on_inconclusive_type_0 = check_gate_on_inconclusive_type_0(data)

                return on_inconclusive_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(GateOnInconclusiveType0 | None, data)

        on_inconclusive = _parse_on_inconclusive(d.pop("on_inconclusive"))

        def _parse_max_regression_percent(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        max_regression_percent = _parse_max_regression_percent(d.pop("max_regression_percent"))

        findings = []
        _findings = d.pop("findings")
        for findings_item_data in _findings:
            findings_item = GateFinding.from_dict(findings_item_data)

            findings.append(findings_item)

        designs = []
        _designs = d.pop("designs")
        for designs_item_data in _designs:
            designs_item = GatedDesign.from_dict(designs_item_data)

            designs.append(designs_item)

        provenance = GateProvenance.from_dict(d.pop("provenance"))

        gate = cls(
            schema=schema,
            verdict=verdict,
            exit_code=exit_code,
            mode=mode,
            seed=seed,
            fail_level=fail_level,
            on_inconclusive=on_inconclusive,
            max_regression_percent=max_regression_percent,
            findings=findings,
            designs=designs,
            provenance=provenance,
        )

        return gate

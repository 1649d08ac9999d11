from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.gated_design_basis import check_gated_design_basis
from ..models.gated_design_basis import GatedDesignBasis
from ..models.gated_design_verdict import check_gated_design_verdict
from ..models.gated_design_verdict import GatedDesignVerdict
from typing import cast

if TYPE_CHECKING:
    from ..models.gate_number import GateNumber
    from ..models.gate_requirement import GateRequirement
    from ..models.gate_section import GateSection
    from ..models.gate_target import GateTarget
    from ..models.unjudged import Unjudged


T = TypeVar("T", bound="GatedDesign")


@_attrs_define
class GatedDesign:
    """One design and the numbers that were judged.

    Attributes:
        file (str): Name given with the design.
        name (None | str): Name of the design; null: the document could not be read.
        sha256 (None | str): SHA-256 of the design's canonical content; null: the document could not be read.
        design_class (None | str): Class of the policy whose rules applied; null: the general ones.
        verdict (GatedDesignVerdict): Verdict on this design.
        basis (GatedDesignBasis): What it rests on.
        trials (int | None): Trials that were drawn; null: first order.
        targets (list[GateTarget]): The error at each target: what a later gate compares with.
        numbers (list[GateNumber]): Every number that was held against a limit.
        requirements (list[GateRequirement]): What was asked for, judged or not; empty in records of earlier versions.
        not_judged (list[Unjudged]): What was asked for, or targets, that nothing was held against.
        sections (list[GateSection]): Sections of the document by their content: how a design is found again in a
            baseline.
    """

    file: str
    name: None | str
    sha256: None | str
    design_class: None | str
    verdict: GatedDesignVerdict
    basis: GatedDesignBasis
    trials: int | None
    targets: list[GateTarget]
    numbers: list[GateNumber]
    requirements: list[GateRequirement]
    not_judged: list[Unjudged]
    sections: list[GateSection]

    def to_dict(self) -> dict[str, Any]:
        from ..models.gate_number import GateNumber  # noqa: PLC0415
        from ..models.gate_requirement import GateRequirement  # noqa: PLC0415
        from ..models.gate_section import GateSection  # noqa: PLC0415
        from ..models.gate_target import GateTarget  # noqa: PLC0415
        from ..models.unjudged import Unjudged  # noqa: PLC0415

        file = self.file

        name: None | str
        name = self.name

        sha256: None | str
        sha256 = self.sha256

        design_class: None | str
        design_class = self.design_class

        verdict: str = self.verdict

        basis: str = self.basis

        trials: int | None
        trials = self.trials

        targets = []
        for targets_item_data in self.targets:
            targets_item = targets_item_data.to_dict()
            targets.append(targets_item)

        numbers = []
        for numbers_item_data in self.numbers:
            numbers_item = numbers_item_data.to_dict()
            numbers.append(numbers_item)

        requirements = []
        for requirements_item_data in self.requirements:
            requirements_item = requirements_item_data.to_dict()
            requirements.append(requirements_item)

        not_judged = []
        for not_judged_item_data in self.not_judged:
            not_judged_item = not_judged_item_data.to_dict()
            not_judged.append(not_judged_item)

        sections = []
        for sections_item_data in self.sections:
            sections_item = sections_item_data.to_dict()
            sections.append(sections_item)

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "file": file,
                "name": name,
                "sha256": sha256,
                "design_class": design_class,
                "verdict": verdict,
                "basis": basis,
                "trials": trials,
                "targets": targets,
                "numbers": numbers,
                "requirements": requirements,
                "not_judged": not_judged,
                "sections": sections,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.gate_number import GateNumber  # noqa: PLC0415
        from ..models.gate_requirement import GateRequirement  # noqa: PLC0415
        from ..models.gate_section import GateSection  # noqa: PLC0415
        from ..models.gate_target import GateTarget  # noqa: PLC0415
        from ..models.unjudged import Unjudged  # noqa: PLC0415

        d = dict(src_dict)
        file = d.pop("file")

        def _parse_name(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        name = _parse_name(d.pop("name"))

        def _parse_sha256(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        sha256 = _parse_sha256(d.pop("sha256"))

        def _parse_design_class(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        design_class = _parse_design_class(d.pop("design_class"))

        verdict = check_gated_design_verdict(d.pop("verdict"))

        basis = check_gated_design_basis(d.pop("basis"))

        def _parse_trials(data: object) -> int | None:
            if data is None:
                return data
            return cast(int | None, data)

        trials = _parse_trials(d.pop("trials"))

        targets = []
        _targets = d.pop("targets")
        for targets_item_data in _targets:
            targets_item = GateTarget.from_dict(targets_item_data)

            targets.append(targets_item)

        numbers = []
        _numbers = d.pop("numbers")
        for numbers_item_data in _numbers:
            numbers_item = GateNumber.from_dict(numbers_item_data)

            numbers.append(numbers_item)

        requirements = []
        _requirements = d.pop("requirements")
        for requirements_item_data in _requirements:
            requirements_item = GateRequirement.from_dict(requirements_item_data)

            requirements.append(requirements_item)

        not_judged = []
        _not_judged = d.pop("not_judged")
        for not_judged_item_data in _not_judged:
            not_judged_item = Unjudged.from_dict(not_judged_item_data)

            not_judged.append(not_judged_item)

        sections = []
        _sections = d.pop("sections")
        for sections_item_data in _sections:
            sections_item = GateSection.from_dict(sections_item_data)

            sections.append(sections_item)

        gated_design = cls(
            file=file,
            name=name,
            sha256=sha256,
            design_class=design_class,
            verdict=verdict,
            basis=basis,
            trials=trials,
            targets=targets,
            numbers=numbers,
            requirements=requirements,
            not_judged=not_judged,
            sections=sections,
        )

        return gated_design

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.study_comparison_error import check_study_comparison_error
from ..models.study_comparison_error import StudyComparisonError
from ..models.study_comparison_verdict import check_study_comparison_verdict
from ..models.study_comparison_verdict import StudyComparisonVerdict
from typing import cast
from typing import Literal, cast

if TYPE_CHECKING:
    from ..models.explanation import Explanation
    from ..models.finding import Finding
    from ..models.level_compared import LevelCompared
    from ..models.measured_file import MeasuredFile
    from ..models.provenance import Provenance
    from ..models.validity import Validity


T = TypeVar("T", bound="StudyComparison")


@_attrs_define
class StudyComparison:
    """Bench measurements against the prediction of a design.

    Attributes:
        schema (Literal['tailstack/study-comparison/1']): Name and version of this record's schema.
        error (StudyComparisonError): Error that was measured: tcp (at the tool) or localisation (of the target).
        frame (str): Frame of vectors: con or tcp.
        file (MeasuredFile):
        seed (int): Seed of the simulated benches.
        confidence (float): Confidence of intervals and of all tests together, 0 to 1.
        instrument_sd_mm (float): Standard deviation of the instrument per coordinate, which is added to the prediction,
            mm.
        levels (list[LevelCompared]): Every level at every target.
        explanations (list[Explanation]): How large one contributor alone would have to be for the measurements to be
            plausible.
        verdict (StudyComparisonVerdict): What all tests together say.
        conclusions (list[str]): What can be said of the comparison.
        findings (list[Finding]): Remarks about design and measurements.
        validity (Validity): How far to trust the linearisation: nu and what it was calibrated to mean.
        provenance (Provenance): Which design, by which version, under which model, and what is not included.
    """

    schema: Literal["tailstack/study-comparison/1"]
    error: StudyComparisonError
    frame: str
    file: MeasuredFile
    seed: int
    confidence: float
    instrument_sd_mm: float
    levels: list[LevelCompared]
    explanations: list[Explanation]
    verdict: StudyComparisonVerdict
    conclusions: list[str]
    findings: list[Finding]
    validity: Validity
    provenance: Provenance

    def to_dict(self) -> dict[str, Any]:
        from ..models.explanation import Explanation  # noqa: PLC0415
        from ..models.finding import Finding  # noqa: PLC0415
        from ..models.level_compared import LevelCompared  # noqa: PLC0415
        from ..models.measured_file import MeasuredFile  # noqa: PLC0415
        from ..models.provenance import Provenance  # noqa: PLC0415
        from ..models.validity import Validity  # noqa: PLC0415

        schema = self.schema

        error: str = self.error

        frame = self.frame

        file = self.file.to_dict()

        seed = self.seed

        confidence = self.confidence

        instrument_sd_mm = self.instrument_sd_mm

        levels = []
        for levels_item_data in self.levels:
            levels_item = levels_item_data.to_dict()
            levels.append(levels_item)

        explanations = []
        for explanations_item_data in self.explanations:
            explanations_item = explanations_item_data.to_dict()
            explanations.append(explanations_item)

        verdict: str = self.verdict

        conclusions = self.conclusions

        findings = []
        for findings_item_data in self.findings:
            findings_item = findings_item_data.to_dict()
            findings.append(findings_item)

        validity = self.validity.to_dict()

        provenance = self.provenance.to_dict()

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "schema": schema,
                "error": error,
                "frame": frame,
                "file": file,
                "seed": seed,
                "confidence": confidence,
                "instrument_sd_mm": instrument_sd_mm,
                "levels": levels,
                "explanations": explanations,
                "verdict": verdict,
                "conclusions": conclusions,
                "findings": findings,
                "validity": validity,
                "provenance": provenance,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.explanation import Explanation  # noqa: PLC0415
        from ..models.finding import Finding  # noqa: PLC0415
        from ..models.level_compared import LevelCompared  # noqa: PLC0415
        from ..models.measured_file import MeasuredFile  # noqa: PLC0415
        from ..models.provenance import Provenance  # noqa: PLC0415
        from ..models.validity import Validity  # noqa: PLC0415

        d = dict(src_dict)
        schema = cast(Literal["tailstack/study-comparison/1"], d.pop("schema"))
        if schema != "tailstack/study-comparison/1":
            raise ValueError(f"schema must match const 'tailstack/study-comparison/1', got '{schema}'")

        error = check_study_comparison_error(d.pop("error"))

        frame = d.pop("frame")

        file = MeasuredFile.from_dict(d.pop("file"))

        seed = d.pop("seed")

        confidence = d.pop("confidence")

        instrument_sd_mm = d.pop("instrument_sd_mm")

        levels = []
        _levels = d.pop("levels")
        for levels_item_data in _levels:
            levels_item = LevelCompared.from_dict(levels_item_data)

            levels.append(levels_item)

        explanations = []
        _explanations = d.pop("explanations")
        for explanations_item_data in _explanations:
            explanations_item = Explanation.from_dict(explanations_item_data)

            explanations.append(explanations_item)

        verdict = check_study_comparison_verdict(d.pop("verdict"))

        conclusions = cast(list[str], d.pop("conclusions"))

        findings = []
        _findings = d.pop("findings")
        for findings_item_data in _findings:
            findings_item = Finding.from_dict(findings_item_data)

            findings.append(findings_item)

        validity = Validity.from_dict(d.pop("validity"))

        provenance = Provenance.from_dict(d.pop("provenance"))

        study_comparison = cls(
            schema=schema,
            error=error,
            frame=frame,
            file=file,
            seed=seed,
            confidence=confidence,
            instrument_sd_mm=instrument_sd_mm,
            levels=levels,
            explanations=explanations,
            verdict=verdict,
            conclusions=conclusions,
            findings=findings,
            validity=validity,
            provenance=provenance,
        )

        return study_comparison

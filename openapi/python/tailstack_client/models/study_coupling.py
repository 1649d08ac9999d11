from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.study_coupling_error import check_study_coupling_error
from ..models.study_coupling_error import StudyCouplingError
from typing import cast
from typing import Literal, cast

if TYPE_CHECKING:
    from ..models.coupling_case import CouplingCase
    from ..models.provenance import Provenance
    from ..models.validity import Validity


T = TypeVar("T", bound="StudyCoupling")


@_attrs_define
class StudyCoupling:
    """Is the tail of installation error and noise together more than the parts?

    Attributes:
        schema (Literal['tailstack/study-coupling/1']): Name and version of this record's schema.
        error (StudyCouplingError): Error that is studied: tcp (at the tool) or localisation (of the target).
        quantile (float): Quantile of the error's norm, 0.95 for P95.
        seed (int): Seed of the trials.
        trials (int): Trials of each case, with the same deviates in all of them.
        confidence (float): Confidence of each interval by itself, 0 to 1.
        interval_method (str): How intervals are made, in words.
        installation (str): Contributors that count as installation error.
        noise (str): Contributors that count as noise.
        cases (list[CouplingCase]): Every installation error in every reading at every target.
        conclusions (list[str]): What can be said of the cases.
        validity (Validity): How far to trust the linearisation: nu and what it was calibrated to mean.
        provenance (Provenance): Which design, by which version, under which model, and what is not included.
    """

    schema: Literal["tailstack/study-coupling/1"]
    error: StudyCouplingError
    quantile: float
    seed: int
    trials: int
    confidence: float
    interval_method: str
    installation: str
    noise: str
    cases: list[CouplingCase]
    conclusions: list[str]
    validity: Validity
    provenance: Provenance

    def to_dict(self) -> dict[str, Any]:
        from ..models.coupling_case import CouplingCase  # noqa: PLC0415
        from ..models.provenance import Provenance  # noqa: PLC0415
        from ..models.validity import Validity  # noqa: PLC0415

        schema = self.schema

        error: str = self.error

        quantile = self.quantile

        seed = self.seed

        trials = self.trials

        confidence = self.confidence

        interval_method = self.interval_method

        installation = self.installation

        noise = self.noise

        cases = []
        for cases_item_data in self.cases:
            cases_item = cases_item_data.to_dict()
            cases.append(cases_item)

        conclusions = self.conclusions

        validity = self.validity.to_dict()

        provenance = self.provenance.to_dict()

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "schema": schema,
                "error": error,
                "quantile": quantile,
                "seed": seed,
                "trials": trials,
                "confidence": confidence,
                "interval_method": interval_method,
                "installation": installation,
                "noise": noise,
                "cases": cases,
                "conclusions": conclusions,
                "validity": validity,
                "provenance": provenance,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.coupling_case import CouplingCase  # noqa: PLC0415
        from ..models.provenance import Provenance  # noqa: PLC0415
        from ..models.validity import Validity  # noqa: PLC0415

        d = dict(src_dict)
        schema = cast(Literal["tailstack/study-coupling/1"], d.pop("schema"))
        if schema != "tailstack/study-coupling/1":
            raise ValueError(f"schema must match const 'tailstack/study-coupling/1', got '{schema}'")

        error = check_study_coupling_error(d.pop("error"))

        quantile = d.pop("quantile")

        seed = d.pop("seed")

        trials = d.pop("trials")

        confidence = d.pop("confidence")

        interval_method = d.pop("interval_method")

        installation = d.pop("installation")

        noise = d.pop("noise")

        cases = []
        _cases = d.pop("cases")
        for cases_item_data in _cases:
            cases_item = CouplingCase.from_dict(cases_item_data)

            cases.append(cases_item)

        conclusions = cast(list[str], d.pop("conclusions"))

        validity = Validity.from_dict(d.pop("validity"))

        provenance = Provenance.from_dict(d.pop("provenance"))

        study_coupling = cls(
            schema=schema,
            error=error,
            quantile=quantile,
            seed=seed,
            trials=trials,
            confidence=confidence,
            interval_method=interval_method,
            installation=installation,
            noise=noise,
            cases=cases,
            conclusions=conclusions,
            validity=validity,
            provenance=provenance,
        )

        return study_coupling

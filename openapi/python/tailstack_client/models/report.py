from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast
from typing import Literal, cast

if TYPE_CHECKING:
    from ..models.allowance import Allowance
    from ..models.convergence import Convergence
    from ..models.error_distribution import ErrorDistribution
    from ..models.headline import Headline
    from ..models.optimisation import Optimisation
    from ..models.provenance import Provenance
    from ..models.report_design import ReportDesign
    from ..models.reproduction import Reproduction
    from ..models.score import Score
    from ..models.verification import Verification


T = TypeVar("T", bound="Report")


@_attrs_define
class Report:
    """A design, what was found about it, and how to find it again.

    Attributes:
        schema (Literal['tailstack/report/1']): Name and version of this record's schema.
        title (str): Title of the report: the design's name.
        headline (Headline): The first page: what a project lead needs to know.
        score (Score): First order: bias, covariance, tail and budget at every target.
        verification (None | Verification): Monte Carlo check; null where it was not asked for.
        optimisation (None | Optimisation): The optimised design; null where it was not asked for.
        distributions (list[ErrorDistribution]): TCP error at the targets with the largest P95, by bins.
        convergence (list[Convergence]): How the sampled P95 settled; empty where nothing was drawn.
        allowances (list[Allowance]): How far each half-width could go by itself, at the targets of `distributions`.
        design (ReportDesign): The design document, complete.
        reproduction (Reproduction): How to get the same numbers again.
        provenance (Provenance): Which design, by which version, under which model, and what is not included.
    """

    schema: Literal["tailstack/report/1"]
    title: str
    headline: Headline
    score: Score
    verification: None | Verification
    optimisation: None | Optimisation
    distributions: list[ErrorDistribution]
    convergence: list[Convergence]
    allowances: list[Allowance]
    design: ReportDesign
    reproduction: Reproduction
    provenance: Provenance

    def to_dict(self) -> dict[str, Any]:
        from ..models.allowance import Allowance  # noqa: PLC0415
        from ..models.convergence import Convergence  # noqa: PLC0415
        from ..models.error_distribution import ErrorDistribution  # noqa: PLC0415
        from ..models.headline import Headline  # noqa: PLC0415
        from ..models.optimisation import Optimisation  # noqa: PLC0415
        from ..models.provenance import Provenance  # noqa: PLC0415
        from ..models.report_design import ReportDesign  # noqa: PLC0415
        from ..models.reproduction import Reproduction  # noqa: PLC0415
        from ..models.score import Score  # noqa: PLC0415
        from ..models.verification import Verification  # noqa: PLC0415

        schema = self.schema

        title = self.title

        headline = self.headline.to_dict()

        score = self.score.to_dict()

        verification: dict[str, Any] | None
        if isinstance(self.verification, Verification):
            verification = self.verification.to_dict()
        else:
            verification = self.verification

        optimisation: dict[str, Any] | None
        if isinstance(self.optimisation, Optimisation):
            optimisation = self.optimisation.to_dict()
        else:
            optimisation = self.optimisation

        distributions = []
        for distributions_item_data in self.distributions:
            distributions_item = distributions_item_data.to_dict()
            distributions.append(distributions_item)

        convergence = []
        for convergence_item_data in self.convergence:
            convergence_item = convergence_item_data.to_dict()
            convergence.append(convergence_item)

        allowances = []
        for allowances_item_data in self.allowances:
            allowances_item = allowances_item_data.to_dict()
            allowances.append(allowances_item)

        design = self.design.to_dict()

        reproduction = self.reproduction.to_dict()

        provenance = self.provenance.to_dict()

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "schema": schema,
                "title": title,
                "headline": headline,
                "score": score,
                "verification": verification,
                "optimisation": optimisation,
                "distributions": distributions,
                "convergence": convergence,
                "allowances": allowances,
                "design": design,
                "reproduction": reproduction,
                "provenance": provenance,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.allowance import Allowance  # noqa: PLC0415
        from ..models.convergence import Convergence  # noqa: PLC0415
        from ..models.error_distribution import ErrorDistribution  # noqa: PLC0415
        from ..models.headline import Headline  # noqa: PLC0415
        from ..models.optimisation import Optimisation  # noqa: PLC0415
        from ..models.provenance import Provenance  # noqa: PLC0415
        from ..models.report_design import ReportDesign  # noqa: PLC0415
        from ..models.reproduction import Reproduction  # noqa: PLC0415
        from ..models.score import Score  # noqa: PLC0415
        from ..models.verification import Verification  # noqa: PLC0415

        d = dict(src_dict)
        schema = cast(Literal["tailstack/report/1"], d.pop("schema"))
        if schema != "tailstack/report/1":
            raise ValueError(f"schema must match const 'tailstack/report/1', got '{schema}'")

        title = d.pop("title")

        headline = Headline.from_dict(d.pop("headline"))

        score = Score.from_dict(d.pop("score"))

        def _parse_verification(data: object) -> None | Verification:
            if data is None:
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                verification_type_0 = Verification.from_dict(data)

                return verification_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(None | Verification, data)

        verification = _parse_verification(d.pop("verification"))

        def _parse_optimisation(data: object) -> None | Optimisation:
            if data is None:
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                optimisation_type_0 = Optimisation.from_dict(data)

                return optimisation_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(None | Optimisation, data)

        optimisation = _parse_optimisation(d.pop("optimisation"))

        distributions = []
        _distributions = d.pop("distributions")
        for distributions_item_data in _distributions:
            distributions_item = ErrorDistribution.from_dict(distributions_item_data)

            distributions.append(distributions_item)

        convergence = []
        _convergence = d.pop("convergence")
        for convergence_item_data in _convergence:
            convergence_item = Convergence.from_dict(convergence_item_data)

            convergence.append(convergence_item)

        allowances = []
        _allowances = d.pop("allowances")
        for allowances_item_data in _allowances:
            allowances_item = Allowance.from_dict(allowances_item_data)

            allowances.append(allowances_item)

        design = ReportDesign.from_dict(d.pop("design"))

        reproduction = Reproduction.from_dict(d.pop("reproduction"))

        provenance = Provenance.from_dict(d.pop("provenance"))

        report = cls(
            schema=schema,
            title=title,
            headline=headline,
            score=score,
            verification=verification,
            optimisation=optimisation,
            distributions=distributions,
            convergence=convergence,
            allowances=allowances,
            design=design,
            reproduction=reproduction,
            provenance=provenance,
        )

        return report

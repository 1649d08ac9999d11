"""The tolerance-budget report of a design: score, check and optimisation in one record."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from tailstack.montecarlo import MAX_TRIALS
from tailstack.results.radiostereometry import Profile

from ..console.command_line import EXIT_CODE
from ..console.flags import Flag
from ..report.records import Report, Reproduction
from .operation import Again, Call, CheckOptions, Demand, HeldDesign, LateImport, Operation, Repetition, within_trials
from .optimisation import check_freedom

if TYPE_CHECKING:
    from ..report.assembling import ReportContents as Parts
    from ..settings import Settings
    from .request import Request

Part = Literal["score", "verification", "optimisation"]

PARTS = Flag(
    "of a design: score, verification, optimisation (default score,verification)", metavar="LIST", in_query="part"
)


class ReportOptions(CheckOptions):
    """What a report holds, and how much is sampled."""

    flags: ClassVar = {
        "trials": Flag("of a design: trials of its check"),
        "precision": Flag("of a design: see tailstack verify", metavar="REL"),
        "max_trials": Flag("of a design: stop its check after so many"),
        "seed": Flag("of a design: seed of its check"),
    }

    parts: Annotated[list[Part], Field(min_length=1, max_length=3), PARTS] = Field(
        ["score", "verification"], examples=[["score", "verification"]]
    )
    """What the record holds, each once; optimisation: before and after."""

    profile: Profile | None = None
    """A chapter for a field of work. rsa, radiostereometry (ISO 16087): condition number, fitting and crossing-line
    errors, and the precision of double examinations of the design's bodies."""

    @model_validator(mode="after")
    def _each_once(self) -> ReportOptions:
        if len(set(self.parts)) < len(self.parts):
            named = ", ".join(self.parts)
            raise PydanticCustomError("given-twice", f"each part is named once; got {named}", {"at": "/parts"})
        return self


def _report(call: Call) -> Report:
    from ..report.assembling import compute_report, options_of

    options = options_of(call.options.model_dump())
    return compute_report(call.design, options, progress=call.progress)


def _check(request: Request, settings: Settings) -> None:
    """What its parts need.  Raises RefusedAt, LimitError."""
    from tailstack.design import check_design

    if "verification" in request.options.parts:
        within_trials(request, settings)
    if "optimisation" in request.options.parts:
        check_freedom(request, settings, starts_of_design=True)
    else:
        request.refuse_by(check_design)
    if request.options.profile is not None:
        from tailstack.studies.radiostereometry import refuse_without_bodies

        request.refuse_by(refuse_without_bodies)


def demand_of(made: Reproduction, at: str) -> Demand:
    """How much the reproduction of a report asks for."""
    starts = (made.starts or 0) if "optimisation" in made.parts else 0
    if "verification" not in made.parts:
        return Demand(starts=starts, starts_at=f"{at}/starts", checks=0)
    name = "max_trials" if made.trials is None else "trials"
    trials = made.trials or made.max_trials or MAX_TRIALS
    return Demand(trials=trials, trials_at=f"{at}/{name}", starts=starts, starts_at=f"{at}/starts")


def parts_of(record: Report) -> Parts:
    """The options that a report was made with."""
    from ..report.assembling import options_of

    return options_of(asdict(record.reproduction))


def _repeat(again: Repetition) -> Again:
    from ..report.assembling import assemble, compute_report

    record: Report = again.record
    (design,), options = again.designs, parts_of(record)
    if not again.fast:
        return Again(compute_report(design, options, progress=again.progress))
    made = assemble(design, options, record.verification, record.optimisation)
    return Again(made, "the Monte Carlo check" if record.verification is not None else "")


OPERATION = Operation(
    name="report",
    verb="report",
    path="/v1/reports",
    summary="Tolerance-budget report: HTML, PDF, spreadsheet, JSON",
    description="Score, check and optimisation of one design in one record, of which /v1/results/{sha256}/report makes "
    "pages.",
    title="score, check and optimisation of one design in one record; html, pdf and xlsx are made from it",
    options=ReportOptions,
    example={"parts": ["score", "verification"], "precision": 0.01, "seed": 7},
    record=lambda: Report,
    run=_report,
    cut=True,
    check=_check,
    document=LateImport("..report.chapters.report", "report_document"),
    exit_code=lambda record: EXIT_CODE[record.headline.status],
    hold=lambda record: (HeldDesign("design", record.design, record.provenance.design_sha256),),
    demand=lambda record: demand_of(record.reproduction, "/reproduction"),
    repeat=_repeat,
)

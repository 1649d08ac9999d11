"""The same design under each estimator, side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from .operation import Again, Call, Demand, LateImport, Operation, Repetition
from .options import Options, Seed, within

if TYPE_CHECKING:
    from tailstack.studies.estimators import EstimatorCase, StudyEstimators

    from ..settings import Settings
    from .sent import Request

LEAST_TRIALS, MOST_TRIALS = 1024, 2**22  # of each estimator
HEADER = ("estimator", "P95\nmm", "if exact\nmm", "simulated\nmm", "as good at\nmm")


class EstimatorOptions(Options):
    """How well intrinsics are known where a view does not say, and how much is simulated."""

    focal_rel_sd: Annotated[float, Field(ge=1e-6, le=1)] = Field(
        0.01, description="Standard deviation of the assumed focal length, as a part of it."
    )
    principal_point_px_sd: Annotated[float, Field(ge=1e-3, le=1e4)] = Field(
        10.0, description="Standard deviation of each coordinate of the assumed principal point, px."
    )
    trials: Annotated[int, Field(ge=LEAST_TRIALS, le=MOST_TRIALS)] | None = Field(
        None, description="Trials of a simulation under each estimator; absent: first order alone."
    )
    seed: Seed = Field(0, description="Seed of the simulations.")


def _study(call: Call) -> StudyEstimators:
    from tailstack.studies.estimators import study_estimators

    options = call.options
    return study_estimators(
        call.design,
        focal_rel_sd=options.focal_rel_sd,
        principal_point_px_sd=options.principal_point_px_sd,
        trials=options.trials or 0,
        seed=options.seed,
        threads=call.threads,
        progress=call.progress,
    )


def _check(request: Request, settings: Settings) -> None:
    """A design that can be compiled, trials within the limit.  Raises Placed, LimitError."""
    from tailstack.design import compile_design

    within(request.options.trials, "max_trials", settings, "/trials")
    request.refuse_by(compile_design)


def _cases(record: StudyEstimators) -> list[EstimatorCase]:
    return [case for case in record.cases if not case.reason]


def _assumption(record: StudyEstimators) -> str:
    return (
        f"Intrinsics are off by what a view says of its own, otherwise by {100 * record.focal_rel_sd:g} % of the focal "
        f"length and {record.principal_point_px_sd:g} px of the principal point (standard deviations, once per unit). "
        f"As good at: the extent of a structure of this shape that would do under it what this one of "
        f"{record.extent_mm:.0f} mm does under dlt."
    )


def _text(record: StudyEstimators) -> str:
    from ..rendering.tables import decimal, table, wrap
    from ..rendering.verdict import heading, join_blocks, more_text, provenance_text

    rows = [
        [
            case.estimator,
            *(decimal(value, 4) for value in (case.p95_mm, case.p95_exact_mm, case.simulated_p95_mm)),
            decimal(case.same_size_mm, 0),
        ]
        for case in _cases(record)
    ]
    lacking = [wrap(f"{case.estimator}: no answer: {case.reason}") for case in record.cases if case.reason]
    needs = [wrap(f"{case.estimator} needs {case.needs}.", first="* ", indent="  ") for case in record.cases]
    return join_blocks(
        heading(record.provenance, "What knowing the intrinsics of each view is worth.", "each estimator"),
        "\n".join(wrap(said, first="* ", indent="  ") for said in record.conclusions),
        table(HEADER, rows),
        *lacking,
        wrap(_assumption(record)),
        "\n".join(needs),
        provenance_text(record.provenance),
        more_text(),
    )


def _document(record: StudyEstimators, sha256: str) -> Any:
    from ..report.blocks import Bullets, Column, Document, KeyNumber, Paragraph, Row, Section, Table
    from ..report.chapters.tables import not_included, provenance_facts

    best = min(_cases(record), key=lambda case: case.p95_mm or 0.0)
    columns = (
        Column("Estimator"), Column("P95", "mm", "fixed"), Column("P95, intrinsics exact", "mm", "fixed"),
        Column("P95, simulated", "mm", "fixed"), Column("As good at", "mm", "fixed", 0),
        Column("Estimate", on_page=False),
    )  # fmt: skip
    rows = tuple(
        Row((case.estimator, case.p95_mm, case.p95_exact_mm, case.simulated_p95_mm, case.same_size_mm, case.validity))
        for case in _cases(record)
    )
    needs = tuple(f"{case.estimator} needs {case.needs}." for case in record.cases)
    lacking = tuple(f"{case.estimator}: no answer: {case.reason}." for case in record.cases if case.reason)
    table = Table("Estimators", "P95 of the error at the tool under each estimator.", columns, rows)
    return Document(
        kind="Study: estimators",
        title=record.provenance.design_name,
        tone="neutral",
        status="estimators",
        sentence=record.conclusions[0],
        numbers=(KeyNumber("Smallest P95", f"{best.p95_mm:.3f} mm", best.estimator.replace("_", " ")),),
        matters=record.conclusions[1:],
        figures=(),
        requirements=None,
        sections=(
            Section("Side by side", (table, Paragraph(_assumption(record)), Bullets((*needs, *lacking)))),
            Section("What is not included", (not_included(record.provenance),), reader="auditor"),
        ),
        provenance=provenance_facts(record.provenance, sha256, record.schema),
    )


def _repeat(again: Repetition) -> Again:
    record: StudyEstimators = again.record
    options = EstimatorOptions(
        focal_rel_sd=record.focal_rel_sd,
        principal_point_px_sd=record.principal_point_px_sd,
        trials=record.trials or None,
        seed=record.seed,
    )
    if again.fast and record.trials:
        return Again(record, "Monte Carlo of every estimator")
    return Again(_study(Call(again.designs, options, progress=again.progress)))


OPERATION = Operation(
    name="study-estimators",
    verb="study estimators",
    path="/v1/studies/estimators",
    summary="What is knowing the intrinsics of each view worth?",
    description="P95 of the same design under each estimator: eleven unknowns of a view by linear equations or by "
    "least squares, its pose with a prior of its intrinsics, its pose alone; what each needs to know, and what being "
    "wrong costs.",
    title="answer of study estimators: P95 under each estimator, what it needs, and what being wrong costs",
    options=EstimatorOptions,
    example={"trials": 1024},
    record=LateImport("tailstack.studies.estimators", "StudyEstimators").load,
    run=_study,
    check=_check,
    text=_text,
    document=_document,
    demand=lambda record: Demand(trials=record.trials * len(record.cases), trials_at="/trials", checks=0),
    repeat=_repeat,
    threads=True,
)

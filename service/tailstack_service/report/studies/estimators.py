"""The same design under each estimator."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tailstack.results.tables import Column, On, Table, tabulate

from ...rendering.document import Bullets, Document, KeyNumber, Paragraph, Section, compose_study

if TYPE_CHECKING:
    from tailstack.studies.estimators import EstimatorCase, StudyEstimators


def estimators_document(study: StudyEstimators, sha256: str) -> Document:
    """P95 under each estimator, what each needs, and why one has no answer."""
    best = min(_list_answered(study), key=lambda case: case.p95_mm or 0.0)
    needs = [f"{case.estimator} needs {case.needs}." for case in study.cases]
    lacking = [f"{case.estimator}: no answer: {case.reason}." for case in study.cases if case.reason]
    assumption = (
        f"Intrinsics are off by what a view says of its own, otherwise by {100 * study.focal_rel_sd:g} % of the focal "
        f"length and {study.principal_point_px_sd:g} px of the principal point (standard deviations, once per unit). "
        f"As good at: the extent of a structure of this shape that would do under it what this one of "
        f"{study.extent_mm:.0f} mm does under dlt."
    )
    remarks = Bullets((*needs, *lacking))
    options = f"--focal-rel-sd {study.focal_rel_sd:g} --principal-point-px-sd {study.principal_point_px_sd:g}"
    trials = f" --trials {study.trials} --seed {study.seed}" if study.trials else ""
    return compose_study(
        study,
        sha256,
        "estimators",
        status="estimators",
        question="What knowing the intrinsics of each view is worth.",
        method="each estimator",
        sentences=study.conclusions,
        numbers=(KeyNumber("Smallest P95", f"{best.p95_mm:.3f} mm", best.estimator.replace("_", " ")),),
        sections=(Section("Side by side", (estimators_table(study), Paragraph(assumption), remarks)),),
        command=f"tailstack study estimators design.yaml {options}{trials} --json",
    )


def _list_answered(study: StudyEstimators) -> list[EstimatorCase]:
    return [case for case in study.cases if not case.reason]


def estimators_table(study: StudyEstimators) -> Table:
    """A row for each estimator that has an answer."""
    columns = (
        Column("Estimator", of=lambda case: case.estimator),
        Column("P95", "mm", "fixed", of=lambda case: case.p95_mm),
        Column("P95, intrinsics exact", "mm", "fixed", brief="if exact\nmm", of=lambda case: case.p95_exact_mm),
        Column("P95, simulated", "mm", "fixed", brief="simulated\nmm", of=lambda case: case.simulated_p95_mm),
        Column("As good at", "mm", "fixed", 0, of=lambda case: case.same_size_mm),
        Column("Estimate", on=On.SHEET, of=lambda case: case.validity),
    )
    caption = "P95 of the error at the tool under each estimator"
    return tabulate("Estimators", caption, columns, _list_answered(study))

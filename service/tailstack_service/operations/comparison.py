"""Two designs checked alike, with one seed, and what sets them apart."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from tailstack.errors import DesignError, Problem

from ..console.command_line import EXIT_CODE
from ..problems import RefusedAt
from ..report.records import Comparison
from .example import EXAMPLE_DESIGN
from .operation import Again, Call, CheckOptions, Demand, HeldDesign, LateImport, Operation, Repetition, within_trials
from .report import demand_of, parts_of

if TYPE_CHECKING:
    from ..settings import Settings
    from .request import Request

Name = Annotated[str, Field(min_length=1, max_length=80)]
SIDES = {"first": "The design that is compared with.", "second": "The design whose changes are looked at."}


class ComparisonOptions(CheckOptions):
    """How both designs are checked."""

    parts: Annotated[list[Literal["score", "verification"]], Field(min_length=1, max_length=2)] = Field(
        ["score", "verification"]
    )
    """What is computed of both; score alone: to first order."""
    names: Annotated[list[Name], Field(min_length=2, max_length=2)] | None = None
    """What to call the two, such as versions of one design; null: the first and the second."""


def _compare(call: Call) -> Comparison:
    from ..report.assembling import options_of
    from ..report.comparing import compute_comparison

    options = options_of(call.options.model_dump())
    first, second = call.designs
    return compute_comparison(first, second, options, progress=call.progress)


def _check(request: Request, settings: Settings) -> None:
    """Both designs determine an answer, and share a target.  Raises RefusedAt, LimitError."""
    from tailstack.design import check_design

    if "verification" in request.options.parts:
        within_trials(request, settings)
    names = []
    for which in range(len(SIDES)):
        system, _, _ = request.refuse_by(check_design, which)
        names.append({target.name for target in system.targets})
    if not names[0] & names[1]:
        detail = "the two designs have no target of the same name: there is nothing to compare"
        problem = Problem("/targets", "no-common-target", detail, "give the targets the same names")
        raise RefusedAt.place(DesignError(problem), "/second")


def _hold(record: Comparison) -> tuple[HeldDesign, ...]:
    pair = (("first design", record.first), ("second design", record.second))
    return tuple(HeldDesign(name, report.design, report.provenance.design_sha256) for name, report in pair)


def _demand(record: Comparison) -> Demand:
    each = demand_of(record.first.reproduction, "/first/reproduction")
    return replace(each, trials=2 * each.trials)


def _repeat(again: Repetition) -> Again:
    from ..report.assembling import assemble
    from ..report.comparing import compare, compute_comparison

    record: Comparison = again.record
    options, (first, second) = replace(parts_of(record.first), names=record.names), again.designs
    if not again.fast:
        return Again(compute_comparison(first, second, options, progress=again.progress))
    pair = ((first, record.first), (second, record.second))
    made = [assemble(design, options, report.verification, None) for design, report in pair]
    trusted = "the Monte Carlo checks of both" if record.first.verification is not None else ""
    return Again(compare(made[0], made[1], options), trusted)


_QUIETER = {
    **EXAMPLE_DESIGN,
    "name": "eight beads, quieter images",
    "views": [{**view, "fiducial_noise_px": 0.2} for view in EXAMPLE_DESIGN["views"]],
}

OPERATION = Operation(
    name="comparison",
    verb="report",
    path="/v1/comparisons",
    summary="Two designs side by side",
    description="Both are checked alike with one seed; differences have an interval.",
    title="two designs reported with one seed and what sets them apart",
    options=ComparisonOptions,
    designs=SIDES,
    example={"first": EXAMPLE_DESIGN, "second": _QUIETER, "precision": 0.01, "seed": 7},
    example_title="The same structure with quieter images",
    record=lambda: Comparison,
    run=_compare,
    cut=True,
    check=_check,
    document=LateImport("..report.chapters.comparison", "comparison_document"),
    exit_code=lambda record: EXIT_CODE[record.headline.status],
    hold=_hold,
    demand=_demand,
    repeat=_repeat,
)

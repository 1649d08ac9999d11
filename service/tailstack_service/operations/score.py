"""An estimate of the error at the tool, where it comes from, and the verdict, in milliseconds."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import Field

from tailstack.errors import IllPosedError, OutOfRangeError
from tailstack.results import FiducialWorth, Score

from ..console.answer import Answer, exit_code_of
from ..console.arguments import add_design, read_design
from ..console.flags import Flag, add_flags
from .batch import add_batch_arguments, refuse_beside_batch, run_batch
from .effort import Size, score_seconds
from .operation import Call, Command, LateImport, Operation
from .options import Options, refuse_unknown_target

if TYPE_CHECKING:
    from tailstack.design import Design

SEARCH_SECONDS = 5.0
NO_SLOPE = "the derivative is known of a quantile of all shots together"


class ScoreOptions(Options):
    """How a score is computed."""

    second_order: bool = Field(False, description="Add the second-order correction where it holds.")
    reliability: Annotated[bool, Flag("add the smallest slip of each image that would be noticed")] = Field(
        False, description="Add the smallest slip of each fiducial's image that its residuals give away."
    )
    losses: Annotated[bool, Flag("look neither for the worst loss of fiducials nor at levers")] = Field(
        True,
        description="Look for the worst loss of one fiducial and of two, and at what each lever leads to by itself. "
        "Without it, a score takes a third less.",
    )
    search: bool = Field(
        False,
        description="Search what moving fiducials leads to by itself, and one view more, within what the design's "
        "optimise section allows: seconds. Needs losses.",
    )
    fifty_shots: Annotated[bool, Flag("add fifty shots that stand for all, as dots")] = Field(
        False, description="Add fifty quantiles of what decides: fifty shots that stand for all, and how many miss."
    )
    fiducials: Annotated[bool, Flag("add what moving and losing each fiducial does to the value that decides")] = Field(
        False,
        description="Add the derivative of the value that decides by each fiducial's place, and what it comes "
        "to without each of them. Some 30 ms more for each fiducial.",
    )

    @classmethod
    def of_record(cls, record: Any, **others: Any) -> Self | None:
        return super().of_record(
            record,
            second_order=any(target.second_order.status != "not requested" for target in record.targets),
            reliability=bool(record.reliability),
            losses=bool(record.losses or record.levers),
            fiducials=bool(record.fiducials),
            search=any(lever.how == "found" for lever in record.levers),
            fifty_shots=record.fifty_shots is not None,
        )

    def seconds(self, sizes: Iterable[Size]) -> float:
        own = score_seconds(sizes, second_order=self.second_order, losses=self.losses) + self.search * SEARCH_SECONDS
        return own + self.fiducials * sum(0.03 * each.fiducials for each in sizes)


def _score(call: Call) -> Score:
    from tailstack.scoring import score

    design = call.design
    found = score(design, **call.options.model_dump(exclude={"search", "fiducials"}))
    if call.options.fiducials:
        found = replace(found, fiducials=_weigh_fiducials(design, found))
    if not call.options.search:
        return found
    from .levers import search_levers

    return search_levers(design, found)


def _weigh_fiducials(design: Design, record: Score) -> tuple[FiducialWorth, ...]:
    """What each fiducial does to the value that decides: by moving, exactly, and by being lost."""
    from tailstack.design import compile_design, design_to_data, load_design
    from tailstack.design_function import DesignFunction
    from tailstack.losses import without_fiducials
    from tailstack.results.verdicts import P95, decisive_check
    from tailstack.scoring import score, vector3

    system, check = compile_design(design), decisive_check(record.verdict.checks)
    item = next((each for each in system.requirements if check and each.name == check.requirement), None)
    target = record.worst_target.name if check is None else check.target
    slopes: list[Any] = [None] * len(system.fiducial_labels)
    why = "" if item is None or (item.level is None and item.row.by_quantile) else NO_SLOPE
    if not why:
        places = [f"/fiducials/points/{i}/position_mm/{k}" for i in range(len(slopes)) for k in range(3)]
        function = DesignFunction(load_design(design_to_data(design)), places)  # which has those of a file, too
        error, quantile = (item.error, item.quantile) if item else ("tcp", P95)
        try:
            _, by_place = function.p95_gradient(function.present, target, error, quantile)
            slopes = [vector3(each) for each in by_place.reshape(-1, 3)]
        except OutOfRangeError as refusal:
            why = refusal.problems[0].detail
    own = [each for each in system.targets if each.name == target] or system.targets
    stated = () if item is None else (replace(item, targets=(target,)),)
    system, worth = replace(system, targets=tuple(own), requirements=stated), []
    for label, slope in zip(system.fiducial_labels, slopes, strict=True):
        without, reason = None, ""
        try:
            left = score(without_fiducials(system, (label,)), losses=False)
            without = left.verdict.checks[0].value if stated else left.worst_target.p95_mm
        except IllPosedError as refusal:
            reason = refusal.problems[0].detail
        worth.append(FiducialWorth(label, slope, without, "; ".join(filter(None, (why, reason)))))
    return tuple(worth)


# --- the command ------------------------------------------------------------------------------------------


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_design(parser)
    add_flags(parser, ScoreOptions)
    parser.add_argument("--target", metavar="NAME", help="target whose budget is shown (default: the largest P95)")
    add_batch_arguments(parser)


def _run(arguments: argparse.Namespace) -> Answer:
    refuse_beside_batch(arguments, ScoreOptions)
    if arguments.batch is not None:
        return run_batch(arguments)
    design = read_design(arguments.design)  # bad input is refused before the solver is loaded

    from ..documents import to_json

    record = _score(Call((design,), ScoreOptions.of_flags(arguments)))
    refuse_unknown_target(arguments.target, [target.name for target in record.targets])
    code = exit_code_of(record.verdict)
    if arguments.json:
        return Answer(to_json(record), code)
    return Answer(OPERATION.write(record, arguments.target), code)


OPERATION = Operation(
    name="score",
    verb="score",
    path="/v1/scores",
    summary="Estimate of the error: P95, where it comes from, verdict",
    description="First order through every stage at the biased geometry: bias, covariance and quantiles of the error "
    "under the declared laws, their bounds, the budget of every tolerance, the validity of the linearisation, the "
    "verdict. Takes milliseconds; more with second_order.",
    title="answer of score: first-order bias, covariance, tail, budget",
    options=ScoreOptions,
    example={"second_order": True},
    record=lambda: Score,
    run=_score,
    immediate=True,
    document=LateImport("..report.chapters.score", "score_document"),
    exit_code=lambda record: exit_code_of(record.verdict),
    command=Command(_add_arguments, _run),
)

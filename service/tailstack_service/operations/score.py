"""An estimate of the error at the tool, where it comes from, and the verdict, in milliseconds."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import replace
from typing import Annotated, Any, Self

from tailstack.results import Score

from ..console.command_line import Answer, add_design, exit_code_of, read_design
from ..console.flags import NO_FLAG, Flag, add_flags
from ..documents import to_json
from .batch import add_batch_arguments, refuse_beside_batch, run_batch
from .operation import Call, Command, LateImport, Operation, Options, Size, refuse_unknown_target, score_seconds

SEARCH_SECONDS = 5.0


class ScoreOptions(Options):
    """How a score is computed."""

    second_order: bool = False
    """Add the second-order correction where it holds."""
    reliability: Annotated[bool, Flag("add the smallest slip of each image that would be noticed")] = False
    """Add the smallest slip of each fiducial's image that its residuals give away."""
    losses: Annotated[bool, Flag("look neither for the worst loss of fiducials nor at levers")] = True
    """Look for the worst loss of one fiducial and of two, and at what each lever leads to by itself. Without it, a
    score takes a third less."""
    search: bool = False
    """Search what moving fiducials leads to by itself, and one view more, within what the design's optimise section
    allows: seconds. Needs losses."""
    fifty_shots: Annotated[bool, Flag("add fifty shots that stand for all, as dots")] = False
    """Add fifty quantiles of what decides: fifty shots that stand for all, and how many miss."""
    fiducials: Annotated[bool, Flag("add what moving and losing each fiducial does to the value that decides")] = False
    """Add the derivative of the value that decides by each fiducial's place, and what it comes to without each of them.
    Some 30 ms more for each fiducial."""

    covariances: Annotated[bool, Flag("add what the errors at every two targets have in common")] = False
    """Add the covariance of the errors at every two targets, of 64 at most."""
    targets: Annotated[list[str] | None, NO_FLAG] = None
    """Names of targets that are told, beside the one at which the design is decided and the one with the largest P95;
    absent: all. The verdict is of all targets either way."""

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
            covariances=bool(record.covariances),
            targets=[target.name for target in record.targets],
        )

    def seconds(self, sizes: Iterable[Size]) -> float:
        own = score_seconds(sizes, second_order=self.second_order, losses=self.losses) + self.search * SEARCH_SECONDS
        return own + self.fiducials * sum(0.03 * each.fiducials for each in sizes)


def _score(call: Call) -> Score:
    from tailstack.scoring import score

    design = call.design
    found = score(design, **call.options.model_dump(exclude={"search", "fiducials"}))
    if call.options.fiducials:
        from tailstack.design_function import weigh_fiducials

        found = replace(found, fiducials=weigh_fiducials(design, found))
    if not call.options.search:
        return found
    from tailstack.optimisation.levers import search_levers

    return search_levers(design, found)


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

    record = _score(Call((design,), ScoreOptions.of_flags(arguments)))
    refuse_unknown_target(arguments.target, [target.name for target in record.targets])
    body = to_json(record) if arguments.json else OPERATION.write(record, arguments.target)
    return Answer(body, exit_code_of(record.verdict))


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

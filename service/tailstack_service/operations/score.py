"""An estimate of the error at the tool, where it comes from, and the verdict, in milliseconds."""

from __future__ import annotations

import argparse

from pydantic import Field

from tailstack.results import Score

from ..console.answer import Answer, exit_code_of
from ..console.arguments import add_design, read_design
from .batch import add_batch_arguments, refuse_beside_batch, run_batch
from .effort import score_reception_seconds
from .operation import Again, Call, Command, LateImport, Operation, Repetition
from .options import Options, refuse_unknown_target


class ScoreOptions(Options):
    """How a score is computed."""

    second_order: bool = Field(False, description="Add the second-order correction where it holds.")
    reliability: bool = Field(
        False, description="Add the smallest slip of each fiducial's image that its residuals give away."
    )
    losses: bool = Field(
        True, description="Look for the worst loss of one fiducial and of two. Without it, a score takes a third less."
    )


def _score(call: Call) -> Score:
    from tailstack.scoring import score

    options = call.options
    return score(call.design, second_order=options.second_order, losses=options.losses, reliability=options.reliability)


def _repeat(again: Repetition) -> Again:
    from tailstack.scoring import score

    second_order = any(target.second_order.status != "not requested" for target in again.record.targets)
    losses, reliability = bool(again.record.losses), bool(again.record.reliability)
    return Again(score(again.designs[0], second_order=second_order, losses=losses, reliability=reliability))


# --- the command ------------------------------------------------------------------------------------------


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_design(parser)
    parser.add_argument("--second-order", action="store_true", help="add the second-order correction where it holds")
    parser.add_argument(
        "--reliability", action="store_true", help="add the smallest slip of each image that would be noticed"
    )
    parser.add_argument(
        "--no-losses", dest="losses", action="store_false", help="do not look for the worst loss of fiducials"
    )
    parser.add_argument("--target", metavar="NAME", help="target whose budget is shown (default: the largest P95)")
    add_batch_arguments(parser)


def _run(arguments: argparse.Namespace) -> Answer:
    refuse_beside_batch(arguments)
    if arguments.batch is not None:
        return run_batch(arguments)
    design = read_design(arguments.design)  # bad input is refused before the solver is loaded

    from ..documents import to_json
    from ..rendering.score import score_text

    record = _score(
        Call(
            (design,),
            ScoreOptions(
                second_order=arguments.second_order, losses=arguments.losses, reliability=arguments.reliability
            ),
        )
    )
    refuse_unknown_target(arguments.target, [target.name for target in record.targets])
    code = exit_code_of(record.verdict)
    if arguments.json:
        return Answer(to_json(record), code)
    return Answer(score_text(record, target=arguments.target), code)


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
    seconds=score_reception_seconds,
    text=LateImport("..rendering.score", "score_text"),
    document=LateImport("..report.chapters.score", "score_document"),
    exit_code=lambda record: exit_code_of(record.verdict),
    repeat=_repeat,
    command=Command(_add_arguments, _run),
)

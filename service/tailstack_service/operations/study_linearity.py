"""How far the estimate of a score can be trusted: it is held against a simulation over a grid.

Varied are noise, rotation, spread and the number of fiducials; the estimated P95 is within 1, 5 or 20 %, or beyond.
Every axis takes V1,V2,... in place of its default values.
"""

from __future__ import annotations

import argparse
from math import isfinite
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from ..console.answer import Answer, exit_code_of_points
from ..console.arguments import add_design, add_figure, add_form, read_design, whole
from ..console.files import writable_figure, write_figure
from ..console.progress import Progress
from .operation import Again, Call, Command, Demand, LateImport, Operation, Repetition
from .options import Options, Seed, refuse_unknown_target, within

if TYPE_CHECKING:
    from tailstack.studies.linearity import StudyLinearity

    from ..settings import Settings
    from .sent import Request

LEAST_TRIALS, MOST_TRIALS = 8192, 2**22  # of each point


class LinearityOptions(Options):
    """The grid, and how each of its points is sampled."""

    noises_px: Annotated[list[float], Field(min_length=1, max_length=50)] | None = Field(
        None, description="Noise of every image coordinate, px; absent: 0.3, 1, 3, 10.", examples=[[0.3, 1.0, 3.0]]
    )
    rotations_deg: Annotated[list[float], Field(min_length=1, max_length=50)] | None = Field(
        None,
        description="Standard deviation of each rotation of the structure's mount, deg, normal; absent: 0, 1, 5.",
        examples=[[0.0, 1.0, 5.0]],
    )
    spreads: Annotated[list[float], Field(min_length=1, max_length=50)] | None = Field(
        None, description="Factors on the layout about its centroid; absent: 1, 0.5, 0.2.", examples=[[1.0, 0.5]]
    )
    counts: Annotated[list[int], Field(min_length=1, max_length=50)] | None = Field(
        None, description="Numbers of fiducials kept, far apart; absent: all, two thirds, 7.", examples=[[12, 8]]
    )
    target: str | None = Field(None, description="Name of the target; absent: the one with the largest P95.")
    error: Literal["tcp", "localisation"] = Field("tcp", description="Which error.")
    trials: Annotated[int, Field(ge=LEAST_TRIALS, le=MOST_TRIALS)] = Field(2**14, description="Trials of each point.")
    seed: Seed = Field(0, description="Seed of every point.")

    @classmethod
    def in_query(cls) -> dict[str, str]:
        return {name: name for name in ("noises_px", "rotations_deg", "spreads", "counts")}

    @classmethod
    def from_query(cls, option: str, given: list[str]) -> Any:
        kind = int if option == "counts" else float
        try:
            return [kind(value) for text in given for value in text.split(",")]
        except ValueError:
            return given  # refused as what it is


def _study(call: Call) -> StudyLinearity:
    from tailstack.studies.linearity import Grid, study_linearity

    options: dict[str, Any] = call.options.model_dump(exclude_none=True)
    grid = Grid(**{name: options.pop(name) for name in LinearityOptions.in_query() if name in options})
    return study_linearity(call.design, grid, **options, threads=call.threads, progress=call.progress)


def _check(request: Request, settings: Settings) -> None:
    """A design that determines an answer, and a target that it has.  Raises Placed, RequestError, LimitError."""
    from tailstack.design import check_design

    within(request.options.trials, "max_trials", settings, "/trials")
    system, _, _ = request.refuse_by(check_design)
    refuse_unknown_target(request.options.target, [target.name for target in system.targets], "/target")


def _repeat(again: Repetition) -> Again:
    record: StudyLinearity = again.record
    if again.fast:
        return Again(record, "Monte Carlo at every point")
    options = LinearityOptions(
        noises_px=list(record.noises_px),
        rotations_deg=list(record.rotations_deg),
        spreads=list(record.spreads),
        counts=list(record.counts),
        target=record.target,
        error=record.error,
        trials=record.trials,
        seed=record.seed,
    )
    return Again(_study(Call(again.designs, options, progress=again.progress)))


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_design(parser, json=False)
    parser.add_argument("--noise", type=_numbers, metavar="PX,...", help="of every image coordinate (0.3,1,3,10)")
    parser.add_argument(
        "--rotation", type=_numbers, metavar="DEG,...",
        help="standard deviation of each rotation of the structure's mount, normal (0,1,5)",
    )  # fmt: skip
    parser.add_argument(
        "--spread", type=_numbers, metavar="F,...", help="factor on the layout about its centroid (1,0.5,0.2)"
    )
    parser.add_argument(
        "--count", type=_whole_numbers, metavar="N,...", help="fiducials kept, far apart (all, two thirds, 7)"
    )
    parser.add_argument("--target", metavar="NAME", help="target (default: the one with the largest P95)")
    parser.add_argument(
        "--error", choices=("tcp", "localisation"), default="tcp", help="which error (default %(default)s)"
    )
    parser.add_argument(
        "--trials", type=whole(LEAST_TRIALS, 2**22), default=2**14, metavar="N",
        help="trials of each point (default %(default)s)",
    )  # fmt: skip
    parser.add_argument("--seed", type=whole(0, 2**63 - 1), default=0, metavar="N", help="seed (default %(default)s)")
    add_form(parser, "study-linearity", "point")
    add_figure(parser, "the map")
    parser.add_argument("--threads", type=whole(1, 1024), metavar="N", help="threads; the answer does not depend on it")


def _numbers(said: str) -> list[float]:
    try:
        values = [float(part) for part in said.split(",")]
        if not all(map(isfinite, values)):
            raise ValueError
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"expected numbers with commas between them like 0.3,1,3; got {said!r}"
        ) from None
    return values


def _whole_numbers(said: str) -> list[int]:
    try:
        return [int(part) for part in said.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected whole numbers like 12,8,6; got {said!r}") from None


def _run(arguments: argparse.Namespace) -> Answer:
    design = read_design(arguments.design)

    from ..documents import to_json
    from ..rendering.studies.linearity import linearity_csv, linearity_text
    from ..report.study_charts import draw_linearity

    figure = None if arguments.figure is None else writable_figure(arguments.figure)
    options = LinearityOptions(
        noises_px=arguments.noise,
        rotations_deg=arguments.rotation,
        spreads=arguments.spread,
        counts=arguments.count,
        target=arguments.target,
        error=arguments.error,
        trials=arguments.trials,
        seed=arguments.seed,
    )
    with Progress("study linearity") as progress:
        study = _study(Call((design,), options, threads=arguments.threads, progress=progress.report))
    if figure is not None:
        write_figure(figure, draw_linearity(study))
    code = exit_code_of_points(study)
    if arguments.json:
        return Answer(to_json(study), code)
    return Answer(linearity_csv(study) if arguments.csv else linearity_text(study), code)


OPERATION = Operation(
    name="study-linearity",
    verb="study linearity",
    path="/v1/studies/linearity",
    summary="How far the estimate can be trusted: a map over noise, rotation, spread and count",
    description="First order, second order and Monte Carlo over a grid of noise, rotation, spread and count: where the "
    "first-order P95 is within 1, 5 and 20 %, where it is optimistic, and whether the validity number nu knew.",
    title="answer of study linearity: first order over Monte Carlo, point by point of a grid",
    options=LinearityOptions,
    example={"noises_px": [0.3, 3.0], "rotations_deg": [0.0, 1.0], "spreads": [1.0], "trials": 8192},
    record=LateImport("tailstack.studies.linearity", "StudyLinearity").load,
    run=_study,
    check=_check,
    text=LateImport("..rendering.studies.linearity", "linearity_text"),
    document=LateImport("..report.chapters.studies", "linearity_document"),
    demand=lambda record: Demand(trials=record.trials * len(record.points), trials_at="/trials", checks=0),
    repeat=_repeat,
    exit_code=exit_code_of_points,
    command=Command(_add_arguments, _run),
    threads=True,
)

"""The tables S1 to S4 of the paper this chain comes from, printed cells beside ours, and what explains the rest.

Its geometry is not printed: two were fitted to the tables, one in each reading of the installation error, and a C-arm
stands beside them.  With DESIGN the same sweeps are made in that design's geometry instead: its views without their
noise, its fiducials, its first target, the pivot of its structure_connector, its transforms and model.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from tailstack.errors import Problem
from tailstack.extras import require_extras

from ..console.answer import Answer
from ..console.arguments import add_form, read_design
from ..console.files import writable_directory, write_figure
from ..console.flags import Flag, add_flags
from ..console.progress import Progress
from ..examples import example_folder
from ..problems import RequestError
from .operation import Again, Call, Command, Demand, LateImport, Operation, Repetition
from .options import Options, Seed, check_trials

if TYPE_CHECKING:
    from tailstack.design import Design
    from tailstack.studies.paper.reproduce import StudyPaper


FITTED = ("fitted_eq18.yaml", "fitted_physical.yaml")
C_ARM = "c_arm.yaml"
LEAST_TRIALS, MOST_TRIALS = 40_000, 1_000_000


class PaperOptions(Options):
    """How each of our cells is sampled."""

    trials: Annotated[int, Field(ge=LEAST_TRIALS, le=MOST_TRIALS)] = Field(
        100_000, description="Trials of each of our cells."
    )
    seed: Annotated[Seed, Flag("seed")] = Field(0, description="Seed of all cells.")


def _study(call: Call) -> StudyPaper:
    from tailstack.design import load_design

    fitted = [load_design(scenario(name)) for name in FITTED]
    other = call.designs[0] if call.designs else load_design(scenario(C_ARM))
    return _reproduce(fitted, other, call)


def _reproduce(fitted: list[Design], other: Design, call: Call) -> StudyPaper:
    """fitted: designs whose geometry was fitted to the tables; other: one that is not compared with them."""
    from tailstack.design import compile_design
    from tailstack.studies.paper.reproduce import PaperGeometry, study_paper

    cases = [
        *(PaperGeometry(compile_design(design), True) for design in fitted),
        PaperGeometry(compile_design(other), False),
    ]
    options = call.options
    return study_paper(cases, trials=options.trials, seed=options.seed, threads=call.threads, progress=call.progress)


def _demand(record: StudyPaper) -> Demand:
    cells = sum(len(geometry.cells) for geometry in record.geometries)
    return Demand.of_cases(record.trials, cells, "Monte Carlo of every cell")


def _repeat(again: Repetition) -> Again:
    from tailstack.design import load_design

    record: StudyPaper = again.record
    if again.fast:
        return Again(record, _demand(record).trusted)
    designs = (*map(load_design, map(scenario, FITTED)), *(again.designs or (load_design(scenario(C_ARM)),)))
    if [design.sha256 for design in designs] != [geometry.design_sha256 for geometry in record.geometries]:
        detail = "the record is of other geometries than those that come with tailstack"
        hint = "tailstack report --verify FILE DESIGN with its design; one of other fitted designs: --fast"
        raise RequestError(Problem("/geometries", "another-design", detail, hint))
    return Again(_study(Call(again.designs, PaperOptions.of_record(record), progress=again.progress)))


def scenario(name: str) -> Path:
    """A design of ``examples/paper``."""
    return example_folder() / "paper" / name


# --- the command ------------------------------------------------------------------------------------------


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "design", metavar="DESIGN", nargs="?", help="another geometry, not compared (default: a C-arm); - reads stdin"
    )
    parser.add_argument(
        "--fitted", metavar="FILE", action="append",
        help="a design whose geometry was fitted to the tables (default: the two of examples/paper); may be repeated",
    )  # fmt: skip
    add_flags(parser, PaperOptions)
    add_form(parser, "study-paper", "cell and geometry")
    parser.add_argument("--figures", metavar="DIR", help="draw sweeps, levels and S3 of every geometry (.svg)")


def _run(arguments: argparse.Namespace) -> Answer:
    fitted = [read_design(name) for name in arguments.fitted or map(str, map(scenario, FITTED))]
    other = read_design(arguments.design or str(scenario(C_ARM)))

    from ..documents import to_json
    from ..report.studies.paper import draw_paper, paper_csv

    directory = None
    if arguments.figures is not None:
        require_extras("report")
        directory = writable_directory(arguments.figures, "--figures")
    options = PaperOptions.of_flags(arguments)
    with Progress("study paper") as progress:
        call = Call((), options, threads=arguments.threads, progress=progress.report)
        study = _reproduce(fitted, other, call)
    if directory is not None:
        for name, svg in draw_paper(study).items():
            write_figure(directory / name, svg)
    if arguments.json:
        return Answer(to_json(study))
    return Answer(paper_csv(study) if arguments.csv else OPERATION.write(study))


OPERATION = Operation(
    name="study-paper",
    verb="study paper",
    path="/v1/studies/paper",
    summary="The published tables, cell by cell, reproduced and corrected",
    description="The tables S1 to S4 of the paper that this chain comes from: printed cells beside ours in two "
    "geometries that were fitted to them, and what explains the rest. With a design the same sweeps are made in its "
    "geometry too; without one in that of a C-arm.",
    title="answer of study paper: the published tables cell by cell, printed and reproduced",
    options=PaperOptions,
    needs_design=False,
    example={"trials": LEAST_TRIALS},
    record=LateImport("tailstack.studies.paper.reproduce", "StudyPaper").load,
    run=_study,
    check=check_trials,
    document=LateImport("..report.studies.paper", "paper_document"),
    demand=_demand,
    repeat=_repeat,
    command=Command(_add_arguments, _run),
    threads=True,
)

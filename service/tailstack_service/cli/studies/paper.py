"""The tables S1 to S4 of the paper this chain comes from, printed cells beside ours, and what explains the rest.

Its geometry is not printed: two were fitted to the tables, one in each reading of the installation error, and a C-arm
stands beside them.  With DESIGN the same sweeps are made in that design's geometry instead: its views without their
noise, its fiducials, its first target, the pivot of its structure_connector, its transforms and model.
"""

from __future__ import annotations

import argparse
from importlib.resources import files
from pathlib import Path

from ...console.answer import Answer
from ...console.arguments import add_form, read_design, whole
from ...console.progress import Progress

HELP = "the published tables, cell by cell, reproduced and corrected"
FITTED = ("fitted_eq18.yaml", "fitted_physical.yaml")
C_ARM = "c_arm.yaml"
LEAST_TRIALS, MOST_TRIALS = 40_000, 1_000_000


def add(parsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = parsers.add_parser("paper", help=HELP, description=__doc__, allow_abbrev=False)
    parser.add_argument(
        "design", metavar="DESIGN", nargs="?", help="another geometry, not compared (default: a C-arm); - reads stdin"
    )
    parser.add_argument(
        "--fitted", metavar="FILE", action="append",
        help="a design whose geometry was fitted to the tables (default: the two of examples/paper); may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--trials", type=whole(LEAST_TRIALS, MOST_TRIALS), default=100_000, metavar="N",
        help="trials of each of our cells (default %(default)s)",
    )  # fmt: skip
    parser.add_argument("--seed", type=whole(0, 2**63 - 1), default=0, metavar="N", help="seed (default %(default)s)")
    add_form(parser, "study-paper", "cell and geometry")
    parser.add_argument("--figures", metavar="DIR", help="draw sweeps, levels and S3 of every geometry (.svg)")
    parser.add_argument("--threads", type=whole(1, 1024), metavar="N", help="threads; the answer does not depend on it")


def scenario(name: str) -> Path:
    """A design of ``examples/paper``: beside this module in an installed wheel, in ``examples/`` in a checkout."""
    shipped = Path(str(files("tailstack_service.cli.studies"))) / "scenarios" / name
    if shipped.is_file():
        return shipped
    return Path(__file__).resolve().parents[4] / "examples" / "paper" / name


def run(arguments: argparse.Namespace) -> Answer:
    fitted = [read_design(name) for name in arguments.fitted or map(str, map(scenario, FITTED))]
    other = read_design(arguments.design or str(scenario(C_ARM)))

    from tailstack.design import compile_design
    from tailstack.studies.paper.reproduce import Case, paper_study

    from ...console.files import writable_directory, write_figure
    from ...documents import to_json
    from ...rendering.studies.paper import paper_csv, paper_text
    from ...rendering.studies.paper_figures import paper_figures

    directory = None if arguments.figures is None else writable_directory(arguments.figures)
    cases = [*(Case(compile_design(design), True) for design in fitted), Case(compile_design(other), False)]
    with Progress("study paper") as progress:
        study = paper_study(
            cases, trials=arguments.trials, seed=arguments.seed, threads=arguments.threads, progress=progress.report
        )
    if directory is not None:
        for name, svg in paper_figures(study).items():
            write_figure(directory / name, svg)
    if arguments.json:
        return Answer(to_json(study))
    return Answer(paper_csv(study) if arguments.csv else paper_text(study))

"""Installation error and noise together against the parts: noise gain, quadrature, plain sum, first order.

As designed and at fixed installation errors of the structure, in both readings: the structure really moves
(physical), or the coordinates told to the estimator do (the paper's Eq 18).
"""

from __future__ import annotations

import argparse

from tailstack.studies.coupling import LEAST_TRIALS

from ...console.answer import Answer
from ...console.arguments import add_design, read_design, whole
from ...console.progress import Progress

HELP = "is the tail of installation error and noise together more than the parts?"


def add(parsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = parsers.add_parser("coupling", help=HELP, description=__doc__, allow_abbrev=False)
    add_design(parser)
    parser.add_argument(
        "--trials", type=whole(LEAST_TRIALS, 2**24), metavar="N",
        help="trials of each case (default 262144; fewer with many targets or a model that takes a plain SVD)",
    )  # fmt: skip
    parser.add_argument("--seed", type=whole(0, 2**63 - 1), default=0, metavar="N", help="seed (default %(default)s)")
    parser.add_argument(
        "--level", dest="levels", action="append", type=_level, metavar="DEG,MM",
        help="a fixed installation error: DEG about each axis through the pivot, MM along (1, 1, 1); may be repeated "
        "(default 1,2 and 2,5)",
    )  # fmt: skip
    parser.add_argument(
        "--error", choices=("tcp", "localisation"), default="tcp", help="which error (default %(default)s)"
    )
    parser.add_argument("--target", metavar="NAME", help="target that is shown (default: the largest P95)")
    parser.add_argument("--figure", metavar="FILE", help="draw the ratios (.svg)")
    parser.add_argument("--threads", type=whole(1, 1024), metavar="N", help="threads; the answer does not depend on it")


def _level(text: str) -> tuple[float, float]:
    try:
        rotation, translation = (float(part) for part in text.split(","))
        if not (abs(rotation) <= 45 and abs(translation) <= 1000):
            raise ValueError
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"expected DEG,MM like 1,2 (at most 45 deg and 1000 mm); got {text!r}"
        ) from None
    return rotation, translation


def run(arguments: argparse.Namespace) -> Answer:
    design = read_design(arguments.design)

    from tailstack.design import compile_design
    from tailstack.errors import Problem
    from tailstack.studies.coupling import LEVELS, study_coupling

    from ...console.files import writable_figure, write_figure
    from ...documents import to_json
    from ...problems import RequestError
    from ...rendering.studies.coupling import coupling_svg, coupling_text

    figure = None if arguments.figure is None else writable_figure(arguments.figure)
    names = [target.name for target in compile_design(design).targets]
    if arguments.target is not None and arguments.target not in names:
        detail = f"no target is called {arguments.target!r}; there are {', '.join(names[:20])}"
        raise RequestError(Problem("", "unknown-target", detail))
    with Progress("study coupling") as progress:
        result = study_coupling(
            design, trials=arguments.trials, seed=arguments.seed, levels=tuple(arguments.levels or LEVELS),
            error=arguments.error, threads=arguments.threads, progress=progress.report,
        )  # fmt: skip
    if figure is not None:
        write_figure(figure, coupling_svg(result, arguments.target))
    if arguments.json:
        return Answer(to_json(result))
    return Answer(coupling_text(result, arguments.target))

"""First order, second order and Monte Carlo over a grid of noise, rotation, spread and count.

Where the first-order P95 is within 1, 5 and 20 %, where it is optimistic, and whether the validity number nu knew.
Every axis takes V1,V2,... in place of its default values.
"""

from __future__ import annotations

import argparse

from tailstack.studies.linearity import LEAST_TRIALS

from ...console.answer import NOT_EVALUATED, PASS, Answer
from ...console.arguments import add_design, add_figure, add_form, read_design, whole
from ...console.progress import Progress

HELP = "where first order holds: a map over noise, rotation, spread and count"


def add(parsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = parsers.add_parser("linearity", help=HELP, description=__doc__, allow_abbrev=False)
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


def _numbers(said: str) -> tuple[float, ...]:
    from math import isfinite

    try:
        values = tuple(float(part) for part in said.split(","))
        if not all(map(isfinite, values)):
            raise ValueError
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"expected numbers with commas between them like 0.3,1,3; got {said!r}"
        ) from None
    return values


def _whole_numbers(said: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in said.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected whole numbers like 12,8,6; got {said!r}") from None


def run(arguments: argparse.Namespace) -> Answer:
    design = read_design(arguments.design)

    from tailstack.studies.linearity import study_linearity

    from ...console.files import writable_figure, write_figure
    from ...documents import to_json
    from ...rendering.studies.linearity import linearity_csv, linearity_svg, linearity_text

    figure = None if arguments.figure is None else writable_figure(arguments.figure)
    axes = {
        "noises_px": arguments.noise, "rotations_deg": arguments.rotation, "spreads": arguments.spread,
        "counts": arguments.count,
    }  # fmt: skip
    with Progress("study linearity") as progress:
        study = study_linearity(
            design, target=arguments.target, error=arguments.error, trials=arguments.trials, seed=arguments.seed,
            threads=arguments.threads, progress=progress.report,
            **{name: values for name, values in axes.items() if values is not None},
        )  # fmt: skip
    if figure is not None:
        write_figure(figure, linearity_svg(study))
    code = PASS if any(point.status == "ok" for point in study.points) else NOT_EVALUATED
    if arguments.json:
        return Answer(to_json(study), code)
    return Answer(linearity_csv(study) if arguments.csv else linearity_text(study), code)

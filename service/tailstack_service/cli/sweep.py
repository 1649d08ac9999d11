"""Many designs from one: numbers of the design varied over a grid, every point scored or checked.

PATH names a number of the document by its fields with dots between them (views.AP.fiducial_noise_px), or by a JSON
pointer (/views/0/fiducial_noise_px); * stands for every element (views.*.fiducial_noise_px).
"""

from __future__ import annotations

import argparse
from typing import Any

from .answer import NOT_EVALUATED, PASS, Answer
from .design_input import add_design, coloured_output, read_design, whole
from .progress import Progress

HELP = "score or check many designs: numbers of one varied over a grid"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_design(parser, json=False)
    parser.add_argument(
        "--set", dest="axes", action="append", required=True, type=_axis, metavar="PATH=VALUES",
        help="START:STOP:COUNT evenly spaced values, or V1,V2,... ; once for each axis, the last one runs fastest",
    )  # fmt: skip
    form = parser.add_mutually_exclusive_group()
    form.add_argument(
        "--json", action="store_true", help="print the record as JSON (tailstack schema sweep); a refusal is then a "
        "problem document on stderr",
    )  # fmt: skip
    form.add_argument("--csv", action="store_true", help="print one line of CSV for each point and target")
    parser.add_argument(
        "--check", choices=("score", "verification"), default="score", help="what is computed (default %(default)s)"
    )
    parser.add_argument("--trials", type=whole(2), metavar="N", help="trials of each verification")
    parser.add_argument(
        "--seed", type=whole(0, 2**63 - 1), default=0, metavar="N", help="seed of every verification (default 0)"
    )


def _axis(text: str) -> tuple[str, dict[str, Any]]:
    """The path, and its values as they stand in a request."""
    path, found, said = text.rpartition("=")
    try:
        if not found or not path:
            raise ValueError
        if ":" in said:
            start, stop, count = said.split(":")
            return path, {"start": float(start), "stop": float(stop), "count": int(count)}
        return path, {"values": [float(value) for value in said.split(",")]}
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"expected PATH=START:STOP:COUNT or PATH=V1,V2,... like views.*.fiducial_noise_px=0.1:0.5:5; got {text!r}"
        ) from None


def run(arguments: argparse.Namespace) -> Answer:
    design = read_design(arguments.design)

    from tailstack.errors import Problem
    from tailstack.sweeping import axis_pointer, read_axes, sweep

    from ..documents import to_json
    from ..problems import RequestError
    from ..rendering.sweep import sweep_csv, sweep_text

    if arguments.trials is not None and arguments.check == "score":
        detail, hint = "a score draws no trials", "add --check verification, or leave --trials out"
        raise RequestError(Problem("", "no-trials", detail, hint))
    asked = [{"pointer": axis_pointer(design, path), **values} for path, values in arguments.axes]
    axes = read_axes(design, asked)
    with Progress("sweep") as progress:
        result = sweep(
            design, axes, check=arguments.check, trials=arguments.trials, seed=arguments.seed, progress=progress.report
        )
    code = PASS if any(point.status == "ok" for point in result.points) else NOT_EVALUATED
    if arguments.json:
        return Answer(to_json(result, indent=2), code)
    if arguments.csv:
        return Answer(sweep_csv(result), code)
    return Answer(sweep_text(result, colour=coloured_output()), code)

"""Many designs from one: numbers of the design varied over a grid, every point scored or checked.

PATH names a number of the document by its fields with dots between them (views.AP.fiducial_noise_px), or by a JSON
pointer (/views/0/fiducial_noise_px); * stands for every element (views.*.fiducial_noise_px).
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from ..console.answer import NOT_EVALUATED, PASS, Answer
from ..console.arguments import add_design, add_figure, add_form, coloured_output, read_design, whole
from ..console.progress import Progress

if TYPE_CHECKING:
    from tailstack.design import Design
    from tailstack.results.sweep import Sweep

HELP = "score or check many designs: numbers of one varied over a grid"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_design(parser, json=False)
    parser.add_argument(
        "--set", dest="axes", action="append", required=True, type=_axis, metavar="PATH=VALUES",
        help="START:STOP:COUNT evenly spaced values, or V1,V2,... ; once for each axis, the last one runs fastest",
    )  # fmt: skip
    add_form(parser, "sweep", "point and target")
    parser.add_argument(
        "--check", choices=("score", "verification"), default="score", help="what is computed (default %(default)s)"
    )
    parser.add_argument("--trials", type=whole(2), metavar="N", help="trials of each verification")
    parser.add_argument(
        "--seed", type=whole(0, 2**63 - 1), default=0, metavar="N", help="seed of every verification (default 0)"
    )
    add_figure(parser, "P95 over one axis of several values, or two")
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--engine", choices=("pool", "dask"),
        help="compute on processes of this host, or on the Dask cluster of the settings; the answer is the same",
    )  # fmt: skip
    where.add_argument(
        "--remote", metavar="URL", help="let a running service compute, with the key in TAILSTACK_KEY; same answer"
    )
    parser.add_argument(
        "--processes", type=whole(1, 256), metavar="N", help="of engine pool (default TAILSTACK_WORKER_PROCESSES)"
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

    from ..console.files import writable_figure, write_figure
    from ..documents import to_json
    from ..problems import RequestError
    from ..rendering.sweep import sweep_csv, sweep_text
    from ..rendering.sweep_figure import refuse_undrawable, sweep_svg

    if arguments.trials is not None and arguments.check == "score":
        detail, hint = "a score draws no trials", "add --check verification, or leave --trials out"
        raise RequestError(Problem("", "no-trials", detail, hint))
    if arguments.processes is not None and arguments.engine != "pool":
        raise RequestError(Problem("", "no-pool", "--processes is of --engine pool", "add it, or leave this out"))
    figure = None if arguments.figure is None else writable_figure(arguments.figure)
    asked = [{"pointer": axis_pointer(design, path), **values} for path, values in arguments.axes]
    axes = read_axes(design, asked)
    if figure is not None:
        refuse_undrawable([axis.values for axis in axes])
    with Progress("sweep") as progress:
        if arguments.engine is None and arguments.remote is None:
            result = sweep(
                design, axes, check=arguments.check, trials=arguments.trials, seed=arguments.seed,
                progress=progress.report,
            )  # fmt: skip
        else:
            result = _elsewhere(arguments, design, asked, progress)
    if figure is not None:
        write_figure(figure, sweep_svg(result))
    code = PASS if any(point.status == "ok" for point in result.points) else NOT_EVALUATED
    if arguments.json:
        return Answer(to_json(result), code)
    if arguments.csv:
        return Answer(sweep_csv(result), code)
    return Answer(sweep_text(result, colour=coloured_output()), code)


def _elsewhere(arguments: argparse.Namespace, design: Design, asked: list[dict[str, Any]], progress: Progress) -> Sweep:
    """The record by way of the request that a service takes.  Raises RemoteError, RefusedJob, RequestError."""
    from contextlib import closing

    from tailstack.design import design_to_data

    alone = design.document.fiducials.file is None
    trials = {} if arguments.trials is None else {"trials": arguments.trials}
    request = {
        "design": design.source.data if alone else design_to_data(design), "axes": asked, "check": arguments.check,
        "seed": arguments.seed, **trials,
    }  # fmt: skip
    if arguments.remote is not None:
        from .remote import Service, compute_remotely

        service = Service(arguments.remote)
        return _record(compute_remotely(service, "/v1/sweeps", request, progress), design, asked, service.url)

    from ..console.arguments import read_settings
    from ..documents import read_record
    from ..jobs.alone import compute_job
    from ..jobs.engines.engine import start_engine
    from ..work.requests import canonical

    with closing(start_engine(read_settings(arguments))) as engine:
        result: Sweep = read_record("sweep", compute_job(engine, "sweep", canonical(request), progress.report))
    return result


def _record(body: bytes, design: Design, asked: list[dict[str, Any]], url: str) -> Sweep:
    """What a service answered, if it is the sweep that was asked for.  Raises RemoteError."""
    from pydantic import ValidationError

    from tailstack.errors import Problem

    from ..documents import read_record
    from .remote import RemoteError

    try:
        result: Sweep = read_record("sweep", body)
        pointers = [axis.pointer for axis in result.axes]
        if result.provenance.design_sha256 != design.sha256 or pointers != [axis["pointer"] for axis in asked]:
            raise ValueError("it is about another design or other numbers of it")
    except (ValidationError, ValueError) as error:
        detail = f"{url} answered with something that is not this sweep: {str(error).splitlines()[0]}"
        problem = Problem("", "unexpected-answer", detail, "is it a tailstack of this version? tailstack version")
        raise RemoteError("unexpected-answer", "The service gave an unexpected answer", 0, (problem,)) from None
    return result

"""Move fiducials and set rotational half-widths at least cost under the design's limit, verified by Monte Carlo."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from .answer import Answer, exit_code_of
from .design_input import add_design, coloured_output, read_design, whole
from .progress import Progress

HELP = "placement and rotational budgets at least cost"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_design(parser)
    parser.add_argument("-o", "--output", metavar="NEW", help="write the new design here (.yaml or .json)")
    parser.add_argument("--seed", type=whole(0, 2**63 - 1), metavar="N", help="seed (default: the design's)")
    parser.add_argument("--starts", type=whole(1, 256), metavar="N", help="starting layouts (default: the design's)")


def run(arguments: argparse.Namespace) -> Answer:
    output = None if arguments.output is None else writable(arguments.output)
    design = read_design(arguments.design)

    from tailstack import optimise

    from ..documents import to_json
    from ..rendering.optimisation import optimisation_text

    with Progress("optimise") as progress:

        def report(stage: str, done: int, total: int, least: float | None) -> None:
            cost = "" if least is None else f", least cost so far {least:.5g}"
            # the checks come last and are quick: they do not move the fraction
            progress.report(*((done, total) if stage == "start" else (1, 1)), f"{stage} {done} of {total}{cost}")

        result = optimise(design, seed=arguments.seed, starts=arguments.starts, progress=report)
    if output is not None:
        write_design(result.design, output)
        print(f"wrote {output}", file=sys.stderr)
    code = exit_code_of(result.certificate.verification.verdict)
    if arguments.json:
        return Answer(to_json(result, indent=2), code)
    return Answer(optimisation_text(result, colour=coloured_output()), code)


def writable(name: str) -> Path:
    """A path for a new design, refused before the work and not after it.  Raises RequestError."""
    from tailstack.errors import Problem

    from ..problems import RequestError

    path = Path(name)
    if path.suffix.lower() not in (".yaml", ".yml", ".json"):
        raise RequestError(Problem("", "unknown-format", f"{name!r} has no known ending", "known: .yaml, .yml, .json"))
    if not path.parent.is_dir() or path.is_dir():
        raise RequestError(Problem("", "file-unwritable", f"cannot write {name}: no such directory, or a directory"))
    return path


def write_design(data: dict[str, object], path: Path) -> None:
    """Write a design whole or not at all."""
    import json
    import os

    from tailstack.design.loading import data_to_yaml

    is_json = path.suffix.lower() == ".json"
    text = json.dumps(data, indent=2, ensure_ascii=False) + "\n" if is_json else data_to_yaml(data)
    beside = path.with_name(path.name + f".{os.getpid()}.part")
    try:
        beside.write_text(text, encoding="utf-8")
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)

"""First order: bias, covariance, P95, bounds and budget at every target, and the verdict."""

from __future__ import annotations

import argparse

from ..console.answer import Answer, exit_code_of
from ..console.arguments import add_design, coloured_output, read_design

HELP = "first-order score: P95 bound, covariance, budget"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_design(parser)
    parser.add_argument("--second-order", action="store_true", help="add the second-order correction where it holds")
    parser.add_argument("--target", metavar="NAME", help="target whose budget is shown (default: the largest P95)")


def run(arguments: argparse.Namespace) -> Answer:
    design = read_design(arguments.design)  # bad input is refused before the solver is loaded

    from tailstack.errors import Problem
    from tailstack.scoring import score

    from ..documents import to_json
    from ..problems import RequestError
    from ..rendering.score import score_text

    result = score(design, second_order=arguments.second_order)
    names = [target.name for target in result.targets]
    if arguments.target is not None and arguments.target not in names:
        listed = ", ".join(names[:20])
        raise RequestError(
            Problem("", "unknown-target", f"no target is called {arguments.target!r}; there are {listed}")
        )
    code = exit_code_of(result.verdict)
    if arguments.json:
        return Answer(to_json(result), code)
    return Answer(score_text(result, target=arguments.target, colour=coloured_output()), code)

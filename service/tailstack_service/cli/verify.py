"""Monte Carlo on the full nonlinear chain: P95 with its interval, exceedance, and the verdict."""

from __future__ import annotations

import argparse

from ..console.answer import Answer, exit_code_of
from ..console.arguments import add_design, coloured_output, read_design, whole
from ..console.progress import Progress

HELP = "Monte Carlo check of the full nonlinear chain"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_design(parser)
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--trials", type=whole(1), metavar="N", help="number of trials")
    size.add_argument(
        "--precision",
        type=precision,
        metavar="REL",
        help="stop when the interval of P95 is within +-REL of it, e.g. 0.01",
    )
    add_most(parser)
    parser.add_argument("--seed", type=whole(0, 2**63 - 1), default=0, metavar="N", help="seed (default %(default)s)")
    parser.add_argument(
        "--method", choices=("plain", "radial"), default="plain", help="estimator of the quantile (default %(default)s)"
    )
    parser.add_argument("--threads", type=whole(1, 1024), metavar="N", help="threads; the answer does not depend on it")


def add_most(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--max-trials", type=whole(1000), metavar="N",
        help="give up --precision after so many (default 4194304; a service may be set to another number)",
    )  # fmt: skip


def precision(text: str) -> float:
    """An argparse type: a relative half-width."""
    from tailstack.precision import FINEST_PRECISION as FINEST

    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected a number like 0.01; got {text!r}") from None
    if not FINEST <= value < 1:
        raise argparse.ArgumentTypeError(
            f"expected a relative half-width of at least {FINEST:g} and below 1; got {text}"
        )
    return value


def run(arguments: argparse.Namespace) -> Answer:
    design = read_design(arguments.design)  # bad input is refused before the solver is loaded

    from tailstack.verification import MAX_TRIALS, verify

    from ..documents import to_json
    from ..rendering.verification import verification_text

    with Progress("verify") as progress:
        result = verify(
            design,
            trials=arguments.trials,
            precision=arguments.precision,
            seed=arguments.seed,
            method=arguments.method,
            max_trials=arguments.max_trials or MAX_TRIALS,
            threads=arguments.threads,
            progress=progress.report,
        )
    code = exit_code_of(result.verdict)
    if arguments.json:
        return Answer(to_json(result), code)
    return Answer(verification_text(result, colour=coloured_output()), code)

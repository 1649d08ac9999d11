"""Compile the kernels that commands call, so that none of them has to: when an image is built, or before a deadline."""

from __future__ import annotations

import argparse

from ..console.command_line import PASS, Answer

HELP = "compile kernels ahead"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    words = "what these verbs call, such as score,gate (default: what any of them calls)"
    parser.add_argument("--for", dest="verbs", metavar="VERB,...", type=_verbs, default=("demo",), help=words)


def _verbs(text: str) -> tuple[str, ...]:
    from .main import verbs

    chosen = tuple(part.strip() for part in text.split(",") if part.strip())
    for verb in chosen:
        if verb not in verbs():
            raise argparse.ArgumentTypeError(f"there is no verb {verb!r}: expected some of {', '.join(verbs())}")
    return chosen


def run(arguments: argparse.Namespace) -> Answer:
    from ..console.compilation import compile_for, describe_calls

    count = compile_for(arguments.verbs)
    return Answer(f"{describe_calls(arguments.verbs)}; {count or 'none'} compiled now\n", PASS)

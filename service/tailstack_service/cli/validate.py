"""Parse and check designs without computing anything."""

from __future__ import annotations

import argparse
import sys

from ..console.answer import PASS, Answer
from ..console.arguments import read_design

HELP = "parse and check, no computing"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("design", metavar="DESIGN", nargs="+", help="design documents, YAML or JSON; - reads stdin")


def run(arguments: argparse.Namespace) -> Answer:
    from tailstack.errors import TailstackError

    from ..documents import validate
    from ..rendering.validation import validation_text
    from .refusals import name_stdin, next_command, problem_text

    lines, codes = [], []
    for name in arguments.design:
        try:
            lines.append(validation_text(name, validate(read_design(name))))
        except TailstackError as error:
            codes.append(error.exit_code)
            print("\n".join(problem_text(problem) for problem in name_stdin(error.problems, name)), file=sys.stderr)
            print(next_command(error.slug, argparse.Namespace(verb="validate", design=name)), file=sys.stderr)
            lines.append(f"{name}: not valid, {len(error.problems)} problem(s)\n")
    # a document that breaks the rules (2) counts before one that is ill-posed (3)
    return Answer("".join(lines), min(codes, default=PASS))

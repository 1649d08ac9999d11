"""``tailstack VERB ...``: parse, call the verb, write its answer, turn every refusal into text and an exit code."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

from ..names import TRACEBACK
from .answer import BAD_INPUT, INTERRUPTED, NOT_EVALUATED, PASS, Answer
from .verbs import VERBS, program, typed

EPILOG = """\
exit codes: 0 pass · 1 the design fails · 2 bad input or usage · 3 could not evaluate · 4 inconclusive · 130 interrupted
start with: tailstack demo, then tailstack score examples/demo.yaml (DESIGN may be - for stdin)
"""


class _Parser(argparse.ArgumentParser):
    """Usage errors name the next command, and leave with the code for bad input."""

    def error(self, message: str) -> NoReturn:
        self.exit(BAD_INPUT, f"{self.prog}: {message}\nnext: {self.prog} --help\n")

    def format_help(self) -> str:
        return typed(super().format_help())


def build_parser() -> argparse.ArgumentParser:
    """Parser of every verb.  Importing the verbs is cheap: they load numpy and the rest when they run."""
    parser = _Parser(
        prog=program(),
        description="Tolerance stack-up of X-ray reference structures, judged by its tail.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", parser_class=_Parser)
    for name in VERBS:
        module = import_module(f"tailstack_service.cli.{name}")
        verb = verbs.add_parser(name, help=module.HELP, description=module.__doc__, allow_abbrev=False)
        module.add_arguments(verb)
        verb.set_defaults(run=module.run)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.  Returns the exit code; raises nothing that a caller could cause."""
    _speak_utf8_where_possible()
    parser = build_parser()
    try:
        arguments = parser.parse_args(argv)
        if arguments.verb is None:
            parser.print_help(sys.stderr)
            return BAD_INPUT
    except SystemExit as leaving:  # argparse: --help, or a usage error that it has already explained
        return leaving.code if isinstance(leaving.code, int) else BAD_INPUT
    except BrokenPipeError:
        return _reader_left(PASS)
    return _guarded(arguments)


def _guarded(arguments: argparse.Namespace) -> int:
    from tailstack.errors import TailstackError

    from .refusals import report_error, report_failure

    answer: Answer = Answer("", NOT_EVALUATED)
    try:
        answer = arguments.run(arguments)
        _write(answer.body)
    except KeyboardInterrupt:
        print("tailstack: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        return _reader_left(answer.exit_code)
    except (TailstackError, OSError) as error:
        if os.environ.get(TRACEBACK):
            raise
        return report_error(error, arguments)
    except Exception as error:
        if os.environ.get(TRACEBACK):
            raise
        return report_failure(error, arguments)
    return int(answer.exit_code)


def _write(body: str | bytes) -> None:
    if isinstance(body, bytes):
        sys.stdout.flush()
        sys.stdout.buffer.write(body if body.endswith(b"\n") else body + b"\n")
    else:
        sys.stdout.write(body)
    sys.stdout.flush()


def _reader_left(exit_code: int) -> int:
    """The reader of a pipe closed it: what was computed still decides the exit code."""
    devnull = os.open(os.devnull, os.O_WRONLY)
    os.dup2(devnull, sys.stdout.fileno())  # or the interpreter's last flush would complain
    return exit_code


def _speak_utf8_where_possible() -> None:
    """A terminal that cannot show a character gets a question mark, not a traceback."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


if __name__ == "__main__":
    sys.exit(main())

"""``tailstack VERB ...``: parse, call the verb, write its answer, turn every refusal into text and an exit code."""

from __future__ import annotations

import argparse
import atexit
import gc
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

from ..console.answer import BAD_INPUT, INTERRUPTED, NOT_EVALUATED, PASS, Answer
from ..console.answer import write_out as _write
from ..console.program import INSTALLED, know_verbs, program, spell_commands
from .verbs import OWN, verbs

EPILOG = """\
exit codes: 0 pass · 1 the design fails · 2 bad input or usage · 3 could not evaluate · 4 inconclusive · 130 interrupted
start with: tailstack demo, then tailstack score examples/demo.yaml (DESIGN may be - for stdin)
"""


class _Parser(argparse.ArgumentParser):
    """Usage errors name the next command, and leave with the code for bad input."""

    def error(self, message: str) -> NoReturn:
        self.exit(BAD_INPUT, f"{self.prog}: {message}\nnext: {self.prog} --help\n")

    def format_help(self) -> str:
        return spell_commands(super().format_help())


def build_parser(verb: str | None = None) -> argparse.ArgumentParser:
    """Parser of one verb, or of all.  Importing a verb is cheap: it loads numpy and the rest when it runs."""
    parser = _Parser(
        prog=program(),
        description="Tolerance stack-up of X-ray reference structures, judged by its tail.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parsers = parser.add_subparsers(dest="verb", metavar="VERB", parser_class=_Parser)
    for name in verbs() if verb is None else (verb,):
        if name in OWN:
            module = import_module(f"tailstack_service.cli.{name}")
            own = parsers.add_parser(name, help=module.HELP, description=module.__doc__, allow_abbrev=False)
            module.add_arguments(own)
            own.set_defaults(run=module.run)
        else:
            from .operation import add_verb

            add_verb(parsers, name)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.  Returns the exit code; raises nothing that a caller could cause."""
    _speak_utf8_where_possible()
    _leave_quickly()
    argv = sys.argv[1:] if argv is None else argv
    if program() != INSTALLED:
        know_verbs(verbs())  # they are spell_commands in another way here
    parser = build_parser(argv[0] if argv and (argv[0] in OWN or argv[0] in verbs()) else None)
    try:
        arguments = parser.parse_args(argv)
        if arguments.verb is None:
            parser.print_help(sys.stderr)
            return BAD_INPUT
    except SystemExit as leaving:  # argparse: --help, or a usage error that it has already explained
        return leaving.code if isinstance(leaving.code, int) else BAD_INPUT
    except BrokenPipeError:
        return _reader_left(PASS)
    return _run_verb(arguments)


def _leave_quickly() -> None:
    """At exit the interpreter looks for cycles among all that numba, pydantic and LLVM have made, several times: a
    third of what a gate of ten designs takes.  What is frozen it does not look at."""
    atexit.unregister(gc.freeze)  # once, however often a program calls main
    atexit.register(gc.freeze)


def _run_verb(arguments: argparse.Namespace) -> int:
    from tailstack.errors import TailstackError

    from ..console.refusals import report_error, report_failure

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
        return report_error(error, arguments)
    except Exception as error:
        return report_failure(error, arguments)
    return int(answer.exit_code)


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


def command() -> NoReturn:
    """The program: ``main``, and the end of the process with its code."""
    gc.set_threshold(10_000)  # the usual 700 searches a start, which makes a quarter of a million objects, 330 times
    sys.exit(main())


if __name__ == "__main__":
    command()

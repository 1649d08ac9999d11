"""``tailstack VERB ...``: parse, call the verb, write its answer, turn every refusal into text and an exit code."""

from __future__ import annotations

import argparse
import atexit
import gc
import os
import signal
import sys
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from threading import Timer
from typing import NoReturn

from tailstack.errors import TailstackError
from tailstack.extras import name_missing_extra
from tailstack.kernels.process import SINGLE_THREADED, ignore_settings_of_folder, load_late, prepare_with
from tailstack.version import __version__

from ..console.command_line import (
    BAD_INPUT,
    INSTALLED,
    INTERRUPTED,
    NOT_EVALUATED,
    PASS,
    Answer,
    Parser,
    know_verbs,
    page_of,
    program,
    refuse_verb,
    write_out,
)
from ..operations.registry import OPERATIONS, VERB_OF

FIRST = ("demo", "init", "example")
LAST = (
    "serve", "worker", "jobs", "db", "keys", "words", "schema", "openapi", "doctor", "warm-up", "version",
)  # fmt: skip
SPELLINGS = {"optimize": "optimise"}  # of verbs, accepted as well
# Verbs with a module of their own in this package (gate and report take more than a design)
OWN = frozenset({*FIRST, *LAST, "gate", "report"})
EPILOG = """\
exit codes: 0 pass · 1 the design fails · 2 bad input or usage · 3 could not evaluate · 4 inconclusive · 130 interrupted

start with: tailstack demo, or tailstack init and then tailstack score design.yaml (DESIGN may be - for stdin)
"""


@cache
def verbs() -> tuple[str, ...]:
    """All verbs, in the order in which they are listed."""
    of_operations = dict.fromkeys(verb.partition(" ")[0] for verb in VERB_OF.values())
    return (*FIRST, *of_operations, *LAST)


def build_parser(verb: str | None = None) -> argparse.ArgumentParser:
    """Parser of one verb, or of all.

    Importing a verb is cheap: it loads numpy and the rest when it runs.
    """
    parser = Parser(
        prog=program(),
        description="Tolerance stack-up of X-ray reference structures: where the tool ends up, and what to change.",
        epilog=EPILOG,
    )
    parser.add_argument(
        "-V", "--version", action="version", version=f"{INSTALLED} {__version__}", help="print the version"
    )
    Parser.find_verbs = staticmethod(find_verbs_with)
    parsers = parser.add_subparsers(dest="verb", metavar="VERB", parser_class=Parser)
    for verb_name in verbs() if verb is None else (verb,):
        if verb_name in OWN:
            module = import_module(f"{__package__}.{verb_name.replace('-', '_')}")
            own = parsers.add_parser(verb_name, help=module.HELP, description=module.__doc__)
            module.add_arguments(own)
            own.set_defaults(run=module.run)
        else:
            from .operation import add_verb

            add_verb(parsers, verb_name)
    return parser


def find_verbs_with(flag: str) -> list[str]:
    """Verbs of operations that have this flag for an option."""
    from ..console.flags import list_options  # which loads pydantic

    options = ((operation.verb, each) for operation in OPERATIONS.values() for each in list_options(operation.options))
    has = (verb for verb, each in options if each.has_flag and each.spelling == flag)
    return list(dict.fromkeys(has))


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.  Returns the exit code; raises nothing that a caller could cause."""
    try:
        return _run(argv)
    except KeyboardInterrupt:  # wherever it comes: while a library is being loaded, too
        print("tailstack: interrupted", file=sys.stderr)
        return INTERRUPTED


def _run(argv: Sequence[str] | None) -> int:
    _speak_utf8_where_possible()
    _leave_quickly()
    argv = list(sys.argv[1:] if argv is None else argv)
    if program() != INSTALLED:
        know_verbs(verbs())  # they are spell_commands in another way here
    if argv[:1] == ["help"]:
        argv = [*argv[1:], "--help"]
    if argv:
        argv[0] = SPELLINGS.get(argv[0], argv[0])
        if argv[0] not in verbs() and argv[0] not in ("-h", "--help", "-V", "--version"):
            return refuse_verb(argv[0], argv[1:], verbs())
    parser = build_parser(argv[0] if argv and argv[0] in verbs() else None)
    try:
        arguments = parser.parse_args(argv)
        if arguments.verb is None:
            parser.print_help(sys.stderr)
            return BAD_INPUT
    except SystemExit as leaving:  # argparse: --help, or a usage error that it has already explained
        return leaving.code if isinstance(leaving.code, int) else BAD_INPUT
    except BrokenPipeError:  # the reader has left
        _drop_unwritten()
        return PASS
    return _run_verb(arguments)


def _leave_quickly() -> None:
    """At exit the interpreter looks for cycles among all that numba, pydantic and LLVM have made, several times: a
    third of what a gate of ten designs takes.  What is frozen it does not look at."""
    atexit.unregister(gc.freeze)  # once, however often a program calls main
    atexit.register(gc.freeze)


def _run_verb(arguments: argparse.Namespace) -> int:
    from ..console.refusals import report_error, report_failure
    from ..rendering.text import write_on

    def compile_ahead() -> None:
        from ..console.compilation import compile_for

        compile_for([arguments.verb])

    prepare_with(compile_ahead)  # which is not called where every kernel is there
    answer: Answer = Answer("", NOT_EVALUATED)
    try:
        with name_missing_extra(), write_on(page_of(arguments)):
            answer = arguments.run(arguments)
        write_out(answer.body)
    except BrokenPipeError:  # the reader has left: what was computed still decides the exit code
        _drop_unwritten()
    except (TailstackError, OSError) as error:
        code = report_error(error, arguments)
        _drop_unwritten()
        return code
    except Exception as error:
        return report_failure(error, arguments)
    finally:
        prepare_with(None)
    return int(answer.exit_code)


def _drop_unwritten() -> None:
    """What stdout does not take: the interpreter would complain of it at its end, and Python 3.13 leave with 120."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _speak_utf8_where_possible() -> None:
    """A terminal that cannot show a character gets a question mark, not a traceback."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def command() -> NoReturn:
    """The program: ``main``, and the end of the process with its code."""
    ignore_settings_of_folder()
    load_late()
    for name, threads in SINGLE_THREADED.items():
        os.environ.setdefault(name, threads)
    sys.unraisablehook = _repeat_interrupt
    gc.set_threshold(300_000)  # a start makes a quarter of a million objects: the usual 700 searches them 330 times
    gc.callbacks.append(_search_more_often)
    code = main()
    if code == INTERRUPTED:
        _forget_interrupt()
    sys.exit(code)


def _search_more_often(phase: str, _: dict[str, int]) -> None:
    """For cycles, after the first search: a short command never comes to one, a service keeps its memory.  Among what a
    start has made, which stays, no later one looks again."""
    if phase == "stop":
        gc.callbacks.remove(_search_more_often)
        gc.freeze()
        gc.set_threshold(10_000)


def _repeat_interrupt(ignored: sys.UnraisableHookArgs) -> None:
    """An interrupt that came while LLVM called Python, as it does while a kernel is loaded, is ignored there: CPython
    has nobody to raise it to.  It is sent again when that call has ended."""
    if issubclass(ignored.exc_type, KeyboardInterrupt):
        Timer(0.05, os.kill, (os.getpid(), signal.SIGINT)).start()
    else:
        sys.__unraisablehook__(ignored)


def _forget_interrupt() -> None:
    """Under ``python -m`` CPython remembers that an interrupt left a text that was executed (``exec`` of a string, as
    dataclasses and numba make functions), also where it was caught outside of it, and ends the process by the signal
    after all, in place of the code.  The next text that is executed makes it forget."""
    exec("")


if __name__ == "__main__":
    command()

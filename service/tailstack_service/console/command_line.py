"""The command line that all verbs share: its parser, their common arguments, what a verb answers and its exit code."""

from __future__ import annotations

import argparse
import errno
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from tailstack.cures import ask_label, ask_meant, find_nearest
from tailstack.errors import Problem

from ..environment import COMMAND
from ..rendering.text import WIDTH, Page

if TYPE_CHECKING:
    from tailstack.design import Design
    from tailstack.results import Verdict
    from tailstack.results.sweep import Sweep
    from tailstack.studies.linearity import StudyLinearity

    from ..settings import Settings

PASS, FAIL, BAD_INPUT, NOT_EVALUATED, INCONCLUSIVE, INTERRUPTED = 0, 1, 2, 3, 4, 130
EXIT_CODE = {"pass": PASS, "no requirement": PASS, "fail": FAIL, "inconclusive": INCONCLUSIVE}


@dataclass(frozen=True, slots=True)
class Answer:
    """Text for stdout (bytes when it is JSON, which is UTF-8 whatever the terminal speaks) and the exit code."""

    body: str | bytes
    exit_code: int = PASS


def exit_code_of(verdict: Verdict) -> int:
    return EXIT_CODE[verdict.status]


def exit_code_of_points(record: Sweep | StudyLinearity) -> int:
    """Of a grid: it was evaluated if any of its points was."""
    return PASS if any(point.status == "ok" for point in record.points) else NOT_EVALUATED


def write_out(body: str | bytes) -> None:
    """An answer to stdout, its last line ended.  Raises BrokenPipeError where the reader has left, OutputError."""
    try:
        if sys.stdout is None:
            raise OSError(errno.EBADF, "it is closed")
        if isinstance(body, bytes):
            sys.stdout.flush()
            sys.stdout.buffer.write(body if body.endswith(b"\n") or not body else body + b"\n")
        else:
            sys.stdout.write(body)
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        from ..problems import OutputError

        detail = f"cannot write to standard output: {error.strerror or error}"
        raise OutputError(Problem("", "not-written", detail)) from error


# --- what the command is called here, what is wrong with one, what was meant, what to type next -------

INSTALLED = "tailstack"
_verbs: list[str] = []
DOCUMENTS = (".yaml", ".yml", ".json")


def know_verbs(verbs: Iterable[str]) -> None:
    """Say which words after ``tailstack`` are verbs; the command does so when it starts."""
    _verbs[:] = verbs


def program() -> str:
    """What a person types before the verb: ``tailstack``, or ``./run tailstack`` in a checkout."""
    return os.environ.get(COMMAND) or INSTALLED


def spell_commands(text: str) -> str:
    """The text with the commands in it (``tailstack score ...``) as they are typed here."""
    here = program()
    if here == INSTALLED or not _verbs:
        return text
    before = re.escape(here.removesuffix(INSTALLED))
    return re.sub(rf"(?<!{before})\b{INSTALLED} (?=({'|'.join(_verbs)})\b)", lambda _: f"{here} ", text)


class Parser(argparse.ArgumentParser):
    """Usage errors name what was perhaps meant and the next command, and leave with the code for bad input."""

    find_verbs: Callable[[str], list[str]] = staticmethod(lambda flag: [])  # that have a flag

    def __init__(self, **named: Any) -> None:
        named.setdefault("allow_abbrev", False)
        named.setdefault("formatter_class", argparse.RawDescriptionHelpFormatter)
        super().__init__(**named)

    def error(self, message: str) -> NoReturn:
        self.exit(BAD_INPUT, f"{self.prog}: {message}\nnext: {self.prog} --help\n")

    def format_help(self) -> str:
        """Paragraphs as wide as the terminal; what has indented lines is laid out already."""
        width = shutil.get_terminal_size().columns
        paragraphs = spell_commands(super().format_help()).rstrip("\n").split("\n\n")
        return "\n\n".join(text if "\n " in text else textwrap.fill(text, width) for text in paragraphs) + "\n"

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Refused here, what is left over is refused with the verb's own name and flags."""
        parsed, rest = super().parse_known_args(args, namespace)
        if rest:
            self.error(self._explain_rest(rest))
        return parsed, rest

    def _explain_rest(self, rest: Sequence[str]) -> str:
        text = f"unrecognized arguments: {' '.join(rest)}"
        flags = [flag for action in self._actions for flag in action.option_strings]
        for word in rest:
            if word.startswith("-"):
                flag = word.partition("=")[0]
                meant = suggest(flag, (flag for flag in flags if flag.startswith("--")), ask_meant)
                others = [] if meant else self.find_verbs(flag)
                return text + (f"; it is a flag of {program()} {others[0]}" if others else meant)
        return text

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """As the library does it, with what was perhaps meant."""
        if action.choices is not None and value not in action.choices:
            known = [str(choice) for choice in action.choices]
            ask = ask_meant if action.option_strings else ask_label  # a verb, a shell: they are called so
            message = f"invalid choice: {value!r} (choose from {', '.join(known)}){suggest(str(value), known, ask)}"
            raise argparse.ArgumentError(action, message)


def suggest(word: str, known: Iterable[str], ask: Callable[[str, Iterable[str]], str] = ask_label) -> str:
    """``; did you mean X?`` if something known is like the word, else nothing; ``ask``: how that is found."""
    meant = ask(word, known)
    return f"; {meant}" if meant else ""


def refuse_verb(word: str, rest: Sequence[str], verbs: Sequence[str]) -> int:
    """Say what is wrong with a command whose first word is no verb.  Returns the exit code."""
    here = program()
    following = f"{here} --help"
    if word.startswith("-"):
        meant = suggest(word, ("--help", "--version"))
        detail = f"there is no flag {word!r}{meant}" if meant else f"flags stand after the verb; got {word} before it"
    elif word.lower().endswith(DOCUMENTS) or Path(word).is_file():
        detail = f"{word!r} is a file, and no verb stands before it"
        verb = next((other for other in rest if other in verbs), "score")  # DESIGN VERB: the wrong way round
        following = f"{here} {verb} {word}   (all verbs: {here} --help)"
    else:
        detail = f"there is no verb {word!r}{suggest(word, verbs)}"
        following = f"{here} {' '.join([*find_nearest(word, verbs), '--help'])}"
    print(f"{here}: {detail}\nnext: {following}", file=sys.stderr)
    return BAD_INPUT


# --- arguments that verbs share -----------------------------------------------------------------------


def add_design(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("design", metavar="DESIGN", help="design document, YAML or JSON; - reads stdin")
    add_json(parser)


def add_json(parser: argparse._ActionsContainer) -> None:
    """--json, of every verb that answers with a record."""
    words = (
        "print the answer as JSON (tailstack schema lists the schemas); a refusal is then a problem document on stderr"
    )
    parser.add_argument("--json", action="store_true", help=words)


def add_details(parser: argparse.ArgumentParser) -> None:
    """--details, of every verb that prints results for people."""
    parser.add_argument("--details", action="store_true", help="add how it was computed: method, model, every figure")


def read_design(name: str) -> Design:
    """Load a design.  Raises DesignError, LimitError, OSError."""
    from tailstack.design import load_design
    from tailstack.design.reading import DEFAULT_LIMITS

    if name == "-":
        content = sys.stdin.buffer.read(DEFAULT_LIMITS.document_bytes + 1)
        return load_design(content, base_directory=Path.cwd())
    return load_design(Path(name))


def page_of(arguments: argparse.Namespace) -> Page:
    """What a verb's texts are written on: as wide as the terminal, where there is one."""
    return Page(_count_columns(), coloured_output(), getattr(arguments, "details", False))


def _count_columns() -> int:
    """Columns of the terminal; elsewhere those that COLUMNS says, or of a usual page."""
    columns = os.environ.get("COLUMNS", "")
    if columns.isascii() and columns.isdigit() and int(columns) > 0:
        return int(columns)
    if sys.stdout is None or not sys.stdout.isatty():
        return WIDTH
    return shutil.get_terminal_size((WIDTH, 24)).columns


def coloured_output() -> bool:
    """Colour only on a terminal, and not when the user asked for none (https://no-color.org)."""
    if sys.stdout is None:  # whoever started this closed it
        return False
    return sys.stdout.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def whole(low: int, high: int | None = None) -> Any:
    """An argparse type: a whole number in a range, written 1000000, 1_000_000 or 1e6."""

    def convert(text: str) -> int:
        value = read_number(text)
        if value is None or value != value.to_integral_value():
            raise argparse.ArgumentTypeError(f"expected a whole number; got {text!r}")
        if value < low or (high is not None and value > high):
            wanted = f"at least {low}" if high is None else f"{low} to {high}"
            raise argparse.ArgumentTypeError(f"expected {wanted}; got {text}")
        return int(value)

    return convert


def number(bounds: dict[str, Any]) -> Any:
    """An argparse type: a number within bounds; where a fraction is wanted, 1% is 0.01."""
    fraction = bounds.get("le", bounds.get("lt", 2)) <= 1

    def convert(text: str) -> float:
        percent = text.strip().endswith("%")
        value = read_number(text.strip().removesuffix("%"))
        if value is None or (percent and not fraction):
            raise argparse.ArgumentTypeError(f"expected a number; got {text!r}")
        given = float(value / 100 if percent else value)
        tests = {"ge": given.__ge__, "gt": given.__gt__, "le": given.__le__, "lt": given.__lt__}
        words = {"ge": "at least", "gt": "above", "le": "at most", "lt": "below"}
        if not all(tests[name](float(bound)) for name, bound in bounds.items()):
            wanted = " and ".join(f"{words[name]} {bound:g}" for name, bound in bounds.items())
            hint = f" ({text} per cent is written {text}%)" if fraction and not percent and given > 1 else ""
            raise argparse.ArgumentTypeError(f"expected a number {wanted}; got {text}{hint}")
        return given

    return convert


MOST_DIGITS = 30  # as a whole number 1e999999999 would take half a gigabyte


def read_number(text: str) -> Decimal | None:
    """A number as people type it, with every digit; None for anything else, and for numbers beyond every use."""
    try:
        value = Decimal(text)
    except InvalidOperation:
        return None
    return value if value.is_finite() and value.adjusted() <= MOST_DIGITS else None


SETTING_OF = {"database": "database", "processes": "worker_processes", "engine": "engine"}  # by flag


def add_database(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--database", metavar="URL", help="where jobs are kept (default TAILSTACK_DATABASE)")


def read_settings(arguments: argparse.Namespace) -> Settings:
    """Raises RequestError for a setting that cannot be, or a TAILSTACK_ name in the environment that is none."""
    from ..settings import load_settings

    flags = {setting: getattr(arguments, flag, None) for flag, setting in SETTING_OF.items()}
    return load_settings(**{name: value for name, value in flags.items() if value is not None})

"""Write a first design: a C-arm, a carrier with beads, two seats, a target and a limit, each with a comment.

On a terminal it asks for what no flag says; Enter takes the value in brackets, which the design then lists as
``assumed``, as it does the seats.  The design scores as it is, and its
section optimise lets the optimiser improve it.  Correct it where yours differs.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote
from typing import Any

from tailstack.errors import Problem, TailstackError

from ..console.command_line import Answer, number, program, read_number, suggest, whole
from ..console.files import add_force, refuse_overwriting, writable
from ..first_design import Wishes, design_text, show_value, start_lengths
from ..operations.editors import write_document
from ..problems import RequestError

HELP = "write a first design, by questions or flags"

DEFAULT_FILE = "design.yaml"
FEWEST, MOST = 6, 60  # fiducials


def read_point(text: str) -> tuple[float, float, float]:
    """An argparse type: X,Y,Z."""
    values = [read_number(part) for part in text.split(",")]
    if len(values) != 3 or None in values:
        raise argparse.ArgumentTypeError(f"expected three numbers with commas between them like 0,0,90; got {text!r}")
    x, y, z = (float(value) for value in values if value is not None)
    return x, y, z


def read_preset(text: str) -> str:
    """An argparse type: the name of a view preset."""
    from tailstack.design.presets import PRESETS

    if text not in PRESETS:
        known = f"one of {', '.join(PRESETS)}"
        raise argparse.ArgumentTypeError(f"no preset is called {text!r}{suggest(text, PRESETS)} ({known})")
    return text


def read_name(text: str) -> str:
    """An argparse type: a name of one line."""
    if not text.strip() or not text.isprintable() or len(text) > 200:
        raise argparse.ArgumentTypeError(f"expected a name of one line, at most 200 characters; got {text!r}")
    return text.strip()


@dataclass(frozen=True, slots=True)
class Question:
    """What is asked for, and by which flag it is said."""

    flag: str
    metavar: str
    words: str
    read: Callable[[str], Any]
    default: Any

    @property
    def field(self) -> str:
        return self.flag.removeprefix("--").replace("-", "_")


POSITIVE = {"gt": 0, "le": 10_000}
QUESTIONS = (
    Question("--name", "TEXT", "name of the design", read_name, "first design"),
    Question("--preset", "NAME", "C-arm (tailstack schema presets lists them)", read_preset, "generic-mobile-c-arm"),
    Question("--fiducials", "N", "number of fiducials", whole(FEWEST, MOST), 12),
    Question("--size-mm", "X", "edge of the cube that holds them, mm", number(POSITIVE), 80.0),
    Question("--target", "X,Y,Z", "target from the middle of the fiducials, mm (z points to the patient)", read_point,
             (0.0, 0.0, 90.0)),
    Question("--limit-mm", "X", "limit of the error at the tool in 95 % of all shots, mm", number(POSITIVE), 1.0),
    Question("--noise-px", "X", "noise of a fiducial's image, standard deviation, px", number(POSITIVE), 0.3),
)  # fmt: skip
# Asked for, and needed, where the preset's source does not state them
LENGTHS = {
    "source_isocentre_mm": Question(
        "--source-isocentre-mm", "X", "distance from source to isocentre, mm", number(POSITIVE), 700.0
    ),
    "pixel_mm": Question("--pixel-mm", "X", "pixel pitch of the detector, mm", number(POSITIVE), 0.3),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "file", metavar="NEW", nargs="?", default=DEFAULT_FILE, help="file to write; - is stdout (default %(default)s)"
    )
    for question in (*QUESTIONS, *LENGTHS.values()):
        default = "" if question in LENGTHS.values() else f" (default {show_value(question.default)})"
        words = (question.words + default).replace("%", "%%")
        parser.add_argument(question.flag, type=question.read, metavar=question.metavar, help=words)
    parser.add_argument("-y", "--yes", action="store_true", help="ask nothing: what no flag says has its default")
    add_force(parser)


def run(arguments: argparse.Namespace) -> Answer:
    from tailstack.design import check_design, load_design

    to_stdout = arguments.file == "-"
    if not to_stdout:
        refuse_overwriting([writable(arguments.file, (".yaml", ".yml"))], force=arguments.force)
    text = design_text(read_wishes(arguments, ask=sys.stdin is not None and sys.stdin.isatty() and not arguments.yes))
    try:
        check_design(load_design(text))  # refused before anything is written
    except TailstackError as error:  # nobody has the text whose lines it tells
        print("note: --size-mm, --target and the lengths of the C-arm decide what the views show", file=sys.stderr)
        raise RequestError([replace(p, file=None, line=None, column=None) for p in error.problems]) from error
    if to_stdout:
        return Answer(text.encode())
    write_document(Path(arguments.file), text)
    print(f"wrote {arguments.file}", file=sys.stderr)
    return Answer(f"next: {program()} score {quote(arguments.file)}\n")


def read_wishes(arguments: argparse.Namespace, *, ask: bool) -> Wishes:
    """What flags say, and what is asked for besides.  Raises RequestError for a length that nobody says."""
    from tailstack.design.presets import PRESETS

    unstated = set()

    def answer(question: Question) -> Any:
        given = getattr(arguments, question.field)
        if given is None and ask:
            given = ask_for(question)
        if given is None:
            unstated.add(question.field)
        return question.default if given is None else given

    answers = {question.field: answer(question) for question in QUESTIONS}
    missing = PRESETS[answers["preset"]].view_must_state
    for field, question in LENGTHS.items():
        answers[field] = getattr(arguments, field)
        if answers[field] is None and field in missing:
            if not ask:
                detail = f"the source of preset {answers['preset']} does not state {field}"
                raise RequestError(Problem("", "option-missing", detail, f"{question.flag} X, {question.words}"))
            answers[field] = answer(replace(question, default=start_lengths(PRESETS[answers["preset"]])[field]))
    return Wishes(**answers, unstated=frozenset(unstated))


def ask_for(question: Question) -> Any:
    """Ask on the terminal until the answer can be read; nothing, and the end of the input, is None: the default."""
    while True:
        print(f"{question.words} [{show_value(question.default)}]: ", end="", file=sys.stderr, flush=True)
        line = sys.stdin.readline()
        if not line.strip():
            return None
        try:
            return question.read(line.strip())
        except argparse.ArgumentTypeError as error:
            print(f"  {error}", file=sys.stderr)

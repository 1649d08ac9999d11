"""Write a first design: a C-arm, a carrier with beads, two seats, a target and a limit, each with a comment.

On a terminal it asks for what no flag says; Enter takes the value in brackets.  The design scores as it is, and its
section optimise lets the optimiser improve it.  Correct it where yours differs.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, fields
from math import hypot
from pathlib import Path
from typing import Any

from ..console.answer import Answer
from ..console.arguments import number, read_number, whole
from ..console.parser import suggest
from ..console.program import program

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
    "source_isocentre_mm": Question("--source-isocentre-mm", "X", "distance from source to isocentre, mm",
                                    number(POSITIVE), 700.0),
    "pixel_mm": Question("--pixel-mm", "X", "pixel pitch of the detector, mm", number(POSITIVE), 0.3),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Wishes:
    """The answers."""

    name: str
    preset: str
    fiducials: int
    size_mm: float
    target: tuple[float, float, float]
    limit_mm: float
    noise_px: float
    source_isocentre_mm: float | None
    pixel_mm: float | None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "file", metavar="NEW", nargs="?", default=DEFAULT_FILE, help="file to write; - is stdout (default %(default)s)"
    )
    for question in (*QUESTIONS, *LENGTHS.values()):
        default = "" if question in LENGTHS.values() else f" (default {_show(question.default)})"
        parser.add_argument(
            question.flag,
            type=question.read,
            metavar=question.metavar,
            help=(question.words + default).replace("%", "%%"),
        )
    parser.add_argument("-y", "--yes", action="store_true", help="ask nothing: what no flag says has its default")
    parser.add_argument("--force", action="store_true", help="overwrite a file that is there")


def run(arguments: argparse.Namespace) -> Answer:
    from tailstack.design import check_design, load_design
    from tailstack.errors import TailstackError

    from ..console.editors import write_document
    from ..console.files import writable
    from .example import refuse_overwriting

    to_stdout = arguments.file == "-"
    if not to_stdout:
        refuse_overwriting([writable(arguments.file, (".yaml", ".yml"))], force=arguments.force)
    text = design_text(read_wishes(arguments, ask=sys.stdin is not None and sys.stdin.isatty() and not arguments.yes))
    try:
        check_design(load_design(text))  # refused before anything is written
    except TailstackError:
        print("note: --size-mm, --target and the lengths of the C-arm decide what the views show", file=sys.stderr)
        raise
    if to_stdout:
        return Answer(text.encode())
    write_document(Path(arguments.file), text)
    print(f"wrote {arguments.file}", file=sys.stderr)
    return Answer(f"next: {program()} score {arguments.file}\n")


def read_wishes(arguments: argparse.Namespace, *, ask: bool) -> Wishes:
    """What flags say, and what is asked for besides.  Raises RequestError for a length that nobody says."""
    from tailstack.design.presets import PRESETS
    from tailstack.errors import Problem

    from ..problems import RequestError

    def answer(question: Question) -> Any:
        given = getattr(arguments, question.field)
        if given is not None:
            return given
        return ask_for(question) if ask else question.default

    answers = {question.field: answer(question) for question in QUESTIONS}
    missing = PRESETS[answers["preset"]].missing
    for field, question in LENGTHS.items():
        answers[field] = getattr(arguments, field)
        if answers[field] is None and field in missing:
            if not ask:
                detail = f"the source of preset {answers['preset']} does not state {field}"
                raise RequestError(Problem("", "option-missing", detail, f"{question.flag} X, {question.words}"))
            answers[field] = ask_for(question)
    return Wishes(**{field.name: answers[field.name] for field in fields(Wishes)})


def ask_for(question: Question) -> Any:
    """Ask on the terminal until the answer can be read; nothing is the default, and so is the end of the input."""
    while True:
        print(f"{question.words} [{_show(question.default)}]: ", end="", file=sys.stderr, flush=True)
        said = sys.stdin.readline()
        if not said.strip():
            return question.default
        try:
            return question.read(said.strip())
        except argparse.ArgumentTypeError as error:
            print(f"  {error}", file=sys.stderr)


def _show(value: Any) -> str:
    if isinstance(value, tuple):
        return ",".join(f"{part:g}" for part in value)
    return f"{value:g}" if isinstance(value, float) else str(value)


# --- the design -------------------------------------------------------------------------------------------


STEPS = (0.8191725134, 0.6710436067, 0.5497004779)  # whose multiples, modulo 1, fill a cube evenly
CORNERS = ((-1, -1, -1), (1, 1, 1), (-1, 1, 1), (1, -1, -1), (1, -1, 1), (-1, 1, -1), (1, 1, -1), (-1, -1, 1))
CANDIDATES = 200  # for each fiducial


def spread_fiducials(count: int, size_mm: float) -> list[tuple[float, float, float]]:
    """So many points in a cube about the origin: near the corners first, opposite ones in turn, then inside.

    Of the candidates for each that one is taken whose images are farthest from those of the points before, seen along
    x and along y, where the views look.
    """
    points: list[tuple[float, float, float]] = []
    for index in range(count):
        candidates = []
        for at in range(index * CANDIDATES, (index + 1) * CANDIDATES):
            fractions = [(at * step) % 1.0 for step in STEPS]
            if index < len(CORNERS):
                unit = [side * (1 - 0.35 * part) for side, part in zip(CORNERS[index], fractions, strict=True)]
            else:
                unit = [1.9 * (part - 0.5) for part in fractions]
            x, y, z = (round(size_mm / 2 * value, 1 if size_mm >= 20 else 2) for value in unit)
            candidates.append((x, y, z))
        points.append(max(candidates, key=lambda point: closest_images(point, points)))
    return points


def closest_images(point: tuple[float, float, float], others: list[tuple[float, float, float]]) -> float:
    """How far a point is from the others at least, seen along x or y."""
    x, y, z = point
    return min((hypot(min(abs(x - a), abs(y - b)), z - c) for a, b, c in others), default=0.0)


def design_text(wishes: Wishes) -> str:
    """The design, with its comments."""
    from tailstack.design.presets import PRESETS
    from tailstack.design.write import dump_flow

    preset = PRESETS[wishes.preset]
    half = wishes.size_mm / 2
    seat, flange = -(half + 15), -(half + 65)
    tx, ty, tz = wishes.target
    middle = [round((min(0.0, value) + max(0.0, value)) / 2, 1) for value in (tx, ty, tz)]
    lengths = "".join(
        f"    {field}: {_show(value)}\n" for field in LENGTHS if (value := getattr(wishes, field)) is not None
    )
    noise, isocentre = _show(wishes.noise_px), f"[{', '.join(map(_show, middle))}]"
    views = f"""\
  - name: AP
    preset: {wishes.preset} # {preset.title}
{lengths}    orientation: AP
    isocentre_mm: {isocentre} # between the fiducials and the target
    fiducial_noise_px: {noise} # how well one is located; measure yours
    target_noise_px: {noise}
  - name: LAT
    preset: {wishes.preset}
{lengths}    orientation: LAT
    isocentre_mm: {isocentre}
    fiducial_noise_px: {noise}
    target_noise_px: {noise}
"""
    points = "".join(
        f"    - {{ label: F{index}, position_mm: [{', '.join(map(_show, point))}] }}\n"
        for index, point in enumerate(spread_fiducials(wishes.fiducials, wishes.size_mm), 1)
    )
    spacing = round(0.4 * wishes.size_mm / wishes.fiducials ** (1 / 3), 1)
    low, high = (f"[{', '.join([_show(value)] * 3)}]" for value in (-half, half))
    return f"""\
# A first design, made by tailstack init.  Every number is yours to correct; docs/design.md explains the fields.
#
# Frame con (connector): its origin is the middle of the fiducials, z points to the patient.  Lengths in mm.
schema: tailstack/design/1
name: {dump_flow(wishes.name)}

views: # two shots; add more, or give calibrated projections
{views}
fiducials:
  points: # metal beads in the carrier; fiducials.file reads them from .mrk.json, .fcsv or .csv instead
{points}  manufacturing: {{ half_width_mm: 0.05, distribution: uniform }} # where a bead truly sits

interfaces: # half-widths of what may differ from one assembly to the next, about the pivot
  structure_connector:
    label: carrier on connector
    pivot_mm: [0, 0, {_show(seat)}]
    tolerances:
      rx: {{ half_width_deg: 0.1, distribution: uniform }}
      ry: {{ half_width_deg: 0.1, distribution: uniform }}
      rz: {{ half_width_deg: 0.1, distribution: uniform }}
      tx: {{ half_width_mm: 0.05, distribution: uniform }}
      ty: {{ half_width_mm: 0.05, distribution: uniform }}
      tz: {{ half_width_mm: 0.05, distribution: uniform }}
  connector_flange:
    label: connector on the robot's flange
    pivot_mm: [0, 0, {_show(flange)}]
    tolerances:
      rx: {{ half_width_deg: 0.1, distribution: uniform }}
      ry: {{ half_width_deg: 0.1, distribution: uniform }}
      rz: {{ half_width_deg: 0.1, distribution: uniform }}
      tx: {{ half_width_mm: 0.05, distribution: uniform }}
      ty: {{ half_width_mm: 0.05, distribution: uniform }}
      tz: {{ half_width_mm: 0.05, distribution: uniform }}

targets:
  - {{ name: tip, position_mm: [{", ".join(map(_show, wishes.target))}] }} # where the error counts

requirements:
  - {{ name: tip-accuracy, error: tcp, quantile: 0.95, limit_mm: {_show(wishes.limit_mm)} }}

optimise: # what tailstack optimise may change
  box: {{ min_mm: {low}, max_mm: {high} }} # where fiducials may go
  min_spacing_mm: {_show(spacing)}
  rotation_bounds: {{ min_deg: 0.01, max_deg: 0.5 }} # how tight and how loose the seats may be made
  starts: 8
"""

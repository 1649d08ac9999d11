"""Arguments that commands share: DESIGN, numbers, forms of an answer, the database and other settings."""

from __future__ import annotations

import argparse
import os
import shutil
import sys
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..rendering.text import WIDTH, Page

if TYPE_CHECKING:
    from tailstack.design import Design

    from ..settings import Settings


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


def whole(low: int, high: int | None = None) -> type:
    """An argparse type: a whole number in a range, written 1000000, 1_000_000 or 1e6."""

    def convert(text: str) -> int:
        value = read_number(text)
        if value is None or value != value.to_integral_value():
            raise argparse.ArgumentTypeError(f"expected a whole number; got {text!r}")
        if value < low or (high is not None and value > high):
            wanted = f"at least {low}" if high is None else f"{low} to {high}"
            raise argparse.ArgumentTypeError(f"expected {wanted}; got {text}")
        return int(value)

    return convert  # type: ignore[return-value]


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

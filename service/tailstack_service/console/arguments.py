"""Arguments that commands share: DESIGN, whole numbers, forms of an answer, the database and other settings."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tailstack.design import Design

    from ..settings import Settings


def add_design(parser: argparse.ArgumentParser, *, json: bool = True) -> None:
    parser.add_argument("design", metavar="DESIGN", help="design document, YAML or JSON; - reads stdin")
    if json:
        parser.add_argument(
            "--json", action="store_true", help="print the answer as JSON (tailstack schema lists the schemas); "
            "a refusal is then a problem document on stderr",
        )  # fmt: skip


def read_design(name: str) -> Design:
    """Load a design.  Raises DesignError, LimitError, OSError."""
    from tailstack.design import load_design
    from tailstack.design.reading import DEFAULT_LIMITS

    if name == "-":
        content = sys.stdin.buffer.read(DEFAULT_LIMITS.document_bytes + 1)
        return load_design(content, base_directory=Path.cwd())
    return load_design(Path(name))


def coloured_output() -> bool:
    """Colour only on a terminal, and not when the user asked for none (https://no-color.org)."""
    import os

    if sys.stdout is None:  # whoever started this closed it
        return False
    return sys.stdout.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def whole(low: int, high: int | None = None) -> type:
    """An argparse type: a whole number in a range."""

    def convert(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"expected a whole number; got {text!r}") from None
        if value < low or (high is not None and value > high):
            wanted = f"at least {low}" if high is None else f"{low} to {high}"
            raise argparse.ArgumentTypeError(f"expected {wanted}; got {text}")
        return value

    return convert  # type: ignore[return-value]


def number(bounds: dict[str, Any]) -> Any:
    """An argparse type: a number within bounds."""

    def convert(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"expected a number; got {text!r}") from None
        tests = {"ge": value.__ge__, "gt": value.__gt__, "le": value.__le__, "lt": value.__lt__}
        words = {"ge": "at least", "gt": "above", "le": "at most", "lt": "below"}
        if not all(tests[name](float(bound)) for name, bound in bounds.items()):
            wanted = " and ".join(f"{words[name]} {bound:g}" for name, bound in bounds.items())
            raise argparse.ArgumentTypeError(f"expected a number {wanted}; got {text}")
        return value

    return convert


def add_form(parser: argparse.ArgumentParser, record: str, line: str) -> None:
    """--json (the record named) or --csv (one line for each of what ``line`` names)."""
    form = parser.add_mutually_exclusive_group()
    form.add_argument(
        "--json", action="store_true", help=f"print the record as JSON (tailstack schema {record}); a refusal is then "
        "a problem document on stderr",
    )  # fmt: skip
    form.add_argument("--csv", action="store_true", help=f"print one line of CSV for each {line}")


def add_figure(parser: argparse.ArgumentParser, what: str) -> None:
    """--figure FILE, which says what is drawn."""
    parser.add_argument("--figure", metavar="FILE", help=f"draw {what} (.svg)")


SETTING_OF = {"database": "database", "processes": "worker_processes", "engine": "engine"}  # by flag


def add_database(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--database", metavar="URL", help="where jobs are kept (default TAILSTACK_DATABASE)")


def read_settings(arguments: argparse.Namespace) -> Settings:
    """Raises RequestError for a setting that cannot be, or a TAILSTACK_ name in the environment that is none."""
    from ..settings import load_settings

    flags = {setting: getattr(arguments, flag, None) for flag, setting in SETTING_OF.items()}
    return load_settings(**{name: value for name, value in flags.items() if value is not None})

"""Options of every command that answers with a grid: which form stdout takes, and a figure beside it."""

from __future__ import annotations

import argparse


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

"""Print a published JSON Schema (draft 2020-12); without a name, list them."""

from __future__ import annotations

import argparse

from ..console.answer import Answer

HELP = "published JSON Schemas; without a name, their list"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", metavar="NAME", nargs="?", help="design, score, verification, ...")


def run(arguments: argparse.Namespace) -> Answer:
    from tailstack.errors import Problem
    from tailstack.json_text import write_json

    from ..problems import RequestError
    from ..schemas import TITLES, json_schema

    names = TITLES
    if arguments.name is None:
        return Answer("".join(f"{name:<18}{words}\n" for name, words in names.items()))
    if arguments.name not in names:
        raise RequestError(
            Problem("", "unknown-schema", f"no schema is called {arguments.name!r}", f"one of {', '.join(names)}")
        )
    return Answer((write_json(json_schema(arguments.name), indent=2) + "\n").encode())

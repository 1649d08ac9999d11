"""Print or write a published JSON Schema; without a name, list them."""

from __future__ import annotations

import argparse
from pathlib import Path

from tailstack.errors import Problem

from ..console.command_line import Answer
from ..console.files import writable, write_and_tell
from ..documents import DRAFTS
from ..operations.editors import schema_file, schema_text
from ..problems import RequestError

HELP = "published JSON Schemas; without a name, their list"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", metavar="NAME", nargs="?", help="design, score, verification, ...")
    words = "of JSON Schema: %(default)s unless said, 7 for editors that complete and check YAML"
    parser.add_argument("--draft", choices=DRAFTS, default=DRAFTS[0], help=words)
    parser.add_argument(
        "-o", "--output", metavar="FILE", help="write it here; a folder gets tailstack-NAME.schema.json"
    )


def run(arguments: argparse.Namespace) -> Answer:
    from tailstack.cures import ask_label

    from ..schemas import TITLES, json_schema

    if arguments.name is None:
        if arguments.output is not None:
            hint = f"for example tailstack schema design --draft 7 -o {arguments.output}"
            raise RequestError(Problem("", "missing-parameter", "-o writes one schema; none is named", hint))
        return Answer("".join(f"{name:<18}{words}\n" for name, words in TITLES.items()))
    if arguments.name not in TITLES:
        hint = f"{ask_label(arguments.name, TITLES)} one of {', '.join(TITLES)}".strip()
        raise RequestError(Problem("", "unknown-schema", f"no schema is called {arguments.name!r}", hint))
    text = schema_text(json_schema(arguments.name, arguments.draft))
    if arguments.output is None:
        return Answer(text.encode())
    target = Path(arguments.output)
    path = writable(str(target / schema_file(arguments.name) if target.is_dir() else target), (".json",))
    write_and_tell(path, text)
    return Answer("")

"""Write a tolerance-budget report of a design, or render a result that was computed before."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from .answer import EXIT_CODE, NOT_EVALUATED, PASS, Answer
from .design_input import whole
from .progress import Progress
from .verify import precision

if TYPE_CHECKING:
    from collections.abc import Sequence

HELP = "tolerance-budget report: HTML, PDF, spreadsheet, JSON"

FORMATS = ("html", "pdf", "xlsx", "json")
PARTS = ("score", "verification", "optimisation")
SCHEMA = "tailstack/"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "source", metavar="RESULT|DESIGN", help="a design document, or the JSON of a result of tailstack; - reads stdin"
    )
    parser.add_argument(
        "--format", type=_listed(FORMATS), default=("html",), metavar="LIST",
        help="html, pdf, xlsx, json, separated by commas (default html)",
    )  # fmt: skip
    parser.add_argument(
        "-o", "--output", metavar="DIR", default=".", help="directory for the files (default: this one)"
    )
    parser.add_argument(
        "--parts", type=_listed(PARTS), metavar="LIST",
        help="of a design: score, verification, optimisation (default score,verification)",
    )  # fmt: skip
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--trials", type=whole(1), metavar="N", help="of a design: trials of its check")
    size.add_argument("--precision", type=precision, metavar="REL", help="of a design: see tailstack verify")
    parser.add_argument("--seed", type=whole(0, 2**63 - 1), metavar="N", help="of a design: seed of its check (0)")


def _listed(known: Sequence[str]) -> type:
    """An argparse type: names out of a list, separated by commas, each once."""

    def convert(text: str) -> tuple[str, ...]:
        names = tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
        unknown = [name for name in names if name not in known]
        if unknown or not names:
            raise argparse.ArgumentTypeError(f"expected {', '.join(known)}; got {text!r}")
        return names

    return convert  # type: ignore[return-value]


def run(arguments: argparse.Namespace) -> Answer:
    from tailstack.design.loading import read_source

    from ..gate.reading import LIMITS
    from ..reports import render

    output = _directory(arguments.output)
    name = arguments.source
    given = sys.stdin.buffer.read(LIMITS.document_bytes + 1) if name == "-" else Path(name)
    data = read_source(given, limits=LIMITS).data
    schema = str(data.get("schema", "")) if isinstance(data, dict) else ""
    if schema.startswith(SCHEMA) and schema != "tailstack/design/1":
        kind, body = _result(arguments, schema, data)
    else:
        kind, body = "report", _computed(arguments, given)
    stem = "report" if name == "-" else Path(name).name.split(".")[0]
    written = []
    for form in arguments.format:
        rendered, _ = render(kind, body, form)
        path = output / f"{stem}.{'report.' if form == 'json' else ''}{form}"
        _replace(path, rendered)
        written.append(str(path))
    return Answer("".join(f"{path}\n" for path in written), _exit_code(kind, body))


def _computed(arguments: argparse.Namespace, given: bytes | Path) -> bytes:
    """The report of a design, computed here."""
    from tailstack.design import load_design

    from ..documents import to_json
    from ..reports.assembling import ReportOptions, compute_report

    design = load_design(given, base_directory=Path.cwd() if isinstance(given, bytes) else None)
    parts = arguments.parts or ("score", "verification")
    options = ReportOptions(parts, arguments.trials, arguments.precision, arguments.seed or 0)
    with Progress("report"):
        return to_json(compute_report(design, options))


def _result(arguments: argparse.Namespace, schema: str, data: dict[str, object]) -> tuple[str, bytes]:
    """Kind and canonical body of a result that was read from a file.  Raises RequestError."""
    from pydantic import ValidationError

    from tailstack.errors import Problem

    from ..documents import from_plain, to_json
    from ..problems import RequestError
    from ..reports.rendering import CHAPTERS

    file = arguments.source
    given = [f"--{name}" for name in ("parts", "trials", "precision", "seed") if getattr(arguments, name) is not None]
    if given:
        detail = f"{', '.join(given)}: a result is rendered as it is"
        raise RequestError(Problem("", "unused-option", detail, "give the design instead", file))
    kind = schema.removeprefix(SCHEMA).partition("/")[0]
    if kind not in CHAPTERS or schema != f"{SCHEMA}{kind}/1":
        hint = f"results: {', '.join(CHAPTERS)}"
        raise RequestError(Problem("/schema", "unsupported-schema", f"no report is made of {schema!r}", hint, file))
    try:
        return kind, to_json(from_plain(kind, data))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        pointer = "".join(f"/{step}" for step in first["loc"])
        detail = f"this is not a whole {schema}: {first['msg'].lower()}"
        raise RequestError(Problem(pointer, "bad-result", detail, "write it anew with --json", file)) from None


def _exit_code(kind: str, body: bytes) -> int:
    """The verdict that was reported decides, as it does for the verb that computes it."""
    data = json.loads(body)
    if kind == "gate":
        return int(data["exit_code"])
    if kind == "report":
        return EXIT_CODE[data["headline"]["status"]]
    if kind in ("score", "verification"):
        return EXIT_CODE.get(data["verdict"]["status"], NOT_EVALUATED)
    return PASS


def _directory(name: str) -> Path:
    from tailstack.errors import Problem

    from ..problems import RequestError

    path = Path(name)
    if path.exists() and not path.is_dir():
        raise RequestError(Problem("", "file-unwritable", f"{name} is not a directory", "give a directory with -o"))
    path.mkdir(parents=True, exist_ok=True)
    return path


def _replace(path: Path, content: bytes) -> None:
    """Write a file whole or not at all."""
    import os

    beside = path.with_name(path.name + f".{os.getpid()}.part")
    try:
        beside.write_bytes(content)
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)

"""Convert designs (.yaml, .json) and fiducial files (.csv, .fcsv, .mrk.json) into one another."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from pydantic import Field

from tailstack.errors import Problem

from ..console.answer import Answer
from ..problems import RequestError
from .effort import reading_seconds
from .operation import Command, Operation, Reception
from .options import Options

if TYPE_CHECKING:
    from ..settings import Settings
    from .sent import Query, Sent

ConversionFormat = Literal["csv", "fcsv", "mrk.json", "yaml", "json"]
FORMATS: tuple[ConversionFormat, ...] = get_args(ConversionFormat)
IMPLIED: dict[str, ConversionFormat] = {"text/csv": "csv", "yaml": "yaml"}  # by kind of content
BEADS = "label,x_mm,y_mm,z_mm\nF1,0,0,0\nF2,40,0,5\nF3,0,35,-10\n"


class ConversionOptions(Options):
    """The content and what to make of it."""

    format: ConversionFormat = Field(description="What the content is; yaml and json are designs.")
    content: Annotated[str, Field(min_length=1)] = Field(
        description="The text of the file.", examples=["label,x_mm,y_mm,z_mm\nF1,0,0,0\n"]
    )
    to: ConversionFormat = Field("yaml", description="What to make of it; a design becomes a design, or its fiducials.")


@dataclass(frozen=True, slots=True)
class ConvertedPoint:
    label: str
    """Label of the fiducial."""
    position_mm: tuple[float, float, float]
    """Position, con (LPS), mm."""


@dataclass(frozen=True, slots=True)
class Conversion:
    """A fiducial file or a design in another format, and the fiducials in it."""

    schema: Literal["tailstack/conversion/1"]
    """Name and version of this record's schema."""
    format: Literal["csv", "fcsv", "mrk.json", "yaml", "json"]
    """Format of `content`."""
    content: str
    """The converted text."""
    fiducials: tuple[ConvertedPoint, ...]
    """The fiducials in it."""
    notes: tuple[str, ...]
    """What was done to the numbers on the way."""


# --- over HTTP ------------------------------------------------------------------------------------------


def receive(sent: Sent, settings: Settings) -> Reception:
    """The converted text, the fiducials in it, and what was done to the numbers.  Raises Placed, RequestError."""
    from tailstack.design import convert
    from tailstack.errors import DesignError, LimitError

    from ..documents import to_json
    from .sent import Placed, limits_of

    content, source, target, place = _read(sent, settings)
    limits, name = limits_of(settings), f"content.{source}"
    try:
        made = convert(content, name, f"converted.{target}", allow_files=False, limits=limits)
        section = convert(content, name, "converted.json", allow_files=False, limits=limits)
    except (DesignError, LimitError) as error:
        raise Placed(error, place) from None
    points = json.loads(section.text)["fiducials"]["points"]
    record = Conversion(
        schema="tailstack/conversion/1",
        format=target,
        content=made.text,
        fiducials=tuple(
            ConvertedPoint(point.get("label") or f"F{number}", _vector(point["position_mm"]))
            for number, point in enumerate(points, 1)
        ),
        notes=made.notes,
    )
    return Reception(answer=to_json(record))


def _read(sent: Sent, settings: Settings) -> tuple[bytes, ConversionFormat, ConversionFormat, str]:
    """Content, its format, the format wanted, and the pointer to the content in what was sent."""
    from .sent import parse_json, read_options, refuse_query

    if sent.form == "json":
        options = read_options(ConversionOptions, parse_json(sent.body, settings), ())
        return options.content.encode("utf-8", "surrogatepass"), options.format, options.to, "/content"
    refuse_query(sent.query, ("from", "to"))
    source = _format(sent.query, "from") or IMPLIED.get(sent.form)
    if source is None:
        hint = f"add ?from= one of {', '.join(FORMATS)}"
        raise RequestError(Problem("/from", "missing-parameter", "text/plain does not say which format it is", hint))
    return sent.body, source, _format(sent.query, "to") or "yaml", ""


def _format(query: Query, name: str) -> ConversionFormat | None:
    from .sent import single

    value = single(query, name)
    for form in FORMATS:
        if form == value:
            return form
    if value is not None:
        detail = f"{name} is one of {', '.join(FORMATS)}; got {value[:40]!r}"
        raise RequestError(Problem(f"/{name}", "unknown-value", detail))
    return None


def _vector(values: list[float]) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z


# --- the command ------------------------------------------------------------------------------------------


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("design", metavar="IN", help="file to read: .yaml, .json, .csv, .fcsv or .mrk.json")
    parser.add_argument(
        "-o", "--output", metavar="OUT", required=True, help="file to write; its ending decides the format"
    )


def _run(arguments: argparse.Namespace) -> Answer:
    from tailstack.design import convert_file

    from ..console.editors import write_document

    converted = convert_file(Path(arguments.design), Path(arguments.output), write=write_document)
    for note in converted.notes:
        print(f"note: {note}", file=sys.stderr)
    print(f"wrote {arguments.output}", file=sys.stderr)
    return Answer("")


QUERY = {
    "from": {
        "type": "string",
        "enum": list(FORMATS),
        "description": "What the content is; text/csv and YAML say it themselves.",
    },
    "to": {"type": "string", "enum": list(FORMATS), "default": "yaml", "description": "What to make of it."},
}


def _refuse(call: Any) -> Conversion:
    raise NotImplementedError("a conversion is received as a file, not as a design")


OPERATION = Operation(
    name="conversion",
    verb="convert",
    path="/v1/conversions",
    summary="Convert designs and fiducial files, by their endings",
    description="In memory: no file is read, nothing is fetched. With text/plain, from says what the text is.",
    title="answer of convert over HTTP",
    options=ConversionOptions,
    designs={},
    example={"format": "csv", "content": BEADS, "to": "yaml"},
    record=lambda: Conversion,
    run=_refuse,
    immediate=True,
    seconds=reading_seconds,
    receive=receive,
    hint="format and to go into the body, beside the content",
    media=("text/csv", "text/plain"),
    query=("from", "to"),
    query_schemas=lambda: QUERY,
    example_title="A CSV file to the fiducials of a design",
    kernels=False,
    command=Command(_add_arguments, _run),
)

"""Fiducial files and designs converted into one another, in memory: nothing is read from disk or fetched."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field
from starlette.requests import Request
from starlette.responses import Response

from tailstack.design import convert
from tailstack.errors import DesignError, LimitError, Problem

from ..documents import Conversion, ConvertedPoint
from ..problems import RequestError
from .answers import record_response
from .asked import refuse_query
from .bodies import Placed, content_kind, limits_of, parse_json, read_body
from .jobs import single
from .operations import in_short_lane
from .options import Options, options_of
from .service import service_of

Format = Literal["csv", "fcsv", "mrk.json", "yaml", "json"]
FORMATS: tuple[Format, ...] = ("csv", "fcsv", "mrk.json", "yaml", "json")
RAW = ("text/csv", "text/plain")
IMPLIED: dict[str, Format] = {"text/csv": "csv", "yaml": "yaml"}  # by kind of content


class ConversionOptions(Options):
    """The content and what to make of it."""

    format: Format = Field(description="What the content is; yaml and json are designs.")
    content: Annotated[str, Field(min_length=1)] = Field(
        description="The text of the file.", examples=["label,x_mm,y_mm,z_mm\nF1,0,0,0\n"]
    )
    to: Format = Field("yaml", description="What to make of it; a design becomes a design, or its fiducials.")


@dataclass(frozen=True, slots=True)
class _Wanted:
    content: bytes
    source: Format
    target: Format
    pointer: str  # to the content in what was sent


async def create_conversion(request: Request) -> Response:
    """The converted text, the fiducials in it, and what was done to the numbers.  Raises Placed, RequestError."""
    settings = service_of(request).settings
    kind = content_kind(request, yaml=True, raw=RAW)
    body = await read_body(request, settings)
    if kind == "json":
        refuse_query(request, (), "format and to go into the body, beside the content")
        options = options_of(ConversionOptions, parse_json(body, settings))
        wanted = _Wanted(options.content.encode("utf-8", "surrogatepass"), options.format, options.to, "/content")
    else:
        refuse_query(request, ("from", "to"))
        source = _chosen(request, "from") or IMPLIED.get(kind)
        if source is None:
            hint = f"add ?from= one of {', '.join(FORMATS)}"
            raise RequestError(
                Problem("/from", "missing-parameter", "text/plain does not say which format it is", hint)
            )
        wanted = _Wanted(body, source, _chosen(request, "to") or "yaml", "")

    def converted() -> Conversion:
        limits = limits_of(settings)
        name = f"content.{wanted.source}"
        try:
            made = convert(wanted.content, name, f"converted.{wanted.target}", allow_files=False, limits=limits)
            section = convert(wanted.content, name, "converted.json", allow_files=False, limits=limits)
        except (DesignError, LimitError) as error:
            raise Placed(error, wanted.pointer) from None
        points = json.loads(section.text)["fiducials"]["points"]
        return Conversion(
            schema="tailstack/conversion/1",
            format=wanted.target,
            content=made.text,
            fiducials=tuple(
                ConvertedPoint(point.get("label") or f"F{number}", _vector(point["position_mm"]))
                for number, point in enumerate(points, 1)
            ),
            notes=made.notes,
        )

    return record_response(await in_short_lane(request, converted, kernels=False))


def _vector(values: list[float]) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z


def _chosen(request: Request, name: str) -> Format | None:
    value = single(request, name)
    for form in FORMATS:
        if form == value:
            return form
    if value is not None:
        detail = f"{name} is one of {', '.join(FORMATS)}; got {value[:40]!r}"
        raise RequestError(Problem(f"/{name}", "unknown-value", detail))
    return None

"""What a computing process does for the API: read what was sent, compute, write the answer.

Each function stands alone and takes and gives plain values: it is called in another process (``places``), which may be
killed at any moment.  Nothing here knows of requests, connections or databases.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

from tailstack.design import check_design, convert
from tailstack.errors import DesignError, LimitError, Problem, TailstackError

from ..documents import Conversion, ConvertedPoint, to_json
from ..problems import RequestError
from ..settings import Settings
from ..work.requests import canonical
from .asked import Asked, Query, Sent, from_text, read_asked, refuse_query, single
from .bodies import Placed, design_of, limits_of, parse_json
from .operations import JOB_OPERATIONS, OPERATIONS
from .options import SIDES, ComparisonOptions, ConversionFormat, ConversionOptions, options_of, within

CONVERSION_FORMATS: tuple[ConversionFormat, ...] = ("csv", "fcsv", "mrk.json", "yaml", "json")
IMPLIED_FORMAT: dict[str, ConversionFormat] = {"text/csv": "csv", "yaml": "yaml"}  # by kind of content
GATE_QUERY = ("mode", "seed", "fail_level", "on_inconclusive")  # what a single design as YAML can be asked with
GATE_FILE = "design.yaml"  # what findings call such a design
GATE_TEXT = "/designs/0/text"  # where it stands in the request that the body and the query make


@dataclass(frozen=True, slots=True)
class JobRequest:
    """A request that was checked and can become a job."""

    kind: str
    request: bytes  # canonical JSON; what each kind holds is said in tailstack_service.work
    design_name: str
    bare_design: bool = False  # the body was the design itself


@dataclass(frozen=True, slots=True)
class Refusal:
    """A refusal on its way between two processes: exceptions do not travel well."""

    slug: str
    title: str
    problems: tuple[Problem, ...]
    prefix: str  # pointer to the design inside what was sent


def perform(call: Callable[[], Any]) -> Any:
    """What the call returns, or its refusal.  Any other exception is a defect, and the process tells of it."""
    try:
        return call()
    except Placed as placed:
        return Refusal(placed.error.slug, placed.error.title, placed.error.problems, placed.prefix)
    except TailstackError as error:
        return Refusal(error.slug, error.title, error.problems, "")


def warm_up() -> None:
    """Load or compile every kernel that a request can need, so that none of them waits for it."""
    from tailstack.design import load_design
    from tailstack.optimisation import influence
    from tailstack.scoring import score

    from .example import EXAMPLE_DESIGN, variants

    design = load_design(EXAMPLE_DESIGN)
    to_json(score(design, second_order=True))
    for variant in map(load_design, variants()):
        score(variant)
    influence(design)


def answer(path: str, sent: Sent, settings: Settings) -> bytes:
    """The record of an operation that is answered at once.  Raises Placed, RequestError, MalformedError."""
    operation = next(entry for entry in OPERATIONS if entry.path == path)
    asked = read_asked(sent, operation.options, settings)
    design = asked.design(settings)
    try:
        return to_json(operation.compute(design, asked.options))
    except TailstackError as error:
        raise Placed(error, asked.prefix) from None


def job_request(kind: str, sent: Sent, settings: Settings) -> JobRequest:
    """The request of a job for one design, checked.  Raises Placed, RequestError, LimitError, MalformedError."""
    operation = next(entry for entry in JOB_OPERATIONS if entry.kind == kind)
    asked: Asked[Any] = read_asked(sent, operation.options, settings)
    design = asked.design(settings)
    operation.check(asked, design, settings)
    options = operation.kept(asked.options, design)
    limits = {name: getattr(settings, name) for name in operation.limits}
    content = {"design": asked.data(design), **options, **limits}
    return JobRequest(kind, canonical(content), design.name, asked.bare_design)


def comparison_request(sent: Sent, settings: Settings) -> JobRequest:
    """The request of a comparison, both designs checked.  Raises RequestError, LimitError, MalformedError, Placed."""
    data = parse_json(sent.body, settings)
    options = options_of(ComparisonOptions, {key: value for key, value in data.items() if key not in SIDES})
    within(options.trials, "max_trials", settings, "/trials")
    designs, systems = {}, {}
    for side in SIDES:
        designs[side] = design_of(data, settings, side)
        try:
            systems[side], _, _ = check_design(designs[side])
        except TailstackError as error:
            raise Placed(error, f"/{side}") from None
    names = [{target.name for target in systems[side].targets} for side in SIDES]
    if not names[0] & names[1]:
        detail = "the two designs have no target of the same name: there is nothing to compare"
        problem = Problem("/targets", "no-common-target", detail, "give the targets the same names")
        raise Placed(DesignError(problem), "/second")
    content = {**{side: data[side] for side in SIDES}, **options.model_dump(), "max_trials": settings.max_trials}
    name = f"{designs['second'].name} against {designs['first'].name}"
    return JobRequest("comparison", canonical(content), name)


def gate(sent: Sent, settings: Settings) -> tuple[dict[str, Any], bytes | JobRequest]:
    """The terms of a gate, and the record of an analytic one, or the request of a job.

    Raises what ``gate.request.admit_gate`` raises.
    """
    if sent.form == "json":
        data = parse_json(sent.body, settings)
    else:
        refuse_query(sent.query, GATE_QUERY)
        data = _gate_of_one(sent.body, sent.query)
    try:
        return _gate(data, settings)
    except TailstackError as error:
        if sent.form == "yaml":  # the design is the body: pointers start inside it
            error.problems = tuple(replace(p, pointer=p.pointer.removeprefix(GATE_TEXT)) for p in error.problems)
        raise


def _gate_of_one(body: bytes, query: Query) -> dict[str, Any]:
    """The request that a YAML body and the query stand for."""
    from ..gate.request import GateRequest

    data: dict[str, Any] = {"designs": [{"file": GATE_FILE, "text": body.decode("utf-8", "surrogateescape")}]}
    properties = GateRequest.model_json_schema()["properties"]
    for name in GATE_QUERY:
        value = single(query, name)
        if value is not None:
            data[name] = from_text(value, properties[name])
    return data


def _gate(data: dict[str, Any], settings: Settings) -> tuple[dict[str, Any], bytes | JobRequest]:
    from ..gate.request import admit_gate, judge_designs, list_terms

    complete = admit_gate(
        data,
        today=datetime.now(UTC).date(),
        limits=limits_of(settings),
        max_designs=settings.max_gate_designs,
        max_trials=settings.max_trials,
    )
    if complete["mode"] == "analytic":
        return list_terms(complete), to_json(judge_designs(complete))
    count = len(complete["designs"])
    name = complete["designs"][0]["file"] + (f" and {count - 1} more" if count > 1 else "")
    return list_terms(complete), JobRequest("gate", canonical(complete), name)


def conversion(sent: Sent, settings: Settings) -> bytes:
    """The converted text, the fiducials in it, and what was done to the numbers.  Raises Placed, RequestError."""
    content, source, target, place = _conversion_of(sent, settings)
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
    return to_json(record)


def _conversion_of(sent: Sent, settings: Settings) -> tuple[bytes, ConversionFormat, ConversionFormat, str]:
    """Content, its format, the format wanted, and the pointer to the content in what was sent."""
    if sent.form == "json":
        options = options_of(ConversionOptions, parse_json(sent.body, settings))
        return options.content.encode("utf-8", "surrogatepass"), options.format, options.to, "/content"
    refuse_query(sent.query, ("from", "to"))
    source = _format(sent.query, "from") or IMPLIED_FORMAT.get(sent.form)
    if source is None:
        hint = f"add ?from= one of {', '.join(CONVERSION_FORMATS)}"
        raise RequestError(Problem("/from", "missing-parameter", "text/plain does not say which format it is", hint))
    return sent.body, source, _format(sent.query, "to") or "yaml", ""


def _format(query: Query, name: str) -> ConversionFormat | None:
    value = single(query, name)
    for form in CONVERSION_FORMATS:
        if form == value:
            return form
    if value is not None:
        detail = f"{name} is one of {', '.join(CONVERSION_FORMATS)}; got {value[:40]!r}"
        raise RequestError(Problem(f"/{name}", "unknown-value", detail))
    return None


def _vector(values: list[float]) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z


def report(schema_name: str, body: bytes, form: str) -> tuple[bytes, str]:
    """A result as a document, and its media type.  Raises PdfUnavailable."""
    from ..report import render

    return render(schema_name, body, form)

"""What a computing process does for the API: read what was sent, compute, write the answer.

Each function stands alone and takes and gives plain values: it is called in another process (``places``), which may be
killed at any moment.  Nothing here knows of requests, connections or databases.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from tailstack.design import load_design
from tailstack.errors import Problem, TailstackError
from tailstack.extras import name_missing_extra

from ..documents import to_json
from ..operations.content import canonical
from ..operations.example import EXAMPLE_DESIGN, variants
from ..operations.operation import Call, Done, JobRequest, More, Reception
from ..operations.perform import compute, plan
from ..operations.registry import OPERATIONS
from ..operations.sent import BaseNeeded, Placed, Sent, read_request
from ..settings import Settings
from ..task import UnitResult


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
        with name_missing_extra():
            return call()
    except Placed as placed:
        return Refusal(placed.error.slug, placed.error.title, placed.error.problems, placed.prefix)
    except TailstackError as error:
        return Refusal(error.slug, error.title, error.problems, "")


def warm_up() -> None:
    """Load or compile every kernel that a request can need, so that none of them waits for it."""
    from tailstack.optimisation import influence
    from tailstack.scoring import score

    design = load_design(EXAMPLE_DESIGN)
    to_json(score(design, second_order=True))
    for variant in map(load_design, variants()):
        score(variant)
    influence(design)


def receive(name: str, sent: Sent, settings: Settings) -> Reception:
    """What a request to an operation comes to: its answer, or a job.

    Raises Placed, RequestError, LimitError, MalformedError.
    """
    operation = OPERATIONS[name]
    if operation.receive is not None:
        return operation.receive(sent, settings)
    try:
        request = read_request(sent, operation, settings)
    except BaseNeeded as needed:
        return Reception(base_sha256=needed.sha256)
    limits = {limit: getattr(settings, limit) for limit in operation.limits}
    if operation.immediate:
        try:
            answer = to_json(operation.run(Call(request.designs, request.options, limits)))
        except TailstackError as error:
            raise request.place(error) from None
        return Reception(answer=answer, designs=() if request.partial is not None else request.nameable)
    operation.check(request, settings)
    options = operation.prepare(request.options, *request.designs[:1])
    titles = " against ".join(design.name for design in reversed(request.designs)) or operation.summary
    content = canonical({**request.data, **options, **limits})
    return Reception(job=JobRequest(name, content, titles, request.bare_design), designs=request.nameable)


def compute_piece(kind: str, content: bytes, spec: bytes, form: str, *, first: bool) -> bytes:
    """A unit of a job, as a piece of its answer in some format; ``first``: with what comes before all of them."""
    from ..operations.units.batch import encode

    request = json.loads(content)
    return encode(request, (compute(kind, request, json.loads(spec)),), form, first=first)


def compute_unit(kind: str, content: bytes, spec: bytes) -> bytes:
    """A unit of a job."""
    return compute(kind, json.loads(content), json.loads(spec))


def plan_pieces(kind: str, content: bytes) -> tuple[bytes, ...]:
    """The units of a job that needs no second look."""
    step = plan(kind, json.loads(content), ())
    assert isinstance(step, More)
    return step.specs


def join_pieces(kind: str, content: bytes, results: tuple[UnitResult, ...], form: str) -> bytes:
    """The answer of a job in some format, from all its units."""
    from ..operations.units.batch import encode

    request = json.loads(content)
    if form != "json":
        return encode(request, tuple(unit.result for unit in results), form, first=True)
    step = plan(kind, request, results)
    assert isinstance(step, Done)
    return step.answer

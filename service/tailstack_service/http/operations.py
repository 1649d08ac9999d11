"""What is answered at once: read strictly, hold to the limits, compute in a lane, answer with the record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from starlette.requests import Request
from starlette.responses import Response

from tailstack.design import Design
from tailstack.errors import Problem, TailstackError

from ..documents import validate
from ..problems import RequestError
from ..settings import Settings
from .answers import record_response
from .bodies import Placed, content_kind, design_of, loaded, parse_json, read_body
from .computing import Lane, Watch
from .options import (
    Options,
    ScoreOptions,
    ValidationOptions,
    options_of,
)


@dataclass(frozen=True, slots=True)
class Operation:
    """One computation of the service."""

    path: str
    summary: str
    lane: str
    options: type[Options]
    answer: str  # name of the published schema of the answer
    yaml: bool  # the design itself may be the body, as YAML
    compute: Callable[[Design, Any, Settings, Watch], Any]


def _score(design: Design, options: ScoreOptions, settings: Settings, watch: Watch) -> Any:
    from tailstack.scoring import score

    return score(design, second_order=options.second_order)


def _validate(design: Design, options: ValidationOptions, settings: Settings, watch: Watch) -> Any:
    return validate(design)


OPERATIONS = (
    Operation("/v1/scores", "First-order score", "score", ScoreOptions, "score", True, _score),
    Operation("/v1/validations", "Read and check a design", "score", ValidationOptions, "validation", True, _validate),
)  # fmt: skip


async def answer(operation: Operation, request: Request) -> Response:
    """Answer a request.  Raises TailstackError or Placed; the application turns them into problem documents."""
    settings: Settings = request.app.state.settings
    kind = content_kind(request, yaml=operation.yaml)
    body = await read_body(request, settings)
    if kind == "json":
        _refuse_query(request, ())
        data = parse_json(body, settings)
        options, prefix = options_of(operation.options, data), "/design"
    else:
        options, prefix = _query_options(operation, request), ""
    watch = Watch(settings.max_seconds, request.app.state.stopping)
    lane: Lane = request.app.state.lanes[operation.lane]

    def compute() -> Any:
        design = design_of(data, settings) if kind == "json" else loaded(body, settings, prefix)
        try:
            return operation.compute(design, options, settings, watch)
        except TailstackError as error:
            if watch.late:  # the limit on time belongs to the request, not to a field of the design
                raise
            raise Placed(error, prefix) from None

    return record_response(await lane.run(request, watch, compute))


def _refuse_query(request: Request, known: tuple[str, ...]) -> None:
    for name in request.query_params:
        if name not in known:
            hint = f"known: {', '.join(known)}" if known else "options go into the body, beside the design"
            detail = f"there is no query parameter {name[:60]!r}"
            raise RequestError(Problem("", "unknown-parameter", detail, hint))


def _query_options(operation: Operation, request: Request) -> Options:
    """Options of a YAML body, which is the design itself: from the query (flags only)."""
    known = tuple(operation.options.model_fields)
    _refuse_query(request, known)
    flags = {"true": True, "false": False}
    data = {}
    for name in known:
        given = request.query_params.getlist(name)
        if given and (len(given) > 1 or given[0] not in flags):
            raise RequestError(Problem("", "bad-parameter", f"{name} is true or false, once; got {given!r:.80}"))
        if given:
            data[name] = flags[given[0]]
    return options_of(operation.options, data)

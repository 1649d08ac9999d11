"""What is answered at once: read strictly, compute in the short lane step by step, answer with the record."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from starlette.requests import Request
from starlette.responses import Response

from tailstack.design import Design
from tailstack.errors import TailstackError

from ..documents import validate
from ..settings import Settings
from .answers import record_response
from .asked import Asked, read_asked
from .bodies import Placed
from .computing import HERE_SECONDS, Steps, Watch
from .options import Options, ScoreOptions, ValidationOptions
from .service import service_of
from .warmth import second_order_warmed, warmed

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Operation:
    """One computation that is answered at once."""

    path: str
    summary: str
    options: type[Options]
    answer: str  # name of the published schema of the answer
    compute: Callable[[Design, Any], Steps[Any]]
    brief: Callable[[Any], bool] = lambda options: True  # with these options no step takes long


def _score(design: Design, options: ScoreOptions) -> Steps[Any]:
    from tailstack.scoring import score_steps

    return score_steps(design, second_order=options.second_order)


def _validate(design: Design, options: ValidationOptions) -> Steps[Any]:
    yield
    return validate(design)


def _first_order(options: ScoreOptions) -> bool:
    return not options.second_order


SCORES = Operation("/v1/scores", "First-order score", ScoreOptions, "score", _score, _first_order)
VALIDATIONS = Operation("/v1/validations", "Read and check a design", ValidationOptions, "validation", _validate)
OPERATIONS = (SCORES, VALIDATIONS)


async def in_short_lane(request: Request, compute: Callable[[], T], *, kernels: bool = True) -> T:
    """What ``compute`` returns.  Raises what it raises, and TransportError (busy, stopping, warming-up).

    ``kernels``: it needs them, and so waits a little while they are being compiled.
    """
    service = service_of(request)
    if kernels and service.warmth == "warming up":
        await warmed(service)
    return await service.short.run(request, Watch(service.settings.max_seconds, service.stopping), compute)


def answering(operation: Operation) -> Callable[[Request], Awaitable[Response]]:
    """The endpoint of an operation."""

    async def endpoint(request: Request) -> Response:
        asked = await read_asked(request, operation.options)
        service = service_of(request)
        if service.warmth == "warming up":
            await warmed(service)
        if not operation.brief(asked.options) and service.second_order != "ready":
            await second_order_warmed(service)
        here = service.settled and asked.quick_to_read and operation.brief(asked.options)
        return await service.short.run_steps(
            request,
            Watch(service.settings.max_seconds, service.stopping),
            _answer(operation, asked, service.settings),
            here_seconds=HERE_SECONDS if here else 0.0,
        )

    return endpoint


def _answer(operation: Operation, asked: Asked[Any], settings: Settings) -> Steps[Response]:
    """The answer of an operation.  Raises Placed, RequestError, MalformedError."""
    design = asked.design(settings)
    yield
    try:
        record = yield from operation.compute(design, asked.options)
    except TailstackError as error:
        raise Placed(error, asked.prefix) from None
    yield
    return record_response(record)

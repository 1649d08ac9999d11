"""What is answered at once: read strictly, compute in the short lane, answer with the record."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from starlette.requests import Request
from starlette.responses import Response

from tailstack.design import Design
from tailstack.errors import TailstackError

from ..documents import validate
from .answers import record_response
from .asked import Asked, read_asked
from .bodies import Placed
from .computing import Watch
from .options import Options, ScoreOptions, ValidationOptions
from .service import service_of
from .warmth import warmed

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Operation:
    """One computation that is answered at once."""

    path: str
    summary: str
    options: type[Options]
    answer: str  # name of the published schema of the answer
    compute: Callable[[Design, Any], Any]


def _score(design: Design, options: ScoreOptions) -> Any:
    from tailstack.scoring import score

    return score(design, second_order=options.second_order)


def _validate(design: Design, options: ValidationOptions) -> Any:
    return validate(design)


SCORES = Operation("/v1/scores", "First-order score", ScoreOptions, "score", _score)
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


def placed(asked: Asked[Any], design: Design, compute: Callable[[Design], T]) -> T:
    """``compute(design)``, with every refusal placed in what was sent.  Raises Placed."""
    try:
        return compute(design)
    except TailstackError as error:
        raise Placed(error, asked.prefix) from None


def answering(operation: Operation) -> Callable[[Request], Awaitable[Response]]:
    """The endpoint of an operation."""

    async def endpoint(request: Request) -> Response:
        asked = await read_asked(request, operation.options)
        settings = service_of(request).settings

        def compute() -> Any:
            return placed(asked, asked.design(settings), lambda design: operation.compute(design, asked.options))

        return record_response(await in_short_lane(request, compute))

    return endpoint

"""What a computing process does for the API: read what was sent, compute, write the answer.

Each function stands alone and takes and gives plain values: it is called in another process, which may be killed at any
moment (``compute_pool``).  Nothing here knows of requests, connections or databases.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

from tailstack.design import load_design
from tailstack.errors import MissingExtraError, TailstackError
from tailstack.extras import name_missing_extra

from ..documents import to_json
from ..operations.batch import read_sent
from ..operations.content import canonical
from ..operations.example import EXAMPLE_DESIGN, variants
from ..operations.operation import Call, JobRequest, Operation, Reception, size_of
from ..operations.perform import compute, plan
from ..operations.registry import OPERATIONS
from ..operations.request import DesignReferenceUnresolved, Request
from ..problems import RefusedAt, memory_error
from ..processes.task import Estimated, RawRequest, UnitResult
from ..settings import Settings
from ..tables import Format


def perform(call: Callable[[], Any]) -> Any:
    """What the call returns, or why it cannot: RefusedAt or DesignReferenceUnresolved, as a value.

    Any other exception is a defect, and the process tells of it.
    """
    try:
        with name_missing_extra():
            result = call()
            return (
                Estimated(result.seconds, partial(perform, result.compute)) if isinstance(result, Estimated) else result
            )
    except TailstackError as error:
        return RefusedAt.place(error)
    except DesignReferenceUnresolved as unresolved:
        return unresolved
    except MemoryError:
        return RefusedAt.place(memory_error())


def warm_up() -> None:
    """Load or compile every kernel that a request can need: no request waits for it."""
    from tailstack.batch import score_batch
    from tailstack.scoring import score

    design = load_design(EXAMPLE_DESIGN)
    to_json(score(design, second_order=True))
    for variant in map(load_design, variants()):
        score(variant)
    score_batch(design, {"/views/0/fiducial_noise_px": [0.5]})
    with suppress(MissingExtraError):
        from tailstack.optimisation import allocate, influence

        influence(design)
        allocate(design)


def receive(name: str, sent: RawRequest, settings: Settings) -> Reception | Estimated:
    """What a request to an operation comes to when it was read; then its answer, or a job.

    Raises RefusedAt, RequestError, LimitError, MalformedError, DesignReferenceUnresolved.
    """
    operation = OPERATIONS[name]
    if operation.body is not None:
        return operation.body.receive(sent, settings)
    request = operation.read(sent, settings)
    return Estimated(
        request.options.seconds(map(size_of, request.designs)), partial(_complete, operation, request, settings)
    )


def _complete(operation: Operation, request: Request, settings: Settings) -> Reception:
    if operation.immediate:
        try:
            answer = to_json(operation.run(Call(request.designs, request.options)))
        except TailstackError as error:
            raise request.place(error) from None
        return Reception(answer=answer, designs=() if request.patched else request.nameable)
    operation.check(request, settings)
    options = request.options.keep(*request.designs)
    titles = " against ".join(design.name for design in reversed(request.designs)) or operation.summary
    content = canonical({**request.data, **options})
    return Reception(job=JobRequest(operation.name, content, titles, request.bare_design), designs=request.nameable)


def compute_piece(sent: RawRequest, settings: Settings, spec: bytes, form: Format, *, first: bool) -> bytes:
    """Some rows of a table, as a piece of its answer in some format; ``first``: with what comes before all of them."""
    from ..operations.units.batch import encode

    request = read_sent(sent, settings).content
    return encode(request, compute("batch", request, json.loads(spec)), form, first=first)


def compute_unit(sent: RawRequest, settings: Settings, spec: bytes) -> bytes:
    """Some rows of a table, as a unit of a job."""
    return compute("batch", read_sent(sent, settings).content, json.loads(spec))


def join_units(sent: RawRequest, settings: Settings, results: tuple[UnitResult, ...]) -> bytes:
    """The record of a table, from all its units."""
    answer = plan("batch", read_sent(sent, settings).content, results).answer
    assert answer is not None
    return answer

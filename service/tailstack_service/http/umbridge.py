"""UM-Bridge 1.0: the protocol by which programs for uncertainty quantification ask a model for numbers.

The routes and the form of errors are the protocol's, not ours, and its clients are libraries of its own: none of this
is in the OpenAPI document.  What a model computes stands in ``umbridge_models``.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from fastapi import APIRouter, Depends, Request, Response

from tailstack.errors import Problem

from ..documents import to_json
from ..operations.sent import Placed
from ..problems import TransportError
from . import umbridge_models
from .answers import JSON
from .body import read_body
from .dependencies import Needs, TheService
from .posting import find_base
from .umbridge_models import INVALID, MODELS, VERBS, Reply, error_reply

router = APIRouter(
    prefix="/umbridge",
    include_in_schema=False,
    dependencies=[Depends(Needs("compute"))],
    default_response_class=Response,
)


@router.get("/Info")
async def info() -> Response:
    return Response(to_json({"protocolVersion": 1.0, "models": list(MODELS)}), media_type=JSON)


@router.post("/{verb}")
async def call(request: Request, service: TheService) -> Response:
    """What a client asks of a model.  Its libraries state no content type, or any: the body is JSON all the same."""
    verb = request.path_params["verb"]
    if verb not in VERBS:
        hint = f"it has {', '.join(VERBS)}, and Info for the models"
        raise TransportError("not-found", Problem("", "not-found", f"UM-Bridge has no {verb[:60]!r}", hint))
    body = await read_body(request)
    await service.places.wait_until_warm(service.settings.warm_up_seconds)
    try:
        reply = await _compute(request, verb, body, None)
        if reply.base_sha256 is not None:
            reply = await _compute(request, verb, body, await find_base(request, reply.base_sha256))
    except TransportError as error:
        if error.slug != "unknown-design":
            raise
        reply = error_reply(INVALID, error)
    return Response(reply.body, reply.status, media_type=JSON)


async def _compute(request: Request, verb: str, body: bytes, base: bytes | None) -> Reply:
    service: Any = request.app.state.service
    asked = partial(umbridge_models.answer, verb, body, base, service.settings)
    try:
        reply: Reply = await service.places.run(request, asked, VERBS[verb])
    except Placed as placed:  # the computation took longer than it may
        return error_reply(INVALID, placed.error)
    return reply

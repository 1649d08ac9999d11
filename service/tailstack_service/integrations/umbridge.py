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
from ..http.answers import JSON
from ..http.body import read_body
from ..http.dependencies import Needs, TheService
from ..http.posting import find_base
from ..operations.effort import text_reading_seconds
from ..operations.request import DesignReferenceUnresolved, RawRequest
from ..problems import RefusedAt, TransportError
from . import umbridge_models
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
    await service.pool.wait_until_warm(service.settings.warm_up_seconds)
    try:
        try:
            reply = await _compute(request, verb, body, None)
        except DesignReferenceUnresolved as unresolved:
            reply = await _compute(request, verb, body, await find_base(request, unresolved.sha256))
    except TransportError as error:
        if error.slug != "unknown-design":
            raise
        reply = error_reply(INVALID, error)
    return Response(reply.body, reply.status, media_type=JSON)


async def _compute(request: Request, verb: str, body: bytes, base: bytes | None) -> Reply:
    service: Any = request.app.state.service
    asked = partial(umbridge_models.answer, verb, body, base, service.settings)
    try:
        reply: Reply = await service.pool.run(request, asked, text_reading_seconds(RawRequest("json", body)))
    except RefusedAt as refused:  # the computation took more than it may
        return error_reply(INVALID, refused)
    return reply

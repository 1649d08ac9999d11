"""Results: immutable, named by their SHA-256, and rendered as reports on request."""

from __future__ import annotations

from functools import partial

from fastapi import APIRouter, Depends, Request, Response

from tailstack.errors import Problem

from ..problems import RequestError
from ..store import results as stored
from ..store.results import Result
from . import computations, effort
from .answers import JSON, tagged_response
from .asked import single
from .dependencies import Needs, TheService, query
from .jobs import nothing
from .service import service_of

FORMATS = ("html", "pdf", "xlsx", "json")
# private: whoever may read a result is decided by the credential, which a shared cache does not look at
router = APIRouter(tags=["results"], dependencies=[Depends(Needs("read"))])
FOR_EVER = {"Cache-Control": "private, max-age=31536000, immutable", "Vary": "Authorization"}


async def _found(request: Request) -> Result:
    """The result in the path, if a job of the caller's tenant came to it.  Raises TransportError 404."""
    sha256 = request.path_params["sha256"]
    result = await service_of(request).storage.run(stored.get, request.state.caller.tenant, sha256)
    if result is None:
        raise nothing("result", sha256)
    return result


def result_response(request: Request, result: Result, headers: dict[str, str] | None = None) -> Response:
    """A result as it was recorded, byte for byte."""
    return tagged_response(request, result.body, JSON, {**FOR_EVER, **(headers or {})}, result.sha256)


@router.get("/v1/results/{sha256}", operation_id="get_result", dependencies=[Depends(query())])
async def get_result(request: Request) -> Response:
    return result_response(request, await _found(request))


@router.get("/v1/results/{sha256}/report", operation_id="get_report", dependencies=[Depends(query("format"))])
async def get_report(request: Request, service: TheService) -> Response:
    form = single(request.query_params.multi_items(), "format")
    form = "html" if form is None else form
    if form not in FORMATS:
        detail = f"format is one of {', '.join(FORMATS)}; got {form[:40]!r}"
        raise RequestError(Problem("/format", "unknown-value", detail))
    result = await _found(request)
    call = partial(computations.report, result.schema_name, result.body, form)
    body, media_type = await service.places.run(request, call, effort.LONG if form != "json" else 0.0)
    headers = {
        "Cache-Control": "private, no-cache",
        "Content-Disposition": f'inline; filename="tailstack-{result.sha256[:12]}.{form}"',
        "X-Content-Type-Options": "nosniff",
        **_policy(form),
    }
    return tagged_response(request, body, media_type, headers)


def _policy(form: str) -> dict[str, str]:
    """A report holds text that a stranger may have written: the page runs what it came with and asks for nothing.

    Browsers show a PDF by a plug-in of their own, which such a policy forbids.
    """
    if form == "pdf":
        return {}
    from ..report.html import content_policy

    return {"Content-Security-Policy": content_policy(served=True)}

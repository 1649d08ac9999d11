"""Results: immutable, named by their SHA-256, and rendered as reports on request."""

from __future__ import annotations

from starlette.requests import Request
from starlette.responses import Response

from tailstack.errors import Problem

from ..problems import RequestError
from ..store import results as stored
from ..store.results import Result
from .answers import JSON, tagged_response
from .computing import Watch
from .jobs import nothing, single
from .service import service_of

FORMATS = ("html", "pdf", "xlsx", "json")
# private: whoever may read a result is decided by the credential, which a shared cache does not look at
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


async def get_result(request: Request) -> Response:
    return result_response(request, await _found(request))


async def get_report(request: Request) -> Response:
    form = single(request, "format")
    form = "html" if form is None else form
    if form not in FORMATS:
        detail = f"format is one of {', '.join(FORMATS)}; got {form[:40]!r}"
        raise RequestError(Problem("/format", "unknown-value", detail))
    service, result = service_of(request), await _found(request)

    def render() -> tuple[bytes, str]:
        from ..reports import render

        return render(result.schema_name, result.body, form)

    watch = Watch(service.settings.max_seconds, service.stopping)
    body, media_type = await service.reports.run(request, watch, render)
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
    from ..reports.html import content_policy

    return {"Content-Security-Policy": content_policy(served=True)}

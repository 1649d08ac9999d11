"""Jobs as a client meets them (pages, records, cancelling, events), and their results.

A result is immutable, named by its SHA-256, and rendered as a report on request.
"""

from __future__ import annotations

import json
import math
import re
import unicodedata
from collections.abc import AsyncIterator
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar
from urllib.parse import urlencode

from fastapi import APIRouter, Depends, Request, Response
from fastapi.responses import StreamingResponse

from tailstack.errors import Problem, TailstackError
from tailstack.results.json_text import write_json

from ..documents import to_json
from ..environment import variable
from ..jobs.document import KINDS, JobPage, job_document, problem_of
from ..jobs.store import jobs as stored
from ..jobs.store import results as stored_results
from ..jobs.store.database import Database
from ..jobs.store.events import estimate_eta_seconds, read_events
from ..jobs.store.jobs import Job
from ..jobs.store.results import StoredResult
from ..jobs.store.tables import STATES
from ..logs import moment
from ..operations.operation import LONG
from ..operations.rendering import FORMATS, MEDIA_TYPES, render
from ..operations.request import single
from ..problems import RequestError, TransportError
from ..processes.task import ENDED
from .answers import JSON, path_of, place, record_response, tagged_response
from .openapi import (
    REPORT,
    REPORT_FORMS,
    component,
    extra,
    job_links,
    json_of,
    media_types,
    parameter,
    query_parameter,
    reference,
    response_of,
    result_links,
)
from .problems import document_response
from .service import Needs, Seat, Service, TheService, query, service_of

PAGE, LARGEST_PAGE = 50, 200
LONGEST_RETRY = 30  # seconds
REVALIDATE = {"Cache-Control": "private, no-cache"}
CHANGING = {"ETag": "ETag", "Cache_Control": "CacheControl", "Retry_After": "RetryAfter"}

T = TypeVar("T")
router = APIRouter(tags=["jobs"], default_response_class=Response)
READ, COMPUTE = Depends(Needs("read")), Depends(Needs("compute"))


def require_found(found: T | None, what: str, name: str) -> T:
    """Raises TransportError 404, the same words for what never was and for what belongs to another tenant."""
    if found is None:
        raise TransportError("not-found", f"there is no {what} {name[:80]!r}")
    return found


async def find_job(request: Request) -> Job:
    """The job in the path, if it is the caller's.  Raises TransportError 404."""
    job_id = request.path_params["id"]
    job = await service_of(request).storage.run(stored.find_job, request.state.caller.tenant, job_id)
    return require_found(job, "job", job_id)


def retry_after(eta: float | None = None) -> dict[str, str]:
    """When it is worth asking again: soon for what is short."""
    return {"Retry-After": str(min(max(math.ceil((eta or 0) / 4), 1), LONGEST_RETRY))}


def accepted_response(job: Job, **headers: str) -> Response:
    """202 with the record of a job."""
    waiting = {} if job.is_over else retry_after()
    return record_response(job_document(job, place=place), 202, {**REVALIDATE, **waiting, **headers})


@router.get(
    "/v1/jobs/{id}",
    operation_id="get_job",
    dependencies=[READ, Depends(query())],
    summary="State, progress, problem and links of a job",
    description="While it runs, Retry-After says when it is worth asking again; with If-None-Match the answer is 304 "
    "until something has changed.",
    responses={
        200: response_of("The record.", json_of("Job", "Job"), **CHANGING) | {"links": job_links() | result_links()},
        304: response_of("Unchanged.", None, **CHANGING),
    },
    openapi_extra=extra(parameter("JobId"), parameter("IfNoneMatch"), problems=(404, 422, 503)),
)
async def get_job(request: Request) -> Response:
    """The record.  Its time to the end is that of the last event, so that equal versions are equal bytes."""
    job_id = request.path_params["id"]
    found, eta = await service_of(request).storage.run(_with_eta, request.state.caller.tenant, job_id)
    job = require_found(found, "job", job_id)
    waiting = {} if job.is_over else retry_after(eta)
    return tagged_response(request, to_json(job_document(job, eta, place)), JSON, {**REVALIDATE, **waiting})


def _with_eta(db: Database, tenant: str, job_id: str) -> tuple[Job | None, float | None]:
    job = stored.find_job(db, tenant, job_id)
    if job is None or job.state != "running":
        return job, None
    last = read_events(db, tenant, job_id, job.last_event - 1, 1)
    return job, last[0].data.get("eta_seconds") if last else None


@router.get(
    "/v1/jobs",
    operation_id="list_jobs",
    dependencies=[READ, Depends(query("limit", "cursor", "state", "kind"))],
    summary="Jobs, newest first",
    description="Those of the caller's tenant. The field next and the Link header lead to the next page.",
    responses={
        200: {
            **response_of(
                "A page, newest first.", json_of("JobPage", "JobPage"), Link="Link", Cache_Control="CacheControl"
            ),
            "links": {"get_job": {"operationId": "get_job", "parameters": {"id": "$response.body#/jobs/0/id"}}},
        },
    },
    openapi_extra=extra(
        query_parameter(
            "limit", {"type": "integer", "minimum": 1, "maximum": LARGEST_PAGE, "default": PAGE}, "Jobs a page."
        ),
        query_parameter(
            "cursor",
            {"type": "string"},
            "From the field next, or the Link header, of the page before; empty: the first page.",
        ),
        query_parameter("state", {"type": "string", "enum": list(STATES)}, "Only jobs in this state."),
        query_parameter("kind", {"type": "string", "enum": list(KINDS)}, "Only jobs of this kind."),
        problems=(422, 503),
    ),
)
async def list_jobs(request: Request) -> Response:
    options = _page_query(request)
    try:
        page = await service_of(request).storage.run(
            stored.list_page, request.state.caller.tenant, state=options.get("state"), kind=options.get("kind"),
            after=options.get("cursor"), limit=options["limit"],
        )  # fmt: skip
    except ValueError:
        detail = "the cursor is not one that this service gave"
        hint = "take it from the field next, or from the Link header"
        raise RequestError(Problem("/cursor", "bad-parameter", detail, hint)) from None
    following = "/v1/jobs?" + urlencode({**options, "cursor": page.next}) if page.next else None
    documents = tuple(
        job_document(job, estimate_eta_seconds(job.started_at, job.units_done, job.units_expected, page.at), place)
        for job in page.jobs
    )
    link = {"Link": f'<{following}>; rel="next"'} if following else {}
    found = JobPage("tailstack/jobs/1", documents, following and place(following))
    return record_response(found, 200, {**REVALIDATE, **link})


def _page_query(request: Request) -> dict[str, Any]:
    options: dict[str, Any] = {"limit": PAGE}
    for name, known in (("state", tuple(STATES)), ("kind", KINDS), ("cursor", None), ("limit", None)):
        value = single(request.query_params.multi_items(), name)
        if value is None or (name == "cursor" and not value):  # an empty cursor is the first page
            continue
        if known is not None and value not in known:
            detail = f"{name} is one of {', '.join(known)}; got {value[:40]!r}"
            raise RequestError(Problem(f"/{name}", "unknown-value", detail))
        options[name] = _limit(value) if name == "limit" else value
    return options


def _limit(text: str) -> int:
    limit = int(text) if text.isascii() and text.isdigit() and len(text) < 10 else 0
    if not 1 <= limit <= LARGEST_PAGE:
        detail = f"limit is a whole number from 1 to {LARGEST_PAGE}; got {text[:40]!r}"
        raise RequestError(Problem("/limit", "out-of-range", detail))
    return limit


@router.post(
    "/v1/jobs/{id}/cancel",
    operation_id="cancel_job",
    dependencies=[COMPUTE, Depends(query())],
    summary="Cancel a job",
    description="Nothing of it can be recorded from then on. Again 202 for a job that was cancelled before.",
    status_code=202,
    responses={
        202: response_of("Cancelled.", json_of("Job", "Job"), Cache_Control="CacheControl") | {"links": job_links()}
    },
    openapi_extra=extra(parameter("JobId"), problems=(404, 409, 422, 503)),
)
async def cancel_job(request: Request) -> Response:
    job_id = request.path_params["id"]
    found = await service_of(request).storage.write(stored.cancel_job, request.state.caller.tenant, job_id)
    job = require_found(found, "job", job_id)
    if job.state != "cancelled":
        detail = f"the job has {job.state}; there is nothing to cancel"
        raise TransportError("finished", detail, f"GET /v1/jobs/{job.id}")
    return accepted_response(job)


@router.get(
    "/v1/jobs/{id}/result",
    operation_id="get_job_result",
    dependencies=[READ, Depends(query())],
    summary="From a job to its result",
    description="A job that failed answers with its own problem and that problem's status.",
    status_code=303,
    responses={303: response_of("The result is there.", Location="ResultLocation", Cache_Control="CacheControl")},
    openapi_extra=extra(parameter("JobId"), problems=(404, 409, 422, 503)),
)
async def get_job_result(request: Request) -> Response:
    job = await find_job(request)
    if job.state == "succeeded":
        return Response(b"", 303, {"Location": f"/v1/results/{job.result_sha256}", **REVALIDATE})
    return failure_response(request, job)


def failure_response(request: Request, job: Job, *, bare_design: bool = False) -> Response:
    """Why there is no result.  ``bare_design``: the body was the design itself, so pointers start inside it."""
    if job.problem is not None:
        document = problem_of(job.problem)
        errors = document.errors
        if bare_design:
            errors = tuple(replace(entry, pointer=entry.pointer.removeprefix("/design")) for entry in errors)
        return document_response(
            replace(document, instance=path_of(request), request_id=request.state.request_id, errors=errors)
        )
    if job.is_over:
        raise TransportError("cancelled", "the job was cancelled; it has no result")
    detail = f"the job is {job.state}: {job.units_done} of about {job.units_expected} units are done"
    hint = f"ask again later, or follow /v1/jobs/{job.id}/events"
    raise TransportError("not-finished", detail, hint, retry_after())


# --- what happens to a job, as server-sent events: rows of the database, so that a stream can be taken up again ------

EVENT_STREAM = "text/event-stream"
AT_ONCE = 200  # rows read in one look
LOOK_SECONDS, IDLE_SECONDS = 0.1, 0.5  # between looks: just after something happened, and after a while
HEARTBEAT_SECONDS = 10.0  # shorter than the time after which proxies end a silent connection
RETRY_MS = 1000
SEAT_SECONDS = 5  # after which a seat may be free


@router.get(
    "/v1/jobs/{id}/events",
    operation_id="get_job_events",
    dependencies=[READ, Depends(query())],
    summary="What happens to a job, as server-sent events",
    description="The schema is that of one event. Events state, progress and recomputed; id counts them from 1, data "
    "is one JSON object. The stream begins after Last-Event-ID, heartbeats are comments, and it ends after "
    "the final state.",
    responses={
        200: response_of(
            "The stream.",
            media_types(EVENT_STREAM, reference("schemas", "JobEvent"), "JobEvent"),
            Cache_Control="CacheControl",
            X_Accel_Buffering="Unbuffered",
        ),
        204: response_of("The job has ended and the client has seen everything: stop asking."),
    },
    openapi_extra=extra(parameter("JobId"), parameter("LastEventID"), problems=(404, 422, 429, 503)),
)
async def get_events(request: Request, service: TheService) -> Response:
    after = _last_event_id(request)
    job = await find_job(request)
    if job.is_over and job.last_event <= after:
        return Response(b"", 204)  # which tells an EventSource to stop asking
    if (seat := service.seat(job.tenant)) != "seated":
        raise _seat_error(service, seat)
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}  # nginx would hold events back
    # who has seen more than there is has seen what there is: the stream of a later event alone would never end
    return _EventStream(service, job.tenant, _stream(service, job, min(after, job.last_event)), headers)


def _seat_error(service: Service, seat: Seat) -> TransportError:
    if seat == "share taken":
        slug, setting, whose = "too-many-streams", "max_tenant_streams", " of one tenant"
    else:
        slug, setting, whose = "busy", "max_streams", ""
    detail = f"{getattr(service.settings, setting)} event streams and waits{whose} are open, the limit"
    hint = f"close one, or ask for the job's record instead; the operator's setting is {variable(setting)}"
    return TransportError(slug, detail, hint, {"Retry-After": str(SEAT_SECONDS)})


class _EventStream(StreamingResponse):
    """Gives its seat back when it has ended, whichever way, even if it never began."""

    def __init__(self, service: Service, tenant: str, content: AsyncIterator[bytes], headers: dict[str, str]) -> None:
        super().__init__(content, headers=headers, media_type=EVENT_STREAM)
        self.headers["content-type"] = EVENT_STREAM  # always UTF-8: the standard has no charset here
        self.service, self.tenant = service, tenant

    async def __call__(self, scope, receive, send) -> None:  # type: ignore[no-untyped-def]
        try:
            await super().__call__(scope, receive, send)
        finally:
            self.service.leave(self.tenant)


def _last_event_id(request: Request) -> int:
    """Sequence of the last event the client saw."""
    text = request.headers.get("last-event-id", "").strip() or "0"
    if not (text.isascii() and text.isdigit() and len(text) < 16):
        detail = f"the Last-Event-ID is a whole number; got {text[:40]!r}"
        raise RequestError(Problem("", "bad-header", detail, "send the id of the last event that was read"))
    return int(text)


async def _stream(service: Service, job: Job, after: int) -> AsyncIterator[bytes]:
    yield f"retry: {RETRY_MS}\n\n".encode()
    clock = service.clock
    written = looked = clock.monotonic()  # when something was last sent, and last looked for
    wait = LOOK_SECONDS
    while not service.stopping.is_set():
        try:
            events = await service.storage.run(read_events, job.tenant, job.id, after, AT_ONCE)
        except TailstackError:  # the database is away for a moment; what happens meanwhile is still to come
            events = []
        for event in events:
            after = event.sequence
            data = write_json({"job": job.id, "at": moment(event.at), **event.data})
            yield f"id: {event.sequence}\nevent: {event.name}\ndata: {data}\n\n".encode()
        now = clock.monotonic()
        if events:
            written, wait = now, LOOK_SECONDS
            if events[-1].name == "state" and events[-1].data.get("state") in ENDED:
                return
            continue
        if now - written > HEARTBEAT_SECONDS:
            written = now
            yield b": still here\n\n"
            if await _is_deleted(service, job):
                return
        wait = min(1.2 * wait, IDLE_SECONDS)
        looked = now
        while (left := looked + wait - clock.monotonic()) > 0 and not service.stopping.is_set():
            await clock.sleep_async(min(left, LOOK_SECONDS))


async def _is_deleted(service: Service, job: Job) -> bool:
    """Whether the job was deleted (its time to be kept is over) while somebody listened."""
    try:
        return await service.storage.run(stored.find_job, job.tenant, job.id) is None
    except TailstackError:
        return False


# --- results ------------------------------------------------------------------------------------------

UNCHANGING = {"ETag": "ETag", "Cache_Control": "CacheControl", "Vary": "Vary"}
ANY_RECORD = [reference("schemas", component(kind)) for kind in KINDS]
# private: whoever may read a result is decided by the credential, which a shared cache does not look at
result_router = APIRouter(tags=["results"], dependencies=[Depends(Needs("read"))], default_response_class=Response)
FOR_EVER = {"Cache-Control": "private, max-age=31536000, immutable", "Vary": "Authorization"}


async def find_result(request: Request) -> StoredResult:
    """The result in the path, if a job of the caller's tenant came to it.  Raises TransportError 404."""
    sha256 = request.path_params["sha256"]
    result = await service_of(request).storage.run(stored_results.read_result, request.state.caller.tenant, sha256)
    return require_found(result, "result", sha256)


def result_response(request: Request, result: StoredResult, headers: dict[str, str] | None = None) -> Response:
    """A result as it was recorded, byte for byte."""
    return tagged_response(request, result.body, JSON, {**FOR_EVER, **(headers or {})}, result.sha256)


@result_router.get(
    "/v1/results/{sha256}",
    operation_id="get_result",
    dependencies=[Depends(query())],
    summary="A result, which never changes",
    description="It is named by the SHA-256 of its bytes and may be kept for ever. Its field schema says which record "
    "it is.",
    responses={
        200: response_of("The result.", media_types(JSON, {"oneOf": ANY_RECORD, "x-more-values": True}), **UNCHANGING),
        304: response_of("The client has it.", None, **UNCHANGING),
    },
    openapi_extra=extra(parameter("Sha256"), parameter("IfNoneMatch"), problems=(404, 422, 503)),
)
async def get_result(request: Request) -> Response:
    return result_response(request, await find_result(request))


@result_router.get(
    "/v1/results/{sha256}/report",
    operation_id="get_report",
    dependencies=[Depends(query("format", "summary"))],
    summary="A result as a report",
    description="Any result, rendered for people: html (one self-contained file), pdf, xlsx; or json, the record "
    "itself. Nothing is computed anew, and the record stands in every format. With summary a pdf is one page.",
    responses={
        200: response_of("The report.", REPORT_FORMS, ETag="ETag", Cache_Control="CacheControl", **REPORT),
        304: response_of("The client has it.", None, ETag="ETag", Cache_Control="CacheControl", **REPORT),
    },
    openapi_extra=extra(
        parameter("Sha256"),
        query_parameter("format", {"type": "string", "enum": list(FORMATS), "default": "html"}, "Of the report."),
        query_parameter("summary", {"type": "boolean", "default": False}, "One page of A4, to sign: of format pdf."),
        parameter("IfNoneMatch"),
        problems=(404, 422, 501, 503),
    ),
)
async def get_report(request: Request) -> Response:
    asked = request.query_params.multi_items()
    form, wanted = single(asked, "format"), single(asked, "summary")
    form, summary = "html" if form is None else form, wanted == "true"
    if form not in FORMATS:
        detail = f"format is one of {', '.join(FORMATS)}; got {form[:40]!r}"
        raise RequestError(Problem("/format", "unknown-value", detail))
    if wanted not in (None, "false", "true") or (summary and form != "pdf"):
        detail = f"summary is true or false, and true of a pdf alone; got {str(wanted)[:40]!r} with format={form}"
        raise RequestError(Problem("/summary", "unknown-value", detail, "format=pdf&summary=true"))
    result = await find_result(request)
    name, sha256 = result.schema_name, result.sha256
    body, headers = await render_report(request, name, result.body, form, sha256, summary=summary)
    return tagged_response(request, body, MEDIA_TYPES[form], {**REVALIDATE, **headers})


async def render_report(
    request: Request, name: str, record: bytes, form: str, sha256: str, *, summary: bool = False
) -> tuple[bytes, dict[str, str]]:
    """A record as a report, and the headers that it is sent with.

    name: of the operation that made it.  record: its JSON, with its sha256.  form: one of FORMATS.
    """
    call = partial(render, name, record, form, summary=summary)
    body = await service_of(request).pool.run(request, call, LONG if form != "json" else 0.0)
    saved_as = (_file_name(record) or f"tailstack-{sha256[:12]}") + ".summary" * summary
    return body, {
        "Content-Disposition": f'inline; filename="{saved_as}.{form}"',
        "X-Content-Type-Options": "nosniff",
        **_policy(form),
    }


DESIGN_NAME = re.compile(rb'"design_name": *("(?:[^"\\\\]|\\\\.)*")')


def _file_name(record: bytes) -> str:
    """The name of the design that a record is of, as that of a file; the page names its files by the same rule."""
    found = DESIGN_NAME.search(record)
    letters = "" if found is None else unicodedata.normalize("NFKD", json.loads(found[1]).lower())
    name = "".join(letter for letter in letters if not unicodedata.combining(letter))
    return re.sub(r"[^a-z0-9]+", "-", name).strip("-")[:60].rstrip("-")


def _policy(form: str) -> dict[str, str]:
    """A report holds text that a stranger may have written: the page runs what it came with and asks for nothing.

    Browsers show a PDF by a plug-in of their own, which such a policy forbids.
    """
    if form == "pdf":
        return {}
    from ..report.html import content_policy

    return {"Content-Security-Policy": content_policy(served=True)}

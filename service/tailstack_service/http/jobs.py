"""Jobs as a client meets them: pages, records, cancelling, and the way to a result."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any
from urllib.parse import urlencode

from fastapi import APIRouter, Depends, Request, Response

from tailstack.errors import Problem

from ..documents import to_json
from ..job_document import JobPage, job_document, problem_of
from ..problems import RequestError, TransportError
from ..store import jobs as stored
from ..store.database import Database
from ..store.events import eta_seconds, events_after
from ..store.jobs import Job
from ..store.tables import STATES
from ..work.kinds import KINDS
from .answers import JSON, path_of, record_response, stated_problem, tagged_response
from .asked import single
from .dependencies import Needs, query
from .service import service_of

PAGE, LARGEST_PAGE = 50, 200
LONGEST_RETRY = 30  # seconds
REVALIDATE = {"Cache-Control": "private, no-cache"}

router = APIRouter(tags=["jobs"])
READ, COMPUTE = Depends(Needs("read")), Depends(Needs("compute"))


def nothing(what: str, name: str) -> TransportError:
    """404, the same words for what never was and for what belongs to another tenant."""
    return TransportError("not-found", Problem("", "not-found", f"there is no {what} {name[:80]!r}"))


async def found(request: Request) -> Job:
    """The job in the path, if it is the caller's.  Raises TransportError 404."""
    job_id = request.path_params["id"]
    job = await service_of(request).storage.run(stored.find, request.state.caller.tenant, job_id)
    if job is None:
        raise nothing("job", job_id)
    return job


def retry_after(eta: float | None = None) -> dict[str, str]:
    """When it is worth asking again: soon for what is short."""
    return {"Retry-After": str(min(max(math.ceil((eta or 0) / 4), 1), LONGEST_RETRY))}


def accepted(job: Job, **headers: str) -> Response:
    """202 with the record of a job."""
    waiting = {} if job.finished else retry_after()
    return record_response(job_document(job), 202, {**REVALIDATE, **waiting, **headers})


@router.get("/v1/jobs/{id}", operation_id="get_job", dependencies=[READ, Depends(query())])
async def get_job(request: Request) -> Response:
    """The record.  Its time to the end is that of the last event, so that equal versions are equal bytes."""
    job_id = request.path_params["id"]
    job, eta = await service_of(request).storage.run(_with_eta, request.state.caller.tenant, job_id)
    if job is None:
        raise nothing("job", job_id)
    waiting = {} if job.finished else retry_after(eta)
    return tagged_response(request, to_json(job_document(job, eta)), JSON, {**REVALIDATE, **waiting})


def _with_eta(db: Database, tenant: str, job_id: str) -> tuple[Job | None, float | None]:
    job = stored.find(db, tenant, job_id)
    if job is None or job.state != "running":
        return job, None
    last = events_after(db, tenant, job_id, job.last_event - 1, 1)
    return job, last[0].data.get("eta_seconds") if last else None


@router.get(
    "/v1/jobs", operation_id="list_jobs", dependencies=[READ, Depends(query("limit", "cursor", "state", "kind"))]
)
async def list_jobs(request: Request) -> Response:
    wanted = _page_query(request)
    try:
        page = await service_of(request).storage.run(
            stored.page, request.state.caller.tenant, state=wanted.get("state"), kind=wanted.get("kind"),
            after=wanted.get("cursor"), limit=wanted["limit"],
        )  # fmt: skip
    except ValueError:
        detail = "the cursor is not one that this service gave"
        hint = "take it from the field next, or from the Link header"
        raise RequestError(Problem("/cursor", "bad-parameter", detail, hint)) from None
    following = "/v1/jobs?" + urlencode({**wanted, "cursor": page.next}) if page.next else None
    now = time.time()
    documents = tuple(
        job_document(job, eta_seconds(job.started_at, job.units_done, job.units_expected, now)) for job in page.jobs
    )
    link = {"Link": f'<{following}>; rel="next"'} if following else {}
    return record_response(JobPage("tailstack/jobs/1", documents, following), 200, {**REVALIDATE, **link})


def _page_query(request: Request) -> dict[str, Any]:
    wanted: dict[str, Any] = {"limit": PAGE}
    for name, known in (("state", tuple(STATES)), ("kind", tuple(KINDS)), ("cursor", None), ("limit", None)):
        value = single(request.query_params.multi_items(), name)
        if value is None or (name == "cursor" and not value):  # an empty cursor is the first page
            continue
        if known is not None and value not in known:
            detail = f"{name} is one of {', '.join(known)}; got {value[:40]!r}"
            raise RequestError(Problem(f"/{name}", "unknown-value", detail))
        wanted[name] = _limit(value) if name == "limit" else value
    return wanted


def _limit(text: str) -> int:
    if not (text.isascii() and text.isdigit() and 1 <= int(text[:9]) <= LARGEST_PAGE):
        detail = f"limit is a whole number from 1 to {LARGEST_PAGE}; got {text[:40]!r}"
        raise RequestError(Problem("/limit", "out-of-range", detail))
    return int(text)


@router.post("/v1/jobs/{id}/cancel", operation_id="cancel_job", dependencies=[COMPUTE, Depends(query())])
async def cancel_job(request: Request) -> Response:
    """202 once nothing of the job can be recorded any more; again 202 if it was cancelled before."""
    job_id = request.path_params["id"]
    job = await service_of(request).storage.write(stored.cancel, request.state.caller.tenant, job_id)
    if job is None:
        raise nothing("job", job_id)
    if job.state != "cancelled":
        detail = f"the job has {job.state}; there is nothing to cancel"
        raise TransportError("finished", Problem("", "finished", detail, f"GET /v1/jobs/{job.id}"))
    return accepted(job)


@router.get("/v1/jobs/{id}/result", operation_id="get_job_result", dependencies=[READ, Depends(query())])
async def get_job_result(request: Request) -> Response:
    """303 to the result; the job's own problem if it failed."""
    job = await found(request)
    if job.state == "succeeded":
        return Response(b"", 303, {"Location": f"/v1/results/{job.result_sha256}", **REVALIDATE})
    return unsuccessful(request, job)


def unsuccessful(request: Request, job: Job, *, bare_design: bool = False) -> Response:
    """Why there is no result.  ``bare_design``: the body was the design itself, so pointers start inside it."""
    if job.problem is not None:
        document = problem_of(job.problem)
        errors = document.errors
        if bare_design:
            errors = tuple(replace(entry, pointer=entry.pointer.removeprefix("/design")) for entry in errors)
        return stated_problem(
            replace(document, instance=path_of(request), request_id=request.state.request_id, errors=errors)
        )
    if job.finished:
        raise TransportError("cancelled", Problem("", "cancelled", "the job was cancelled; it has no result"))
    detail = f"the job is {job.state}: {job.units_done} of about {job.units_expected} units are done"
    hint = f"ask again later, or follow /v1/jobs/{job.id}/events"
    raise TransportError("not-finished", Problem("", "not-finished", detail, hint), retry_after())

"""Computations over HTTP: what is answered at once, and what becomes a job and is perhaps waited for."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from functools import partial
from typing import Annotated, TypeVar

from fastapi import APIRouter, Depends, Request, Response

from tailstack import __version__
from tailstack.errors import Problem

from ..jobs.store import jobs as stored
from ..jobs.store import results
from ..jobs.store.errors import StoreUnavailable
from ..jobs.store.jobs import Job
from ..jobs.store.usage import sum_cpu_seconds
from ..problems import TransportError
from ..settings import variable
from . import computations, effort
from .answers import JSON, idempotency_key, wait_seconds
from .asked import Sent
from .body import strict_body
from .computations import JobRequest
from .dependencies import Needs, TheService
from .jobs import accepted_response, failure_response, result_response
from .operations import JOB_OPERATIONS, OPERATIONS, SCORES, JobOperation, Operation
from .service import Service, note_policy, service_of

T = TypeVar("T")

log = logging.getLogger("tailstack.service")
HOUR = 3600.0
BUDGET_RETRY_SECONDS = 60  # what was used leaves the last hour minute by minute
FIRST_LOOK, LONGEST_LOOK = 0.01, 0.25  # seconds between looks at a job that somebody waits for
RAW = ("text/csv", "text/plain")  # what a conversion reads besides

router = APIRouter(tags=["computations"], dependencies=[Depends(Needs("compute"))])
DesignSent = Annotated[Sent, Depends(strict_body())]
DesignsSent = Annotated[Sent, Depends(strict_body(yaml=False, hint="options go into the body, beside the designs"))]
GateSent = Annotated[Sent, Depends(strict_body(hint="options go into the body, beside the designs"))]
FileSent = Annotated[Sent, Depends(strict_body(raw=RAW, hint="format and to go into the body, beside the content"))]


async def computed(request: Request, call: Callable[[], T], expected_seconds: float, *, kernels: bool = True) -> T:
    """What the call returns, computed in a process of its own.  Raises what ``Places.run`` does.

    ``kernels``: it needs them, and so waits a little while they are being compiled (TransportError 503 if longer).
    """
    service = service_of(request)
    if kernels:
        await service.places.wait_until_warm(service.settings.warm_up_seconds)
    return await service.places.run(request, call, expected_seconds)


def _answering(operation: Operation) -> Callable[[Request, Service, Sent], Awaitable[Response]]:
    """The endpoint of a computation that is answered at once."""

    async def create(request: Request, service: TheService, sent: DesignSent) -> Response:
        seconds = effort.reading_seconds(sent)
        if operation is SCORES:
            sizes = effort.sizes_of(sent)
            second_order = effort.asks_second_order(sent)
            seconds += effort.LONG if sizes is None else effort.score_seconds(sizes, second_order=second_order)
        call = partial(computations.answer, operation.path, sent, service.settings)
        return Response(await computed(request, call, seconds), media_type=JSON)

    return create


def _submitting(operation: JobOperation) -> Callable[[Request, Service, Sent], Awaitable[Response]]:
    """The endpoint of a computation of one design that becomes a job."""

    async def create(request: Request, service: TheService, sent: DesignSent) -> Response:
        key = idempotency_key(request)
        call = partial(computations.job_request, operation.kind, sent, service.settings)
        return await submitted(request, await computed(request, call, effort.admission_seconds(sent)), key)

    return create


for _operation in OPERATIONS:
    router.add_api_route(
        _operation.path, _answering(_operation), methods=["POST"], operation_id=f"create_{_operation.answer}",
        summary=_operation.summary,
    )  # fmt: skip
for _job in JOB_OPERATIONS:
    router.add_api_route(
        _job.path, _submitting(_job), methods=["POST"], operation_id=f"create_{_job.kind}", summary=_job.summary
    )


@router.post("/v1/conversions", operation_id="create_conversion", summary="Convert a fiducial file or a design")
async def create_conversion(request: Request, service: TheService, sent: FileSent) -> Response:
    """Nothing is read from disk or fetched."""
    call = partial(computations.conversion, sent, service.settings)
    body = await computed(request, call, effort.reading_seconds(sent), kernels=False)
    return Response(body, media_type=JSON)


@router.post("/v1/comparisons", operation_id="create_comparison", summary="Compare two designs")
async def create_comparison(request: Request, service: TheService, sent: DesignsSent) -> Response:
    """Two designs checked alike, with one seed, and what sets them apart; always a job."""
    key = idempotency_key(request)
    call = partial(computations.comparison_request, sent, service.settings)
    return await submitted(request, await computed(request, call, effort.admission_seconds(sent)), key)


@router.post("/v1/gates", operation_id="create_gate", summary="Hold designs to a policy")
async def create_gate(request: Request, service: TheService, sent: GateSent) -> Response:
    """First order at once, Monte Carlo as a job."""
    key = idempotency_key(request)
    call = partial(computations.gate, sent, service.settings)
    terms, found = await computed(request, call, effort.gate_seconds(sent))
    await note_policy(request, terms)
    if isinstance(found, JobRequest):
        return await submitted(request, found, key)
    return Response(found, media_type=JSON)


async def submitted(request: Request, posted: JobRequest, key: str | None) -> Response:
    """The answer to a request that was checked: its job, or with Prefer: wait perhaps already its result.

    Raises TransportError (cpu-budget), QueueFull, IdempotencyConflict, StoreUnavailable.
    """
    service, tenant = service_of(request), request.state.caller.tenant
    settings = service.settings
    await _hold_to_budget(service, tenant)
    job, new = await service.storage.write(
        stored.submit_job, tenant=tenant, kind=posted.kind, request=posted.request, design_name=posted.design_name,
        solver_version=__version__, request_id=request.state.request_id, idempotency_key=key,
        max_queued=settings.max_queued_jobs,
    )  # fmt: skip
    if new:
        fields = {"request": request.state.request_id, "job": job.id, "kind": job.kind, "tenant": tenant}
        log.info("accepted a job", extra={"action": "accepted", **fields})
    headers = {"Location": f"/v1/jobs/{job.id}"}
    if not new:
        headers["Idempotency-Replayed"] = "true"
    wait = wait_seconds(request, settings.max_wait_seconds)
    if wait is None:
        return accepted_response(job, **headers)
    headers["Preference-Applied"] = f"wait={wait}"
    job = await _awaited(request, service, job, wait)
    if job.state == "succeeded":
        result = await service.storage.run(results.read_result, tenant, str(job.result_sha256))
        if result is not None:  # otherwise its time to be kept ended while we looked
            here = {"Content-Location": f"/v1/results/{result.sha256}", **headers}
            return result_response(request, result, here)
    if job.state == "failed":
        response = failure_response(request, job, bare_design=posted.bare_design)
        response.headers.update(headers)
        return response
    return accepted_response(job, **headers)


async def _hold_to_budget(service: Service, tenant: str) -> None:
    """Refuse a tenant that used its CPU seconds of the last hour.  Raises TransportError 429."""
    budget = service.settings.cpu_seconds_per_hour
    if budget <= 0:
        return
    used = await service.storage.run(sum_cpu_seconds, tenant, time.time() - HOUR)
    if used >= budget:
        detail = f"{budget:g} CPU seconds an hour are given to a tenant; {used:.0f} were used in the last hour"
        hint = f"come back later; the operator's setting is {variable('cpu_seconds_per_hour')}"
        raise TransportError(
            "cpu-budget", Problem("", "cpu-budget", detail, hint), {"Retry-After": str(BUDGET_RETRY_SECONDS)}
        )


async def _awaited(request: Request, service: Service, job: Job, seconds: float) -> Job:
    """The job when it has ended, or as it is after so many seconds.

    Waiting is a wish: it ends early when too many wait already, the service stops, or the caller has left.
    """
    if service.seat(job.tenant) != "seated":
        return job
    try:
        deadline, look = time.monotonic() + seconds, FIRST_LOOK
        while not job.finished and (left := deadline - time.monotonic()) > 0 and not service.stopping.is_set():
            await asyncio.sleep(min(look, left))
            if await request.is_disconnected():
                break
            look = min(1.3 * look, LONGEST_LOOK)
            with suppress(StoreUnavailable):  # what was accepted stays accepted, and its address is known
                seen = await service.storage.run(stored.find_job, job.tenant, job.id)
                job = seen or job
        return job
    finally:
        service.leave(job.tenant)

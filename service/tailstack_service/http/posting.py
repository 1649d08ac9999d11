"""What becomes a job: checked strictly first, then written down, then waited for as long as the caller likes."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from starlette.requests import Request
from starlette.responses import Response

from tailstack import __version__
from tailstack.design import Design
from tailstack.errors import Problem

from ..problems import TransportError
from ..settings import Settings, variable
from ..store import jobs as stored
from ..store import results
from ..store.errors import StoreUnavailable
from ..store.jobs import Job
from ..store.usage import cpu_seconds_since
from ..work.requests import canonical
from . import checks
from .asked import Asked, read_asked
from .jobs import accepted, unsuccessful
from .operations import in_short_lane
from .options import OptimisationOptions, Options, ReportOptions, SweepOptions, VerificationOptions
from .preferences import idempotency_key, wait_seconds
from .results import result_response
from .service import Service, service_of

log = logging.getLogger("tailstack.service")
HOUR = 3600.0
BUDGET_RETRY_SECONDS = 60  # what was used leaves the last hour minute by minute
FIRST_LOOK, LONGEST_LOOK = 0.01, 0.25  # seconds between looks at a job that somebody waits for


@dataclass(frozen=True, slots=True)
class Posted:
    """A request that was checked and can become a job."""

    kind: str
    request: bytes  # canonical JSON; what each kind holds is said in tailstack_service.work
    design_name: str
    bare_design: bool = False  # the body was the design itself


@dataclass(frozen=True, slots=True)
class JobOperation:
    """One computation of one design that becomes a job."""

    path: str
    kind: str
    summary: str
    options: type[Options]
    check: Callable[[Asked[Any], Design, Settings], None]  # raises Placed, RequestError, LimitError
    kept: Callable[[Any, Design], dict[str, Any]] = lambda options, design: options.model_dump()
    limits: tuple[str, ...] = ()  # settings that workers have to know, because they shape the answer


JOB_OPERATIONS = (
    JobOperation(
        "/v1/verifications", "verification", "Monte Carlo check", VerificationOptions, checks.check_verification,
        limits=("max_trials",),
    ),
    JobOperation(
        "/v1/optimisations", "optimisation", "Optimise placement and tolerances", OptimisationOptions,
        checks.check_optimisation,
    ),
    JobOperation(
        "/v1/sweeps", "sweep", "Many designs", SweepOptions, checks.check_sweep, checks.sweep_options, ("max_trials",)
    ),
    JobOperation(
        "/v1/reports", "report", "One record of score, check and optimisation", ReportOptions, checks.check_report,
        limits=("max_trials",),
    ),
)  # fmt: skip


def posting(operation: JobOperation) -> Callable[[Request], Awaitable[Response]]:
    """The endpoint of an operation."""

    async def endpoint(request: Request) -> Response:
        asked = await read_asked(request, operation.options)
        settings = service_of(request).settings

        def prepare() -> Posted:
            design = asked.design(settings)
            operation.check(asked, design, settings)
            options = operation.kept(asked.options, design)
            limits = {name: getattr(settings, name) for name in operation.limits}
            content = {"design": asked.data(design), **options, **limits}
            return Posted(operation.kind, canonical(content), design.name, asked.bare_design)

        key = idempotency_key(request)
        return await submitted(request, await in_short_lane(request, prepare), key)

    return endpoint


async def submitted(request: Request, posted: Posted, key: str | None) -> Response:
    """The answer to a request that was checked: its job, or with Prefer: wait perhaps already its result.

    Raises TransportError (cpu-budget), QueueFull, IdempotencyConflict, StoreUnavailable.
    """
    service, tenant = service_of(request), request.state.caller.tenant
    settings = service.settings
    await _hold_to_budget(service, tenant)
    job, new = await service.storage.write(
        stored.submit, tenant=tenant, kind=posted.kind, request=posted.request, design_name=posted.design_name,
        solver_version=__version__, request_id=request.state.request_id, idempotency_key=key,
        max_queued=settings.max_queued_jobs,
    )  # fmt: skip
    if new:
        log.info("", extra={"action": "accepted", "request": request.state.request_id, "job": job.id,
                            "kind": job.kind, "tenant": tenant})  # fmt: skip
    headers = {"Location": f"/v1/jobs/{job.id}"}
    if not new:
        headers["Idempotency-Replayed"] = "true"
    wait = wait_seconds(request, settings.max_wait_seconds)
    if wait is None:
        return accepted(job, **headers)
    headers["Preference-Applied"] = f"wait={wait}"
    job = await _awaited(request, service, job, wait)
    if job.state == "succeeded":
        result = await service.storage.run(results.get, tenant, str(job.result_sha256))
        if result is not None:  # otherwise its time to be kept ended while we looked
            here = {"Content-Location": f"/v1/results/{result.sha256}", **headers}
            return result_response(request, result, here)
    if job.state == "failed":
        response = unsuccessful(request, job, bare_design=posted.bare_design)
        response.headers.update(headers)
        return response
    return accepted(job, **headers)


async def _hold_to_budget(service: Service, tenant: str) -> None:
    """Refuse a tenant that used its CPU seconds of the last hour.  Raises TransportError 429."""
    budget = service.settings.cpu_seconds_per_hour
    if budget <= 0:
        return
    used = await service.storage.run(cpu_seconds_since, tenant, time.time() - HOUR)
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
                seen = await service.storage.run(stored.find, job.tenant, job.id)
                job = seen or job
        return job
    finally:
        service.leave(job.tenant)

"""Computations over HTTP: each operation has its route; what it came to is answered, or becomes a job."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from shlex import quote
from typing import Any, TypeVar

from fastapi import APIRouter, Depends, Request, Response
from fastapi.responses import StreamingResponse

from tailstack.errors import LimitError, Problem, TailstackError

from ..environment import variable
from ..jobs.store import jobs as stored
from ..jobs.store import results
from ..jobs.store.jobs import Job
from ..jobs.store.usage import sum_cpu_seconds
from ..operations import perform, rendering
from ..operations.operation import JobRequest, Operation, Pieces, Reception, reading_seconds
from ..operations.registry import OPERATIONS
from ..operations.request import DesignReferenceUnresolved, refuse_query
from ..problems import MalformedError, TransportError
from ..processes.birth import running_code
from ..processes.task import NAMED, RawRequest, UnitResult
from ..tables import MEDIA_TYPES
from .answers import JSON, asks_for_job, idempotency_key, takes, wait_seconds
from .jobs import accepted_response, failure_response, render_report, result_response
from .openapi import describe
from .problems import BodyTooLarge
from .service import Needs, Service, TheService, note_policy, service_of

log = logging.getLogger("tailstack.service")
HOUR = 3600.0
BUDGET_RETRY_SECONDS = 60  # what was used leaves the last hour minute by minute
T = TypeVar("T")
FIRST_LOOK, LONGEST_LOOK = 0.01, 0.25  # seconds between looks at a job that somebody waits for

router = APIRouter(tags=["computations"], dependencies=[Depends(Needs("compute"))], default_response_class=Response)


# --- the body of a request: of a kind that the operation reads, bounded in size and in time -----------

YAML = ("application/yaml", "application/x-yaml", "text/yaml", "text/x-yaml")
FORM = "application/x-www-form-urlencoded"
DRAINED = 8_000_000  # bytes of an over-long body that are read and dropped, so that the refusal reaches its sender


def _body_of(operation: Operation) -> Callable[[Request], Awaitable[RawRequest]]:
    """The dependency that reads the body of an operation: JSON, YAML where it takes that, and what else it can be."""
    own, beside = operation.body, "design" if len(operation.designs) == 1 else "designs"
    raw = () if own is None else own.media
    hint = f"options go into the body, beside the {beside}" if own is None else own.hint

    async def sent(request: Request) -> RawRequest:
        form = _form(request, yaml=operation.yaml, raw=raw)
        body = await _read_body(request, "max_step_bytes" if form in raw else "max_body_bytes")
        query = tuple(request.query_params.multi_items())
        if form == "json":
            refuse_query(query, (), hint)
        return RawRequest(form, body, query)

    return sent


def _form(request: Request, *, yaml: bool, raw: tuple[str, ...]) -> str:
    """``json``, ``yaml`` or one of ``raw`` by the content type.  Raises TransportError 415."""
    header = ", ".join(request.headers.getlist("content-type"))  # of two, neither counts
    kind, _, parameters = header.partition(";")
    kind = kind.strip().lower()
    encodings = [coding.strip().lower() for coding in ",".join(request.headers.getlist("content-encoding")).split(",")]
    encoding = ", ".join(coding for coding in encodings if coding not in ("", "identity"))
    named = [part.partition("=")[2] for part in parameters.split(";") if part.strip().lower().startswith("charset=")]
    charset = named[0].strip(" \"'").lower() if named else "utf-8"
    cure = ""
    if encoding:
        cure = "send it as it is"
        refused = f"the body is sent with Content-Encoding: {encoding[:40]}"
    elif charset not in ("utf-8", "utf8", "us-ascii"):
        refused = f"the body is sent as charset={charset[:40]}"
        cure = f"send the text as UTF-8, without charset: iconv -f {quote(charset[:40])} -t UTF-8 FILE makes it so"
    elif kind == JSON or (kind.startswith("application/") and kind.endswith("+json")):
        return "json"
    elif yaml and kind in YAML:
        return "yaml"
    elif kind in raw:
        return kind
    else:
        refused = f"Content-Type: {header[:80]}" if header else "no Content-Type"
    taken = [*(YAML[:1] if yaml else ()), *raw, JSON]
    if not cure:
        cure = f"send Content-Type: {' or '.join(taken)}, whichever the body is"
    if kind == FORM:
        cure += (
            f"; curl -d says {FORM} by itself and drops line ends: add -H 'Content-Type: {taken[0]}', and send "
            "--data-binary @FILE"
        )
    detail = f"this operation reads {', '.join([JSON, *taken[:-1]])}; UTF-8, not compressed; got {refused}"
    raise TransportError("unsupported-media-type", detail, cure, code="content-type")


async def _read_body(request: Request, setting: str) -> bytes:
    """The body, as long as a setting allows.

    Raises LimitError (too long), TransportError 408 (too slow), MalformedError (empty).
    """
    service = service_of(request)
    settings = service.settings
    limit: int = getattr(settings, setting)
    announced = request.headers.get("content-length", "")
    if announced.isdigit() and len(announced) < 19 and int(announced) > DRAINED + limit:
        raise _too_long(f"{int(announced)} bytes were announced", setting, limit)
    chunks: list[bytes] = []
    size, more = 0, True
    try:
        async with service.clock.timeout(settings.body_seconds):
            while more:
                message = await request.receive()
                if message["type"] == "http.disconnect":
                    detail = f"the body broke off after {size} bytes"
                    raise MalformedError(Problem("", "incomplete-body", detail))
                chunk, more = message.get("body", b""), message.get("more_body", False)
                size += len(chunk)
                if size <= limit:
                    chunks.append(chunk)
                elif size > DRAINED + limit:
                    raise _too_long(f"more than {size} bytes arrived", setting, limit)
    except TimeoutError:
        detail = f"the body was not complete after {settings.body_seconds:g} s; {size} bytes arrived"
        hint = f"send it faster, or start the service with a higher {variable('body_seconds')}"
        raise TransportError("body-timeout", detail, hint, {"Connection": "close"}, code="too-slow") from None
    if size > limit:
        raise _too_long(f"{size} bytes arrived", setting, limit)
    return b"".join(chunks)


def _too_long(arrived: str, setting: str, limit: int) -> BodyTooLarge:
    hint = f"send less, or start the service with a higher {variable(setting)}"
    return BodyTooLarge(Problem("", "too-large", f"a request body may hold {limit} bytes; {arrived}", hint))


# --- the routes ---------------------------------------------------------------------------------------


def _endpoint(operation: Operation) -> Callable[..., Awaitable[Response]]:
    """The endpoint of an operation: its answer at once, or a job."""
    own = operation.body
    body = Depends(_body_of(operation))

    async def create(request: Request, service: TheService, sent: RawRequest = body) -> Response:
        key = None if operation.immediate else idempotency_key(request)
        if own is None or own.kernels:
            await service.pool.wait_until_warm(service.settings.warm_up_seconds)
        sent = replace(sent, as_job=bool(operation.answers) and asks_for_job(request))
        try:
            reception = await _receive(request, operation, sent)
        except DesignReferenceUnresolved as unresolved:
            sent = replace(sent, base=await find_base(request, unresolved.sha256))
            reception = await _receive(request, operation, sent)
        service.kept_designs.keep(request.state.caller.tenant, reception.designs)
        if reception.terms is not None:
            await note_policy(request, dict(reception.terms))
        if reception.pieces is not None:
            return await _send_pieces(request, sent, reception.pieces)
        if reception.job is not None:
            return await submit(request, reception.job, key)
        assert reception.answer is not None
        forms = rendering.media_types_of(operation)
        form = _answer_form(request, forms, "json")
        if form == "json":
            return Response(reception.answer, media_type=JSON)
        sha256 = hashlib.sha256(reception.answer).hexdigest()
        report, headers = await render_report(request, operation.name, reception.answer, form, sha256)
        return Response(report, headers=headers, media_type=forms[form])

    return create


async def _receive(request: Request, operation: Operation, sent: RawRequest) -> Reception:
    service = service_of(request)
    call = partial(perform.receive, operation.name, sent, service.settings)
    seconds = reading_seconds if operation.body is None else operation.body.reading_seconds
    reception: Reception = await service.pool.run(request, call, seconds(sent))
    return reception


async def find_base(request: Request, sha256: str) -> bytes:
    """The design that a request names.  Raises TransportError 404, StoreUnavailable."""
    base = await service_of(request).kept_designs.find(request.state.caller.tenant, sha256)
    if base is None:
        detail = f"no design with the SHA-256 {sha256} is kept here"
        hint = "send the design whole, in the field design"
        raise TransportError("unknown-design", detail, hint, pointer=f"/{NAMED}")
    return base


for _operation in OPERATIONS.values():
    router.add_api_route(
        _operation.path,
        _endpoint(_operation),
        methods=["POST"],
        operation_id=f"create_{_operation.name.replace('-', '_')}",
        **describe(_operation),
    )


# --- a job that is answered at once, unit by unit -----------------------------------------------------


async def _send_pieces(request: Request, sent: RawRequest, pieces: Pieces) -> Response:
    """The units of what could be a job, computed one after the other for a caller who waits.

    Lines are sent as they are computed, the next unit when the one before it is on its way; JSON when it is complete.
    A caller who leaves ends it.  Raises LimitError for more than is computed at once, and, before the
    first byte, what the first unit raises.
    """
    service = service_of(request)
    if pieces.seconds > service.settings.max_seconds:
        detail = f"this takes some {pieces.seconds:.0f} s; {service.settings.max_seconds:g} s are computed at once"
        hint = "send Prefer: respond-async, and it becomes a job; or send fewer rows"
        raise LimitError(Problem("", "too-much-work", detail, hint))
    form = _answer_form(request, MEDIA_TYPES, pieces.form)

    async def compute(function: Callable[..., T], *arguments: object, **named: object) -> T:
        call = partial(function, sent, service.settings, *arguments, **named)
        result: T = await service.pool.run(request, call, pieces.unit_seconds)
        return result

    specs = pieces.specs
    if form == "json":
        units = [UnitResult(index, spec, await compute(perform.compute_unit, spec)) for index, spec in enumerate(specs)]
        return Response(await compute(perform.join_units, tuple(units)), media_type=JSON)

    first = await compute(perform.compute_piece, specs[0], form, first=True)

    async def send() -> AsyncIterator[bytes]:
        yield first
        for spec in specs[1:]:
            yield await compute(perform.compute_piece, spec, form, first=False)

    return StreamingResponse(send(), headers={"Content-Type": MEDIA_TYPES[form]})


def _answer_form(request: Request, media_types: Mapping[Any, str], usual: str) -> Any:
    """The first format that Accept names and that there is; otherwise the usual one.  JSON is always there."""
    forms = {media.partition(";")[0]: form for form, media in media_types.items()} | {JSON: "json"}
    named = [part.partition(";")[0].strip().lower() for part in request.headers.get("accept", "").split(",")]
    return next((forms[media] for media in named if media in forms and takes(request, "accept", media)), usual)


async def submit(request: Request, posted: JobRequest, key: str | None) -> Response:
    """The answer to a request that was checked: its job, or with Prefer: wait perhaps already its result.

    Raises TransportError (cpu-budget), QueueFull, IdempotencyConflict, StoreUnavailable.
    """
    service, tenant = service_of(request), request.state.caller.tenant
    settings = service.settings
    await _hold_to_budget(service, tenant)
    job, new = await service.storage.write(
        stored.submit_job, tenant=tenant, kind=posted.kind, request=posted.content, design_name=posted.design_name,
        solver_version=running_code(), request_id=request.state.request_id, idempotency_key=key,
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
    job = await _await_end(request, service, job, wait)
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
    used = await service.storage.run(sum_cpu_seconds, tenant, service.clock.time() - HOUR)
    if used >= budget:
        detail = f"{budget:g} CPU seconds an hour are given to a tenant; {used:.0f} were used in the last hour"
        hint = f"come back later; the operator's setting is {variable('cpu_seconds_per_hour')}"
        raise TransportError("cpu-budget", detail, hint, {"Retry-After": str(BUDGET_RETRY_SECONDS)})


async def _await_end(request: Request, service: Service, job: Job, seconds: float) -> Job:
    """The job when it has ended, or as it is after so many seconds.

    Waiting is a wish: it ends early when too many wait already, the service stops, or the caller has left.
    """
    if service.seat(job.tenant) != "seated":
        return job
    try:
        deadline, look = service.clock.monotonic() + seconds, FIRST_LOOK
        while not job.is_over and (left := deadline - service.clock.monotonic()) > 0 and not service.stopping.is_set():
            await service.clock.sleep_async(min(look, left))
            if await request.is_disconnected():
                break
            look = min(1.3 * look, LONGEST_LOOK)
            with suppress(TailstackError):  # what was accepted stays accepted, and its address is known
                seen = await service.storage.run(stored.find_job, job.tenant, job.id)
                job = seen or job
        return job
    finally:
        service.leave(job.tenant)

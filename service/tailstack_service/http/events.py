"""Server-sent events of a job: rows of the database, so that a stream can be taken up again anywhere."""

from __future__ import annotations

from collections.abc import AsyncIterator

from fastapi import APIRouter, Depends, Request, Response
from fastapi.responses import StreamingResponse

from tailstack.errors import Problem, TailstackError
from tailstack.results.json_text import write_json

from ..environment import variable
from ..jobs.store import jobs as stored
from ..jobs.store.events import read_events
from ..jobs.store.jobs import Job
from ..logs import moment
from ..problems import RequestError, TransportError
from ..processes.task import ENDED
from .jobs import find_job
from .openapi import extra, media_types, parameter, reference, response_of
from .service import Needs, Seat, Service, TheService, query

EVENT_STREAM = "text/event-stream"
AT_ONCE = 200  # rows read in one look
LOOK_SECONDS, IDLE_SECONDS = 0.1, 0.5  # between looks: just after something happened, and after a while
HEARTBEAT_SECONDS = 10.0  # shorter than the time after which proxies end a silent connection
RETRY_MS = 1000
SEAT_SECONDS = 5  # after which a seat may be free

router = APIRouter(tags=["jobs"], dependencies=[Depends(Needs("read"))], default_response_class=Response)


@router.get(
    "/v1/jobs/{id}/events",
    operation_id="get_job_events",
    dependencies=[Depends(query())],
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
    """A stream of what happened after the last event that the client saw, until the job ends.

    204 when the job has ended and the client has seen all: that tells an EventSource to stop asking.
    """
    after = _last_event_id(request)
    job = await find_job(request)
    if job.is_over and job.last_event <= after:
        return Response(b"", 204)
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

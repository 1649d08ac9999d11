"""A computation that a running service does: sent, followed on stderr, its document fetched."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Any

from ..console.progress import Progress

if TYPE_CHECKING:
    from .remote import RemoteError, Service

SENDING_SECONDS = 120.0  # for the service to accept a request, or to answer it at once


def answer(service: Service, path: str, request: dict[str, Any], progress: Progress) -> bytes:
    """The document that a service makes of a request.  Ctrl-C cancels the job.  Raises RemoteError."""
    reply = service.ask("POST", path, request, seconds=SENDING_SECONDS)
    if reply.status != 202:
        return reply.body
    job = reply.json()
    place = f"/v1/jobs/{job['id']}"
    try:
        for event in service.events(job["id"]):
            if event.name == "progress":
                progress.report(event.data["units_done"], event.data["units_expected"], f"job {job['id']}")
        job = service.ask("GET", place).json()
    except KeyboardInterrupt:
        _cancel(service, place)
        raise
    if job["state"] != "succeeded":
        raise _ended(job)
    body = service.ask("GET", f"/v1/results/{job['result_sha256']}").body
    if hashlib.sha256(body).hexdigest() != job["result_sha256"]:
        raise _changed(job)
    return body


def _cancel(service: Service, place: str) -> None:
    """Nobody waits for the job any more."""
    from .remote import RemoteError

    try:
        service.ask("POST", place + "/cancel", seconds=5.0)
    except RemoteError:
        return


def _changed(job: dict[str, Any]) -> RemoteError:
    """An answer that is not the one that was recorded, changed where it is stored or on its way."""
    from tailstack.errors import Problem

    from .remote import RemoteError

    detail = f"the answer of job {job['id']} arrived changed: its SHA-256 is not {job['result_sha256']}"
    problem = Problem("", "damaged-answer", detail, "ask again; a proxy in between must pass bytes on as they are")
    return RemoteError("store-error", "The answer is damaged", 0, (problem,))


def _ended(job: dict[str, Any]) -> RemoteError:
    """A job that failed with its own problem, or was cancelled."""
    from tailstack.errors import Problem

    from .remote import OPTIONAL, RemoteError

    document = job["problem"]
    if document is None:
        detail = f"job {job['id']} is {job['state']}: there is no answer"
        problem = Problem("", "not-finished", detail, "start it again")
        return RemoteError("not-finished", f"The {job['kind']} was not finished", 0, (problem,))
    problems = tuple(Problem(**{**OPTIONAL, **entry}) for entry in document["errors"])
    return RemoteError(document["type"].rpartition("/")[2], document["title"], 0, problems)

"""A gate that a running service judges: sent, waited for, brought back to the files here."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .progress import Progress

if TYPE_CHECKING:
    from ..gate.designs import Gate
    from ..gate.records import GateRecord
    from .remote import RemoteError, Service


def asked(gate: Gate, url: str, progress: Progress) -> GateRecord:
    """The record as it would have been computed here.  Raises RemoteError, also for an answer that is no record."""
    from pydantic import ValidationError

    from tailstack.errors import Problem

    from ..documents import read_record
    from ..gate.asking import completed, request_of
    from ..gate.designs import first_order
    from ..gate.judging import conclude
    from .remote import RemoteError, Service

    request = request_of(gate)
    service = Service(url)
    if not request["designs"]:  # there is nothing to ask
        return conclude(gate, first_order(gate), [None] * len(gate.designs))
    try:
        record: GateRecord = read_record("gate", _answer(service, request, progress))
        names = [entry["file"] for entry in request["designs"]]
        if [design.file for design in record.designs] != names or record.exit_code not in range(5):
            raise ValueError("it is about other designs")
    except (ValidationError, ValueError) as error:
        said = str(error).splitlines()[0]
        detail = f"{service.url} answered with something that is not the record of this gate: {said}"
        problem = Problem("", "unexpected-answer", detail, "is it a tailstack of this version? tailstack version")
        raise RemoteError("unexpected-answer", "The service gave an unexpected answer", 0, (problem,)) from None
    return completed(record, gate)


def _answer(service: Service, request: dict[str, Any], progress: Progress) -> bytes:
    reply = service.ask("POST", "/v1/gates", request, seconds=120.0)
    if reply.status != 202:
        return reply.body
    job = reply.json()
    path = f"/v1/jobs/{job['id']}"
    try:
        for event in service.events(job["id"]):
            if event.name == "progress":
                progress.report(event.data["units_done"], event.data["units_expected"], f"job {job['id']}")
        job = service.ask("GET", path).json()
    except KeyboardInterrupt:
        _cancel(service, path)
        raise
    if job["state"] != "succeeded":
        raise _ended(job)
    return service.ask("GET", f"/v1/results/{job['result_sha256']}").body


def _cancel(service: Service, path: str) -> None:
    """Nobody waits for the job any more."""
    from .remote import RemoteError

    try:
        service.ask("POST", path + "/cancel", seconds=5.0)
    except RemoteError:
        return


def _ended(job: dict[str, Any]) -> RemoteError:
    """A job that failed with its own problem, or was cancelled."""
    from tailstack.errors import Problem

    from .remote import OPTIONAL, RemoteError

    document = job["problem"]
    if document is None:
        problem = Problem(
            "", "not-finished", f"job {job['id']} is {job['state']}: there is no verdict", "start it again"
        )
        return RemoteError("not-finished", "The gate was not finished", 0, (problem,))
    problems = tuple(Problem(**{**OPTIONAL, **entry}) for entry in document["errors"])
    return RemoteError(document["type"].rpartition("/")[2], document["title"], 0, problems)

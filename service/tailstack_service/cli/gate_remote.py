"""A gate that a running service judges: sent, waited for, brought back to the files here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..console.progress import Progress

if TYPE_CHECKING:
    from ..gate.designs import Gate
    from ..gate.records import GateRecord


def asked(gate: Gate, url: str, progress: Progress) -> GateRecord:
    """The record as it would have been computed here.  Raises RemoteError, also for an answer that is no record."""
    from pydantic import ValidationError

    from tailstack.errors import Problem

    from ..documents import read_record
    from ..gate.asking import completed, request_of
    from ..gate.designs import first_order
    from ..gate.judging import conclude
    from .remote import RemoteError, Service
    from .remote_job import answer

    request = request_of(gate)
    service = Service(url)
    if not request["designs"]:  # there is nothing to ask
        return conclude(gate, first_order(gate), [None] * len(gate.designs))
    try:
        record: GateRecord = read_record("gate", answer(service, "/v1/gates", request, progress))
        names = [entry["file"] for entry in request["designs"]]
        if [design.file for design in record.designs] != names or record.exit_code not in range(5):
            raise ValueError("it is about other designs")
    except (ValidationError, ValueError) as error:
        said = str(error).splitlines()[0]
        detail = f"{service.url} answered with something that is not the record of this gate: {said}"
        problem = Problem("", "unexpected-answer", detail, "is it a tailstack of this version? tailstack version")
        raise RemoteError("unexpected-answer", "The service gave an unexpected answer", 0, (problem,)) from None
    return completed(record, gate)

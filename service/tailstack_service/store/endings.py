"""How a job ends: its state, its last event, and nothing left of its units but their bookkeeping."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from types import MappingProxyType
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from tailstack.errors import TailstackError
from tailstack.json_text import write_json

from ..problems import problem_document
from . import tables
from .events import tell
from .identifiers import storable_json

NOTHING: Mapping[str, Any] = MappingProxyType({})


def end_job(
    connection: Connection,
    job_id: str,
    last_event: int,
    at: float,
    state: str,
    *,
    result_sha256: str | None = None,
    problem: bytes | None = None,
    changes: Mapping[str, Any] = NOTHING,
) -> None:
    """End a job whose row the caller holds; ``changes`` are columns that change with it.

    Units that are not recorded go; of those that are, the token stays, which tells a worker that asks again whether
    its record went through.
    """
    u, j = tables.units.c, tables.jobs.c
    connection.execute(sa.delete(tables.units).where(u.job_id == job_id, u.state != tables.RECORDED))
    connection.execute(
        sa.update(tables.units).where(u.job_id == job_id).values(spec=None, result=None, result_sha256=None)
    )
    text = None if problem is None else storable_json(write_json(json.loads(problem)))
    values = {
        "state": state,
        "finished_at": at,
        "note": "",
        "result_sha256": result_sha256,
        "problem": text,
        "last_event": last_event + 1,
    }
    connection.execute(sa.update(tables.jobs).where(j.id == job_id).values(values | dict(changes)))
    data: dict[str, Any] = {"state": state}
    if result_sha256 is not None:
        data["result_sha256"] = result_sha256
    if text is not None:
        data["problem"] = json.loads(text)
    tell(connection, job_id, last_event + 1, at, "state", data)


def as_problem(error: TailstackError) -> bytes:
    """A refusal as a problem document in JSON, without instance."""
    return storable_json(write_json(asdict(problem_document(error, instance="")))).encode()

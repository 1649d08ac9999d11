"""Units in the hands of a worker: leases kept alive, results recorded once, units given back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from tailstack.errors import LimitError, Problem

from ..work.kinds import KINDS
from ..work.task import ADVANCE, Outcome
from . import results, tables
from .claims import Claim, claim, lost_unit, new_unit
from .damage import digest
from .database import AnyRow, Database, now, writing
from .endings import as_problem, end_job
from .events import eta_seconds, tell
from .identifiers import storable
from .usage import count_unit
from .workers import Worker, goodbye, heartbeat, workers

__all__ = ["Claim", "Worker", "claim", "goodbye", "heartbeat", "record", "release", "renew", "workers"]

_UNIT = tables.units.c
_JOB = tables.jobs.c


def renew(db: Database, worker_id: str, claims: Sequence[Claim], lease_seconds: float) -> list[Claim]:
    """Prolong the leases to ``lease_seconds`` from now.  Returns the claims that are lost.

    A claim is lost when another worker has the unit, the job was cancelled, deleted, ended or begun anew, or the unit
    was given back.  A lease that ran out while nobody took the unit is prolonged like any other.
    """
    if not claims:
        return []
    values = {
        "of_jobs": sorted({claim.job_id for claim in claims}),
        "of_numbers": sorted({claim.index for claim in claims}),
        "by_worker": worker_id,
    }
    with writing(db) as connection:
        # Never waits: a row that is held just now is being recorded, given back or taken, and is met again next time
        held = {tuple(row) for row in connection.execute(_FREE, values)}
        known = held | {tuple(row) for row in connection.execute(_KNOWN, values)}
        prolonged = [claim for claim in claims if (*_name(claim), "leased") in held]
        if prolonged:
            until = now(db, connection) + lease_seconds
            changes = [{"of_job": c.job_id, "of_number": c.index, "until": until} for c in prolonged]
            connection.execute(_PROLONG, changes)
    return [c for c in claims if (*_name(c), "leased") not in known and (*_name(c), "recorded") not in known]


def _name(claim: Claim) -> tuple[str, int, int, int]:
    return claim.job_id, claim.index, claim.generation, claim.token


# Jobs and numbers apart, which finds more rows than were asked for: SQLite walks the table for a list of pairs
_KNOWN = (
    sa.select(_UNIT.job_id, _UNIT.number, _JOB.generation, _UNIT.token, _UNIT.state)
    .join(tables.jobs, _JOB.id == _UNIT.job_id)
    .where(_UNIT.job_id.in_(sa.bindparam("of_jobs", expanding=True)))
    .where(_UNIT.number.in_(sa.bindparam("of_numbers", expanding=True)))
)
_FREE = _KNOWN.where(_UNIT.worker_id == sa.bindparam("by_worker")).with_for_update(of=tables.units, skip_locked=True)
_PROLONG = (
    sa.update(tables.units)
    .where(_UNIT.job_id == sa.bindparam("of_job"), _UNIT.number == sa.bindparam("of_number"))
    .values(lease_until=sa.bindparam("until"))
)


def record(db: Database, claim: Claim, outcome: Outcome, *, max_job_seconds: float) -> bool:
    """Write what the unit came to, and everything that follows from it, in one transaction.

    True if this claim is recorded, by this call or by an earlier one whose commit was not heard of: it may be called
    again after StoreUnavailable.  False if the unit is no longer this claim's; then nothing was written.  A job whose
    units took more than ``max_job_seconds`` of CPU fails.  Raises ValueError for an outcome that the unit cannot have.
    """
    _require_fitting(claim, outcome)
    with writing(db) as connection:
        job = _hold(connection, claim)
        if job is None:
            return False
        sha256 = None if outcome.result is None else digest(outcome.result)
        kept = {"result": outcome.result, "result_sha256": sha256, "cpu_seconds": outcome.cpu_seconds}
        if job.state not in tables.UNFINISHED or not _give_up(connection, claim, "recorded", **kept):
            return _was_recorded(connection, claim)
        at = now(db, connection)
        cpu_seconds = job.cpu_seconds + outcome.cpu_seconds
        changes = {"units_done": job.units_done + 1, "cpu_seconds": cpu_seconds}
        count_unit(db, connection, job.tenant, at, outcome.cpu_seconds)
        if outcome.problem is not None:
            end_job(connection, job.id, job.last_event, at, "failed", problem=outcome.problem, changes=changes)
        elif outcome.answer is not None:
            name = results.keep(db, connection, KINDS[job.kind].answer, outcome.answer, at)
            changes["units_expected"] = changes["units_done"]
            end_job(connection, job.id, job.last_event, at, "succeeded", result_sha256=name, changes=changes)
        elif cpu_seconds > max_job_seconds:
            problem = _too_long(max_job_seconds)
            end_job(connection, job.id, job.last_event, at, "failed", problem=problem, changes=changes)
        else:
            _go_on(connection, claim, outcome, job, at, changes)
    return True


def _require_fitting(claim: Claim, outcome: Outcome) -> None:
    given = [outcome.result is not None, bool(outcome.more), outcome.answer is not None, outcome.problem is not None]
    fits = (False, True, True, True) if claim.spec == ADVANCE else (True, False, False, True)
    if sum(given) != 1 or not fits[given.index(True)]:
        raise ValueError(f"an outcome that unit {claim.index} of job {claim.job_id} cannot have")


def _hold(connection: Connection, claim: Claim) -> AnyRow | None:
    """The job's row, locked until the end of the transaction; None if it is gone or was begun anew."""
    return connection.execute(_HOLD, {"of_job": claim.job_id, "of_generation": claim.generation}).first()


_HOLD = (
    sa.select(
        _JOB.id, _JOB.tenant, _JOB.kind, _JOB.state, _JOB.created_at, _JOB.started_at, _JOB.units_done,
        _JOB.units_expected, _JOB.cpu_seconds, _JOB.last_event, _JOB.note,
    )
    .where(_JOB.id == sa.bindparam("of_job"), _JOB.generation == sa.bindparam("of_generation"))
    .with_for_update()
)  # fmt: skip


def _give_up(connection: Connection, claim: Claim, state: str, **changes: Any) -> bool:
    """Take the unit out of this claim's hands, into another state; False if it is not in them."""
    values = changes | {"state": state, "worker_id": None, "lease_until": None}
    return connection.execute(_GIVE_UP, _names(claim) | values).rowcount == 1


def _names(claim: Claim) -> dict[str, Any]:
    return {"of_job": claim.job_id, "of_number": claim.index, "of_token": claim.token}


_CLAIMED = sa.and_(
    _UNIT.job_id == sa.bindparam("of_job"),
    _UNIT.number == sa.bindparam("of_number"),
    _UNIT.token == sa.bindparam("of_token"),
)
_GIVE_UP = sa.update(tables.units).where(_CLAIMED, _UNIT.state == tables.LEASED)


def _was_recorded(connection: Connection, claim: Claim) -> bool:
    return bool(connection.execute(_WAS_RECORDED, _names(claim)).scalar_one())


_WAS_RECORDED = sa.select(sa.exists().where(_CLAIMED, _UNIT.state == tables.RECORDED))


def _go_on(
    connection: Connection, claim: Claim, outcome: Outcome, job: AnyRow, at: float, changes: dict[str, Any]
) -> None:
    """The units that come next, and word of how far the job is."""
    if outcome.more:
        rows = [new_unit(job.id, claim.index + 1 + k, spec, job.created_at, at) for k, spec in enumerate(outcome.more)]
        connection.execute(tables.units.insert(), rows)
        changes["units_expected"] = changes["units_done"] + len(rows) + outcome.remaining + 1
        changes["note"] = storable(outcome.note)
    elif not connection.execute(_ANY_OPEN, {"of_job": job.id}).scalar_one():
        last = connection.execute(_LAST, {"of_job": job.id}).scalar_one()
        connection.execute(tables.units.insert(), new_unit(job.id, last + 1, ADVANCE, job.created_at, at))
    told = {
        "units_done": changes["units_done"],
        "units_expected": changes.get("units_expected", job.units_expected),
        "note": changes.get("note", job.note),
    }
    told["eta_seconds"] = eta_seconds(job.started_at, told["units_done"], told["units_expected"], at)
    changes["last_event"] = job.last_event + 1
    connection.execute(_CHANGE_JOB, {"of_job": job.id} | changes)
    tell(connection, job.id, changes["last_event"], at, "progress", told)


_ANY_OPEN = sa.select(sa.exists().where(_UNIT.job_id == sa.bindparam("of_job"), _UNIT.state != tables.RECORDED))
_LAST = sa.select(sa.func.max(_UNIT.number)).where(_UNIT.job_id == sa.bindparam("of_job"))
_CHANGE_JOB = sa.update(tables.jobs).where(_JOB.id == sa.bindparam("of_job"))


def _too_long(max_job_seconds: float) -> bytes:
    detail = f"the job took more than {max_job_seconds:g} CPU seconds"
    hint = "ask for less (trials, starts, points); the operator's setting is TAILSTACK_MAX_JOB_SECONDS"
    return as_problem(LimitError(Problem("", "job-too-long", detail, hint)))


def release(db: Database, claim: Claim, *, died: bool, why: str = "") -> None:
    """Give the unit back at once; nothing happens if it is no longer this claim's.

    ``died``: a computing process ended under it.  With as many deaths or attempts as the claim allows, the job fails,
    and its problem ends with ``why``.
    """
    with writing(db) as connection:
        job = _hold(connection, claim)
        if job is None or job.state not in tables.UNFINISHED:
            return
        deaths, at = claim.deaths + died, now(db, connection)
        if not _give_up(connection, claim, "ready", ready_at=at, deaths=deaths):
            return
        if deaths >= claim.max_deaths or claim.attempts >= claim.max_attempts:
            problem = lost_unit(claim.attempts, deaths, why)
            end_job(connection, job.id, job.last_event, at, "failed", problem=problem)

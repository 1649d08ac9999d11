"""The queue of units: which is computed next and by whom, leases that are prolonged, results that are recorded once.

The queue is ordered by *place*, epoch seconds.  A unit's place is the time at which its job came in, so jobs are served
in the order in which they came; but from the seventeenth unit on, each counts as 10 s younger than the one before, so
that a job of many units lets younger small ones pass instead of keeping every lane for itself.  Units that advance a
job keep its place: they are short, and the job may be done after them.

``claim`` waits for no lock that another transaction holds (SKIP LOCKED on PostgreSQL), so it cannot be part of a
deadlock, although it takes units before jobs and everything else takes jobs before units.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from tailstack.errors import LimitError, Problem

from ...problems import UnitLost
from ...processes.task import ADVANCE, Outcome, UnitResult
from . import tables
from .database import AnyRow, Database, now, reading, writing
from .events import change_job, end_job, estimate_eta_seconds, render_problem
from .results import PART, REQUEST, digest, report_damage, store_result
from .tables import storable
from .usage import count_unit
from .workers import versions_at_work

_UNIT = tables.units.c
_JOB = tables.jobs.c

UNITS_IN_PLACE = 16
SECONDS_PER_FURTHER_UNIT = 10.0
CLOCK_SECONDS = 1.0  # by which a clock may be set back without a lease seeming too long


@dataclass(frozen=True, slots=True)
class Claim:
    """A unit that one worker may compute and record, until its lease runs out and another takes it."""

    job_id: str
    index: int
    generation: int
    token: int  # one more at each claim of the unit: what was claimed before can no longer be recorded
    kind: str
    request: bytes
    spec: bytes
    results: tuple[UnitResult, ...]  # advance only: what is recorded, in index order
    deaths: int
    attempts: int  # this one included
    request_id: str
    tenant: str
    max_attempts: int  # the terms of the claim: with as many attempts or deaths its release ends the job
    max_deaths: int

    @property
    def key(self) -> str:
        """Unique among all claims there ever were."""
        return f"{self.job_id}-{self.index}-{self.generation}-{self.token}"


def make_unit(job_id: str, number: int, spec: bytes, at: float) -> dict[str, Any]:
    """A row of ``units`` that can be claimed from ``at`` on, with its place in the queue."""
    further = 0 if spec == ADVANCE else max(0, number - UNITS_IN_PLACE)
    return {
        "job_id": job_id,
        "number": number,
        "advance": spec == ADVANCE,
        "state": "ready",
        "place": tables.time_of_job(job_id) + SECONDS_PER_FURTHER_UNIT * further,
        "ready_at": at,
        "spec": spec,
        "token": 0,
        "attempts": 0,
        "deaths": 0,
        "cpu_seconds": 0.0,
    }


def claim(
    db: Database, *, worker_id: str, solver_version: str, lease_seconds: float, limit: int, max_attempts: int,
    max_deaths: int, may_take_over: Callable[[], bool] = lambda: True,
) -> list[Claim]:  # fmt: skip
    """At most ``limit`` units for this worker: those that wait, and those whose lease has run out.

    A lease that ends further ahead than leases last was given while the clock was ahead, and counts as run out.
    ``may_take_over`` is asked once the database has said what time it is: False leaves leases that have run out alone.

    A job that was begun by another version of the solver is left to its workers while one of them was seen within the
    last ``lease_seconds``; after that it is begun anew here.  A unit that was begun ``max_attempts`` times, or took
    ``max_deaths`` processes with it, is not given out again: its job fails.  While other claims are under way the list
    may be shorter than what is there.
    """
    if limit <= 0 or (db.dialect == "sqlite" and not _can_claim(db, lease_seconds)):
        return []
    with writing(db) as connection:
        at = now(db, connection)
        run_out = _bound_leases(at, lease_seconds) if may_take_over() else None
        others = versions_at_work(connection, at, lease_seconds) - {solver_version}
        rows = _find_claimable(connection, run_out, others, limit)
        rows = _settle_jobs(connection, rows, at, solver_version, max_attempts, max_deaths)
        if not rows:
            return []
        wanted = {"job_ids": sorted({row.job_id for row in rows})}
        bodies = {row.job_id: row.body for row in connection.execute(_BODIES, wanted)}
        recorded = {row.job_id: _read_recorded(connection, row.job_id) for row in rows if row.advance}
        rows = _drop_damaged(connection, rows, at, bodies, recorded)
        if rows:
            until = {"by_worker": worker_id, "until": at + lease_seconds}
            connection.execute(_LEASE, [{"of_job": row.job_id, "of_number": row.number} | until for row in rows])
        return [
            Claim(
                job_id=row.job_id, index=row.number, generation=row.generation, token=row.token + 1, kind=row.kind,
                request=bodies[row.job_id], spec=row.spec,
                results=tuple(result for result, _ in recorded.get(row.job_id, ())),
                deaths=row.deaths, attempts=row.attempts + 1, request_id=row.request_id, tenant=row.tenant,
                max_attempts=max_attempts, max_deaths=max_deaths,
            )
            for row in rows
        ]  # fmt: skip


def _can_claim(db: Database, lease_seconds: float) -> bool:
    """Idle workers ask many times a second: they must not take the only write lock of a file for that."""
    with reading(db) as connection:
        return bool(connection.execute(_ANYTHING, _bound_leases(now(db, connection), lease_seconds)).scalar_one())


def _bound_leases(at: float, lease_seconds: float) -> dict[str, float]:
    """The bounds outside of which a lease has run out."""
    return {"at": at, "last": at + lease_seconds + CLOCK_SECONDS}


_RUN_OUT = sa.and_(
    _UNIT.state == tables.LEASED,
    sa.or_(_UNIT.lease_until < sa.bindparam("at"), _UNIT.lease_until > sa.bindparam("last")),
)
_ANYTHING = sa.select(sa.or_(sa.exists().where(tables.ready), sa.exists().where(_RUN_OUT)))
_CANDIDATE = (
    sa.select(
        _UNIT.job_id, _UNIT.number, _UNIT.advance, _UNIT.place, _UNIT.spec, _UNIT.token, _UNIT.attempts, _UNIT.deaths,
        _JOB.kind, _JOB.generation, _JOB.request_id, _JOB.tenant, _JOB.state.label("job_state"), _JOB.solver_version,
        _JOB.request_sha256,
    )
    .join(tables.jobs, _JOB.id == _UNIT.job_id)
    .order_by(_UNIT.place, _UNIT.job_id, _UNIT.number)
    .with_for_update(of=tables.units, skip_locked=True)
)  # fmt: skip
# Built once: putting a statement together takes longer than running it
_OF_SOME = _JOB.solver_version.not_in(sa.bindparam("others", expanding=True))
_READY = _CANDIDATE.where(_UNIT.state == tables.READY).limit(sa.bindparam("at_most", type_=sa.Integer))
_READY_OF_SOME = _READY.where(_OF_SOME)
_EXPIRED = _CANDIDATE.where(_RUN_OUT).limit(sa.bindparam("at_most", type_=sa.Integer))
_EXPIRED_OF_SOME = _EXPIRED.where(_OF_SOME)


def _find_claimable(
    connection: Connection, run_out: dict[str, float] | None, others: set[str], limit: int
) -> list[AnyRow]:
    """Units that may be taken, in the order of the queue; on PostgreSQL their rows are locked."""
    values: dict[str, Any] = {"at_most": limit} | ({"others": sorted(others)} if others else {})
    ready, expired = (_READY_OF_SOME, _EXPIRED_OF_SOME) if others else (_READY, _EXPIRED)
    rows = [*connection.execute(ready, values)]
    if run_out is not None:
        rows += connection.execute(expired, values | run_out)
    return sorted(rows, key=lambda row: (row.place, row.job_id, row.number))[:limit]


def _settle_jobs(
    connection: Connection, rows: list[AnyRow], at: float, version: str, max_attempts: int, max_deaths: int
) -> list[AnyRow]:
    """The rows that can be leased, after what has to happen to their jobs: begun, begun anew, or ended."""

    def spent(row: AnyRow) -> bool:
        return bool(row.attempts >= max_attempts or row.deaths >= max_deaths)

    changing = {row.job_id for row in rows if row.job_state == "queued" or row.solver_version != version or spent(row)}
    if not changing:
        return rows
    query = sa.select(_JOB.id, _JOB.state, _JOB.solver_version, _JOB.last_event, _JOB.generation, _JOB.created_at)
    locked = connection.execute(query.where(_JOB.id.in_(sorted(changing))).with_for_update(skip_locked=True))
    ready = [row for row in rows if row.job_id not in changing]
    for job in [job for job in locked if job.state in tables.UNFINISHED]:
        of_job = [row for row in rows if row.job_id == job.id]
        last = next((row for row in of_job if spent(row)), None)
        if job.solver_version != version:
            _restart_job(connection, job, at, version)
            again = _CANDIDATE.where(_UNIT.job_id == job.id, _UNIT.number == 0)
            ready.append(connection.execute(again).one())
        elif last is not None:
            end_job(connection, job, at, "failed", problem=render_lost_unit(last.attempts, last.deaths))
        else:
            if job.state == "queued":
                change_job(connection, job, at, _RUNNING, state="running", started_at=at)
            ready += of_job
    return sorted(ready, key=lambda row: (row.place, row.job_id, row.number))


def _restart_job(connection: Connection, job: AnyRow, at: float, version: str) -> None:
    """After an upgrade: what another version computed is not mixed with what this one computes."""
    connection.execute(sa.delete(tables.units).where(_UNIT.job_id == job.id))
    connection.execute(tables.units.insert(), make_unit(job.id, 0, ADVANCE, at))
    events = [("recomputed", {"from": job.solver_version, "to": version})]
    events += [_RUNNING] if job.state == "queued" else []
    change_job(
        connection, job, at, *events, state="running", solver_version=version, generation=job.generation + 1,
        started_at=at, units_done=0, units_expected=1, note="",
    )  # fmt: skip


_RUNNING = ("state", {"state": "running"})


def render_lost_unit(attempts: int, deaths: int, why: str = "") -> bytes:
    """The problem of a job whose unit was begun that often, and took so many processes with it, without an end; ``why``
    says how the last of them ended, where anybody saw it."""
    detail = f"one part of the job was begun {attempts} times without an end; {deaths} computing processes died of it"
    detail += f"; at last, {why}" if why else ""
    hint = "ask for less at a time (trials, starts, points); the log of the worker says how its processes ended"
    return render_problem(UnitLost(Problem("", "unit-lost", detail, hint)))


_OF_UNIT = sa.and_(_UNIT.job_id == sa.bindparam("of_job"), _UNIT.number == sa.bindparam("of_number"))
_LEASE = sa.update(tables.units).where(_OF_UNIT).values(
    state="leased", token=_UNIT.token + 1, attempts=_UNIT.attempts + 1, worker_id=sa.bindparam("by_worker"),
    lease_until=sa.bindparam("until"),
)  # fmt: skip


_Recorded = tuple[tuple[UnitResult, str], ...]  # with the hash under which each was recorded


def _drop_damaged(
    connection: Connection, rows: list[AnyRow], at: float, bodies: dict[str, bytes], recorded: dict[str, _Recorded]
) -> list[AnyRow]:
    """The rows whose jobs can go on; a job whose request or recorded results were changed fails."""
    damages = {}
    for job_id in {row.job_id for row in rows}:
        expected = next(row.request_sha256 for row in rows if row.job_id == job_id)
        if job_id not in bodies or digest(bodies[job_id]) != expected:
            damages[job_id] = REQUEST, expected
        for result, sha256 in recorded.get(job_id, ()):
            if digest(result.result) != sha256:
                damages[job_id] = PART, sha256
    if damages:
        query = sa.select(_JOB.id, _JOB.last_event).where(_JOB.id.in_(sorted(damages)))
        for job in connection.execute(query.with_for_update(skip_locked=True)):
            problem = render_problem(report_damage(*damages[job.id]))
            end_job(connection, job, at, "failed", problem=problem, idempotency_key=None)
    return [row for row in rows if row.job_id not in damages]


_BODIES = sa.select(tables.requests).where(tables.requests.c.job_id.in_(sa.bindparam("job_ids", expanding=True)))


def _read_recorded(connection: Connection, job_id: str) -> _Recorded:
    rows = connection.execute(_RESULTS, {"of_job": job_id})
    return tuple((UnitResult(row.number, row.spec, row.result), row.result_sha256) for row in rows)


_RESULTS = (
    sa.select(_UNIT.number, _UNIT.spec, _UNIT.result, _UNIT.result_sha256)
    .where(_UNIT.job_id == sa.bindparam("of_job"), _UNIT.state == tables.RECORDED, _UNIT.advance.is_(False))
    .order_by(_UNIT.number)
)


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
        free = {tuple(row) for row in connection.execute(_FREE, values)}
        known = free | {tuple(row) for row in connection.execute(_KNOWN, values)}
        ours = [claim for claim in claims if (*_identify(claim), "leased") in free]
        if ours:
            until = now(db, connection) + lease_seconds
            changes = [{"of_job": c.job_id, "of_number": c.index, "until": until} for c in ours]
            connection.execute(_PROLONG, changes)
    return [c for c in claims if (*_identify(c), "leased") not in known and (*_identify(c), "recorded") not in known]


def _identify(claim: Claim) -> tuple[str, int, int, int]:
    return claim.job_id, claim.index, claim.generation, claim.token


# Jobs and numbers apart, which finds more rows than were asked for: SQLite walks the table for a list of pairs
_KNOWN = (
    sa.select(_UNIT.job_id, _UNIT.number, _JOB.generation, _UNIT.token, _UNIT.state)
    .join(tables.jobs, _JOB.id == _UNIT.job_id)
    .where(_UNIT.job_id.in_(sa.bindparam("of_jobs", expanding=True)))
    .where(_UNIT.number.in_(sa.bindparam("of_numbers", expanding=True)))
)
_FREE = _KNOWN.where(_UNIT.worker_id == sa.bindparam("by_worker")).with_for_update(of=tables.units, skip_locked=True)
_PROLONG = sa.update(tables.units).where(_OF_UNIT).values(lease_until=sa.bindparam("until"))


def record(db: Database, endings: Sequence[tuple[Claim, Outcome]], *, max_job_seconds: float) -> list[bool]:
    """Write what units of one job came to, and everything that follows from it, in one transaction.

    Of each: True if this claim is recorded, by this call or by an earlier one whose commit was not heard of: it may be
    called again after StoreUnavailable.  False if the unit is no longer this claim's; then nothing was written of it.
    A job whose units took more than ``max_job_seconds`` of CPU fails.  Raises ValueError for an outcome that its unit
    cannot have.
    """
    for claim, outcome in endings:
        require_fitting(claim, outcome)
    with writing(db) as connection:
        return [_record(db, connection, claim, outcome, max_job_seconds) for claim, outcome in endings]


def _record(db: Database, connection: Connection, claim: Claim, outcome: Outcome, max_job_seconds: float) -> bool:
    job = _lock_job(connection, claim)
    if job is None:
        return False
    sha256 = None if outcome.result is None else digest(outcome.result)
    values = {"result": outcome.result, "result_sha256": sha256, "cpu_seconds": outcome.cpu_seconds}
    if job.state not in tables.UNFINISHED or not _end_claim(connection, claim, "recorded", **values):
        return bool(connection.execute(_WAS_RECORDED, _bind_claim(claim)).scalar_one())
    at = now(db, connection)
    cpu_seconds = job.cpu_seconds + outcome.cpu_seconds
    changes = {"units_done": job.units_done + 1, "cpu_seconds": cpu_seconds}
    count_unit(db, connection, job.tenant, at, outcome.cpu_seconds)
    if outcome.problem is not None:
        end_job(connection, job, at, "failed", problem=outcome.problem, **changes)
    elif outcome.answer is not None:
        name = store_result(db, connection, job.kind, outcome.answer, at)
        changes["units_expected"] = changes["units_done"]
        end_job(connection, job, at, "succeeded", result_sha256=name, **changes)
    elif cpu_seconds > max_job_seconds:
        detail = f"the job took more than {max_job_seconds:g} CPU seconds"
        hint = "ask for less (trials, starts, points); the operator's setting is TAILSTACK_MAX_JOB_SECONDS"
        problem = render_problem(LimitError(Problem("", "job-too-long", detail, hint)))
        end_job(connection, job, at, "failed", problem=problem, **changes)
    else:
        _continue_job(connection, claim, outcome, job, at, changes)
    return True


def require_fitting(claim: Claim, outcome: Outcome) -> None:
    """Raise ValueError for an outcome that the unit cannot have."""
    parts = [outcome.result is not None, bool(outcome.more), outcome.answer is not None, outcome.problem is not None]
    fits = (False, True, True, True) if claim.spec == ADVANCE else (True, False, False, True)
    if sum(parts) != 1 or not fits[parts.index(True)]:
        raise ValueError(f"an outcome that unit {claim.index} of job {claim.job_id} cannot have")


def _lock_job(connection: Connection, claim: Claim) -> AnyRow | None:
    """The job's row, locked until the end of the transaction; None if it is gone or was begun anew."""
    return connection.execute(_LOCK_JOB, {"of_job": claim.job_id, "of_generation": claim.generation}).first()


_LOCK_JOB = (
    sa.select(
        _JOB.id, _JOB.tenant, _JOB.kind, _JOB.state, _JOB.created_at, _JOB.started_at, _JOB.units_done,
        _JOB.units_expected, _JOB.cpu_seconds, _JOB.last_event, _JOB.note,
    )
    .where(_JOB.id == sa.bindparam("of_job"), _JOB.generation == sa.bindparam("of_generation"))
    .with_for_update()
)  # fmt: skip


def _end_claim(connection: Connection, claim: Claim, state: str, **changes: Any) -> bool:
    """Take the unit out of this claim's hands, into another state; False if it is not in them."""
    values = changes | {"state": state, "worker_id": None, "lease_until": None}
    return connection.execute(_END_CLAIM, _bind_claim(claim) | values).rowcount == 1


def _bind_claim(claim: Claim) -> dict[str, Any]:
    return {"of_job": claim.job_id, "of_number": claim.index, "of_token": claim.token}


_CLAIMED = sa.and_(_OF_UNIT, _UNIT.token == sa.bindparam("of_token"))
_END_CLAIM = sa.update(tables.units).where(_CLAIMED, _UNIT.state == tables.LEASED)
_WAS_RECORDED = sa.select(sa.exists().where(_CLAIMED, _UNIT.state == tables.RECORDED))


def _continue_job(
    connection: Connection, claim: Claim, outcome: Outcome, job: AnyRow, at: float, changes: dict[str, Any]
) -> None:
    """The units that come next, and word of how far the job is."""
    if outcome.more:
        rows = [make_unit(job.id, claim.index + 1 + k, spec, at) for k, spec in enumerate(outcome.more)]
        connection.execute(tables.units.insert(), rows)
        changes["units_expected"] = changes["units_done"] + len(rows) + outcome.remaining + 1
        changes["note"] = storable(outcome.note)
    elif not connection.execute(_ANY_OPEN, {"of_job": job.id}).scalar_one():
        last = connection.execute(_LAST, {"of_job": job.id}).scalar_one()
        connection.execute(tables.units.insert(), make_unit(job.id, last + 1, ADVANCE, at))
    done, expected = changes["units_done"], changes.get("units_expected", job.units_expected)
    eta_seconds = estimate_eta_seconds(job.started_at, done, expected, at)
    note = changes.get("note", job.note)
    data = {"units_done": done, "units_expected": expected, "note": note, "eta_seconds": eta_seconds}
    change_job(connection, job, at, ("progress", data), **changes)


_ANY_OPEN = sa.select(sa.exists().where(_UNIT.job_id == sa.bindparam("of_job"), _UNIT.state != tables.RECORDED))
_LAST = sa.select(sa.func.max(_UNIT.number)).where(_UNIT.job_id == sa.bindparam("of_job"))


def release(db: Database, claim: Claim, *, died: bool, why: str = "") -> None:
    """Give the unit back at once; nothing happens if it is no longer this claim's.

    ``died``: a computing process ended under it.  With as many deaths or attempts as the claim allows, the job fails,
    and its problem ends with ``why``.
    """
    with writing(db) as connection:
        job = _lock_job(connection, claim)
        if job is None or job.state not in tables.UNFINISHED:
            return
        deaths, at = claim.deaths + died, now(db, connection)
        if not _end_claim(connection, claim, "ready", ready_at=at, deaths=deaths):
            return
        if deaths >= claim.max_deaths or claim.attempts >= claim.max_attempts:
            end_job(connection, job, at, "failed", problem=render_lost_unit(claim.attempts, deaths, why))

"""The worker in this process, on both databases: what it records, what it gives back, what it stops.

Answers are compared with what ``strange_units`` computes outside any worker.
"""

from __future__ import annotations

import json
import logging
import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import psutil
import pytest
import sqlalchemy as sa
from store_scenes import find, problem_of, submit, unit_rows
from strange_units import begun, expected_answer, request, units_begun
from worker_scenes import TENANT, finished, prepared_database, working

from tailstack.errors import Problem, SourcesChangedError
from tailstack.version import __version__
from tailstack_service.jobs import worker
from tailstack_service.jobs.store import events, jobs, queue, results, tables, workers
from tailstack_service.jobs.store.database import Database, writing
from tailstack_service.jobs.store.jobs import Job
from tailstack_service.problems import StoreUnavailable
from tailstack_service.processes.birth import running_code
from turned_clock import TurnedClock
from waiting import until

LEASE = 30.0  # s, by a clock that is turned
BEAT = LEASE / worker.BEATS_PER_LEASE

pytestmark = pytest.mark.usefixtures("quiet")


@pytest.fixture
def quiet(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG, logger="tailstack.worker")


@pytest.fixture
def db(database_url: str) -> Iterator[Database]:
    with prepared_database(database_url) as db:
        yield db


def by_turned_clock(db: Database) -> tuple[Database, TurnedClock]:
    """The same database by a clock that stands still, and the clock."""
    clock = TurnedClock()
    return replace(db, clock=clock), clock


def computes(caplog: pytest.LogCaptureFixture, note: Path, units: int) -> bool:
    """Whether these units are being computed and the worker knows of them all, so that a beat which ends them does so:
    a process that is killed before it begins is followed by another one."""
    return len(units_begun(note)) == units and len(told(caplog, "begun")) == 1 + units


def pass_a_beat(clock: TurnedClock) -> None:
    clock.until_waits(BEAT)
    clock.turn(BEAT)


def answer(db: Database, ended: Job) -> bytes:
    assert ended.state == "succeeded", ended.problem
    assert ended.result_sha256 is not None
    found = results.read_result(db, TENANT, ended.result_sha256)
    assert found is not None
    return found.body


def told(caplog: pytest.LogCaptureFixture, action: str) -> list[logging.LogRecord]:
    return [record for record in caplog.records if getattr(record, "action", "") == action]


@pytest.mark.long("postgresql")
def test_a_job_is_computed_and_recorded_once(db: Database) -> None:
    asked = request(units=5)
    submitted = submit(db, asked)
    with working(db):
        ended = finished(db, submitted)
    assert answer(db, ended) == expected_answer(asked)
    assert ended.units_done == 7  # a look, five units, a look
    assert [row.attempts for row in unit_rows(db, submitted)] == [1] * 7


def test_what_ends_a_job_is_its_own_problem(db: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    with working(db):
        ended = finished(db, submit(db, request("refuse")))
    assert problem_of(ended)["type"] == "/v1/problems/infeasible"
    with working(db, max_unit_deaths=2):
        ended = finished(db, submit(db, request("die", signal=int(signal.SIGILL))))
    assert problem_of(ended)["type"] == "/v1/problems/unit-lost"
    assert "SIGILL (illegal instruction: kernels built for another processor)" in problem_of(ended)["detail"]
    # A solver that answers nothing at all: refused by the store, and said so.
    monkeypatch.setattr("strange_units.FUNCTION", "empty_units:perform")
    with working(db):
        ended = finished(db, submit(db, request()))
    assert problem_of(ended)["type"] == "/v1/problems/internal-error"


def test_a_defect_fails_the_job_and_not_the_worker(db: Database, caplog: pytest.LogCaptureFixture) -> None:
    with working(db):
        bad, good = submit(db, request("raise"), request_id="r-77"), submit(db, request())
        ended = finished(db, bad)
        assert finished(db, good).state == "succeeded"
    assert problem_of(ended)["type"] == "/v1/problems/internal-error"
    assert "ArithmeticError" not in json.dumps(ended.problem)  # what went wrong inside is for the log
    (line,) = told(caplog, "defect")
    assert "ArithmeticError: a defect, for the test of it" in line.getMessage()
    assert (line.job, line.request, line.unit) == (bad.id, "r-77", 1)  # type: ignore[attr-defined]


def test_a_worker_whose_sources_were_replaced_stops_and_leaves_the_job_to_another(
    db: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    submitted = submit(db, request(units=2))
    with monkeypatch.context() as before:
        before.setattr("tailstack_service.processes.birth.digest_code", lambda: "of the files that were here")
        with working(db, expected=SourcesChangedError) as (worker, _):
            until(lambda: worker._failure is not None)
    assert not find(db, submitted).is_over
    with working(db):
        assert finished(db, submitted).state == "succeeded"


@pytest.mark.long("postgresql")
def test_a_cancelled_job_stops_computing_within_a_lease(
    db: Database, caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    (db, clock), note = by_turned_clock(db), tmp_path / "note"
    with working(db, lease_seconds=LEASE) as (_, engine):
        submitted = submit(db, request("burn", units=2, note=str(note)))
        until(lambda: computes(caplog, note, 2))
        before = set(engine.pids())
        assert jobs.cancel_job(db, TENANT, submitted.id) is not None
        pass_a_beat(clock)
        until(lambda: not engine._begun)
        until(lambda: len(set(engine.pids()) - before) == 2)
        assert finished(db, submit(db, request())).state == "succeeded"
    assert find(db, submitted).state == "cancelled"


@pytest.mark.long
def test_a_unit_that_takes_too_long_is_stopped(db: Database, caplog: pytest.LogCaptureFixture, tmp_path: Path) -> None:
    (db, clock), note = by_turned_clock(db), tmp_path / "note"
    with working(db, max_job_seconds=1.5 * BEAT, lease_seconds=LEASE) as (_, engine):
        submitted = submit(db, request("wait", note=str(note)))
        until(lambda: computes(caplog, note, 1))
        pass_a_beat(clock)
        clock.until_waits(BEAT)
        assert not find(db, submitted).is_over
        pass_a_beat(clock)
        ended = finished(db, submitted)
        until(lambda: not engine._begun)
        assert finished(db, submit(db, request())).state == "succeeded"
    assert problem_of(ended)["type"] == "/v1/problems/limit-exceeded"
    assert "TAILSTACK_MAX_JOB_SECONDS" in problem_of(ended)["errors"][0]["hint"]
    assert len(told(caplog, "too-long")) == 1


def test_a_stop_gives_everything_back_at_once(db: Database, tmp_path: Path) -> None:
    """Also what would never end."""
    go = tmp_path / "go"
    asked = request("wait", units=2, until=str(go))
    submitted = submit(db, asked)
    with working(db) as (_, engine):
        until(lambda: len(engine._begun) == 2)
        assert len(workers.list_workers(db)) == 1
    assert workers.list_workers(db) == []
    rows = unit_rows(db, submitted)
    assert [row.state for row in rows] == ["recorded", "ready", "ready"]
    assert [row.deaths for row in rows] == [0, 0, 0]
    go.touch()
    with working(db):
        assert answer(db, finished(db, submitted)) == expected_answer(asked)


def test_a_late_record_is_refused(
    db: Database, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The unit is taken over when this worker is about to write what it found: that is not written."""
    db, _ = by_turned_clock(db)  # there is no beat, by which it would notice its loss
    submitted, record = submit(db, request()), queue.record

    def taken_over(store: Database, *arguments: Any, **options: Any) -> list[bool]:
        with writing(store) as connection:
            held = tables.units.c.number == 1
            connection.execute(sa.update(tables.units).where(held).values(token=tables.units.c.token + 1))
        return record(store, *arguments, **options)

    monkeypatch.setattr(queue, "record", taken_over)
    with working(db):
        until(lambda: told(caplog, "late"))
        assert unit_rows(db, submitted)[1].state == "leased"
        assert find(db, submitted).units_done == 1


def test_a_code_of_the_same_version_computes_anew_and_says_so(db: Database) -> None:
    """Two commits may both be called 0.1.0: what a worker calls itself has the sources in it."""
    asked = request(units=3)
    submitted = submit(db, asked, solver_version=__version__)
    with working(db, solver_version=None):
        ended = finished(db, submitted)
    assert (ended.solver_version, ended.generation) == (running_code(), 2)
    assert ended.solver_version.startswith(f"{__version__}+")
    assert answer(db, ended) == expected_answer(asked)
    (event,) = [e for e in events.read_events(db, TENANT, submitted.id, 0, 100) if e.name == "recomputed"]
    assert event.data == {"from": __version__, "to": running_code()}


def test_a_killed_process_is_counted_and_its_unit_computed_again(db: Database, tmp_path: Path) -> None:
    note, go = tmp_path / "note", tmp_path / "go"
    asked = request("wait", note=str(note), until=str(go))
    submitted = submit(db, asked)
    with working(db, worker_processes=1) as (_, engine):
        until(lambda: len(begun(note)) == 2)  # a look, and the unit itself
        (killed,) = engine.pids()
        os.kill(killed, signal.SIGKILL)
        until(lambda: not psutil.pid_exists(killed))
        go.touch()
        assert answer(db, finished(db, submitted)) == expected_answer(asked)
    assert [row.deaths for row in unit_rows(db, submitted)] == [0, 1, 0]
    assert [row.attempts for row in unit_rows(db, submitted)] == [1, 2, 1]


@pytest.mark.long
def test_short_units_are_taken_ahead_and_long_ones_are_not(db: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    claim = queue.claim

    def counting(*arguments: Any, **options: Any) -> list[Any]:
        asked.append(options["limit"])
        return claim(*arguments, **options)

    monkeypatch.setattr(queue, "claim", counting)
    with working(db):
        finished(db, submit(db, request(units=4, cost=0.5)))
        longest = max(asked)
        finished(db, submit(db, request(units=150, cost=0.001)))
    assert longest == 2  # as many as there are processes
    assert max(asked) == 2 * (1 + worker.AHEAD_UNITS)


def test_the_database_may_go_away_while_units_are_computed(
    db: Database, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Every statement fails for a while: what was computed meanwhile is recorded afterwards, by the same claims."""
    away = False
    rooms = {"claim": queue, "record": queue, "renew": queue, "release": queue, "report_alive": workers}
    real = {name: getattr(room, name) for name, room in rooms.items()}

    def replacing(name: str) -> Any:
        def call(*arguments: Any, **options: Any) -> Any:
            if away:
                raise StoreUnavailable(Problem("", "store-unavailable", "gone", ""))
            return real[name](*arguments, **options)

        return call

    for name, room in rooms.items():
        monkeypatch.setattr(room, name, replacing(name))
    submitted = submit(db, request("wait", units=2, until=str(tmp_path / "go")))
    (db, clock), beat = by_turned_clock(db), 1200.0  # a lease is not over by the small turns below

    def is_over() -> bool:
        clock.turn(0.1)  # whoever found the database away tries again after a while
        return find(db, submitted).is_over

    with working(db, lease_seconds=worker.BEATS_PER_LEASE * beat) as (_, engine):
        until(lambda: len(engine._begun) == 2)
        away = True
        clock.until_waits(beat)
        clock.turn(beat)
        until(lambda: told(caplog, "store-unavailable"))
        (tmp_path / "go").touch()
        until(lambda: not engine._begun)
        away = False
        until(is_over)
    assert find(db, submitted).state == "succeeded"
    assert [row.attempts for row in unit_rows(db, submitted)] == [1, 1, 1, 1]


def test_a_defect_of_the_second_thread_ends_the_worker(db: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without heartbeats a worker would compute in vain for ever."""

    def broken(*_: Any, **__: Any) -> Any:
        raise ArithmeticError("for the test of it")

    held = submit(db, request("wait"))
    with working(db, lease_seconds=1.0, expected=ArithmeticError):
        until(lambda: len(unit_rows(db, held)) == 2)
        monkeypatch.setattr(queue, "renew", broken)
        until(lambda: workers.list_workers(db) == [])
    assert [row.state for row in unit_rows(db, held)] == ["recorded", "ready"]


def test_a_lost_unit_is_stopped_and_left_alone(db: Database, caplog: pytest.LogCaptureFixture, tmp_path: Path) -> None:
    """Another worker has the unit by now: the computation ends, nothing is released or recorded."""
    (db, clock), note = by_turned_clock(db), tmp_path / "note"
    submitted = submit(db, request("burn", note=str(note)))
    with working(db, lease_seconds=LEASE) as (_, engine):
        until(lambda: computes(caplog, note, 1))
        with db.engine.connect() as connection:
            held = tables.units.c.number == 1
            taken = {"token": tables.units.c.token + 1, "worker_id": "another", "lease_until": clock.time() + LEASE}
            connection.execute(sa.update(tables.units).where(held).values(taken))
            connection.commit()
        pass_a_beat(clock)
        until(lambda: not engine._begun)
        assert len(told(caplog, "lost")) == 1
    row = unit_rows(db, submitted)[1]
    assert (row.state, row.worker_id, row.deaths) == ("leased", "another", 0)

"""A store under an injected clock, and the short ways in which its tests submit, claim and record."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from postgres import Server

from tailstack_service import clock as clock_module
from tailstack_service.jobs.store import jobs, queue, tables, upkeep
from tailstack_service.jobs.store.database import Database, reading, writing
from tailstack_service.jobs.store.jobs import Job
from tailstack_service.jobs.store.queue import Claim
from tailstack_service.jobs.store.schema import migrate_database, open_database
from tailstack_service.processes.task import ADVANCE, Outcome

VERSION = "1.0"
LEASE = 15.0
MAX_ATTEMPTS = 25
MAX_DEATHS = 5
PROBLEM = b'{"type":"/v1/problems/infeasible","title":"No design","status":422,"detail":"none","errors":[]}'


class Clock(clock_module.Clock):
    """Epoch seconds that move only when told.  Who waits for a lock of the database waits by the machine's time."""

    def __init__(self) -> None:
        self.now = 1_800_000_000.0
        self.lived = 0.0

    def time(self) -> float:
        return self.now

    def monotonic(self) -> float:
        return super().monotonic() + self.lived

    def advance(self, seconds: float) -> None:
        """Let so many seconds be lived through."""
        self.lived += seconds
        self.now += seconds


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture(scope="session")
def migrated_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("migrated") / "store.sqlite3"
    migrate_database(f"sqlite:///{path}")
    return path


@pytest.fixture(scope="session")
def migrated_database(postgres_server: Server) -> str:
    url = postgres_server.url(postgres_server.create_database())
    migrate_database(url)
    return url


@pytest.fixture(params=["sqlite", "postgresql"])
def store(request: pytest.FixtureRequest, tmp_path: Path, clock: Clock) -> Iterator[Database]:
    """An empty database, on each of the two systems in turn, that asks ``clock`` for the time."""
    if request.param == "sqlite":
        path = tmp_path / "store.sqlite3"
        shutil.copy(request.getfixturevalue("migrated_file"), path)
        db = open_database(f"sqlite:///{path}", clock=clock)
    else:
        db = open_database(request.getfixturevalue("migrated_database"), clock=clock)
        with writing(db) as connection:
            for table in reversed(tables.metadata.sorted_tables):
                connection.execute(table.delete())
    with closing(db):
        yield db


def url_of(db: Database) -> str:
    return db.engine.url.render_as_string(hide_password=False)


def submit_or_find(db: Database, request: bytes = b'{"design":{}}', **changes: Any) -> tuple[Job, bool]:
    """A job, and whether it is new."""
    given: dict[str, Any] = {
        "tenant": "acme",
        "kind": "verification",
        "design_name": "carrier",
        "solver_version": VERSION,
        "request_id": "request-1",
        "max_queued": 100_000,
    }
    return jobs.submit_job(db, request=request, **(given | changes))


def submit(db: Database, *request: bytes, **changes: Any) -> Job:
    return submit_or_find(db, *request, **changes)[0]


def claim(db: Database, worker_id: str = "w1", limit: int = 1, **changes: Any) -> list[Claim]:
    given: dict[str, Any] = {
        "solver_version": VERSION,
        "lease_seconds": LEASE,
        "max_attempts": MAX_ATTEMPTS,
        "max_deaths": MAX_DEATHS,
    }
    return queue.claim(db, worker_id=worker_id, limit=limit, **(given | changes))


def claim_one(db: Database, worker_id: str = "w1", **changes: Any) -> Claim:
    (found,) = claim(db, worker_id, 1, **changes)
    return found


def record(db: Database, held: Claim, max_job_seconds: float = 3_600.0, **outcome: Any) -> bool:
    endings = [(held, Outcome(**({"cpu_seconds": 0.5} | outcome)))]
    return queue.record(db, endings, max_job_seconds=max_job_seconds)[0]


def specs(count: int) -> tuple[bytes, ...]:
    return tuple(b'{"unit":%d}' % number for number in range(1, count + 1))


def split(db: Database, count: int, **changes: Any) -> Job:
    """A job whose first advance was recorded: ``count`` units are ready.  Nothing else may be."""
    job = submit(db, **changes)
    held = claim_one(db)
    assert (held.job_id, held.spec) == (job.id, ADVANCE)
    assert record(db, held, more=specs(count))
    return job


def split_each(db: Database, clock: Clock, *counts: int, **changes: Any) -> list[Job]:
    """Several such jobs, one second after another."""
    made = []
    for _ in counts:
        made.append(submit(db, **changes))
        clock.advance(1)
    held = claim(db, limit=len(counts))
    assert [one.job_id for one in held] == [job.id for job in made]
    for one, count in zip(held, counts, strict=True):
        assert record(db, one, more=specs(count))
    return made


def find(db: Database, job: Job) -> Job:
    found = jobs.find_job(db, job.tenant, job.id)
    assert found is not None
    return found


def problem_of(ended: Job) -> dict[str, Any]:
    assert ended.state == "failed"
    assert ended.problem is not None
    return ended.problem


def unit_rows(db: Database, job: Job) -> list[Any]:
    """The units of a job as they are stored."""
    query = sa.select(tables.units).where(tables.units.c.job_id == job.id).order_by(tables.units.c.number)
    with reading(db) as connection:
        return list(connection.execute(query))


def wrong(db: Database) -> list[str]:
    """What the check of a database finds."""
    return [check.name for check in upkeep.check_database(db) if not check.ok]


def finish(db: Database, answer: bytes = b'{"answer":1}') -> None:
    """Compute whatever can be claimed, until nothing can."""
    while held := claim(db):
        (one,) = held
        if one.spec != ADVANCE:
            assert record(db, one, result=b"result of " + one.spec)
        else:
            assert record(db, one, answer=answer)


@pytest.fixture
def command(
    store: Database, monkeypatch: pytest.MonkeyPatch, call: Callable[..., tuple[int, str, str]]
) -> Callable[..., tuple[int, str, str]]:
    """A tailstack command on the database of ``store``: exit code, standard output, standard error."""
    monkeypatch.setenv("TAILSTACK_DATABASE", url_of(store))
    return call

"""Many sides at once on one store, on both databases: each result once, nothing lost, no deadlock."""

from __future__ import annotations

import hashlib
import itertools
import random
import sqlite3
import sys
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest
from postgres import Server
from store_scenes import LEASE, Clock, claim, claim_one, find, record, specs, split, submit, url_of, wrong
from worker_scenes import prepared_database

from family import started
from plain_data import problems_of
from tailstack_service import clock as clocks
from tailstack_service.jobs.store import database, jobs, queue, results, upkeep, usage, workers
from tailstack_service.jobs.store.database import Database, reading, writing
from tailstack_service.jobs.store.jobs import Job
from tailstack_service.jobs.store.queue import Claim
from tailstack_service.jobs.store.schema import HEAD, migrate_database, open_database
from tailstack_service.problems import StoreUnavailable
from tailstack_service.processes.task import ADVANCE, UnitResult
from waiting import LIMIT_SECONDS, until


class TickingClock(clocks.Clock):
    """Its time goes on with each look at it, and so as far on a slow machine as on a quick one."""

    def __init__(self) -> None:
        self._ticks = itertools.count()

    def time(self) -> float:
        return 1.8e9 + 0.002 * next(self._ticks)


def test_threads_that_claim_at_once_never_get_the_same_unit(store: Database) -> None:
    split(store, 120)

    def take(name: str) -> list[int]:
        mine: list[int] = []
        empty = 0
        while empty < 5:  # an empty answer may mean that another was looking at the same moment
            found = claim(store, name, 2)
            empty = 0 if found else empty + 1
            mine += [one.index for one in found]
        return mine

    with ThreadPoolExecutor(6) as pool:
        taken = [index for mine in pool.map(take, [f"w{k}" for k in range(6)]) for index in mine]
    assert sorted(taken) == list(range(1, 121))


@pytest.mark.long
def test_all_that_is_written_at_once_makes_no_deadlock(store: Database) -> None:
    """Every writing function from eight threads on few jobs (seeds 0 to 7), with leases that keep running out."""
    split(store, 30)

    def play(seed: int) -> Counter[str]:
        dice, held, done = random.Random(seed), [], Counter[str]()
        for _ in range(16):
            held += claim(store, f"w{seed % 4}", dice.randrange(1, 6), lease_seconds=dice.choice([0.0, 0.01, 5.0]))
            done["claims"] += 1
            dice.shuffle(held)
            for _ in range(min(len(held), 3)):
                one = held.pop()
                move = dice.random()
                if move < 0.2:
                    queue.release(store, one, died=False)
                elif one.spec != ADVANCE:
                    done["records"] += record(store, one, result=b"x")
                elif move < 0.6:
                    done["records"] += record(store, one, more=specs(20))
                else:
                    done["records"] += record(store, one, answer=b"{}")
            lost = queue.renew(store, f"w{seed % 4}", held, 0.02)
            held = [one for one in held if one not in lost]
            workers.report_alive(store, f"w{seed % 4}", "host", seed, "1.0", "pool", 1)
            recent = jobs.list_page(store, "acme", limit=3).jobs
            if dice.random() < 0.3 or not recent:
                submit(store)
            if recent and dice.random() < 0.25:
                jobs.cancel_job(store, "acme", dice.choice(recent).id)
                done["cancels"] += 1
            if dice.random() < 0.05:
                upkeep.purge(store, 0.0)
        return done

    store = replace(store, clock=TickingClock(), file=None)
    with ThreadPoolExecutor(8) as pool:
        total = sum(pool.map(play, range(8)), Counter())
    assert min(total["claims"], total["records"], total["cancels"]) > 10, total
    assert wrong(store) == []


@pytest.fixture
def db(postgres_server: Server, migrated_database: str, clock: Clock) -> Iterator[Database]:
    """The database of PostgreSQL that others have used as well; its server runs again afterwards."""
    with closing(open_database(migrated_database, clock=clock)) as db:
        yield db
    if not postgres_server.running:
        postgres_server.start()


def test_a_purge_leaves_a_result_that_a_job_is_just_coming_to(db: Database, clock: Clock) -> None:
    """Two jobs, one answer: the first job is purged while the second is being recorded."""
    with writing(db) as connection:
        name = results.store_result(db, connection, "verification", b'{"orphan":1}', clock.now)
    with ThreadPoolExecutor(1) as pool:
        with writing(db) as connection:
            assert results.store_result(db, connection, "verification", b'{"orphan":1}', clock.now) == name
            assert pool.submit(upkeep.purge, db, 1e4).result(LIMIT_SECONDS).results == 0
        assert kept_results(db, name) == 1
        assert pool.submit(upkeep.purge, db, 1e4).result(LIMIT_SECONDS).results >= 1
    assert kept_results(db, name) == 0


def kept_results(db: Database, name: str) -> int:
    with reading(db) as connection:
        found: int = connection.exec_driver_sql(f"SELECT count(*) FROM results WHERE sha256 = '{name}'").scalar_one()
    return found


def test_many_writers_behind_one_that_is_stopped_wait_together_not_one_after_the_other(
    tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The one whose turn it is may wait for the file for ever: who waits for his turn is refused all the same."""
    monkeypatch.setattr(database, "BUSY_SECONDS", 0.3)

    def refused(_: int) -> bool:
        return "no other program may hold the file" in problems_of(submit, db, error=StoreUnavailable)[0].hint

    with closing(open_database(f"sqlite:///{tmp_path / 'a.sqlite3'}", migrate=True, clock=clock)) as db:
        assert db.turn is not None
        with (
            closing(sqlite3.connect(tmp_path / "a.sqlite3", isolation_level=None)) as other,
            ThreadPoolExecutor(12) as pool,
        ):
            other.execute("BEGIN IMMEDIATE")  # and then nothing more: as if it were stopped here
            first = pool.submit(submit, db.within(2 * LIMIT_SECONDS))
            until(db.turn.locked)
            assert all(pool.map(refused, range(11)))
            assert not first.done()
            other.execute("ROLLBACK")
            assert first.result(LIMIT_SECONDS).state == "queued"
        assert find(db, submit(db)).state == "queued"


def test_migrating_at_once_from_many_sides_is_safe(database_url: str) -> None:
    with ThreadPoolExecutor(6) as pool:
        found = list(pool.map(lambda _: migrate_database(database_url), range(6)))
    assert Counter(found) == {(None, HEAD): 1, (HEAD, HEAD): 5}
    with closing(open_database(database_url)) as db:
        assert wrong(db) == []


def test_a_new_file_that_another_is_writing_is_waited_for(tmp_path: Path) -> None:
    """SQLite itself refuses at once to make the log of such a file."""
    path = tmp_path / "a.sqlite3"
    with closing(sqlite3.connect(path, isolation_level=None)) as other, ThreadPoolExecutor(1) as pool:
        other.execute("BEGIN IMMEDIATE")
        with closing(sqlite3.connect(path)) as plain, pytest.raises(sqlite3.OperationalError):
            plain.execute("PRAGMA journal_mode=WAL")
        migrated = pool.submit(migrate_database, f"sqlite:///{path}")
        with pytest.raises(TimeoutError):
            migrated.result(0.1)
        other.execute("ROLLBACK")
        assert migrated.result(LIMIT_SECONDS) == (None, HEAD)


@pytest.mark.long
def test_processes_that_open_a_new_file_at_once(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'new' / 'a.sqlite3'}"
    opens = "from tailstack_service.jobs.store.schema import *; open_database(sys.argv[1], migrate=True).close()"
    command = (sys.executable, "-c", f"import sys; {opens}", url)
    with ExitStack() as stack:
        processes = [stack.enter_context(started(*command, stdout=None, stderr=None)) for _ in range(4)]
        assert [process.wait(LIMIT_SECONDS) for process in processes] == [0] * 4
    path = tmp_path / "new" / "a.sqlite3"
    assert path.stat().st_mode & 0o777 == 0o600
    assert path.parent.stat().st_mode & 0o777 == 0o700


def test_a_server_that_restarts_is_unavailable_and_then_goes_on(db: Database, postgres_server: Server) -> None:
    tenant = "restart"
    job = submit(db, tenant=tenant)
    held = next(one for one in claim(db, limit=1000) if one.job_id == job.id)
    assert record(db, held, more=specs(2))
    postgres_server.stop()
    for call in (
        lambda: find(db, job),
        lambda: submit(db),
        lambda: claim(db),
        lambda: record(db, held, more=specs(2)),
        lambda: queue.renew(db, "w1", [held], LEASE),
        lambda: jobs.cancel_job(db, tenant, job.id),
        lambda: open_database(url_of(db)),
    ):
        with pytest.raises(StoreUnavailable):
            call()
    postgres_server.start()
    # Every connection of the pool is dead; nobody has to notice
    assert find(db, job).units_done == 1
    assert record(db, held, more=specs(2))  # it was recorded before, and is not recorded twice
    assert find(db, job).units_done == 1
    assert [one.index for one in claim(db, limit=1000) if one.job_id == job.id] == [1, 2]


def test_a_connection_cut_in_the_middle_undoes_everything(db: Database) -> None:
    job = submit(db, tenant="cut")
    held = next(one for one in claim(db, limit=1000) if one.job_id == job.id)
    before = find(db, job)

    def write_half() -> None:
        with writing(db) as connection:
            connection.exec_driver_sql("UPDATE jobs SET note = 'half' WHERE tenant = 'cut'")
            mine = connection.exec_driver_sql("SELECT pg_backend_pid()").scalar_one()
            with db.engine.connect() as other:
                other.exec_driver_sql(f"SELECT pg_terminate_backend({mine})")
            connection.exec_driver_sql("UPDATE jobs SET note = 'whole' WHERE tenant = 'cut'")

    with pytest.raises(StoreUnavailable):
        write_half()
    assert find(db, job) == before
    assert record(db, held, answer=b"{}")


@pytest.mark.parametrize("table", ["jobs", "units"])
def test_claims_and_renewals_never_wait_for_a_row_that_another_holds(
    postgres_url: str, clock: Clock, table: str
) -> None:
    """So they cannot be part of a deadlock, whatever the order in which the others take rows."""
    with prepared_database(postgres_url, clock) as db:
        split(db, 1)
        held = claim_one(db)
        submit(db)
        with writing(db) as connection, ThreadPoolExecutor(1) as pool:
            connection.exec_driver_sql(f"SELECT 1 FROM {table} FOR UPDATE")
            assert pool.submit(claim, db, "w2", 9).result(LIMIT_SECONDS) == []
            assert pool.submit(queue.renew, db, "w1", [held], LEASE).result(LIMIT_SECONDS) == []  # not lost, only busy
        assert len(claim(db, "w2", 9)) == 1
        assert record(db, held, result=b"x")


def test_a_lock_held_too_long_is_unavailable(db: Database) -> None:
    job = submit(db, tenant="locked")
    with writing(db) as connection:
        connection.exec_driver_sql("SELECT 1 FROM jobs WHERE tenant = 'locked' FOR UPDATE")
        short = url_of(db) + "?options=-c%20lock_timeout%3D100ms"
        with closing(open_database(short)) as impatient, pytest.raises(StoreUnavailable, match="lock timeout"):
            jobs.cancel_job(impatient, "locked", job.id)
    assert any(one.job_id == job.id for one in claim(db, limit=1000))


# --- everything that can happen, in random order, against a model ---------------------------------


STEPS = 260


def computed(request: bytes, spec: bytes) -> bytes:
    return hashlib.sha256(request + spec).digest()


def advanced(request: bytes, recorded: tuple[UnitResult, ...]) -> dict[str, object]:
    """Two rounds of units, their number drawn from the request; then the answer."""
    rounds = [1 + request[-1] % 4, 1 + request[-2] % 3]
    if len(recorded) < sum(rounds):
        number = 0 if not recorded else 1
        assert len(recorded) == sum(rounds[:number])
        return {"more": tuple(b'{"round":%d,"unit":%d}' % (number, k) for k in range(rounds[number]))}
    parts = [one.spec.hex() + "=" + one.result.hex() for one in recorded]
    assert [one.result for one in recorded] == [computed(request, one.spec) for one in recorded]
    return {"answer": ("{" + f'"parts":"{";".join(parts)}"' + "}").encode()}


def undisturbed(request: bytes) -> bytes:
    recorded: tuple[UnitResult, ...] = ()
    while "answer" not in (step := advanced(request, recorded)):
        specs = step["more"]
        assert isinstance(specs, tuple)
        recorded += tuple(UnitResult(0, spec, computed(request, spec)) for spec in specs)
    assert isinstance(step["answer"], bytes)
    return step["answer"]


@dataclass
class UnitModel:
    token: int = 0  # and so how often it was begun
    deaths: int = 0
    state: str = "ready"
    until: float = 0.0


@dataclass
class JobModel:
    version: str
    state: str = "unfinished"
    generation: int = 1
    done: int = 0
    units: dict[int, UnitModel] = field(default_factory=lambda: {0: UnitModel()})

    def held(self, claimed: Claim) -> UnitModel | None:
        """The unit, if this claim still has it."""
        unit = self.units.get(claimed.index)
        current = self.state == "unfinished" and self.generation == claimed.generation and unit is not None
        return unit if current and unit and unit.token == claimed.token and unit.state == "leased" else None

    def recorded(self, claimed: Claim) -> bool:
        unit = self.units.get(claimed.index)
        same = self.generation == claimed.generation and unit is not None and unit.token == claimed.token
        return same and unit is not None and unit.state == "recorded"

    def end(self, state: str) -> None:
        self.state = state
        self.units = {number: unit for number, unit in self.units.items() if unit.state == "recorded"}

    def add(self, count: int) -> None:
        first = max(self.units) + 1
        self.units |= {first + k: UnitModel() for k in range(count)}

    def can_be_claimed(self, now: float) -> set[int]:
        if self.state != "unfinished":
            return set()
        return {n for n, u in self.units.items() if u.state == "ready" or (u.state == "leased" and u.until < now)}


class Play:
    """The store and its model, moved by the same steps."""

    def __init__(self, store: Database, clock: Clock, seed: int) -> None:
        self.store, self.clock, self.random = store, clock, random.Random(seed)
        self.jobs: dict[str, tuple[Job, bytes]] = {}
        self.model: dict[str, JobModel] = {}
        self.claims: list[tuple[str, Claim]] = []  # also those that are lost
        self.seen: dict[str, float] = {}
        self.counted = {"records": 0, "refused": 0, "again": 0, "lost": 0, "resets": 0, "expired": 0}

    def submit(self) -> None:
        request = b'{"n":%d}' % len(self.jobs) + self.random.randbytes(2)
        version = self.random.choice("12")
        job = submit(self.store, request, solver_version=version)
        self.jobs[job.id], self.model[job.id] = (job, request), JobModel(version)

    def live(self) -> set[str]:
        return {version for version, at in self.seen.items() if at > self.clock.now - LEASE}

    def claim(self) -> None:
        version = self.random.choice("12")
        if self.random.random() < 0.8:
            workers.report_alive(self.store, f"w{version}", "host", 1, version, "pool", 1)
            self.seen[version] = self.clock.now
        limit = self.random.randint(1, 5)
        others = self.live() - {version}
        possible = {
            (job_id, number)
            for job_id, job in self.model.items()
            if job.version not in others
            for number in job.can_be_claimed(self.clock.now)
        }
        found = claim(self.store, f"w{version}", limit, solver_version=version, max_attempts=10_000, max_deaths=10_000)
        assert bool(found) == bool(possible)
        assert len({(one.job_id, one.index) for one in found}) == len(found) <= limit
        kept = sum(self.model[job_id].version == version for job_id, _ in possible)
        assert len(found) >= min(limit, kept and 1)
        for one in found:
            job = self.model[one.job_id]
            if job.version != version:
                job.version, job.generation, job.done, job.units = version, job.generation + 1, 0, {0: UnitModel()}
                self.counted["resets"] += 1
            else:
                assert (one.job_id, one.index) in possible
            unit = job.units[one.index]
            self.counted["expired"] += unit.state == "leased"
            assert (one.generation, one.token) == (job.generation, unit.token + 1)  # tokens only grow
            assert (one.attempts, one.deaths) == (one.token, unit.deaths)
            assert one.request == self.jobs[one.job_id][1]
            unit.token, unit.state, unit.until = one.token, "leased", self.clock.now + LEASE
            self.claims.append((f"w{version}", one))

    def record(self) -> None:
        _, one = self.random.choice(self.claims)
        job, request = self.model[one.job_id], self.jobs[one.job_id][1]
        unit, again = job.held(one), job.recorded(one)
        outcome = advanced(request, one.results) if one.spec == ADVANCE else {"result": computed(request, one.spec)}
        assert record(self.store, one, **outcome) == (unit is not None or again)
        self.counted["records" if unit else "again" if again else "refused"] += 1
        if unit is None:
            return
        unit.state, job.done = "recorded", job.done + 1
        if "answer" in outcome:
            job.end("succeeded")
        elif "more" in outcome:
            assert isinstance(outcome["more"], tuple)
            job.add(len(outcome["more"]))
        elif all(other.state == "recorded" for other in job.units.values()):
            job.add(1)

    def release(self) -> None:
        _, one = self.random.choice(self.claims)
        unit, died = self.model[one.job_id].held(one), self.random.random() < 0.5
        queue.release(self.store, one, died=died)
        if unit is not None:
            unit.state, unit.deaths = "ready", unit.deaths + died

    def leave(self) -> None:
        """A worker ends in order: nobody of another version waits until it counts as silent."""
        version = self.random.choice("12")
        workers.remove_worker(self.store, f"w{version}")
        self.seen.pop(version, None)

    def renew(self) -> None:
        worker_id = self.random.choice(["w1", "w2"])
        mine = [one for owner, one in self.claims if owner == worker_id]
        mine = self.random.sample(mine, min(len(mine), 8))
        expected = [one for one in mine if not (self.holds(one) or self.model[one.job_id].recorded(one))]
        assert queue.renew(self.store, worker_id, mine, LEASE) == expected
        self.counted["lost"] += len(expected)
        for one in mine:
            unit = self.holds(one)
            if unit is not None:
                unit.until = self.clock.now + LEASE

    def holds(self, one: Claim) -> UnitModel | None:
        return self.model[one.job_id].held(one)

    def cancel(self) -> None:
        job_id = self.random.choice(list(self.jobs))
        jobs.cancel_job(self.store, "acme", job_id)
        if self.model[job_id].state == "unfinished":
            self.model[job_id].end("cancelled")

    def step(self) -> None:
        moves: dict[Any, float] = {self.submit: 2, self.claim: 6, self.record: 9, self.release: 1, self.renew: 4}
        moves[self.leave] = 0.5
        if len(self.jobs) > 4:
            moves[self.cancel] = 0.25
        if not self.claims:
            moves = {self.submit: 1, self.claim: 2}
        self.random.choices(list(moves), list(moves.values()))[0]()
        self.clock.advance(self.random.choice([0, 0, 0, 0.1, 1, LEASE / 2, LEASE + 1]))

    def compare(self) -> None:
        for job_id, model in self.model.items():
            job = find(self.store, self.jobs[job_id][0])
            assert job.generation == model.generation
            assert job.units_done == model.done
            assert job.is_over == (model.state != "unfinished")
        spent = usage.sum_cpu_seconds(self.store, "acme", 0.0)
        assert spent == pytest.approx(0.5 * self.counted["records"])  # what is recorded again is not counted again


@pytest.mark.hostile
@pytest.mark.parametrize(
    ("seed", "steps"),
    [(2, 120), pytest.param(1, STEPS, marks=pytest.mark.long), pytest.param(3, STEPS, marks=pytest.mark.long)],
)
def test_random_interleavings_agree_with_the_model(
    store: Database, clock: Clock, seed: int, steps: int, run_seed: int
) -> None:
    play = Play(store, clock, seed + 10 * run_seed)
    for number in range(20 * STEPS):  # until each thing that can happen did: so few steps may leave out the rarest
        play.step()
        if number % 20 == 0:
            play.compare()
        if number >= steps and all(play.counted.values()):
            break
    assert all(play.counted.values()), play.counted  # each thing that can happen did
    assert wrong(store) == []
    clock.advance(10 * LEASE)
    while held := claim(store, "last", 3, solver_version="3"):
        for one in held:
            request = play.jobs[one.job_id][1]
            done = advanced(request, one.results) if one.spec == ADVANCE else {"result": computed(request, one.spec)}
            assert record(store, one, **done)
    for job_id, (job, request) in play.jobs.items():
        ended = find(store, job)
        if play.model[job_id].state == "cancelled":
            assert ended.state == "cancelled"
            continue
        assert ended.result_sha256 is not None
        kept = results.read_result(store, "acme", ended.result_sha256)
        assert kept is not None
        assert kept.body == undisturbed(request)
    assert wrong(store) == []

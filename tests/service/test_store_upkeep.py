"""Migrations, the check, copies that can be restored, and what a purge leaves."""

from __future__ import annotations

import hashlib
import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from postgres import Server
from service_scenes import ROOT
from store_scenes import Clock, claim, claim_one, find, finish, record, specs, split, split_each, submit, url_of, wrong
from worker_scenes import prepared_database

from plain_data import read_cases
from tailstack.errors import Problem
from tailstack_service.jobs.store import events, jobs, queue, results, schema, tables, upkeep, usage, workers
from tailstack_service.jobs.store.database import Database, connect, writing
from tailstack_service.jobs.store.queue import make_unit
from tailstack_service.jobs.store.schema import open_database
from tailstack_service.jobs.store.tables import new_job_id
from tailstack_service.problems import StoreError, StoreUnavailable
from tailstack_service.processes.task import ADVANCE

DAY = 86_400.0


@pytest.fixture
def fresh(database_url: str, clock: Clock) -> Iterator[Database]:
    """A database of this test alone, which it may damage."""
    with prepared_database(database_url, clock) as db:
        yield db


def execute(db: Database, statement: str) -> None:
    with writing(db) as connection:
        connection.exec_driver_sql(statement)


def test_migrations_lead_to_the_tables_of_the_code(fresh: Database) -> None:
    script = ScriptDirectory(str(schema.MIGRATIONS))
    assert script.get_heads() == [schema.HEAD]
    assert schema.schema_version(fresh) == schema.HEAD
    with fresh.engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True, "compare_server_default": True})
        assert compare_metadata(context, tables.metadata) == []
        found = sa.inspect(connection)
        checks = {name: found.get_check_constraints(name) for name in ("jobs", "units")}
        partial = {index["name"] for index in found.get_indexes("units")}
    # What the comparison does not look at
    assert {check["name"] for check in checks["jobs"]} == {"jobs_state", "jobs_result", "jobs_problem", "jobs_finished"}
    assert {check["name"] for check in checks["units"]} == {"units_state"}
    assert partial == {"units_ready", "units_leased", "units_open"}


def test_migrating_again_changes_nothing(fresh: Database) -> None:
    job = split(fresh, 2)
    assert schema.migrate_database(url_of(fresh)) == (schema.HEAD, schema.HEAD)
    assert find(fresh, job).units_done == 1


def test_a_database_without_tables_is_refused_with_the_next_command(postgres_url: str, tmp_path: Path) -> None:
    missing = f"sqlite:///{tmp_path / 'a.sqlite3'}"
    with pytest.raises(StoreError, match=r"no database.*tailstack db migrate"):
        open_database(missing)
    assert not (tmp_path / "a.sqlite3").exists()
    for migrate in (False, True):  # serve never changes a server's tables
        with pytest.raises(StoreError, match=r"no tables.*tailstack db migrate"):
            open_database(postgres_url, migrate=migrate)
    open_database(missing, migrate=True).close()
    open_database(missing).close()


@pytest.mark.parametrize(
    ("version", "words"), [("0001", "of a tailstack before 0.2.*move it away"), ("0005", "knows 0004 at most.*newer")]
)
def test_another_version_is_refused(fresh: Database, version: str, words: str) -> None:
    execute(fresh, f"UPDATE alembic_version SET version_num = '{version}'")
    with pytest.raises(StoreError, match=words):
        open_database(url_of(fresh))
    assert wrong(fresh) == ["schema version"]
    with pytest.raises(StoreError, match=words):
        schema.migrate_database(url_of(fresh))
    assert schema.schema_version(fresh) == version


@pytest.mark.parametrize(("url", "words"), read_cases("settings", "databases"))
def test_urls_that_cannot_be_used(url: str, words: str) -> None:
    with pytest.raises(StoreError, match=words) as caught:
        open_database(url, migrate=True)
    assert "secret" not in str(caught.value)
    assert "TAILSTACK_DATABASE" in str(caught.value)


def test_a_file_that_is_no_database_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.sqlite3"
    path.write_text("not a database, but long enough to be read as one")
    with pytest.raises(StoreError, match="not a database"):
        open_database(f"sqlite:///{path}", migrate=True)
    assert path.read_text().startswith("not a database")


def test_a_server_that_refuses_is_told_from_one_that_is_away(postgres_server: Server, postgres_url: str) -> None:
    with pytest.raises(StoreUnavailable, match="refused"):
        open_database("postgresql://u:p@127.0.0.1:1/d")
    name = f"visitor_{postgres_url.rpartition('/')[2]}"
    with closing(connect(postgres_url)) as execute_as_owner:
        execute(execute_as_owner, f"CREATE ROLE {name} LOGIN PASSWORD 'p'")
        visitor = f"postgresql://{name}:p@127.0.0.1:{postgres_server.port}/{postgres_url.rpartition('/')[2]}"
        with pytest.raises(StoreError, match=r"permission denied.*ALTER DATABASE"):
            schema.migrate_database(visitor)
        execute(execute_as_owner, f"DROP ROLE {name}")


def scene(db: Database, clock: Clock) -> dict[str, jobs.Job]:
    """One job in each state, and one that is half done."""
    made = {"done": submit(db)}
    finish(db, b'{"answer":42}')
    made["failed"] = submit(db)
    assert record(db, claim_one(db), problem=b'{"type":"x"}')
    made["cancelled"] = split(db, 2)
    assert jobs.cancel_job(db, "acme", made["cancelled"].id)
    made["running"], made["half"] = split_each(db, clock, 2, 3)
    held = claim(db, limit=3)
    assert record(db, held[0], result=b"x")
    assert record(db, held[2], result=b"y")
    made["queued"] = submit(db)
    return {name: find(db, job) for name, job in made.items()}


def test_a_sound_database_is_found_sound(fresh: Database, clock: Clock) -> None:
    scene(fresh, clock)
    checks = upkeep.check_database(fresh)
    assert [check.name for check in checks if not check.ok] == []
    assert len(checks) == (15 if fresh.dialect == "sqlite" else 13)


# What is broken by hand, and the rule that must notice it.  {name} is the id of a job of the scene.
DAMAGE = {
    "results hash to their names": "UPDATE results SET body = {odd_body}",
    "every unit belongs to a job": "UPDATE units SET job_id = '0' WHERE job_id = '{queued}'",
    "every unfinished job has a unit to compute": "DELETE FROM units WHERE job_id = '{queued}'",
    "no finished job has one": "UPDATE units SET state = 'ready' WHERE job_id = '{done}'",
    "no finished job keeps payloads of units": "UPDATE units SET result = {odd_body} WHERE job_id = '{done}'",
    "every recorded unit of an unfinished job has its payload": "UPDATE units SET result = NULL",
    "units are counted right": "UPDATE jobs SET units_done = units_done + 1 WHERE id = '{half}'",
    "every job has its request": "DELETE FROM requests WHERE job_id = '{half}'",
    "every succeeded job has its result": "UPDATE jobs SET result_sha256 = '0' WHERE id = '{done}'",
    "events are numbered without gaps": "DELETE FROM events WHERE job_id = '{half}' AND sequence = 2",
}


@pytest.mark.long(*[f"postgresql-{rule}" for rule in list(DAMAGE)[2::2]])  # the same queries
@pytest.mark.parametrize("rule", DAMAGE)
def test_the_check_notices_what_is_broken(fresh: Database, clock: Clock, rule: str) -> None:
    made = scene(fresh, clock)
    odd_body = "x'00'" if fresh.dialect == "sqlite" else r"'\x00'"
    statement = DAMAGE[rule].format(odd_body=odd_body, **{name: job.id for name, job in made.items()})
    with fresh.engine.connect() as connection:
        if fresh.dialect == "sqlite":
            connection.connection.driver_connection.execute("PRAGMA foreign_keys=OFF")  # type: ignore[union-attr]
        else:
            connection.exec_driver_sql("SET session_replication_role = replica")  # foreign keys are not looked at
        connection.exec_driver_sql(statement)
        connection.commit()
        connection.invalidate()
    found = wrong(fresh)
    assert rule in found
    # One cause may break other rules as well, and SQLite's own check of references
    allowed = {"foreign key check", "units are counted right", "every unfinished job has a unit to compute"}
    assert set(found) - {rule} <= allowed


def raise_if_wrong(db: Database) -> None:
    names = wrong(db)
    if names:
        raise StoreError(Problem("", "damaged", ", ".join(names), "restore a backup"))


def test_a_page_of_a_file_that_is_overwritten_is_noticed(tmp_path: Path, clock: Clock) -> None:
    path = tmp_path / "a.sqlite3"
    with closing(open_database(f"sqlite:///{path}", migrate=True, clock=clock)) as db:
        split_each(db, clock, *[5] * 40)
    content = bytearray(path.read_bytes())
    for page in range(20, len(content) // 4096):
        content[page * 4096 : page * 4096 + 64] = b"\xff" * 64
    path.write_bytes(content)
    with closing(connect(f"sqlite:///{path}")) as damaged, pytest.raises(StoreError, match="restore a backup"):
        # SQLite may refuse to read at all, which is told in the same words
        raise_if_wrong(damaged)


def test_a_copy_that_sqlite_makes_while_the_service_runs_can_be_restored(tmp_path: Path, clock: Clock) -> None:
    """By the command of docs/deploy.md."""
    page = (ROOT / "docs" / "deploy.md").read_text(encoding="utf-8")
    (command,) = re.findall(r'^sqlite3 .*"(VACUUM INTO)', page, re.MULTILINE)
    with closing(open_database(f"sqlite:///{tmp_path / 'a.sqlite3'}", migrate=True, clock=clock)) as db:
        made = scene(db, clock)
        with closing(sqlite3.connect(tmp_path / "a.sqlite3")) as beside:
            beside.execute(f"{command} '{tmp_path / 'b.sqlite3'}'")
        submit(db)  # goes on
    with closing(open_database(f"sqlite:///{tmp_path / 'b.sqlite3'}", clock=clock)) as db:
        assert wrong(db) == []
        assert {name: find(db, job) for name, job in made.items()} == made
        assert len(jobs.list_page(db, "acme", limit=99).jobs) == len(made)
        assert made["done"].result_sha256 is not None
        kept = results.read_result(db, "acme", made["done"].result_sha256)
        assert kept is not None
        assert kept.body == b'{"answer":42}'
        clock.advance(1_000)  # and it goes on where it was
        finish(db)
        assert find(db, made["half"]).state == "succeeded"


def test_a_purge_deletes_what_is_old_and_nothing_else(store: Database, clock: Clock) -> None:
    old = submit(store, idempotency_key="k")
    shared = submit(store, tenant="other")
    held = {one.job_id: one for one in claim(store, limit=2)}
    assert record(store, held[old.id], answer=b'{"only":"old"}')
    assert record(store, held[shared.id], answer=b'{"shared":1}')
    unfinished = split(store, 2)
    assert upkeep.purge(store, 30.0) == upkeep.Deletions(0, 0, 0, 0, 0)  # from now on they age
    clock.advance(20 * DAY)
    young = submit(store)
    claimed = next(one for one in claim(store, limit=9) if one.job_id == young.id)
    assert record(store, claimed, answer=b'{"shared":1}')
    workers.report_alive(store, "w1", "host", 1, "1.0", "pool", 1)
    assert upkeep.purge(store, 30.0) == upkeep.Deletions(jobs=0, results=0, usage_rows=2, workers=0, audit_entries=0)
    clock.advance(11 * DAY)

    gone, kept = find(store, old).result_sha256, find(store, young).result_sha256
    assert gone is not None
    assert kept is not None
    assert upkeep.purge(store, 30.0) == upkeep.Deletions(jobs=2, results=1, usage_rows=1, workers=1, audit_entries=0)
    assert jobs.find_job(store, "acme", old.id) is None
    assert jobs.find_job(store, "other", shared.id) is None
    assert results.read_result(store, "acme", gone) is None
    assert results.read_result(store, "acme", kept) is not None
    assert results.read_result(store, "other", kept) is None
    assert find(store, unfinished).state == "running"
    assert submit(store, idempotency_key="k").id != old.id  # a key lives as long as its job
    assert wrong(store) == []
    assert upkeep.purge(store, 30.0) == upkeep.Deletions(0, 0, 0, 0, 0)


@pytest.mark.parametrize("served_days", [0.0, 1.0], ids=["at a boot", "while it is served"])
def test_a_clock_that_leaps_makes_nothing_old(
    store: Database, clock: Clock, caplog: pytest.LogCaptureFixture, served_days: float
) -> None:
    """Forty days ahead, or back and right again: what is young stays, and goes when its days were lived through."""
    upkeep.purge(store, 30.0)
    clock.advance(served_days * DAY)
    jobs.cancel_job(store, "acme", submit(store, b"1").id)
    results.keep_designs(store, [("acme", "1" * 64, b"{}")], 9)
    clock.now += 40 * DAY
    assert upkeep.purge(store, 30.0, 30.0) == upkeep.Deletions(0, 0, 0, 0, 0)
    assert [vars(each)["action"] for each in caplog.records if each.levelname == "WARNING"] == ["clock-leapt"]
    clock.now -= 80 * DAY
    jobs.cancel_job(store, "acme", submit(store, b"2").id)
    clock.now += 40 * DAY
    assert upkeep.purge(store, 30.0, 30.0) == upkeep.Deletions(0, 0, 0, 0, 0)
    clock.advance(29 * DAY)
    assert upkeep.purge(store, 30.0, 30.0) == upkeep.Deletions(0, 0, 0, 0, 0)
    clock.advance(2 * DAY)
    gone = upkeep.purge(store, 30.0, 30.0)
    assert (gone.jobs, gone.designs) == (2, 1)


def test_the_order_of_jobs_does_not_depend_on_the_clock(store: Database, clock: Clock) -> None:
    """Neither which are listed as the newest, nor which are served first."""
    asked: list[str] = []
    for seconds in (0.0, 40 * DAY, -80 * DAY, 0.0, 60.0, 40 * DAY):
        clock.now += seconds
        asked.append(submit(store, b"%d" % len(asked)).id)
    page = jobs.list_page(store, "acme", limit=9)
    assert [job.id for job in page.jobs] == asked[::-1]
    assert page.at == clock.now
    assert [claim_one(store).job_id for _ in asked] == asked


@pytest.mark.long("postgresql")
def test_a_purge_takes_many_jobs_in_several_transactions(store: Database, clock: Clock) -> None:
    for number in range(230):
        jobs.cancel_job(store, "acme", submit(store, b"%d" % number).id)
    assert upkeep.purge(store, 1.0).jobs == 0
    clock.advance(DAY + 1)
    last = submit(store)
    assert upkeep.purge(store, 1.0).jobs == 230
    assert jobs.list_page(store, "acme", limit=9).jobs == (last,)


def test_old_usage_becomes_one_sum(store: Database, clock: Clock) -> None:
    for tenant in ("acme", "other"):
        for _ in range(3):
            submit(store, tenant=tenant)
            assert record(store, claim_one(store), answer=b"{}", cpu_seconds=2.0)
            clock.advance(60)
    clock.advance(2 * DAY)
    recent = clock.now
    submit(store)
    assert record(store, claim_one(store), answer=b"{}", cpu_seconds=5.0)
    before = usage.read_figures(store)
    assert upkeep.purge(store, 30.0).usage_rows == 6
    after = usage.read_figures(store)
    assert (after.recorded_units, after.cpu_seconds) == (7, pytest.approx(17.0))
    assert (before.recorded_units, before.cpu_seconds) == (after.recorded_units, pytest.approx(after.cpu_seconds))
    assert usage.sum_cpu_seconds(store, "acme", recent - 3_600) == pytest.approx(5.0)
    assert usage.sum_cpu_seconds(store, "acme", 0.0) == pytest.approx(11.0)
    assert upkeep.purge(store, 30.0).usage_rows == 0


def test_the_commands_of_an_operator(call: Any, database_url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TAILSTACK_DATABASE", database_url)
    code, out, err = call("db", "check")
    assert code == 3, (out, err)
    assert "tailstack db migrate" in out + err or "none" in out
    code, out, err = call("db", "migrate")
    assert (code, out) == (0, "")
    assert f"created with schema version {schema.HEAD}" in err
    assert "already at" in call("db", "migrate")[2]
    code, out, err = call("db", "check")
    assert code == 0, (out, err)
    assert out.count("ok  ") == len(out.splitlines()) - 1
    assert out.endswith(": sound\n")
    with closing(connect(database_url)) as db:
        split(db, 2)
        execute(db, "UPDATE jobs SET units_done = 7")
    code, out, err = call("db", "check")
    assert code == 3
    assert "FAIL  units are counted right: not so: 0" in out
    password = database_url.split(":")[2].partition("@")[0] if "@" in database_url else None
    assert password is None or password not in out + err


# --- a long queue costs no more than a short one --------------------------------------------------


QUEUED = 1_500


@pytest.fixture
def long_queue(store: Database, clock: Clock) -> Database:
    """Fifteen hundred queued jobs of thirty tenants, and a job that runs."""
    first = submit(store)
    assert record(store, claim(store)[0], more=specs(300))
    for one in claim(store, limit=100):
        assert record(store, one, result=b"x" * 500)
    claim(store, limit=50)
    values = {name: getattr(find(store, first), name) for name in jobs.Job.__dataclass_fields__}
    values |= {"state": "queued", "started_at": None, "problem": None}
    rows = []
    for number in range(QUEUED):
        clock.advance(0.01)
        rows.append(values | {"id": new_job_id(clock.now), "tenant": f"t{number % 30}", "created_at": clock.now})
    with writing(store) as connection:
        connection.execute(tables.jobs.insert(), rows)
        connection.execute(tables.requests.insert(), [{"job_id": row["id"], "body": b'{"design":{}}'} for row in rows])
        fresh = [make_unit(row["id"], 0, ADVANCE, row["created_at"]) for row in rows]
        connection.execute(tables.units.insert(), fresh)
    if store.dialect == "postgresql":  # does it by itself, sooner or later; SQLite never does
        with writing(store) as connection:
            connection.exec_driver_sql("ANALYZE")
    return store


class Recorder:
    """What the functions of the store really send, and how the database means to find it."""

    def __init__(self, db: Database) -> None:
        self.db = db
        self.plans: dict[str, str] = {}
        sa.event.listen(db.engine, "before_cursor_execute", self.explain)

    def explain(self, connection: sa.Connection, cursor: object, statement: str, values: object, *_: object) -> None:
        many = isinstance(values, list)
        if many or not statement.startswith(("SELECT", "UPDATE", "DELETE")) or "pg_advisory" in statement:
            return
        inner = connection.connection.driver_connection
        assert inner is not None
        how = "EXPLAIN QUERY PLAN " if self.db.dialect == "sqlite" else "EXPLAIN "
        rows = inner.execute(how + statement, values).fetchall()
        self.plans[statement] = "\n".join(str(row[-1] if self.db.dialect == "sqlite" else row[0]) for row in rows)


def test_no_query_of_the_hot_path_walks_a_table(long_queue: Database, clock: Clock) -> None:
    db = long_queue
    recorder = Recorder(db)
    held = claim(db, limit=3)
    queue.renew(db, "w1", held, 15.0)
    assert record(db, held[0], more=specs(2))
    for _ in range(2):
        (one,) = claim(db)
        assert one.job_id == held[0].job_id
        assert record(db, one, result=b"x")
    (last,) = claim(db)
    assert len(last.results) == 2
    assert record(db, last, answer=b"{}")
    assert record(db, last, answer=b"{}")
    results.read_result(db, "t0", hashlib.sha256(b"{}").hexdigest())
    usage.sum_cpu_seconds(db, "t0", clock.now - 3600)
    queue.release(db, held[1], died=False)
    submit(db, tenant="t1")
    page = jobs.list_page(db, "t1", limit=20)
    jobs.list_page(db, "t1", limit=20, after=page.next)
    jobs.list_page(db, "t1", limit=20, state="queued")
    jobs.list_page(db, "t1", limit=20, kind="verification")
    events.read_events(db, "acme", held[0].job_id, 5, 100)
    jobs.cancel_job(db, "t1", page.jobs[5].id)
    assert len(recorder.plans) > 15
    for statement, plan in recorder.plans.items():
        if "FROM workers" in statement or "FROM usage" in statement:
            continue  # a handful of rows
        if db.dialect == "sqlite":
            # Only the few leases that have run out are sorted
            assert "TEMP B-TREE" not in plan or "units_leased" in plan, (statement, plan)
            scans = [line for line in plan.split("\n") if line.startswith("SCAN") and "CONSTANT ROW" not in line]
            # The queue itself is walked in its order, from its head
            assert all("USING INDEX units_ready" in line or "units_leased" in line for line in scans), (statement, plan)
        else:
            assert "Seq Scan on jobs" not in plan, (statement, plan)
            assert "Seq Scan on units" not in plan, (statement, plan)


@pytest.mark.long
def test_a_long_queue_is_served_in_order(long_queue: Database) -> None:
    seen = []
    while held := claim(long_queue, limit=500, lease_seconds=1e6):
        seen += [one.job_id for one in held if one.spec == ADVANCE]
    assert len(seen) == QUEUED
    assert seen == sorted(seen)

"""A long queue costs no more than a short one: every query of the hot path walks an index, and does not sort.

No clock is looked at here; ``./run bench`` has the times.
"""

from __future__ import annotations

import hashlib

import pytest
import sqlalchemy as sa
from store_scenes import Clock, claim, find, record, specs, submit

from tailstack_service.jobs.store import events, jobs, queue, results, tables, usage
from tailstack_service.jobs.store.database import Database, writing
from tailstack_service.jobs.store.queue import make_unit
from tailstack_service.jobs.store.tables import new_job_id
from tailstack_service.processes.task import ADVANCE

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

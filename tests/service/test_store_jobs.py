"""Jobs as their tenant sees them, on SQLite and on PostgreSQL."""

from __future__ import annotations

import hashlib
import re
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier
from typing import Any

import pytest
from store_scenes import PROBLEM, Clock, claim_one, find, finish, record, split, submit

from tailstack_service.jobs.store import events, jobs, results
from tailstack_service.jobs.store.database import Database
from tailstack_service.jobs.store.jobs import Job
from tailstack_service.problems import IdempotencyConflict, QueueFull
from waiting import LIMIT_SECONDS


def told(db: Database, job: Job, after: int = 0) -> list[tuple[int, str, dict[str, object]]]:
    return [
        (event.sequence, event.name, event.data) for event in events.read_events(db, job.tenant, job.id, after, 1000)
    ]


def test_a_new_job_is_queued_and_holds_its_request(store: Database, clock: Clock) -> None:
    request = b'{"design":{"name":"a"},"seed":1}'
    job, new = jobs.submit_job(
        store, tenant="acme", kind="sweep", request=request, design_name="a\0b\ud800", solver_version="1.2.3",
        request_id="r-7", max_queued=10,
    )  # fmt: skip
    assert new
    assert (job.state, job.kind, job.tenant, job.generation, job.last_event) == ("queued", "sweep", "acme", 1, 1)
    assert (job.units_done, job.units_expected, job.cpu_seconds, job.note) == (0, 1, 0.0, "")
    assert (job.created_at, job.started_at, job.finished_at) == (clock.now, None, None)
    assert (job.solver_version, job.request_id) == ("1.2.3", "r-7")
    assert job.request_sha256 == hashlib.sha256(request).hexdigest()
    assert job.design_name == "a\ufffdb?"  # neither NUL nor a lone surrogate can be stored everywhere
    assert find(store, job) == job
    assert told(store, job) == [(1, "state", {"state": "queued"})]
    assert claim_one(store).request == request


def test_ids_sort_by_time_and_differ_within_a_moment(store: Database, clock: Clock) -> None:
    ids = []
    for _ in range(5):
        ids.append(submit(store).id)
        clock.advance(0.002)
    assert ids == sorted(ids)
    same = {submit(store).id for _ in range(20)}
    assert len(same) == 20
    assert all(re.fullmatch("[0-9a-z]{26}", job_id) for job_id in same)
    assert len({job_id[:10] for job_id in same}) == 1  # the time
    assert len({job_id[10:] for job_id in same}) == 20  # 80 random bits


@pytest.mark.parametrize(
    "job_id", ["", "x", "0" * 25, "0" * 27, "8" + "0" * 25, "\0" * 26, "'; DROP TABLE jobs", "é" * 26]
)
def test_what_cannot_be_an_id_is_not_found(store: Database, job_id: str) -> None:
    assert jobs.find_job(store, "acme", job_id) is None
    assert jobs.cancel_job(store, "acme", job_id) is None
    assert events.read_events(store, "acme", job_id, 0, 10) == []


def test_equal_answers_are_kept_once_and_belong_to_whoever_has_a_job_with_them(store: Database, clock: Clock) -> None:
    mine, theirs = submit(store), submit(store, tenant="other")
    first = clock.now
    finish(store, b'{"same":true}')
    clock.advance(100)
    name = hashlib.sha256(b'{"same":true}').hexdigest()
    for job in (mine, theirs):
        assert find(store, job).result_sha256 == name
        found = results.read_result(store, job.tenant, name)
        assert found == results.StoredResult(name, "verification", b'{"same":true}', first)
    for absent in ("", "0" * 64, name.upper(), name[:-1], "\0" * 64):
        assert results.read_result(store, "acme", absent) is None


def test_the_same_key_and_request_is_the_same_job(store: Database) -> None:
    first = submit(store, idempotency_key="k", request_id="one")
    again, new = jobs.submit_job(
        store, tenant="acme", kind="verification", request=b'{"design":{}}', design_name="carrier",
        solver_version="1.0", request_id="two", idempotency_key="k", max_queued=1,
    )  # fmt: skip
    assert (again, new) == (first, False)  # although the queue is full
    assert submit(store, tenant="other", idempotency_key="k").id != first.id
    assert submit(store, idempotency_key=None).id != submit(store, idempotency_key=None).id
    finish(store)
    assert submit(store, idempotency_key="k").id == first.id  # also once it has finished


@pytest.mark.parametrize("changes", [{"request": b'{"design":{"a":1}}'}, {"kind": "optimisation"}])
def test_the_same_key_with_another_request_is_refused(store: Database, changes: dict[str, Any]) -> None:
    first = submit(store, idempotency_key="k")
    with pytest.raises(IdempotencyConflict, match=first.id):
        submit(store, idempotency_key="k", **changes)
    assert [job.id for job in jobs.list_page(store, "acme", limit=10).jobs] == [first.id]


def test_equal_submissions_at_the_same_moment_make_one_job(store: Database) -> None:
    crowd = 8
    barrier = Barrier(crowd)

    def post(number: int) -> tuple[str, bool]:
        barrier.wait(LIMIT_SECONDS)
        job, new = jobs.submit_job(
            store, tenant="acme", kind="sweep", request=b"{}", design_name="d", solver_version="1.0",
            request_id=str(number), idempotency_key="same", max_queued=100,
        )  # fmt: skip
        return job.id, new

    with ThreadPoolExecutor(crowd) as pool:
        made = list(pool.map(post, range(crowd)))
    assert len({job_id for job_id, _ in made}) == 1
    assert sum(new for _, new in made) == 1
    assert len(jobs.list_page(store, "acme", limit=10).jobs) == 1


def test_the_queue_of_a_tenant_is_bounded_exactly(store: Database) -> None:
    def post(number: int) -> bool:
        try:
            submit(store, max_queued=5)
        except QueueFull:
            return False
        return True

    with ThreadPoolExecutor(8) as pool:
        assert sum(pool.map(post, range(12))) == 5
    assert submit(store, tenant="other", max_queued=5)
    with pytest.raises(QueueFull, match="at most 5"):
        submit(store, max_queued=5)
    first = jobs.list_page(store, "acme", limit=1).jobs[0]
    jobs.cancel_job(store, "acme", first.id)
    assert submit(store, max_queued=5)


def test_pages_stay_whole_while_jobs_come_in(store: Database, clock: Clock) -> None:
    made = []
    for number in range(25):
        clock.advance(0.01)
        made.append(submit(store, kind=("sweep", "gate")[number % 2]).id)
    expected = made[::-1]
    seen, cursor = [], None
    while True:
        page = jobs.list_page(store, "acme", after=cursor, limit=10)
        seen += [job.id for job in page.jobs]
        clock.advance(0.01)
        submit(store)  # comes in front of what was read already
        cursor = page.next
        if cursor is None:
            break
    assert seen == expected
    assert [job.id for job in jobs.list_page(store, "acme", kind="gate", limit=100).jobs] == made[1::2][::-1]


def test_pages_by_state(store: Database, clock: Clock) -> None:
    made = []
    for _ in range(4):
        clock.advance(1)
        made.append(submit(store))
    jobs.cancel_job(store, "acme", made[1].id)
    held = claim_one(store)
    assert held.job_id == made[0].id
    by_state = {
        state: [job.id for job in jobs.list_page(store, "acme", state=state, limit=10).jobs]
        for state in ("queued", "running", "cancelled", "succeeded")
    }
    assert by_state == {
        "queued": [made[3].id, made[2].id], "running": [made[0].id], "cancelled": [made[1].id], "succeeded": [],
    }  # fmt: skip
    exact = jobs.list_page(store, "acme", limit=4)
    assert (len(exact.jobs), exact.next) == (4, None)


@pytest.mark.parametrize("cursor", ["", "x", "é", "MDAw", "!!!!", "A" * 1000])
def test_a_cursor_of_somebody_elses_making_is_refused(store: Database, cursor: str) -> None:
    with pytest.raises(ValueError, match="cursor"):
        jobs.list_page(store, "acme", after=cursor, limit=10)


def test_cancelling_takes_effect_at_once_and_once(store: Database, clock: Clock) -> None:
    job = split(store, 3)
    held = claim_one(store)
    clock.advance(2)
    cancelled = jobs.cancel_job(store, "acme", job.id)
    assert cancelled == find(store, job)
    assert (cancelled.state, cancelled.finished_at, cancelled.is_over) == ("cancelled", clock.now, True)
    assert not record(store, held, result=b"late")
    assert jobs.cancel_job(store, "acme", job.id) == cancelled
    assert told(store, job)[-1] == (cancelled.last_event, "state", {"state": "cancelled"})
    finish(store)
    assert find(store, job) == cancelled


def test_a_finished_job_is_not_cancelled(store: Database) -> None:
    job = submit(store)
    finish(store)
    done = find(store, job)
    assert jobs.cancel_job(store, "acme", job.id) == done
    assert done.state == "succeeded"


def test_events_tell_the_whole_story_and_resume_anywhere(store: Database, clock: Clock) -> None:
    job = submit(store)
    clock.advance(10)
    assert record(store, claim_one(store), more=(b'{"a":1}', b'{"a":2}'), remaining=4, note="two shards")
    clock.advance(10)
    assert record(store, claim_one(store), result=b"1")
    clock.advance(10)
    assert record(store, claim_one(store), result=b"2")
    assert record(store, claim_one(store), answer=b"{}")
    name = hashlib.sha256(b"{}").hexdigest()
    # Begun at second 10; 2 of 1 + 2 + 4 + 1 units after 10 s, 3 of them after 20 s
    expected = [
        (1, "state", {"state": "queued"}),
        (2, "state", {"state": "running"}),
        (3, "progress", {"units_done": 1, "units_expected": 8, "note": "two shards", "eta_seconds": None}),
        (4, "progress", {"units_done": 2, "units_expected": 8, "note": "two shards", "eta_seconds": 30.0}),
        (5, "progress", {"units_done": 3, "units_expected": 8, "note": "two shards", "eta_seconds": 33.333}),
        (6, "state", {"state": "succeeded", "result_sha256": name}),
    ]
    assert told(store, job) == expected
    for sequence in range(7):
        assert told(store, job, sequence) == expected[sequence:]
    assert len(events.read_events(store, "acme", job.id, 1, 2)) == 2
    assert find(store, job).last_event == 6


def test_a_refused_job_carries_its_problem(store: Database) -> None:
    job = submit(store)
    assert record(store, claim_one(store), problem=PROBLEM)
    failed = find(store, job)
    assert (failed.state, failed.result_sha256) == ("failed", None)
    assert failed.problem is not None
    assert failed.problem["type"] == "/v1/problems/infeasible"
    assert told(store, job)[-1][2] == {"state": "failed", "problem": failed.problem}

"""Jobs and their units in the store: what is submitted, claimed, recorded, listed and cancelled."""

from __future__ import annotations

import hashlib
import json
import re
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier
from typing import Any

import pytest
import store_scenes
from store_scenes import LEASE, PROBLEM, Clock, claim, claim_one, find, finish, record, specs, split, split_each, submit

from tailstack_service.jobs.store import events, jobs, queue, results, usage, workers
from tailstack_service.jobs.store.database import Database
from tailstack_service.jobs.store.jobs import Job
from tailstack_service.problems import QueueFull
from tailstack_service.processes.task import ADVANCE, Outcome, UnitResult
from waiting import LIMIT_SECONDS


def told(db: Database, job: Job, after: int = 0) -> list[tuple[int, str, dict[str, object]]]:
    return [
        (event.sequence, event.name, event.data) for event in events.read_events(db, job.tenant, job.id, after, 1000)
    ]


def test_a_new_job_is_queued_and_holds_its_request(store: Database, clock: Clock) -> None:
    request = b'{"design":{"name":"a"},"seed":1}'
    named = {"kind": "sweep", "design_name": "a\0b\ud800", "solver_version": "1.2.3", "request_id": "r-7"}
    job, new = store_scenes.submit_or_find(store, request, **named)
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
    again, new = store_scenes.submit_or_find(store, request_id="two", idempotency_key="k", max_queued=1)
    assert (again, new) == (first, False)  # although the queue is full
    assert submit(store, tenant="other", idempotency_key="k").id != first.id
    assert submit(store, idempotency_key=None).id != submit(store, idempotency_key=None).id
    finish(store)
    assert submit(store, idempotency_key="k").id == first.id  # also once it has finished


def test_equal_submissions_at_the_same_moment_make_one_job(store: Database) -> None:
    crowd = 8
    barrier = Barrier(crowd)

    def post(number: int) -> tuple[str, bool]:
        barrier.wait(LIMIT_SECONDS)
        job, new = store_scenes.submit_or_find(store, request_id=str(number), idempotency_key="same")
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


def test_events_tell_the_whole_story_and_resume_anywhere(store: Database, clock: Clock) -> None:
    job = submit(store, kind="optimisation", request_id="r-9")
    clock.advance(10)
    first = claim_one(store)
    assert (first.kind, first.request_id, first.tenant, first.results) == ("optimisation", "r-9", "acme", ())
    assert record(store, first, more=(b'{"a":1}', b'{"a":2}'), remaining=4, note="two shards", cpu_seconds=0.25)
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
    done = find(store, job)
    assert (done.last_event, done.units_done, done.units_expected) == (6, 4, 4)
    assert (done.started_at, done.finished_at) == (clock.now - 20, clock.now)
    assert done.cpu_seconds == pytest.approx(0.25 + 3 * 0.5, abs=1e-12)
    kept = results.read_result(store, "acme", name)
    assert kept is not None
    assert (kept.body, kept.schema_name) == (b"{}", "optimisation")


def test_a_refused_job_carries_its_problem(store: Database) -> None:
    job = submit(store)
    assert record(store, claim_one(store), problem=PROBLEM)
    failed = find(store, job)
    assert store_scenes.problem_of(failed)["type"] == "/v1/problems/infeasible"
    assert failed.result_sha256 is None
    assert told(store, job)[-1][2] == {"state": "failed", "problem": failed.problem}


# --- units in the hands of workers: what is claimed when, what may be recorded, when a job ends ----


def test_the_last_of_many_recorded_side_by_side_makes_exactly_one_advance(store: Database) -> None:
    for _ in range(5):
        job = split(store, 8)
        held = claim(store, limit=8)
        with ThreadPoolExecutor(8) as pool:
            assert all(pool.map(lambda one: record(store, one, result=b"x"), held))
        advances = [row for row in store_scenes.unit_rows(store, job) if row.advance]
        assert [row.number for row in advances] == [0, 9]
        assert [len(one.results) for one in claim(store, limit=9)] == [8]


def test_units_of_one_job_are_recorded_together_each_only_where_it_is_still_held(store: Database, clock: Clock) -> None:
    """Written together or one by one, the job is told the same; a second time changes nothing."""

    def state(of: Job) -> tuple[object, ...]:
        found = find(store, of)
        rows = [(row.number, row.advance, row.state) for row in store_scenes.unit_rows(store, of)]
        return found.state, found.units_done, found.cpu_seconds, rows, [each[1:] for each in told(store, of)]

    ended: list[tuple[Any, ...]] = []
    for together in (True, False):
        job = split(store, 3)
        first, lost, last = claim(store, limit=3)
        queue.release(store, lost, died=False)
        again = claim_one(store, "w2")
        assert again.index == lost.index
        outcome = Outcome(cpu_seconds=0.5, result=b"x")
        endings = [(one, outcome) for one in (first, lost, last)]
        for _ in range(2):
            groups = [endings] if together else [[each] for each in endings]
            written = [each for group in groups for each in queue.record(store, group, max_job_seconds=3600.0)]
            assert written == [True, False, True]
        assert (find(store, job).units_done, find(store, job).cpu_seconds) == (3, 1.5)
        assert queue.record(store, [(again, outcome)], max_job_seconds=3600.0) == [True]
        ended.append(state(job))
        finish(store)
    assert ended[0] == ended[1]
    assert ended[0][3][-1] == (4, True, "ready")


def test_one_outcome_that_cannot_be_leaves_all_of_them_unwritten(store: Database) -> None:
    job = split(store, 2)
    first, last = claim(store, limit=2)
    before = find(store, job)
    endings = [(first, Outcome(cpu_seconds=0.5, result=b"x")), (last, Outcome(cpu_seconds=0.5))]
    with pytest.raises(ValueError, match=job.id):
        queue.record(store, endings, max_job_seconds=3600.0)
    assert find(store, job) == before


@pytest.mark.parametrize(
    ("advance", "outcome"),
    [
        (True, {"result": b"x"}),
        (True, {}),
        (True, {"more": (b"a",), "answer": b"{}"}),
        (False, {"more": (b"a",)}),
        (False, {"answer": b"{}"}),
        (False, {"result": b"x", "problem": PROBLEM}),
    ],
)
def test_an_outcome_that_the_unit_cannot_have_is_a_defect(
    store: Database, advance: bool, outcome: dict[str, Any]
) -> None:
    job = submit(store) if advance else split(store, 1)
    held = claim_one(store)
    before = find(store, job)
    with pytest.raises(ValueError, match=job.id):
        record(store, held, **outcome)
    assert find(store, job) == before


def test_an_empty_result_is_a_result_and_who_asks_for_none_gets_none(store: Database) -> None:
    split(store, 1)
    assert claim(store, limit=0) == []
    assert record(store, claim_one(store), result=b"")
    assert claim_one(store).results == (UnitResult(1, b'{"unit":1}', b""),)


def test_a_unit_that_kills_its_processes_ends_the_job(store: Database) -> None:
    job = split(store, 3)
    for deaths in range(1, 4):
        held = claim_one(store, max_deaths=3)
        assert (held.index, held.deaths) == (1, deaths - 1)
        queue.release(store, held, died=True)
        assert find(store, job).state == ("running" if deaths < 3 else "failed")
    problem = store_scenes.problem_of(find(store, job))
    assert problem["type"] == "/v1/problems/unit-lost"
    assert "3 times" in problem["detail"]
    assert "3 computing processes" in problem["detail"]
    assert told(store, job)[-1][1] == "state"
    assert [row.number for row in store_scenes.unit_rows(store, job)] == [0]  # only what was recorded
    assert claim(store, limit=9) == []


def test_a_unit_that_takes_whole_workers_with_it_ends_the_job(store: Database, clock: Clock) -> None:
    """Nobody lives to tell: the leases run out, and the attempts are counted."""
    job = split(store, 2)
    for attempt in range(1, 5):
        held = claim(store, f"w{attempt}", limit=9, max_attempts=4)
        assert [(one.index, one.attempts) for one in held] == [(1, attempt), (2, attempt)]
        clock.advance(LEASE + 1)
    assert find(store, job).state == "running"
    bystander = submit(store)
    assert [held.job_id for held in claim(store, "w5", limit=9, max_attempts=4)] == [bystander.id]
    problem = store_scenes.problem_of(find(store, job))
    assert problem["type"] == "/v1/problems/unit-lost"
    assert "4 times" in problem["detail"]
    assert [row.number for row in store_scenes.unit_rows(store, job)] == [0]


def test_giving_back_the_last_attempt_ends_the_job(store: Database) -> None:
    job = split(store, 1)
    for _ in range(2):
        queue.release(store, claim_one(store, max_attempts=2), died=False)
    assert find(store, job).state == "failed"


def test_a_job_that_takes_too_long_fails_but_an_answer_counts(store: Database, clock: Clock) -> None:
    slow, quick = split_each(store, clock, 2, 1)
    one, two, three = claim(store, limit=3)
    assert (one.job_id, three.job_id) == (slow.id, quick.id)
    assert record(store, one, result=b"x", cpu_seconds=9.0, max_job_seconds=10.0)
    assert record(store, two, result=b"x", cpu_seconds=0.6, max_job_seconds=10.0)
    failed = find(store, slow)
    assert failed.cpu_seconds == pytest.approx(0.5 + 9.0 + 0.6)
    assert store_scenes.problem_of(failed)["type"] == "/v1/problems/limit-exceeded"
    assert "10 CPU seconds" in store_scenes.problem_of(failed)["detail"]
    assert record(store, three, result=b"x", max_job_seconds=10.0)
    assert record(store, claim_one(store), answer=b"{}", cpu_seconds=11.0, max_job_seconds=10.0)
    assert find(store, quick).state == "succeeded"


def test_cpu_seconds_are_counted_by_tenant_and_minute(store: Database, clock: Clock) -> None:
    begun = clock.now
    for tenant, seconds in (("other", 4.0), ("acme", 1.5)):
        submit(store, tenant=tenant)
        assert record(store, claim_one(store), more=specs(1), cpu_seconds=seconds)
        assert record(store, claim_one(store), result=b"", cpu_seconds=seconds)
        if tenant == "other":
            assert record(store, claim_one(store), answer=b"{}", cpu_seconds=0.0)
    clock.advance(120)
    assert record(store, claim_one(store), answer=b"{}", cpu_seconds=10.0)
    assert usage.sum_cpu_seconds(store, "acme", begun) == pytest.approx(13.0)
    assert usage.sum_cpu_seconds(store, "acme", clock.now) == pytest.approx(10.0)
    assert usage.sum_cpu_seconds(store, "acme", clock.now + 60) == 0.0
    assert usage.sum_cpu_seconds(store, "other", begun) == pytest.approx(8.0)
    assert usage.sum_cpu_seconds(store, "nobody", 0.0) == 0.0


def test_a_small_job_is_not_stuck_behind_a_large_one_of_the_same_age(store: Database, clock: Clock) -> None:
    large, small = split_each(store, clock, 500, 5)
    served = []
    while find(store, small).state != "succeeded":
        held = claim_one(store)
        served.append(held.job_id)
        if held.spec == ADVANCE:
            assert record(store, held, answer=b"{}")
        else:
            assert record(store, held, result=b"x")
    # Units 1 to 16 keep the large job's place, those of the small job follow, and its answer
    assert served.count(large.id) <= 16
    assert served.count(small.id) == 6
    # ... and the large job is not starved by small ones that keep coming: its place does not move
    clock.advance(10 * 500)
    submit(store)
    assert claim_one(store).job_id == large.id


def test_a_large_job_is_advanced_before_younger_ones_are_begun(store: Database, clock: Clock) -> None:
    large = split(store, 40)
    for held in claim(store, limit=40):
        assert record(store, held, result=b"x")
    clock.advance(1)
    submit(store)
    held = claim_one(store)
    assert (held.job_id, held.spec) == (large.id, ADVANCE)


def test_a_queued_job_of_another_version_says_that_it_changed_hands(store: Database) -> None:
    job = submit(store)
    claim_one(store, solver_version="2.0")
    assert [(name, data) for _, name, data in told(store, job)] == [
        ("state", {"state": "queued"}),
        ("recomputed", {"from": "1.0", "to": "2.0"}),
        ("state", {"state": "running"}),
    ]


def test_workers_are_listed_until_they_say_goodbye(store: Database, clock: Clock) -> None:
    workers.report_alive(store, "w1", "alpha", 11, "1.0", "pool", 4)
    clock.advance(5)
    workers.report_alive(store, "w2", "beta", 22, "1.0", "dask", 16)
    clock.advance(5)
    workers.report_alive(store, "w1", "alpha", 11, "1.0", "pool", 4)
    begun = clock.now - 10
    assert workers.list_workers(store) == [
        workers.WorkerEntry("w1", "alpha", 11, "1.0", "pool", 4, begun, begun + 10),
        workers.WorkerEntry("w2", "beta", 22, "1.0", "dask", 16, begun + 5, begun + 5),
    ]
    workers.remove_worker(store, "w1")
    assert [worker.id for worker in workers.list_workers(store)] == ["w2"]


def test_figures_count_everything(store: Database, clock: Clock) -> None:
    workers.report_alive(store, "silent", "host", 1, "1.0", "pool", 2)
    clock.advance(53)  # and 7: a worker that was not seen for a whole minute counts as gone
    workers.report_alive(store, "w1", "host", 1, "1.0", "pool", 2)
    job = split(store, 4)
    claim(store, limit=1)
    submit(store)
    jobs.cancel_job(store, "acme", submit(store).id)
    clock.advance(7)
    submit(store)
    seen = usage.read_figures(store)
    assert seen.jobs == {"queued": 2, "running": 1, "succeeded": 0, "failed": 0, "cancelled": 1}
    assert (seen.ready_units, seen.leased_units, seen.recorded_units, seen.live_workers) == (5, 1, 1, 1)
    assert (seen.oldest_ready_seconds, seen.cpu_seconds) == (pytest.approx(7.0), pytest.approx(0.5))
    jobs.cancel_job(store, "acme", job.id)
    finish(store)
    assert usage.read_figures(store).oldest_ready_seconds == 0.0


def test_outcomes_with_odd_texts_can_be_told(store: Database) -> None:
    job = submit(store)
    assert record(store, claim_one(store), more=specs(1), note="a\0b\ud800")
    assert find(store, job).note == "a\ufffdb?"
    odd = json.dumps({"type": "/v1/problems/infeasible", "detail": "nul \0 and \ud800"}).encode()
    assert record(store, claim_one(store), problem=odd)
    assert store_scenes.problem_of(find(store, job))["detail"] == "nul \0 and \ud800"


# --- a clock that was ahead ----------------------------------------------------------------------


def test_a_lease_given_while_the_clock_was_ahead_does_not_stand_until_then(store: Database, clock: Clock) -> None:
    submit(store)
    clock.advance(7_200)
    held = claim_one(store, "w1")
    clock.advance(-7_200)
    again = claim_one(store, "w2")
    assert (again.job_id, again.token) == (held.job_id, held.token + 1)
    assert not record(store, held, more=specs(1))
    assert record(store, again, more=specs(1))


def test_a_clock_set_back_a_little_takes_nothing_from_who_computes(store: Database, clock: Clock) -> None:
    submit(store)
    held = claim_one(store, "w1")
    clock.advance(-0.5)
    assert claim(store, "w2") == []
    assert record(store, held, more=specs(1))


def test_a_worker_seen_in_the_future_is_not_alive(store: Database, clock: Clock) -> None:
    submit(store, solver_version="0.9")
    clock.advance(7_200)
    workers.report_alive(store, "w1", "host", 1, "0.9", "pool", 1)
    clock.advance(-7_200)
    assert usage.read_figures(store).live_workers == 0
    assert claim_one(store, "w2").generation == 2  # begun anew: nobody of its version is there


def test_cpu_seconds_used_in_the_future_are_not_of_the_last_hour(store: Database, clock: Clock) -> None:
    split(store, 1)
    clock.advance(7_200)
    assert record(store, claim_one(store), result=b"r", cpu_seconds=100.0)
    clock.advance(-7_200)
    assert usage.sum_cpu_seconds(store, "acme", clock.now - 3_600) < 10.0

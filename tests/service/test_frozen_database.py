"""A database that stands still: its processes stopped by a signal.  Nobody waits for it longer than he may, readiness
says so, and everything goes on by itself when it wakes."""

from __future__ import annotations

import asyncio
import signal
import threading
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest
import strange_units
from postgres import Server
from served import served
from service_scenes import client_of, client_with, small_design
from store_scenes import submit
from worker_scenes import finished, prepared_database, worker_process
from worker_scenes import submit as submit_strange

from tailstack_service.http import service
from tailstack_service.jobs.store import database, jobs, schema, workers
from tailstack_service.jobs.store.database import Database
from tailstack_service.jobs.store.schema import open_database
from tailstack_service.problems import StoreUnavailable
from tailstack_service.settings import Settings
from waiting import LIMIT_SECONDS, in_event_loop, until


@pytest.mark.long
def test_a_transaction_gives_a_silent_server_up_and_the_next_one_works(
    postgres_server: Server, postgres_url: str
) -> None:
    schema.migrate_database(postgres_url)
    with closing(open_database(postgres_url)) as db:
        job = submit(db)
        for _ in range(2):  # with a connection of the pool, and without one
            with postgres_server.frozen():
                with pytest.raises(StoreUnavailable, match="did not answer within 1 s"):
                    submit(db.within(1.0))
                ending, asked = db.endable(), threading.Event()

                def ask(ending: Database, asked: threading.Event) -> object:
                    asked.set()
                    return jobs.find_job(ending, "acme", job.id)

                with ThreadPoolExecutor(1) as pool:
                    waiting = pool.submit(ask, ending, asked)
                    assert asked.wait(LIMIT_SECONDS)
                    ending.end_within(0.3)
                    with pytest.raises(StoreUnavailable):
                        waiting.result(LIMIT_SECONDS)
            assert jobs.find_job(db, "acme", job.id) == job


def ready(client: httpx.Client) -> tuple[int, str]:
    answer = client.get("/health/ready")
    return answer.status_code, answer.json()["status"]


@pytest.mark.long
def test_readiness_tells_of_a_frozen_server_and_the_service_goes_on_when_it_wakes(
    postgres_server: Server, postgres_url: str, tmp_path: Path
) -> None:
    schema.migrate_database(postgres_url)
    body = {"design": small_design(), "trials": 1000}
    with (
        served(tmp_path, TAILSTACK_DATABASE=postgres_url, TAILSTACK_LEASE_SECONDS="3") as service,
        client_of(service.url) as client,
        ThreadPoolExecutor(24) as pool,
    ):
        serve = next(p for p in psutil.Process().children() if p.cmdline()[-3:] == ["serve", "--port", "0"])
        accepted = client.post("/v1/verifications", json=body)
        assert accepted.status_code == 202, accepted.text
        with postgres_server.frozen():
            waiting = [pool.submit(client.get, "/v1/jobs") for _ in range(16)]  # more than there are readers
            for status, told in pool.map(ready, [client] * 5):
                assert (status, told) == (503, "no database")
            assert client.get("/health/live").status_code == 200
            assert client.post("/v1/scores", json={"design": small_design()}).status_code == 200
            for refused in waiting:
                response = refused.result(LIMIT_SECONDS)
                assert response.status_code == 503, response.text
                assert response.json()["type"] == "/v1/problems/store-unavailable"
            threads, files = serve.num_threads(), serve.num_fds()
            for _ in range(3):
                assert ready(client)[0] == 503
            assert serve.num_threads() <= threads
            assert serve.num_fds() <= files + 2
        until(lambda: ready(client)[0] == 200)
        assert len(client.get("/v1/jobs").json()["jobs"]) == 1
        job = accepted.headers["location"]
        until(lambda: client.get(job).json()["state"] == "succeeded")


@pytest.mark.long
def test_readiness_waits_for_nobody_who_waits(
    postgres_server: Server, postgres_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those who read wait for as long as the server stands still, in every thread that there is for them."""
    schema.migrate_database(postgres_url)
    monkeypatch.setattr(database, "CONNECTING_SECONDS", LIMIT_SECONDS)
    monkeypatch.setattr(service, "LOOK_SECONDS", 0.3)
    listing: list[bool] = []
    list_page = jobs.list_page

    def listed(*arguments: Any, **named: Any) -> Any:
        listing.append(True)
        return list_page(*arguments, **named)

    monkeypatch.setattr(jobs, "list_page", listed)
    with client_with(Settings(database=postgres_url)) as client, ThreadPoolExecutor(16) as pool:
        assert ready(client)[0] == 200
        with postgres_server.frozen():
            waiting = [pool.submit(client.get, "/v1/jobs") for _ in range(2 * service.THREADS)]
            until(lambda: len(listing) == service.THREADS, lambda: listing)
            for _ in range(3):
                assert ready(client) == (503, "no database")
            assert not any(each.done() for each in waiting)
        assert [each.result(LIMIT_SECONDS).status_code for each in waiting] == [200] * len(waiting)
        until(lambda: ready(client)[0] == 200)


@pytest.mark.long
def test_what_is_computed_while_the_database_stands_still_is_recorded_and_not_computed_again(
    postgres_server: Server, postgres_url: str, tmp_path: Path
) -> None:
    """Two workers with units in their hands; by the time the server wakes every lease has run out."""
    note, go = tmp_path / "note", tmp_path / "go"
    request = strange_units.request("wait", units=3, note=str(note), until=str(go))
    with prepared_database(postgres_url) as db, ExitStack() as stack:
        for name in ("one", "other"):
            stack.enter_context(worker_process(postgres_url, tmp_path / name))
        until(lambda: len(workers.list_workers(db)) == 2)
        made = submit_strange(db, request)
        until(lambda: len(strange_units.begun(note)) == 4)
        with postgres_server.frozen():
            go.touch()
            for name in ("one", "other"):  # by then no beat came through for longer than a lease
                until(lambda name=name: "leases are not prolonged" in (tmp_path / name).read_text())  # type: ignore[misc]
        ended = finished(db, made)
    assert ended.state == "succeeded"
    assert Counter(strange_units.units_begun(note)) == {0: 1, 1: 1, 2: 1}


@pytest.mark.long
def test_a_worker_stops_while_its_database_stands_still(
    postgres_server: Server, postgres_url: str, tmp_path: Path
) -> None:
    with prepared_database(postgres_url) as db, worker_process(postgres_url, tmp_path / "log") as worker:
        submit_strange(db, strange_units.request("wait"))
        until(lambda: "begun" in (tmp_path / "log").read_text())
        with postgres_server.frozen():
            until(lambda: "leases are not prolonged" in (tmp_path / "log").read_text())
            worker.send_signal(signal.SIGTERM)
            assert worker.wait(LIMIT_SECONDS) == 0  # while it stands still


@in_event_loop
async def test_calls_that_cannot_be_ended_are_not_waited_for_and_do_not_pile_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on a disk that hangs: the thread stays where it is until the disk answers."""
    monkeypatch.setattr(database, "BUSY_SECONDS", 0.3)
    monkeypatch.setattr(service, "LOOK_SECONDS", 0.2)
    monkeypatch.setattr(service, "LATE_SECONDS", 0.1)
    url, answers = f"sqlite:///{tmp_path / 'a.sqlite3'}", threading.Event()
    open_database(url, migrate=True).close()
    begun: list[int] = []

    def hang(_: object, number: int = -1) -> int:
        begun.append(number)
        answers.wait(LIMIT_SECONDS)
        return number

    kept = service.Storage(url)
    before = threading.active_count()
    looks = [kept.look(hang) for _ in range(5)]
    calls = [kept.run(hang, number) for number in range(40)] + [kept.write(hang, number) for number in range(40)]
    told = await asyncio.gather(*looks, *calls, return_exceptions=True)
    assert {type(each) for each in told} == {StoreUnavailable}
    assert threading.active_count() - before <= 2 * service.THREADS + 1
    assert len(begun) == 2 * service.THREADS + 1  # what nobody waits for any more is not begun
    answers.set()
    assert await kept.look(hang) == -1
    assert await kept.run(hang, 7) == 7
    kept.close()

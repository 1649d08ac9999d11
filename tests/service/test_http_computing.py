"""The short lane: bounded, stoppable; what is answered at once, and what a client meets when all places are taken."""

from __future__ import annotations

import asyncio
import socket
import sqlite3
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any, cast

import httpx
import pytest
from service_scenes import client_with, small_design
from starlette.requests import Request

from tailstack.errors import LimitError
from tailstack_service.http.computing import LEFT, Lane, Steps, Stopped, Watch
from tailstack_service.problems import TransportError
from tailstack_service.settings import Settings
from tailstack_service.store import database


class Connection:
    """Stands for a client that stays, or leaves."""

    def __init__(self, gone: bool = False) -> None:
        self.gone = gone
        self.scope = {"state": {LEFT: True} if gone else {}}

    async def is_disconnected(self) -> bool:
        return self.gone


def request(gone: bool = False) -> Request:
    return cast(Request, Connection(gone))


def watch(seconds: float = 60.0) -> Watch:
    return Watch(seconds, threading.Event())


def until_told(watch: Watch) -> None:
    """A computation that only its watch ends."""
    while True:
        watch()
        time.sleep(0.005)


def test_a_lane_computes_and_hands_errors_on() -> None:
    async def story() -> None:
        lane = Lane("score", 1, 0)
        assert await lane.run(request(), watch(), lambda: 42) == 42
        with pytest.raises(ZeroDivisionError):
            await lane.run(request(), watch(), lambda: 1 // 0)
        assert lane.taken == 0
        lane.close()

    asyncio.run(story())


def test_a_full_lane_refuses_and_recovers() -> None:
    async def story() -> None:
        lane, first, second = Lane("score", 1, 1), watch(), watch()
        running = [asyncio.create_task(lane.run(request(), w, lambda w=w: until_told(w))) for w in (first, second)]  # type: ignore[misc]
        await asyncio.sleep(0.05)
        with pytest.raises(TransportError) as refused:
            await lane.run(request(), watch(), lambda: 1)
        assert refused.value.slug == "busy"
        assert int(refused.value.headers["Retry-After"]) > 0
        first.unwanted = True
        second.unwanted = True
        assert all(isinstance(e, Stopped) for e in await asyncio.gather(*running, return_exceptions=True))
        assert await lane.run(request(), watch(), lambda: 1) == 1
        lane.close()

    asyncio.run(story())


def test_one_after_the_other_but_not_behind_a_long_one() -> None:
    """Short computations of a lane with two threads never overlap; behind one that goes on, the next starts."""

    async def story() -> None:
        lane, at_once, most = Lane("score", 2, 8), 0, 0

        def short() -> None:
            nonlocal at_once, most
            at_once += 1
            most = max(most, at_once)
            time.sleep(0.002)
            at_once -= 1

        await asyncio.gather(*(lane.run(request(), watch(), short) for _ in range(8)))
        assert most == 1
        long = watch()
        running = asyncio.create_task(lane.run(request(), long, lambda: until_told(long)))
        await asyncio.sleep(0)
        assert await asyncio.wait_for(lane.run(request(), watch(), lambda: 1), 5.0) == 1
        assert not running.done()
        long.unwanted = True
        with pytest.raises(Stopped):
            await running
        assert lane.taken == 0
        lane.close()

    asyncio.run(story())


def test_a_computation_nobody_waits_for_is_ended() -> None:
    async def story() -> None:
        lane, mine = Lane("score", 1, 0), watch()
        with pytest.raises(Stopped):
            await lane.run(request(gone=True), mine, lambda: until_told(mine))
        assert lane.taken == 0
        lane.close()

    asyncio.run(story())


def test_the_clock_starts_with_the_computation_and_ends_it() -> None:
    late = watch(0.05)
    time.sleep(0.06)
    late()  # still waiting for its place: no time is used up
    late.begin()
    with pytest.raises(LimitError, match="TAILSTACK_MAX_SECONDS"):
        until_told(late)


def test_stopping_ends_and_refuses() -> None:
    async def story() -> None:
        lane, stopping = Lane("score", 1, 0), threading.Event()
        mine = Watch(60.0, stopping)
        task = asyncio.create_task(lane.run(request(), mine, lambda: until_told(mine)))
        await asyncio.sleep(0.05)
        stopping.set()
        for waiting in (task, lane.run(request(), mine, lambda: None)):
            with pytest.raises(TransportError) as refused:
                await waiting
            assert refused.value.slug == "stopping"
        lane.close()

    asyncio.run(story())


# --- in steps ---------------------------------------------------------------------------------------


def in_steps(where: list[str], rests: int, seconds: float = 0.0) -> Steps[int]:
    """A computation that notes in which thread each of its steps runs."""
    for _ in range(rests):
        where.append(threading.current_thread().name)
        time.sleep(seconds)
        yield
    where.append(threading.current_thread().name)
    return rests


def test_quick_steps_run_on_the_loop_and_slow_ones_go_on_in_a_thread() -> None:
    async def story() -> None:
        lane, here = Lane("score", 1, 0), threading.current_thread().name
        where: list[str] = []
        assert await lane.run_steps(request(), watch(), in_steps(where, 5), 60.0) == 5
        assert where == [here] * 6
        where.clear()
        assert await lane.run_steps(request(), watch(), in_steps(where, 4, 0.02), 0.03) == 4
        assert where[:2] == [here, here]
        assert where[2:] == ["tailstack-score_0"] * 3
        where.clear()
        assert await lane.run_steps(request(), watch(), in_steps(where, 1), 0.0) == 1
        assert where == ["tailstack-score_0"] * 2
        assert lane.taken == 0
        lane.close()

    asyncio.run(story())


def test_the_loop_looks_at_its_connections_between_two_computations() -> None:
    """Whoever arrives while eight wait is seen before they are all done, and beyond the places there is a refusal."""

    async def story() -> None:
        lane, done, seen = Lane("score", 1, 7), 0, -1

        def arrived() -> None:
            nonlocal seen
            seen = done

        async def one() -> None:
            nonlocal done
            await lane.run_steps(request(), watch(), in_steps([], 1, 0.005), 60.0)
            done += 1

        running = [asyncio.create_task(one()) for _ in range(8)]
        await asyncio.sleep(0)
        with pytest.raises(TransportError, match="8 score computations are running or waiting"):
            await lane.run_steps(request(), watch(), in_steps([], 1), 60.0)
        near, far = socket.socketpair()
        with near, far:
            near.setblocking(False)
            asyncio.get_running_loop().add_reader(near, arrived)
            far.send(b".")
            await asyncio.sleep(0.006)
            asyncio.get_running_loop().remove_reader(near)
        await asyncio.gather(*running)
        assert 0 <= seen <= 3
        assert lane.taken == 0
        lane.close()

    asyncio.run(story())


def test_who_has_left_while_he_waited_is_not_computed_for() -> None:
    async def story() -> None:
        lane, where = Lane("score", 1, 5), list[str]()
        first = asyncio.create_task(lane.run_steps(request(), watch(), in_steps([], 3, 0.005), 60.0))
        await asyncio.sleep(0)
        with pytest.raises(Stopped):
            await lane.run_steps(request(gone=True), watch(), in_steps(where, 1), 60.0)
        assert await first == 3
        assert where == []
        assert lane.taken == 0
        lane.close()

    asyncio.run(story())


def test_steps_on_the_loop_end_as_those_of_a_thread_do() -> None:
    """At an error, late, or when the service stops; the place is free again each time."""

    def failing() -> Steps[int]:
        yield
        return 1 // 0

    async def story() -> None:
        lane, stopping = Lane("score", 1, 0), threading.Event()
        with pytest.raises(ZeroDivisionError):
            await lane.run_steps(request(), watch(), failing(), 60.0)
        with pytest.raises(LimitError, match="TAILSTACK_MAX_SECONDS"):
            await lane.run_steps(request(), watch(0.02), in_steps([], 100, 0.005), 60.0)

        def told_to_stop() -> Steps[int]:
            stopping.set()
            yield
            raise AssertionError("it was told to stop")

        with pytest.raises(TransportError) as refused:
            await lane.run_steps(request(), Watch(60.0, stopping), told_to_stop(), 60.0)
        assert refused.value.slug == "stopping"
        assert lane.taken == 0
        lane.close()

    asyncio.run(story())


# --- over HTTP ------------------------------------------------------------------------------------


def test_many_scores_at_once_are_all_answered_alike() -> None:
    body = {"design": small_design()}

    def post(client: httpx.Client) -> Any:
        response = client.post("/v1/scores", json=body)
        assert response.status_code == 200, response.text
        return response.json()

    with client_with(Settings(max_waiting=100)) as client, ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(post, [client] * 40))
    assert all(answer == answers[0] for answer in answers)


def test_yaml_and_json_designs_score_alike() -> None:
    from tailstack.design.loading import data_to_yaml

    with client_with() as client:
        by_json = client.post("/v1/scores", json={"design": small_design(), "second_order": True}).json()
        text = data_to_yaml(small_design())
        yaml = {"Content-Type": "application/yaml"}
        by_yaml = client.post("/v1/scores?second_order=true", content=text, headers=yaml).json()
    assert by_yaml == by_json


def test_a_writer_that_is_stopped_keeps_nobody_from_reading(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(database, "BUSY_SECONDS", 2.0)
    path, body = tmp_path / "jobs.sqlite3", {"design": small_design(), "trials": 1000}
    with client_with(Settings(database=f"sqlite:///{path}")) as client, ThreadPoolExecutor(20) as pool:
        assert client.post("/v1/verifications", json=body).status_code == 202
        with sqlite3.connect(path, isolation_level=None) as other:
            other.execute("BEGIN IMMEDIATE")
            began = time.monotonic()
            waiting = [pool.submit(client.post, "/v1/verifications", json=body) for _ in range(12)]
            time.sleep(0.3)
            assert len(client.get("/v1/jobs").json()["jobs"]) == 1
            assert client.get("/health/ready").status_code == 200
            assert time.monotonic() - began < 1.5
            for refused in waiting:
                response = refused.result(timeout=30)
                assert response.status_code == 503, response.text
                assert response.json()["type"] == "/v1/problems/store-unavailable"
                assert int(response.headers["retry-after"]) > 0
            assert time.monotonic() - began < 10
            other.execute("ROLLBACK")
        other.close()
        assert client.post("/v1/verifications", json=body).status_code == 202


def test_scores_need_no_database(tmp_path: Any) -> None:
    """The directory of the database is gone: scores are answered, jobs are refused for a while."""
    settings = Settings(database=f"sqlite:///{tmp_path / 'jobs.sqlite3'}")
    with client_with(settings) as client:
        for path in tmp_path.iterdir():
            path.unlink()
        body = {"design": small_design()}
        assert client.post("/v1/scores", json=body).status_code == 200
        assert client.post("/v1/validations", json=body).status_code == 200
        refused = client.post("/v1/verifications", json=body)
        assert refused.status_code == 503, refused.text
        assert int(refused.headers["retry-after"]) > 0
        assert str(tmp_path) not in refused.text
        ready = client.get("/health/ready")
        assert (ready.status_code, ready.json()["status"]) == (503, "no database")

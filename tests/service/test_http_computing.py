"""Lanes: bounded, fair to each other, stoppable; and what a client meets when they are full."""

from __future__ import annotations

import asyncio
import threading
import time
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from typing import Any, cast

import httpx
import pytest
from service_scenes import check_problem, client_with, small_design
from starlette.requests import Request

from tailstack.errors import LimitError
from tailstack_service.http.computing import Lane, Stopped, Watch
from tailstack_service.problems import TransportError
from tailstack_service.settings import Settings

MANY = {"design": small_design(), "trials": 1_000_000_000}
ROOMY = Settings(max_trials=1_000_000_000, max_seconds=3.0, long_workers=1, max_waiting=0, threads=1)


class Connection:
    """Stands for a client that stays, or leaves."""

    def __init__(self, gone: bool = False) -> None:
        self.gone = gone

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
        first.unwanted.set()
        second.unwanted.set()
        assert all(isinstance(e, Stopped) for e in await asyncio.gather(*running, return_exceptions=True))
        assert await lane.run(request(), watch(), lambda: 1) == 1
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


def test_a_full_service_says_when_to_come_back_and_scores_are_not_held_up() -> None:
    scored = {"design": small_design()}
    with client_with(ROOMY) as client, ThreadPoolExecutor(2) as pool:
        client.post("/v1/scores", json=scored)  # kernels are compiled before anything is measured
        both = [pool.submit(client.post, "/v1/verifications", json=MANY) for _ in range(2)]
        done, running = wait(both, return_when=FIRST_COMPLETED)
        assert len(running) == 1
        refused, long = done.pop().result(), running.pop()
        check_problem(refused, 503, "busy")
        assert int(refused.headers["retry-after"]) > 0
        assert client.post("/v1/scores", json=scored).status_code == 200
        assert not long.done()
        check_problem(long.result(), 422, "limit-exceeded")


def test_one_seed_is_one_answer_over_http() -> None:
    body = {"design": small_design(), "trials": 3000, "seed": 5}
    with client_with() as client:
        first, second = (client.post("/v1/verifications", json=body) for _ in range(2))
        other = client.post("/v1/verifications", json={**body, "seed": 6})
    assert first.status_code == other.status_code == 200
    assert first.content == second.content
    assert first.json()["targets"] != other.json()["targets"]


def test_yaml_and_json_designs_score_alike() -> None:
    from tailstack.design.loading import data_to_yaml

    with client_with() as client:
        by_json = client.post("/v1/scores", json={"design": small_design(), "second_order": True}).json()
        text = data_to_yaml(small_design())
        yaml = {"Content-Type": "application/yaml"}
        by_yaml = client.post("/v1/scores?second_order=true", content=text, headers=yaml).json()
    assert by_yaml == by_json

"""Places to compute: processes that are killed when they have to be, and shared, so that nobody waits for the large
request of somebody else."""

from __future__ import annotations

import asyncio
import operator
import os
import sqlite3
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from functools import partial
from types import SimpleNamespace
from typing import Any, cast

import httpx
import psutil
import pytest
from service_scenes import Caller, client_with, small_design
from starlette.requests import Request

from tailstack.errors import LimitError
from tailstack_service.http import computations, places
from tailstack_service.http.places import CallerLeft, Places, Turns
from tailstack_service.jobs.store import database
from tailstack_service.operations import effort
from tailstack_service.operations.sent import Placed, Sent
from tailstack_service.problems import TransportError
from tailstack_service.processes import interpreter
from tailstack_service.processes.frames import Defect, Died
from tailstack_service.settings import Settings

QUICK, LONG = 0.0, 60.0  # seconds expected


def request(tenant: str = "a") -> Request:
    return Caller(tenant).request()


@asynccontextmanager
async def some(count: int = 2, waiting: int = 8, seconds: float = 60.0) -> AsyncIterator[Places]:
    made = Places(count, waiting, seconds, threading.Event())
    try:
        yield made
    finally:
        pids = made.pids()
        await made.close()
        assert not any(psutil.pid_exists(pid) for pid in pids)


def tell(story: Callable[[], Awaitable[None]]) -> None:
    async def told() -> None:
        await asyncio.wait_for(story(), 60)

    asyncio.run(told())


async def until(true: Callable[[], object], seconds: float = 20.0) -> None:
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline
        await asyncio.sleep(0.01)


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(places, "LOOK_SECONDS", 0.02)
    monkeypatch.setattr(places, "WORTH_SECONDS", 0.0)


def test_what_a_call_returns_refuses_or_breaks_arrives() -> None:
    async def story() -> None:
        async with some() as computing:
            assert await computing.run(request(), partial(operator.add, 40, 2), QUICK) == 42
            sent = Sent("json", b'{"design": {"schema": "tailstack/design/1"}}')
            with pytest.raises(Placed) as refused:
                await computing.run(request(), partial(computations.receive, "score", sent, Settings()), QUICK)
            assert (refused.value.error.slug, refused.value.prefix) == ("invalid-design", "/design")
            with pytest.raises(Defect, match="ZeroDivisionError"):
                await computing.run(request(), partial(operator.truediv, 1, 0), QUICK)
            assert await computing.run(request(), partial(operator.add, 1, 1), LONG) == 2

    tell(story)


def test_a_process_that_dies_under_a_call_is_replaced() -> None:
    async def story() -> None:
        async with some(1) as computing:
            with pytest.raises(Died, match="7"):
                await computing.run(request(), partial(os._exit, 7), QUICK)
            assert await computing.run(request(), partial(operator.add, 1, 1), QUICK) == 2

    tell(story)


def test_files_that_were_replaced_under_the_service_are_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is computed with some of the old sources and some of the new."""
    monkeypatch.setattr(interpreter, "digest_code", lambda: "of other sources")

    async def story() -> None:
        async with some(1) as computing:
            with pytest.raises(TransportError, match="were replaced") as refused:
                await computing.run(request(), os.getpid, QUICK)
            assert (refused.value.slug, computing.warmth) == ("stopping", "failed")

    tell(story)


@pytest.mark.long
def test_what_takes_longer_than_the_limit_is_killed(impatient: None) -> None:
    async def story() -> None:
        async with some(1, seconds=0.5) as computing:
            begun = time.monotonic()
            with pytest.raises(LimitError, match="TAILSTACK_MAX_SECONDS"):
                await computing.run(request(), partial(time.sleep, 60), LONG)
            assert time.monotonic() - begun < 10
            assert await computing.run(request(), os.getpid, QUICK) in computing.pids()

    tell(story)


@pytest.mark.long
def test_what_nobody_waits_for_any_more_is_killed(impatient: None) -> None:
    async def story() -> None:
        async with some(1) as computing:
            pid = await computing.run(request(), os.getpid, QUICK)
            leaving = Caller()
            running = asyncio.create_task(computing.run(leaving.request(), partial(time.sleep, 60), LONG))
            waiting = asyncio.create_task(computing.run(leaving.request(), partial(time.sleep, 60), LONG))
            await asyncio.sleep(0.1)
            leaving.gone = True
            for task in (running, waiting):
                with pytest.raises(CallerLeft):
                    await task
            await until(lambda: not psutil.pid_exists(pid))
            assert await computing.run(request(), partial(operator.add, 1, 1), LONG) == 2

    tell(story)


def test_what_has_just_begun_is_finished_for_who_left() -> None:
    """A new process costs more than what is left of it."""

    async def story() -> None:
        async with some(1) as computing:
            pid = await computing.run(request(), os.getpid, QUICK)
            await computing.run(Caller(gone=True).request(), partial(time.sleep, 0.4), QUICK)
            assert computing.pids() == [pid]

    tell(story)


@pytest.mark.long
def test_a_stop_ends_what_runs_and_what_waits() -> None:
    async def story() -> None:
        async with some(1) as computing:
            tasks = [asyncio.create_task(computing.run(request(), partial(time.sleep, 60), LONG)) for _ in range(3)]
            await asyncio.sleep(0.3)
            begun = time.monotonic()
            computing._stopping.set()
            for task in (*tasks, computing.run(request(), os.getpid, QUICK)):
                with pytest.raises(TransportError) as refused:
                    await task
                assert refused.value.slug == "stopping"
            assert time.monotonic() - begun < 5

    tell(story)


@pytest.mark.long
def test_something_quick_never_waits_for_something_long() -> None:
    """Of two processes long computations have one, however many wait, and quick ones have both."""

    async def story() -> None:
        async with some(2) as computing:
            long = [asyncio.create_task(computing.run(request(), partial(time.sleep, 60), LONG)) for _ in range(4)]
            await asyncio.sleep(0.1)
            for _ in range(3):
                assert await asyncio.wait_for(computing.run(request(), partial(operator.add, 1, 1), QUICK), 20) == 2
            assert not any(task.done() for task in long)
            for task in long:
                task.cancel()
            await asyncio.gather(*long, return_exceptions=True)
            at_once = [computing.run(request(), partial(time.sleep, 0.5), QUICK) for _ in range(2)]
            await asyncio.gather(*at_once)
            assert len(computing.pids()) == 2

    tell(story)


def test_tenants_take_turns() -> None:
    """One asks ten times before the other asks once: the other's comes after one of the ten."""

    async def story() -> None:
        async with some(1, waiting=20) as computing:
            ended: list[str] = []

            async def ask(tenant: str) -> None:
                await computing.run(request(tenant), partial(time.sleep, 0.02), QUICK)
                ended.append(tenant)

            greedy = [asyncio.create_task(ask("greedy")) for _ in range(10)]
            await asyncio.sleep(0)
            await asyncio.gather(*greedy, ask("other"))
            assert ended.index("other") <= 2

    tell(story)


def test_the_order_of_turns() -> None:
    turns = Turns()
    for name in ("a1", "a2", "a3", "b1", "c1", "b2"):
        turns.put(cast(Any, SimpleNamespace(tenant=name[0], name=name)))
    assert len(turns) == 6
    assert [cast(Any, turns.take()).name for _ in range(6)] == ["a1", "b1", "c1", "a2", "b2", "a3"]
    assert not turns


def test_who_fills_the_room_is_the_one_who_is_refused() -> None:
    async def story() -> None:
        async with some(1, waiting=3) as computing:
            asked = [asyncio.create_task(computing.run(request("a"), partial(time.sleep, 0.3), LONG)) for _ in range(4)]
            await asyncio.sleep(0.05)
            with pytest.raises(TransportError) as refused:
                await computing.run(request("a"), os.getpid, LONG)
            assert (refused.value.slug, refused.value.headers) == ("busy", {"Retry-After": "2"})
            assert "3 wait, the limit" in str(refused.value)
            assert await computing.run(request("b"), os.getpid, LONG) in computing.pids()
            ends = await asyncio.gather(*asked, return_exceptions=True)
            assert [isinstance(end, TransportError) for end in ends] == [False, False, False, True]

    tell(story)


@pytest.mark.long
def test_what_was_taken_for_quick_begins_anew_among_the_long_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """... and gives the place that is kept free back."""
    monkeypatch.setattr(places, "OVERRUN_SECONDS", 0.3)

    async def story() -> None:
        async with some(2) as computing:
            slow = [asyncio.create_task(computing.run(request(), partial(time.sleep, 1.5), QUICK)) for _ in range(2)]
            await asyncio.sleep(0.8)
            begun = time.monotonic()
            await computing.run(request(), partial(operator.add, 1, 1), QUICK)
            assert not any(task.done() for task in slow) or time.monotonic() - begun > 0.5
            await asyncio.gather(*slow)

    tell(story)


# --- how long something takes ---------------------------------------------------------------------


def sized(fiducials: int, views: int, targets: int) -> dict[str, Any]:
    design = small_design()
    point, view, target = design["fiducials"]["points"][0], design["views"][0], design["targets"][0]
    return {
        **design,
        "fiducials": {"points": [point] * fiducials},
        "views": [view] * views,
        "targets": [target] * targets,
    }


@pytest.mark.parametrize(
    ("size", "quick"),
    [
        ((8, 2, 1), True),
        ((24, 2, 2), True),
        ((12, 2, 5), True),
        ((200, 8, 1), False),
        ((8, 2, 50), False),
        ((200, 8, 200), False),
    ],
)
def test_size_says_what_is_quick(size: tuple[int, int, int], quick: bool) -> None:
    from tailstack.design.write import data_to_yaml

    design = sized(*size)
    for sent in (
        Sent("json", httpx.Request("POST", "http://x", json={"design": design}).content),
        Sent("yaml", data_to_yaml(design).encode()),
    ):
        assert effort.sizes_of(sent) == [size]
        assert (effort.score_seconds([size]) <= places.QUICK_SECONDS) == quick


def test_designs_of_a_gate_are_counted_and_what_is_odd_is_not_read() -> None:
    import json

    designs = [{"file": "a.yaml", "design": sized(8, 2, 1)}, {"file": "b.yaml", "text": json.dumps(sized(9, 2, 3))}]
    assert effort.sizes_of(Sent("json", json.dumps({"designs": designs}).encode())) == [(8, 2, 1), (12, 2, 12)]
    for body in (b"[]", b"", b"{", b"[" * 50_000, b'{"design": 3, "designs": {"a": 1}}', b"\xff"):
        assert effort.sizes_of(Sent("json", body)) == []
    assert effort.sizes_of(Sent("json", b" " * 200_000)) is None


# --- over HTTP ------------------------------------------------------------------------------------


@pytest.mark.long
def test_many_scores_at_once_are_all_answered_alike() -> None:
    body = {"design": small_design()}

    def post(client: httpx.Client) -> Any:
        response = client.post("/v1/scores", json=body)
        assert response.status_code == 200, response.text
        return response.json()

    with client_with(Settings(max_waiting=100)) as client, ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(post, [client] * 40))
    assert all(answer == answers[0] for answer in answers)


@pytest.mark.long
def test_yaml_and_json_designs_score_alike() -> None:
    from tailstack.design.write import data_to_yaml

    with client_with() as client:
        by_json = client.post("/v1/scores", json={"design": small_design(), "second_order": True}).json()
        text = data_to_yaml(small_design())
        yaml = {"Content-Type": "application/yaml"}
        by_yaml = client.post("/v1/scores?second_order=true", content=text, headers=yaml).json()
    assert by_yaml == by_json


@pytest.mark.long
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


@pytest.mark.long
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

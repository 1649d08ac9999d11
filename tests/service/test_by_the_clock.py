"""What waits and decides by time, by a clock that the test turns: retries, patience, what keeps a connection alive."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import threading
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import httpx
import pytest
from service_scenes import small_design
from store_scenes import submit

from family import die_with_parent
from tailstack_service.http import jobs
from tailstack_service.http.app import create_app
from tailstack_service.http.posting import FIRST_LOOK
from tailstack_service.http.server import FIRST_PAUSE, GOOD_SECONDS, RestartedProcess
from tailstack_service.http.service import Service
from tailstack_service.jobs.store import database
from tailstack_service.jobs.store.database import writing
from tailstack_service.jobs.store.schema import open_database
from tailstack_service.problems import StoreUnavailable
from tailstack_service.settings import Settings
from turned_clock import TurnedClock
from waiting import LIMIT_SECONDS, until

# --- a service --------------------------------------------------------------------------------------------


def test_a_process_that_ends_again_and_again_is_started_more_and_more_slowly() -> None:
    clock, started = TurnedClock(), []

    def start() -> subprocess.Popen[bytes]:
        started.append(subprocess.Popen(["sleep", "3600"], stdin=subprocess.PIPE, preexec_fn=die_with_parent))
        return started[-1]

    kept = RestartedProcess("worker", start, clock=clock)

    def until_started(count: int) -> None:
        until(lambda: len(started) == count and kept.pid == started[-1].pid)

    try:
        for number, pause in enumerate((FIRST_PAUSE, 2 * FIRST_PAUSE, 4 * FIRST_PAUSE), start=1):
            os.kill(started[-1].pid, signal.SIGKILL)
            clock.until_waits(pause)
            assert len(started) == number
            clock.turn(pause)
            until_started(number + 1)
        clock.turn(GOOD_SECONDS + 1.0)
        os.kill(started[-1].pid, signal.SIGKILL)
        clock.until_waits(FIRST_PAUSE)
    finally:
        kept.stop()
    assert len(started) == 4


async def test_a_stream_without_events_says_now_and_then_that_it_is_there() -> None:
    clock = TurnedClock(jumping=True)

    async def nothing(*_: object) -> list[Any]:
        return []

    service = SimpleNamespace(clock=clock, stopping=threading.Event(), storage=SimpleNamespace(run=nothing))
    job = SimpleNamespace(tenant="a", id="1")
    stream: AsyncIterator[bytes] = jobs._stream(cast(Service, service), cast(Any, job), 0)
    assert await anext(stream) == b"retry: 1000\n\n"
    for number in range(1, 4):
        assert await anext(stream) == b": still here\n\n"
        passed = number * jobs.HEARTBEAT_SECONDS
        assert passed < clock.passed < passed + number * (jobs.IDLE_SECONDS + jobs.LOOK_SECONDS)


@pytest.mark.long
async def test_who_waits_for_a_job_is_told_after_its_time_that_it_is_accepted(tmp_path: Path) -> None:
    clock, url = TurnedClock(), f"sqlite:///{tmp_path / 'jobs.sqlite3'}"
    open_database(url, migrate=True).close()
    app = create_app(Settings(database=url, body_seconds=20.0), warm_up=False, clock=clock)
    service: Service = app.state.service
    body, headers = {"design": small_design(), "trials": 1000}, {"Prefer": "respond-async, wait=10"}
    try:
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://localhost") as client:
            asking = asyncio.create_task(client.post("/v1/verifications", json=body, headers=headers))
            await clock.until_waits_async(FIRST_LOOK)
            assert not asking.done()
            clock.turn(10.0)
            answer = await asking
    finally:
        await service.pool.close()
        service.storage.close()
    assert answer.status_code == 202, answer.text
    assert answer.headers["preference-applied"] == "wait=10"
    assert answer.json()["state"] == "queued"


# --- the store ----------------------------------------------------------------------------------------------


def test_a_file_that_stays_locked_is_given_up_after_its_time(tmp_path: Path) -> None:
    clock = TurnedClock()
    url = f"sqlite:///{tmp_path / 'a.sqlite3'}"
    with (
        closing(open_database(url, migrate=True, clock=clock)) as here,
        closing(open_database(url)) as there,
        ThreadPoolExecutor(1) as pool,
    ):
        with writing(there):
            waiting = pool.submit(submit, here)
            until(lambda: clock.waits)
            clock.turn(database.BUSY_SECONDS - 0.01)
            looks = len(clock.waits)
            until(lambda: len(clock.waits) > looks)
            assert not waiting.done()
            clock.turn(0.02)
            with pytest.raises(StoreUnavailable, match="locked"):
                waiting.result(LIMIT_SECONDS)
        submit(here)

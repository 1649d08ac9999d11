"""Before the kernels are compiled: a request waits for a moment, then is told to come back; never for a minute."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
import threading
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import httpx
import pytest
from service_scenes import Caller, check_problem, small_design

from family import run_python
from tailstack_service.http.app import create_app
from tailstack_service.http.compute_pool import WARMTH_LOOK_SECONDS, ComputePool
from tailstack_service.http.service import Service
from tailstack_service.jobs.store.schema import open_database
from tailstack_service.processes.task import Died
from tailstack_service.settings import Settings
from turned_clock import TurnedClock
from waiting import LIMIT_SECONDS, until_async

BODY = {"design": small_design()}
GATE = {"designs": [{"file": "a.yaml", "design": small_design()}], "mode": "analytic"}
BEADS = {"format": "csv", "content": "label,x_mm,y_mm,z_mm\nF1,0,0,0\nF2,40,0,5\nF3,0,35,-10\n"}


def told(tmp_path: Path, seconds: float, story: Callable[[httpx.AsyncClient, Service], Awaitable[None]]) -> None:
    """Tell a story about a service that is warming up, whose clock stands still until the story turns it."""
    url = f"sqlite:///{tmp_path / 'jobs.sqlite3'}"
    open_database(url, migrate=True).close()
    app = create_app(Settings(database=url, warm_up_seconds=seconds), warm_up=False, clock=TurnedClock())
    service: Service = app.state.service
    service.pool.warmth = "warming up"

    async def tell() -> None:
        transport = httpx.ASGITransport(app)
        try:
            async with httpx.AsyncClient(
                transport=transport, base_url="http://localhost", timeout=LIMIT_SECONDS
            ) as client:
                await story(client, service)
        finally:
            await service.pool.close()
            service.storage.close()

    asyncio.run(tell())


async def asked(client: httpx.AsyncClient, service: Service, path: str, body: Any) -> asyncio.Task[httpx.Response]:
    """A request that waits for the kernels."""
    asking = asyncio.create_task(client.post(path, json=body))
    await clock_of(service).until_waits_async(WARMTH_LOOK_SECONDS)
    return asking


def clock_of(service: Service) -> TurnedClock:
    assert isinstance(service.clock, TurnedClock)
    return service.clock


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("/v1/scores", BODY),
        ("/v1/validations", BODY),
        ("/v1/verifications", {**BODY, "trials": 1000}),
        ("/v1/gates", GATE),
    ],
)
def test_a_computation_waits_a_little_and_is_told_to_come_back(tmp_path: Path, path: str, body: Any) -> None:
    async def story(client: httpx.AsyncClient, service: Service) -> None:
        asking = await asked(client, service, path, body)
        clock_of(service).turn(29.0)
        await clock_of(service).until_waits_async(WARMTH_LOOK_SECONDS)
        assert not asking.done()
        clock_of(service).turn(1.0)
        response = await asking
        entry = check_problem(response, 503, "warming-up")["errors"][0]
        assert 1 <= int(response.headers["retry-after"]) <= 30
        assert "waited 30 s" in entry["detail"]
        assert "/health/ready" in entry["hint"]
        assert (await client.get("/health/ready")).json()["status"] == "warming up"

    told(tmp_path, 30.0, story)


@pytest.mark.parametrize("stops", [False, True])
def test_who_comes_shortly_before_is_answered_and_a_service_that_stops_meanwhile_says_so(
    tmp_path: Path, stops: bool
) -> None:
    async def story(client: httpx.AsyncClient, service: Service) -> None:
        asking = await asked(client, service, "/v1/scores", BODY)
        if stops:
            service.stopping.set()
        else:
            service.pool.warmth = "ready"
        clock_of(service).turn(WARMTH_LOOK_SECONDS)
        answer = await asking
        if stops:
            check_problem(answer, 503, "stopping")
        assert answer.status_code == (503 if stops else 200)

    told(tmp_path, 60.0, story)


def test_what_needs_no_kernels_is_answered_at_once(tmp_path: Path) -> None:
    async def story(client: httpx.AsyncClient, service: Service) -> None:
        assert (await client.post("/v1/conversions", json=BEADS)).status_code == 200
        assert (await client.get("/v1/jobs")).status_code == 200
        check_problem(await client.post("/v1/scores", json={}), 503, "warming-up")
        check_problem(await client.post("/v1/scores?x=1", json={}), 422, "invalid-request")

    told(tmp_path, 0.0, story)


async def test_everything_is_loaded_once_and_what_was_forked_before_makes_room() -> None:
    """What needs no kernels is computed meanwhile; who is killed is followed by a process that has all of them."""
    places = ComputePool(2, 8, 60.0, threading.Event(), warm=True)
    places.begin()
    try:
        request = Caller().request()
        assert places.warmth == "warming up"
        cold = await places.run(request, os.getpid, 0.0)
        await until_async(lambda: places.warmth != "warming up", lambda: "the kernels are still loaded")
        assert places.warmth == "ready"
        first = await places.run(request, loaded, 0.0)
        assert first != cold
        os.kill(first, signal.SIGKILL)
        with contextlib.suppress(Died):
            while first in places.pids():
                await places.run(request, loaded, 0.0)
        assert await places.run(request, loaded, 0.0) not in (cold, first)
    finally:
        await places.close()


def loaded() -> int:
    """The pid of a process that has everything; in one that has not, a defect."""
    assert "tailstack.optimisation.course" in sys.modules, "this process was not forked from one that is warm"
    return os.getpid()


@pytest.mark.long
def test_after_the_warm_up_no_score_has_a_kernel_compiled() -> None:
    """A kernel that is compiled in front of a client makes it wait for seconds."""
    program = """
from contextlib import suppress
from pathlib import Path
from tailstack import load_design, score
from tailstack.errors import TailstackError
from tailstack.kernels.store import KERNELS
from tailstack_service.operations.perform import warm_up

def compiled():
    return {(name, str(signature)) for name, kernel in KERNELS.items() for signature in kernel.overloads}

warm_up()
known, scored = compiled(), 0
for file in sorted(Path("examples").rglob("*.yaml")):
    with suppress(TailstackError):  # policies, workflows, designs that are refused
        score(load_design(file))
        scored += 1
print(scored, *sorted(compiled() - known), sep="\\n")
"""
    done = run_python("-c", program, cwd=Path(__file__).parents[2], timeout=3 * LIMIT_SECONDS)
    assert done.returncode == 0, done.stderr
    scored, *more = done.stdout.splitlines()
    assert int(scored) >= 8
    assert more == []

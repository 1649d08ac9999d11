"""Before the kernels are compiled: a request waits for a moment, then is told to come back; never for a minute."""

from __future__ import annotations

import asyncio
import subprocess
import sys
import threading
import time
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import pytest
from service_scenes import check_problem, small_design

from tailstack_service.http.app import create_app
from tailstack_service.http.service import Service
from tailstack_service.http.warmth import Warming
from tailstack_service.settings import Settings
from tailstack_service.store.database import open_database

BODY = {"design": small_design()}
GATE = {"designs": [{"file": "a.yaml", "design": small_design()}], "mode": "analytic"}
BEADS = {"format": "csv", "content": "label,x_mm,y_mm,z_mm\nF1,0,0,0\nF2,40,0,5\nF3,0,35,-10\n"}


def told(tmp_path: Path, seconds: float, story: Callable[[httpx.AsyncClient, Service], Awaitable[None]]) -> None:
    """Tell a story about a service that is warming up."""
    url = f"sqlite:///{tmp_path / 'jobs.sqlite3'}"
    open_database(url, migrate=True).close()
    app = create_app(Settings(database=url, warm_up_seconds=seconds), warm_up=False)
    service: Service = app.state.service
    service.warmth = "warming up"

    async def tell() -> None:
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost", timeout=60) as client:
            await story(client, service)

    try:
        asyncio.run(tell())
    finally:
        for part in (service.short, service.reports, service.storage):
            part.close()


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
        begun = time.monotonic()
        response = await client.post(path, json=body)
        assert 0.3 <= time.monotonic() - begun < 5
        entry = check_problem(response, 503, "warming-up")["errors"][0]
        assert 1 <= int(response.headers["retry-after"]) <= 30
        assert "0.3 s" in entry["detail"]
        assert "/health/ready" in entry["hint"]
        assert (await client.get("/health/ready")).json()["status"] == "warming up"

    told(tmp_path, 0.3, story)


def test_who_comes_shortly_before_is_answered(tmp_path: Path) -> None:
    async def story(client: httpx.AsyncClient, service: Service) -> None:
        asking = asyncio.create_task(client.post("/v1/scores", json=BODY))
        await asyncio.sleep(0.2)
        assert not asking.done()
        service.warmth = "ready"
        assert (await asking).status_code == 200

    told(tmp_path, 60.0, story)


def test_a_service_that_stops_meanwhile_says_so(tmp_path: Path) -> None:
    async def story(client: httpx.AsyncClient, service: Service) -> None:
        asking = asyncio.create_task(client.post("/v1/scores", json=BODY))
        await asyncio.sleep(0.1)
        service.stopping.set()
        check_problem(await asking, 503, "stopping")

    told(tmp_path, 60.0, story)


def test_second_order_waits_for_its_own_kernels_and_nobody_else_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are compiled once, however many ask, and who waits is told so or answered."""
    from tailstack_service.http import warmth

    enough, begun = threading.Event(), []

    def compiling(service: Service) -> None:
        begun.append(1)
        enough.wait(60.0)
        service.second_order = "ready"

    monkeypatch.setattr(warmth, "_warm_second_order", compiling)

    async def story(client: httpx.AsyncClient, service: Service) -> None:
        service.warmth, service.second_order = "ready", "not asked for"
        asked = {**BODY, "second_order": True}
        assert (await client.post("/v1/scores", json=BODY)).status_code == 200
        assert begun == []
        entry = check_problem(await client.post("/v1/scores", json=asked), 503, "warming-up")["errors"][0]
        assert "but for those of second order" in entry["hint"]
        assert (await client.post("/v1/scores", json=BODY)).status_code == 200
        service.settings = replace(service.settings, warm_up_seconds=60.0)
        asking = asyncio.create_task(client.post("/v1/scores", json=asked))
        await asyncio.sleep(0.1)
        assert not asking.done()
        enough.set()
        answer = await asking
        assert answer.json()["targets"][0]["second_order"]["status"] == "applied"
        assert begun == [1]

    told(tmp_path, 0.3, story)


def test_second_order_warms_up_by_itself(tmp_path: Path) -> None:
    async def story(client: httpx.AsyncClient, service: Service) -> None:
        service.warmth, service.second_order = "ready", "not asked for"
        answer = await client.post("/v1/scores", json={**BODY, "second_order": True})
        assert answer.json()["targets"][0]["second_order"]["status"] == "applied"
        assert service.second_order == "ready"

    told(tmp_path, 300.0, story)


def test_what_needs_no_kernels_is_answered_at_once(tmp_path: Path) -> None:
    async def story(client: httpx.AsyncClient, service: Service) -> None:
        begun = time.monotonic()
        assert (await client.post("/v1/conversions", json=BEADS)).status_code == 200
        assert (await client.get("/v1/jobs")).status_code == 200
        check_problem(await client.post("/v1/scores", json={}), 503, "warming-up")
        check_problem(await client.post("/v1/scores?x=1", json={}), 422, "invalid-request")
        assert time.monotonic() - begun < 5

    told(tmp_path, 0.0, story)


def test_a_warm_up_is_not_waited_for() -> None:
    enough = threading.Event()
    warming = Warming(lambda: enough.wait(60.0) or None)
    warming.start()
    began = time.monotonic()
    warming.end()
    assert time.monotonic() - began < 5
    assert warming.is_alive()
    enough.set()
    warming.end()
    assert not warming.is_alive()


LEAVING = """
import threading, time
from tailstack_service.http.warmth import Warming, leave_if_compiling
leave_if_compiling(3)
print("nothing is compiled", flush=True)
Warming(lambda: time.sleep(60)).start()
print("left", end="")
leave_if_compiling(130)
"""


def test_a_process_that_compiles_ends_where_it_is() -> None:
    done = subprocess.run([sys.executable, "-c", LEAVING], capture_output=True, text=True, timeout=30)
    assert (done.returncode, done.stdout, done.stderr) == (130, "nothing is compiled\nleft", "")


def test_after_the_example_and_its_variants_no_score_has_a_kernel_compiled() -> None:
    """Scores are computed on the event loop: a kernel compiled there would keep everybody waiting for seconds."""
    program = """
import sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from tailstack.design import load_design
from tailstack.errors import TailstackError
from tailstack.scoring import score
from tailstack_service.http.example import EXAMPLE_DESIGN, variants

def compiled():
    return {
        (value.py_func.__module__, value.__name__, str(signature))
        for module in list(sys.modules.values()) if getattr(module, "__name__", "").startswith("tailstack.")
        for value in vars(module).values() if isinstance(value, Dispatcher)
        for signature in value.overloads
    }

for design in (EXAMPLE_DESIGN, *variants()):
    score(load_design(design))
known = compiled()
scored = 0
for file in sorted(Path("examples").rglob("*.yaml")):
    try:
        score(load_design(file))
        scored += 1
    except TailstackError:
        pass  # policies, workflows, designs that are refused
print(scored)
for more in sorted(compiled() - known):
    print(*more)
"""
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run([sys.executable, "-c", program], cwd=root, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    scored, *more = done.stdout.splitlines()
    assert int(scored) >= 8
    assert more == []

"""One tenant asks for as much as it may; another asks for little.  A real service, real keys, real connections."""

from __future__ import annotations

import copy
import json
import os
import random
import signal
import socket
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from threading import Event
from typing import Any

import httpx
import psutil
import pytest
from served import Served, served
from service_scenes import read_answer, small_design

CONNECTIONS = 60
TIMES = 10  # its time on an idle service that a small score may take
STOP_SECONDS = 10.0  # docs/http.md
SMALL = json.dumps({"design": small_design()}).encode()


@dataclass(frozen=True, slots=True)
class Place:
    service: Served
    keys: dict[str, str]

    def post(self, key: str, path: str, body: bytes, timeout: float = 120.0) -> httpx.Response:
        headers = {"Authorization": f"Bearer {self.keys[key]}", "Content-Type": "application/json"}
        return httpx.post(self.service.url + path, content=body, headers=headers, timeout=timeout, trust_env=False)

    def begin(self, key: str, path: str, body: bytes) -> socket.socket:
        """Send a request and leave the answer for later."""
        host, _, port = self.service.url.removeprefix("http://").partition(":")
        connection = socket.create_connection((host, int(port)), timeout=60)
        head = f"POST {path} HTTP/1.1\r\nHost: {host}\r\nAuthorization: Bearer {self.keys[key]}\r\n"
        head += f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n\r\n"
        connection.sendall(head.encode() + body)
        return connection

    def seconds_of_small_scores(self, count: int) -> list[float]:
        took = []
        headers = {"Authorization": f"Bearer {self.keys['modest']}", "Content-Type": "application/json"}
        with httpx.Client(base_url=self.service.url, headers=headers, timeout=60, trust_env=False) as client:
            for _ in range(count):
                begun = time.perf_counter()
                assert client.post("/v1/scores", content=SMALL).status_code == 200
                took.append(time.perf_counter() - begun)
        return sorted(took)

    def computing(self) -> list[psutil.Process]:
        """The computing processes of the API."""
        every = psutil.Process().children(recursive=True)
        return [one for one in every if "tailstack_service.http.computations:perform" in " ".join(_command(one))]


def _command(process: psutil.Process) -> list[str]:
    with suppress(psutil.NoSuchProcess):
        return process.cmdline()
    return []


def large(targets: int) -> dict[str, Any]:
    """As many fiducials and targets as are admitted."""
    design, draw = small_design(requirements=[{"name": "all", "limit_mm": 1.5}], optimise=None), random.Random(1)
    design["fiducials"]["points"] = [
        {"position_mm": [draw.uniform(-40, 40), draw.uniform(-40, 40), draw.uniform(-80, 5)]} for _ in range(200)
    ]
    design["targets"] = [
        {"name": f"t{k}", "position_mm": [draw.uniform(-5, 5), draw.uniform(-5, 5), 70]} for k in range(targets)
    ]
    return design


def large_gate() -> bytes:
    designs = [{"file": f"{k}.yaml", "design": {**copy.deepcopy(large(50)), "name": f"design {k}"}} for k in range(25)]
    return json.dumps({"designs": designs, "mode": "analytic"}).encode()


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    folder = tmp_path_factory.mktemp("load")
    with served(folder, TAILSTACK_AUTH="required", TAILSTACK_MAX_TARGETS="200", TAILSTACK_SHORT_WORKERS="2") as service:
        keys = {
            tenant: service.run("keys", "create", "--tenant", tenant, "--name", "test", "--scope", "compute").strip()
            for tenant in ("greedy", "modest")
        }
        yield Place(service, keys)


@pytest.mark.long
@pytest.mark.long
def test_a_small_score_beside_sixty_of_the_largest(place: Place) -> None:
    """p99 of it is at most ten times its time on an idle service.

    Whatever else the machine does only adds to it, and so the best of three attempts counts.
    """
    place.seconds_of_small_scores(5)
    body, ended = json.dumps({"design": large(200)}).encode(), Event()
    idle = median(place.seconds_of_small_scores(40))

    def flood() -> None:
        while not ended.is_set():
            with suppress(httpx.HTTPError):
                place.post("greedy", "/v1/scores", body, timeout=5)

    seen: list[float] = []
    with ThreadPoolExecutor(CONNECTIONS) as pool:
        for _ in range(CONNECTIONS):
            pool.submit(flood)
        try:
            time.sleep(1.0)
            while len(seen) < 3 and (not seen or min(seen) > TIMES * idle):
                seen.append(place.seconds_of_small_scores(100)[-2])
        finally:
            ended.set()
    assert min(seen) <= TIMES * idle, (idle, seen)


@pytest.mark.long
def test_large_gates_that_nobody_waits_for_are_given_up(place: Place) -> None:
    connections = [place.begin("greedy", "/v1/gates", large_gate()) for _ in range(3)]
    time.sleep(2.0)
    for connection in connections:
        connection.close()
    begun = time.monotonic()
    small_gate = json.dumps({"designs": [{"file": "a.yaml", "design": small_design()}], "mode": "analytic"}).encode()
    assert place.post("modest", "/v1/scores", SMALL).status_code == 200
    assert place.post("modest", "/v1/gates", small_gate).status_code == 200
    assert place.post("modest", "/v1/verifications", json.dumps({"design": small_design()}).encode()).status_code == 202
    assert time.monotonic() - begun < 15
    deadline = time.monotonic() + 60
    while True:  # until nothing is computed any more, and the process that was killed is replaced and warm
        before = {one.pid: sum(one.cpu_times()[:2]) for one in place.computing()}
        time.sleep(1.0)
        after = {one.pid: sum(one.cpu_times()[:2]) for one in place.computing()}
        if before.keys() == after.keys() and len(after) == 2 and sum(after.values()) - sum(before.values()) < 0.1:
            break
        assert time.monotonic() < deadline


@pytest.mark.long
def test_a_stop_takes_seconds_whatever_is_computed(place: Place) -> None:
    """Whoever waits is told so as a problem document: in a process, in the queue, and with half of a body sent."""
    gates = [place.begin("greedy", "/v1/gates", large_gate()) for _ in range(3)]
    half = place.begin("greedy", "/v1/scores", SMALL)
    host, _, port = place.service.url.removeprefix("http://").partition(":")
    half.close()
    half = socket.create_connection((host, int(port)), timeout=60)
    head = f"POST /v1/scores HTTP/1.1\r\nHost: {host}\r\nAuthorization: Bearer {place.keys['greedy']}\r\n"
    half.sendall(head.encode() + b"Content-Type: application/json\r\nContent-Length: 1000\r\n\r\n{")
    time.sleep(1.5)
    family = psutil.Process(place.service.pid).children(recursive=True)
    begun = time.monotonic()
    os.kill(place.service.pid, signal.SIGTERM)
    for connection in (*gates, half):
        with connection:
            status, rest = read_answer(connection)
        assert status == b"HTTP/1.1 503 Service Unavailable"
        assert b"content-type: application/problem+json" in rest.lower()
        assert b"/v1/problems/stopping" in rest
    place.service.process.wait(timeout=60)
    assert time.monotonic() - begun < STOP_SECONDS
    _, alive = psutil.wait_procs(family, timeout=5)
    assert not alive
    log = Path(place.service.log).read_text()
    assert "Traceback" not in log

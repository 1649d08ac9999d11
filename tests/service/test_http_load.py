"""One tenant asks for as much as it may; another asks for little.  A real service, real keys, real connections."""

from __future__ import annotations

import copy
import json
import os
import random
import signal
import socket
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Event
from typing import Any

import httpx
import psutil
import pytest
from served import Served, served
from service_scenes import ask, read_answer, small_design

from family import forked_of
from waiting import LIMIT_SECONDS, until

CONNECTIONS = 60
WORKERS = 2  # computing processes; one more is kept warm
QUIET_LOOKS = 40  # at an idle service, one after another: more than it needs to notice that a caller has left
LOOK_SECONDS = 0.25  # that a caller waits for its answer before it looks whether the flood has ended
DONE = b"HTTP/1.1 200 OK"
SMALL = json.dumps({"design": small_design()}).encode()


@dataclass(frozen=True, slots=True)
class Place:
    service: Served
    keys: dict[str, str]

    def post(self, key: str, path: str, body: bytes) -> httpx.Response:
        headers = {"Authorization": f"Bearer {self.keys[key]}", "Content-Type": "application/json"}
        url = self.service.url + path
        return ask("POST", url, content=body, headers=headers)

    def begin(self, key: str, path: str, body: bytes) -> socket.socket:
        """Send a request and leave the answer for later."""
        host, _, port = self.service.url.removeprefix("http://").partition(":")
        connection = socket.create_connection((host, int(port)), timeout=LIMIT_SECONDS)
        head = f"POST {path} HTTP/1.1\r\nHost: {host}\r\nAuthorization: Bearer {self.keys[key]}\r\n"
        head += f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n\r\n"
        connection.sendall(head.encode() + body)
        return connection

    def used(self) -> list[tuple[int, float]]:
        """The computing processes of the API, and the processor time that each has used, s."""
        found = []
        for one in forked_of(self.service.pid):
            with suppress(psutil.NoSuchProcess):
                found.append((one.pid, sum(one.cpu_times()[:2])))
        return found

    def kills(self) -> int:
        return Path(self.service.log).read_text().count("its process was killed")

    def wait_until_used(self, before: dict[int, float], seconds: float) -> None:
        """Until one of the computing processes has used so many seconds more."""
        until(lambda: any(used > before.get(pid, 0.0) + seconds for pid, used in self.used()), says=self.used)

    def wait_until_quiet(self) -> dict[int, float]:
        """Until nothing is computed and every process is there and warm; then what each has used, s.

        A process that has something to do and waits for a processor does not sleep, however busy the machine.
        """
        seen: list[list[tuple[int, float]]] = []

        def quiet() -> bool:
            if not self.asleep():
                seen.clear()
            seen.append(self.used())
            return len(seen) > QUIET_LOOKS and seen[-1] == seen[-1 - QUIET_LOOKS] and len(seen[-1]) == WORKERS

        until(quiet, says=lambda: seen[-QUIET_LOOKS:])
        return dict(seen[-1])

    def asleep(self) -> bool:
        """Whether the API and each of its computing processes wait for something to do."""
        with suppress(psutil.NoSuchProcess):
            family = [psutil.Process(self.service.pid), *forked_of(self.service.pid)]
            return all(one.status() == psutil.STATUS_SLEEPING for one in family)
        return False


@contextmanager
def flooded(begin: Callable[[], socket.socket], connections: int) -> Iterator[list[bytes]]:
    """Let so many callers ask again and again, who hang up at the end.

    Yields what they were answered so far, the first line of each.
    """
    ended, answered = Event(), []

    def again() -> None:
        while not ended.is_set():
            with suppress(OSError), begin() as connection:
                connection.settimeout(LOOK_SECONDS)
                while not ended.is_set():
                    with suppress(TimeoutError):
                        answered.append(connection.recv(1_000).partition(b"\r\n")[0])
                        break

    with ThreadPoolExecutor(connections) as pool:
        for _ in range(connections):
            pool.submit(again)
        try:
            yield answered
        finally:
            ended.set()


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


LARGE = json.dumps({"design": large(200)}).encode()


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    folder = tmp_path_factory.mktemp("load")
    with served(
        folder,
        "--no-worker",
        TAILSTACK_AUTH="required",
        TAILSTACK_MAX_TARGETS="200",
        TAILSTACK_SHORT_WORKERS=str(WORKERS),
    ) as service:
        keys = {
            tenant: service.run("keys", "create", "--tenant", tenant, "--name", "test", "--scope", "compute").strip()
            for tenant in ("greedy", "modest")
        }
        yield Place(service, keys)


@pytest.mark.long
def test_a_small_score_beside_sixty_of_the_largest(place: Place) -> None:
    """It never waits for the turns of others: while it is computed, about as many end as there are processes."""
    before, turns = place.wait_until_quiet(), []
    with flooded(partial(place.begin, "greedy", "/v1/scores", LARGE), CONNECTIONS) as answered:
        place.wait_until_used(before, 2.0)
        for _ in range(50):
            begun = answered.count(DONE)
            assert place.post("modest", "/v1/scores", SMALL).status_code == 200
            turns.append(answered.count(DONE) - begun)
    assert max(turns) <= 2 * WORKERS, turns
    assert set(answered) <= {DONE, b"HTTP/1.1 429 Too Many Requests", b"HTTP/1.1 503 Service Unavailable"}


@pytest.mark.long
def test_large_gates_that_nobody_waits_for_are_given_up(place: Place) -> None:
    """The one that is computed is ended, those that wait are never begun, and nobody else waits for any of them."""
    small_gate = json.dumps({"designs": [{"file": "a.yaml", "design": small_design()}], "mode": "analytic"}).encode()
    check = json.dumps({"design": small_design()}).encode()

    before, kills = place.wait_until_quiet(), place.kills()
    connections = [place.begin("greedy", "/v1/gates", large_gate()) for _ in range(3)]
    place.wait_until_used(before, 2.0)
    for connection in connections:
        connection.close()
    assert place.post("modest", "/v1/scores", SMALL).status_code == 200
    assert place.post("modest", "/v1/gates", small_gate).status_code == 200
    assert place.post("modest", "/v1/verifications", check).status_code == 202
    after = place.wait_until_quiet()  # the process that was ended is replaced and warm
    assert place.kills() == kills + 1
    assert len(before.keys() & after.keys()) == len(before) - 1


@pytest.mark.long
def test_a_stop_waits_for_nothing_that_is_computed(place: Place) -> None:
    """Whoever waits is told so as a problem document: in a process, in the queue, and with half of a body sent."""
    before = place.wait_until_quiet()
    gates = [place.begin("greedy", "/v1/gates", large_gate()) for _ in range(3)]
    host, _, port = place.service.url.removeprefix("http://").partition(":")
    half = socket.create_connection((host, int(port)), timeout=LIMIT_SECONDS)
    head = f"POST /v1/scores HTTP/1.1\r\nHost: {host}\r\nAuthorization: Bearer {place.keys['greedy']}\r\n"
    half.sendall(head.encode() + b"Content-Type: application/json\r\nContent-Length: 1000\r\n\r\n{")
    place.wait_until_used(before, 0.5)
    assert place.post("modest", "/v1/scores", SMALL).status_code == 200  # what was sent before it has arrived
    family = psutil.Process(place.service.pid).children(recursive=True)
    os.kill(place.service.pid, signal.SIGTERM)
    for connection in (*gates, half):
        with connection:
            status, rest = read_answer(connection)
        assert status == b"HTTP/1.1 503 Service Unavailable"
        assert b"content-type: application/problem+json" in rest.lower()
        assert b"/v1/problems/stopping" in rest
    place.service.process.wait(timeout=LIMIT_SECONDS)
    _, alive = psutil.wait_procs(family, timeout=LIMIT_SECONDS)
    assert not alive
    log = Path(place.service.log).read_text()
    assert "Traceback" not in log

"""Who asks for as much as he may hangs up, or is there when the service stops: real connections.

Whose turn it is where many ask is asked of the pool itself, in test_http_compute_pool.py.
"""

from __future__ import annotations

import json
import os
import signal
import socket
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import httpx
import psutil
import pytest
from served import Served, served
from service_scenes import ask, large_design, read_answer, small_design

from family import forked_of
from waiting import LIMIT_SECONDS, until

WORKERS = 2  # computing processes; one more is kept warm
QUIET_LOOKS = 40  # at an idle service, one after another: more than it needs to notice that a caller has left
SMALL = json.dumps({"design": small_design()}).encode()


@dataclass(frozen=True, slots=True)
class Place:
    service: Served

    def post(self, path: str, body: bytes) -> httpx.Response:
        url = self.service.url + path
        return ask("POST", url, content=body, headers={"Content-Type": "application/json"})

    def begin(self, path: str, body: bytes, length: int | None = None) -> socket.socket:
        """Send a request, of a length that is told, and leave the answer for later."""
        host, _, port = self.service.url.removeprefix("http://").partition(":")
        connection = socket.create_connection((host, int(port)), timeout=LIMIT_SECONDS)
        head = f"POST {path} HTTP/1.1\r\nHost: {host}\r\nContent-Type: application/json\r\n"
        head += f"Content-Length: {length or len(body)}\r\n\r\n"
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


def large_gate() -> bytes:
    design = large_design([{"name": f"t{k}", "position_mm": [k / 10, -k / 12, 70]} for k in range(50)])
    designs = [{"file": f"{k}.yaml", "design": {**design, "name": f"design {k}"}} for k in range(25)]
    return json.dumps({"designs": designs, "mode": "analytic"}).encode()


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    folder = tmp_path_factory.mktemp("load")
    with served(folder, "--no-worker", TAILSTACK_SHORT_WORKERS=str(WORKERS)) as service:
        yield Place(service)


@pytest.mark.long
def test_large_gates_that_nobody_waits_for_are_given_up(place: Place) -> None:
    """The one that is computed is ended, those that wait are never begun, and nobody else waits for any of them."""
    small_gate = json.dumps({"designs": [{"file": "a.yaml", "design": small_design()}], "mode": "analytic"}).encode()
    before, kills = place.wait_until_quiet(), place.kills()
    connections = [place.begin("/v1/gates", large_gate()) for _ in range(3)]
    place.wait_until_used(before, 2.0)
    for connection in connections:
        connection.close()
    assert place.post("/v1/scores", SMALL).status_code == 200
    assert place.post("/v1/gates", small_gate).status_code == 200
    assert place.post("/v1/verifications", SMALL).status_code == 202
    after = place.wait_until_quiet()  # the process that was ended is replaced and warm
    assert place.kills() == kills + 1
    assert len(before.keys() & after.keys()) == len(before) - 1


@pytest.mark.long
def test_a_stop_waits_for_nothing_that_is_computed(place: Place) -> None:
    """Whoever waits is told so as a problem document: in a process, in the queue, and with half of a body sent."""
    before = place.wait_until_quiet()
    gates = [place.begin("/v1/gates", large_gate()) for _ in range(3)]
    half = place.begin("/v1/scores", b"{", length=1000)
    place.wait_until_used(before, 0.5)
    assert place.post("/v1/scores", SMALL).status_code == 200  # what was sent before it has arrived
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

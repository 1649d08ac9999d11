"""What the service costs: a real ``tailstack serve`` on loopback, asked by this process.

Each score is of another design: its fiducials moved by micrometres, as a CAD tool moves them.
"""

from __future__ import annotations

import http.client
import json
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from itertools import cycle
from pathlib import Path
from queue import Empty, SimpleQueue
from statistics import median
from threading import Thread
from typing import Any

import psutil
import strange_units
from browsing import used
from worker_scenes import finished, prepared_database, submit, working

from bench import ROOT, Figure, Findings, interleave, watch_load
from tailstack.design import design_to_data, load_design
from tailstack.scoring import score

DEMO = ROOT / "examples" / "demo.yaml"
JSON = {"Content-Type": "application/json"}
CONNECTIONS = 8
BODIES = 200
SCORES = 400  # of a burst
UNITS = 200  # of a job
SYNCS = 100
MOVES = 150


@contextmanager
def serving(folder: str, **settings: object) -> Iterator[tuple[str, int]]:
    """``tailstack serve`` with a database of its own in a folder: host and port, once it is ready and warm."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith("TAILSTACK_")}
    chosen = {"database": f"sqlite:///{folder}/jobs.sqlite3", **settings}
    environment |= {f"TAILSTACK_{name.upper()}": str(value) for name, value in chosen.items()}
    process = subprocess.Popen(
        [sys.executable, "-m", "tailstack_service.cli.main", "serve", "--port", "0"],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment, text=True,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        found = re.search(r"http://([\d.]+):(\d+)", process.stdout.readline())
        assert found is not None, "the service did not say where it listens"
        host, port = found[1], int(found[2])
        while ask(host, port, "GET", "/health/ready")[0] != 200:
            time.sleep(0.05)
        settle()
        yield host, port
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(60)
        assert process.stdout is not None
        process.stdout.close()


def settle(seconds: float = 60.0) -> None:
    """Return when the service has done what it does after a start: its worker and what few requests need warm up."""

    def busy() -> float:
        family = psutil.Process().children(recursive=True)
        return sum(times.user + times.system for times in (child.cpu_times() for child in family))

    deadline, before = time.monotonic() + seconds, -1.0
    while (now := busy()) - before > 0.15 and time.monotonic() < deadline:  # looking for work costs a tenth of this
        before = now
        time.sleep(2.5)


def ask(host: str, port: int, method: str, path: str, body: bytes | None = None) -> tuple[int, bytes]:
    """One request on a connection of its own."""
    with closing(http.client.HTTPConnection(host, port, timeout=120)) as connection:
        connection.request(method, path, body, JSON if body is not None else {})
        answer = connection.getresponse()
        return answer.status, answer.read()


def bodies(count: int) -> list[bytes]:
    """Requests that differ in the fiducials of their designs."""
    design: Any = design_to_data(load_design(DEMO))
    draw, made = random.Random(1), []
    for _ in range(count):
        for point in design["fiducials"]["points"]:
            point["position_mm"] = [round(value + draw.uniform(-0.005, 0.005), 6) for value in point["position_mm"]]
        made.append(json.dumps({"design": design}).encode())
    return made


def post_score(connection: http.client.HTTPConnection, body: bytes) -> None:
    """One score on a connection that is kept."""
    connection.request("POST", "/v1/scores", body, JSON)
    answer = connection.getresponse()
    answer.read()
    if answer.status != 200:
        raise RuntimeError(f"POST of a score was answered with {answer.status}")


def post() -> Findings:
    """The same designs in turn over HTTP and in this process."""
    asked = bodies(BODIES)
    over_http, here = iter(cycle(asked)), iter(cycle(asked))
    with (
        tempfile.TemporaryDirectory(prefix="tailstack-bench-") as folder, serving(folder) as (host, port),
        closing(http.client.HTTPConnection(host, port, timeout=60)) as connection,
    ):  # fmt: skip

        def by_post() -> int:
            post_score(connection, next(over_http))
            return 1

        def in_process() -> int:
            score(load_design(json.loads(next(here))["design"]))
            return 1

        jobs = {"post": by_post, "in process": in_process}
        interleave(jobs, 20)  # what both load at first
        rounds = interleave(jobs, BODIES)
    took, own = (sorted(rounds.wall[name]) for name in jobs)
    figures = [
        Figure("p50 of a POST, wall", 1e3 * median(took), "ms"),
        Figure("p99 of a POST, wall", 1e3 * took[int(0.99 * len(took))], "ms"),
        Figure("p50 in process, wall", 1e3 * median(own), "ms"),
    ]
    return Findings([median(took) / median(own)], rounds.foreign, figures)


def drag() -> Findings:
    """A bead dragged on the page in Chromium: each move until its number is drawn, in turn with its request alone."""
    with tempfile.TemporaryDirectory(prefix="tailstack-bench-") as folder, serving(folder) as (host, port):
        with watch_load() as load:  # before, for processes of Chromium cannot be told from those of others
            time.sleep(3)
        found = used(f"http://{host}:{port}", "pace", moves=MOVES)
    moves, alone = sorted(found["moves"]), sorted(found["alone"])
    late = int(0.95 * MOVES)
    figures = [
        Figure("p50 of a move, wall", median(moves), "ms"),
        Figure("p95 of a move, wall", moves[late], "ms"),
        Figure("p50 of the request alone, wall", median(alone), "ms"),
        Figure("p95 of the request alone, wall", alone[late], "ms"),
        Figure("frames of the drag with numbers of the design of that moment", 100 * found["current"], "%"),
    ]
    return Findings([moves[late] / alone[late], 100 * found["black"]], load.foreign, figures)


def burst(host: str, port: int, asked: list[bytes]) -> int:
    """Scores over eight connections that are kept: each sends the next body as soon as it was answered.

    Not a fixed share for each connection: which API process accepts a connection is chance, and the burst would last
    as long as the process with most of them is busy, while the other had long been idle.
    """
    failed: list[Exception] = []
    left = SimpleQueue[bytes]()
    for body in asked:
        left.put(body)

    def send() -> None:
        try:
            with closing(http.client.HTTPConnection(host, port, timeout=120)) as connection, suppress(Empty):
                while True:
                    post_score(connection, left.get_nowait())
        except Exception as error:  # a thread's exception would be printed and forgotten
            failed.append(error)

    senders = [Thread(target=send) for _ in range(CONNECTIONS)]
    for sender in senders:
        sender.start()
    for sender in senders:
        sender.join()
    if failed:
        raise failed[0]
    return len(asked)


def api_processes() -> Findings:
    """Bursts on a service of one and on one of two API processes, each with one computing process, in turn."""
    asked = (bodies(BODIES) * (SCORES // BODIES + 1))[:SCORES]
    with (
        tempfile.TemporaryDirectory(prefix="tailstack-bench-") as first,
        tempfile.TemporaryDirectory(prefix="tailstack-bench-") as second,
        serving(first, api_processes=1, short_workers=1) as one,
        serving(second, api_processes=2, short_workers=1) as two,
    ):
        jobs: dict[str, Callable[[], int]] = {"one": lambda: burst(*one, asked), "two": lambda: burst(*two, asked)}
        for job in jobs.values():
            job()
        generator, began = time.process_time(), time.perf_counter()
        rounds = interleave(jobs, 5)
        share = (time.process_time() - generator) / ((time.perf_counter() - began) * (psutil.cpu_count() or 1))
    figures = [Figure(f"scores a second, {name} API", 1 / median(rounds.wall[name]), "/s") for name in jobs]
    figures.append(Figure("share of the machine that the load generator took", 100 * share, "%"))
    return Findings([rounds.ratio("one", "two", wall=True)], rounds.foreign, figures)


def unit() -> Findings:
    """Units that compute nothing, in the database and back, in turn with an fsync of 4 kB where the database is."""
    (ROOT / "out").mkdir(exist_ok=True)
    durable, synced = "a durable unit that computes nothing", "an fsync of 4 kB"
    with (
        tempfile.TemporaryDirectory(prefix="bench-", dir=ROOT / "out") as folder,
        prepared_database(f"sqlite:///{folder}/jobs.sqlite3") as db,
        working(db, worker_processes=1),
    ):

        def units() -> int:
            finished(db, submit(db, strange_units.request(units=UNITS)))
            return UNITS

        units()
        rounds = interleave({durable: units, synced: lambda: sync(Path(folder, "file"))})
    figures = [Figure(f"{name}, wall", 1e3 * median(rounds.wall[name]), "ms") for name in (durable, synced)]
    return Findings([rounds.ratio(durable, synced, wall=True)], rounds.foreign, figures)


def sync(file: Path) -> int:
    """Write 4 kB and have it on the disk, again and again."""
    descriptor = os.open(file, os.O_CREAT | os.O_WRONLY)
    try:
        for _ in range(SYNCS):
            os.pwrite(descriptor, bytes(4096), 0)
            os.fsync(descriptor)
    finally:
        os.close(descriptor)
    return SYNCS

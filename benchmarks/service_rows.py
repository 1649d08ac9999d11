"""What the service costs: a real ``tailstack serve`` on loopback, loaded by wrk and by this process.

Each score is of another design: its fiducials moved by micrometres, as a CAD tool moves them, or every number of every
section changed, so that nothing but its schema was met before.
"""

from __future__ import annotations

import http.client
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from statistics import median
from typing import Any

import psutil

from bench import Row
from tailstack.design import design_to_data, load_design
from tailstack.scoring import score

DEMO = Path(__file__).resolve().parents[1] / "examples" / "demo.yaml"
JSON = {"Content-Type": "application/json"}
CONNECTIONS, SECONDS = 8, 10
BODIES = 500
QUEUED = 1000
POINTS = 2000  # of the sweep whose units are timed


@contextmanager
def serving(*, api_processes: int = 1, **settings: object) -> Iterator[tuple[str, int, float]]:
    """``tailstack serve`` with a database of its own: host, port, and the seconds until it was ready."""
    with tempfile.TemporaryDirectory(prefix="tailstack-bench-") as folder:
        environment = {key: value for key, value in os.environ.items() if not key.startswith("TAILSTACK_")}
        chosen = {"database": f"sqlite:///{folder}/jobs.sqlite3", "api_processes": api_processes, **settings}
        environment |= {f"TAILSTACK_{name.upper()}": str(value) for name, value in chosen.items()}
        begun = time.monotonic()
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
                time.sleep(0.01)
            yield host, port, time.monotonic() - begun
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(30)
            assert process.stdout is not None
            process.stdout.close()


def ask(host: str, port: int, method: str, path: str, body: bytes | None = None, **headers: str) -> tuple[int, bytes]:
    """One request on a connection of its own."""
    with closing(http.client.HTTPConnection(host, port, timeout=120)) as connection:
        connection.request(method, path, body, {**(JSON if body is not None else {}), **headers})
        answer = connection.getresponse()
        return answer.status, answer.read()


def bodies(count: int, *, strangers: bool = False, **options: object) -> list[bytes]:
    """Requests that differ in the fiducials of their designs; ``strangers``: in every number of every section."""
    design: Any = design_to_data(load_design(DEMO))
    draw, made = random.Random(1), []
    for _ in range(count):
        for point in design["fiducials"]["points"]:
            point["position_mm"] = [round(value + draw.uniform(-0.005, 0.005), 6) for value in point["position_mm"]]
        made.append(json.dumps({"design": _changed(design, draw) if strangers else design, **options}).encode())
    return made


def _changed(data: Any, draw: random.Random, key: str = "") -> Any:
    """The same with its decimal numbers changed by a ten-thousandth, but for what has to be what it is."""
    if isinstance(data, dict):
        return {name: _changed(value, draw, name) for name, value in data.items()}
    if isinstance(data, list):
        return [_changed(value, draw, key) for value in data]
    if isinstance(data, float) and key not in ("quantile", "confidence", "quaternion_wxyz", "rotation"):
        return data * (1 + draw.uniform(-1e-4, 1e-4))
    return data


def scores() -> list[Row]:
    """Latency on one connection; throughput by wrk of one and two API processes with a computing process each."""
    rows = []
    with serving() as (host, port, _), closing(http.client.HTTPConnection(host, port, timeout=60)) as connection:
        took, here = [], []
        settle()
        for body in bodies(BODIES):
            begun = time.perf_counter()
            score(load_design(json.loads(body)["design"]))
            here.append(1e3 * (time.perf_counter() - begun))
            begun = time.perf_counter()
            connection.request("POST", "/v1/scores", body, JSON)
            answer = connection.getresponse()
            answer.read()
            assert answer.status == 200
            took.append(1e3 * (time.perf_counter() - begun))
        took, here = sorted(took[20:]), sorted(here[20:])
        by = "http.client, one connection"
        rows.append(Row(f"POST score, p50, one API process ({by})", median(took), "ms"))
        rows.append(Row("  against the same score() in process", median(took) / median(here), "x", 2, 1.3, "<"))
        rows.append(Row(f"POST score, p99, one API process ({by})", took[int(0.99 * len(took))], "ms"))
    with serving(short_workers=1) as (host, port, _):
        settle()
        rows += wrk_rows(host, port, 1)
    with serving(api_processes=2, short_workers=1) as (host, port, _):
        settle()
        rows += wrk_rows(host, port, 2)
        rows += wrk_rows(host, port, 2, strangers=True)
    return rows


def settle(seconds: float = 60.0) -> None:
    """Return when the service has done what it does after a start: its worker and what few requests need warm up."""

    def busy() -> float:
        family = psutil.Process().children(recursive=True)
        return sum(times.user + times.system for times in (child.cpu_times() for child in family))

    deadline, before = time.monotonic() + seconds, -1.0
    while (now := busy()) - before > 0.15 and time.monotonic() < deadline:  # looking for work costs a tenth of this
        before = now
        time.sleep(2.5)


def wrk_rows(host: str, port: int, processes: int, *, strangers: bool = False) -> list[Row]:
    """Requests per second and latency by wrk, which takes its share of the same cores."""
    if shutil.which("wrk") is None:
        print("bench: no wrk, no throughput; Debian: apt-get install wrk", file=sys.stderr)
        return []
    with tempfile.TemporaryDirectory(prefix="tailstack-wrk-") as folder:
        made = bodies(BODIES, strangers=strangers)
        Path(folder, "bodies.txt").write_bytes(b"\n".join(made))
        script = Path(folder, "post.lua")
        script.write_text(
            f"""local bodies, k = {{}}, 0
for line in io.lines("{folder}/bodies.txt") do bodies[#bodies + 1] = line end
wrk.method, wrk.headers["Content-Type"] = "POST", "application/json"
request = function() k = k % #bodies + 1; return wrk.format(nil, nil, nil, bodies[k]) end
done = function(summary, latency)
  io.write(string.format("TAIL %d %d %d %d %d\\n", summary.requests, summary.duration,
    summary.errors.status + summary.errors.read + summary.errors.write + summary.errors.timeout,
    latency:percentile(50), latency:percentile(99)))
end
"""
        )
        said = subprocess.run(
            ["wrk", "-t1", f"-c{CONNECTIONS}", f"-d{SECONDS}s", "-s", str(script), f"http://{host}:{port}/v1/scores"],
            capture_output=True, text=True, timeout=SECONDS + 60, check=True,
        ).stdout  # fmt: skip
    count, microseconds, errors, middle, late = map(int, said.partition("TAIL ")[2].split()[:5])
    assert errors == 0, said
    where = f"{processes} API process{'es' if processes > 1 else ''} (wrk, {CONNECTIONS} connections)"
    where += ", every section new" if strangers else ""
    must = (300.0, None) if processes == 2 else (None, None)
    return [
        Row(f"POST score, {where}", 1e6 * count / microseconds, "/s", *must),
        Row(f"  p50, {where}", middle / 1e3, "ms"),
        Row(f"  p99, {where}", late / 1e3, "ms"),
    ]


def start() -> list[Row]:
    """From the command to readiness, kernels in their cache."""
    took = []
    for _ in range(4):
        with serving() as (_, _, seconds):
            took.append(seconds)
    return [Row("cold start of serve until ready", median(took[1:]), "s", 3, None, "<")]


def jobs() -> list[Row]:
    """A durable unit against the same unit computed alone, and a full queue drained."""
    rows = []
    with serving(worker_processes=1) as (host, port, _):
        finished(host, port, submit(host, port, bodies(1, trials=20_000)[0]))  # the computing process is warm
        axis = {"pointer": "/views/0/fiducial_noise_px", "start": 0.1, "stop": 0.5, "count": POINTS}
        body = bodies(1, axes=[axis], check="score")[0]
        begun = time.perf_counter()
        record = finished(host, port, submit(host, port, body, "/v1/sweeps"))
        elapsed = time.perf_counter() - begun
        units, computing = record["progress"]["units_done"], record["cpu_seconds"]
        rows.append(Row(f"a durable unit beyond its computing (a sweep of {units} units)",
                        1e3 * (elapsed - computing) / units, "ms", 10, None, "<"))  # fmt: skip
    with serving() as (host, port, _):
        begun = time.perf_counter()
        ids = [submit(host, port, body) for body in bodies(QUEUED, trials=1000)]
        accepted = time.perf_counter() - begun
        records = [finished(host, port, identity) for identity in ids]
        drained = time.perf_counter() - begun
        done = [record for record in records if record["state"] == "succeeded"]
        rows.append(Row("queued jobs accepted (http.client, a connection each)", QUEUED / accepted, "/s"))
        rows.append(Row("queued jobs drained", QUEUED / drained, "/s"))
        rows.append(Row("  lost, of 1000", float(QUEUED - len(done)), "", 0, None, "<"))
        rows.append(Row("  doubled", float(len(ids) - len({record["id"] for record in done})), "", 0, None, "<"))
    return rows


def submit(host: str, port: int, body: bytes, path: str = "/v1/verifications") -> str:
    """The id of a new job."""
    status, answer = ask(host, port, "POST", path, body)
    assert status == 202, answer
    return str(json.loads(answer)["id"])


def finished(host: str, port: int, identity: str, seconds: float = 300.0) -> dict[str, Any]:
    """The record of a job once it has ended."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        record: dict[str, Any] = json.loads(ask(host, port, "GET", f"/v1/jobs/{identity}")[1])
        if record["state"] not in ("queued", "running"):
            return record
        time.sleep(0.01)
    raise TimeoutError(f"job {identity} did not end within {seconds} s")

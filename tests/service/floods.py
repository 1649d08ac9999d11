"""One tenant floods a service in every way it can; another asks for small scores: their times as ratios to idle ones.

    ./run chaos --floods [--connections N] [--scores N]

Each flood is of requests that take seconds and do not say so: large designs disguised, evaluations, gates whose caller
hangs up, a table of eight million cells.  A real service, real keys, real connections.  Beside
the times stands the most memory that the API process held, and how much of it came with the flood: twelve bodies of
8 MB on their way are 96 MB.
"""

from __future__ import annotations

import json
import random
import re
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

from served import served
from service_scenes import ask, client_of, small_design
from test_http_load import LOOK_SECONDS, SMALL, Place, flooded, large, large_gate

from family import forget_peak, peak_bytes
from tailstack.design.write import data_to_yaml
from tailstack_service.tables import MEDIA_TYPES

TIMES = 10.0  # its time on an idle service that a small score may take
JSON, YAML = "application/json", "application/yaml"


@dataclass(frozen=True, slots=True)
class Flood:
    """What one tenant sends again and again; ``looks``: for an answer, after which it hangs up."""

    name: str
    path: str
    media: str
    body: bytes
    looks: int | None = None


@dataclass(frozen=True, slots=True)
class Outcome:
    """What another's small scores took beside a flood, s, how many processes were killed meanwhile, and memory."""

    name: str
    idle: float
    p50: float
    p99: float
    kills: int
    held: int  # bytes by the API process before the flood
    peak: int  # and at most beside it

    @property
    def sound(self) -> bool:
        return self.p99 <= TIMES * self.idle

    def text(self) -> str:
        said = "" if self.sound else f"   over {TIMES:g}"
        return (
            f"  {self.name:<50} p50 {self.p50 / self.idle:5.1f} x idle   p99 {self.p99 / self.idle:5.1f} x idle"
            f"   {self.kills} kills   API {self.peak / 1e6:4.0f} MB ({(self.peak - self.held) / 1e6:+.0f}){said}"
        )


def missed() -> dict[str, Any]:
    """A small design, by its words, of which a score has the exact law of every loss: 466 at five targets."""
    draw = random.Random(1)
    points = [{"position_mm": [draw.uniform(-40, 40), draw.uniform(-40, 40), draw.uniform(-80, 5)]} for _ in range(30)]
    return small_design(
        optimise=None,
        fiducials={"points": points, "loss_probability": 0.01},
        targets=[{"name": f"t{k}", "position_mm": [k, 0, 70]} for k in range(5)],
        requirements=[{"name": "all", "limit_mm": 1.5}],
    )


def list_floods(sha256: str) -> Iterator[Flood]:
    """``sha256``: of a design that the flooding tenant has sent."""
    design = large(50)
    text, one = data_to_yaml(design), json.dumps({"design": design})
    escaped = re.sub(r"^( *(?:- )?)([a-z])([a-z_]*):", lambda m: f'{m[1]}"\\x{ord(m[2]):02x}{m[3]}":', text, flags=re.M)
    gate = json.dumps({"designs": [{"file": "a.yaml", "design": design}], "mode": "analytic"})
    rows = {"design": small_design(), "table": {"/views/0/source_isocentre_mm": [700.0] * 1_000}}
    yield Flood("scores", "/v1/scores", JSON, one.encode())
    yield Flood("scores, YAML in UTF-16", "/v1/scores", YAML, text.encode("utf-16"))
    yield Flood("scores, YAML with escaped keys", "/v1/scores", YAML, escaped.encode())
    yield Flood("scores, second order, escaped", "/v1/scores", JSON,
                one.replace('{"design"', '{"second\\u005forder": true, "design"', 1).encode())  # fmt: skip
    yield Flood("scores of 30 beads that are missed", "/v1/scores", JSON, json.dumps({"design": missed()}).encode())
    yield Flood("gates, mode escaped", "/v1/gates", JSON, gate.replace('"analytic"', '"\\u0061nalytic"').encode())
    yield Flood("gates of 25 designs, hung up after 1.5 s", "/v1/gates", JSON, large_gate(), round(1.5 / LOOK_SECONDS))
    yield Flood("validations", "/v1/validations", YAML, text.encode())
    yield Flood("tables in JSON", "/v1/scores/batch", JSON, json.dumps(rows).encode())
    table = f"/v1/scores/batch?design_sha256={sha256}"
    columns = ",".join(["views.AP.fiducial_noise_px", *(f"c{k}" for k in range(1_900))])
    yield Flood(
        "tables of eight million cells",
        table,
        MEDIA_TYPES["csv"],
        f"{columns}\n{('0.3' + ',' * 1_900 + chr(10)) * 4_000}".encode(),
    )


def seconds_of_small_scores(place: Place, count: int) -> list[float]:
    took = []
    headers = {"Authorization": f"Bearer {place.keys['modest']}", "Content-Type": JSON}
    with client_of(place.service.url, timeout=300, headers=headers) as client:
        for _ in range(count):
            begun = time.perf_counter()
            assert client.post("/v1/scores", content=SMALL).status_code == 200
            took.append(time.perf_counter() - begun)
    return sorted(took)


def run_flood(place: Place, flood: Flood, connections: int, scores: int) -> Outcome:
    """Small scores of one tenant on the idle service, then beside a flood of another's."""
    place.wait_until_quiet()
    idle, before = median(seconds_of_small_scores(place, scores)), place.kills()
    held = forget_peak(place.service.pid)
    begin = partial(place.begin, "greedy", flood.path, flood.body, flood.media)
    with flooded(begin, connections, flood.looks):
        time.sleep(1.0)
        took = seconds_of_small_scores(place, scores)
    slow, peak = took[-max(2, scores // 100)], peak_bytes(place.service.pid)
    return Outcome(flood.name, idle, median(took), slow, place.kills() - before, held, peak)


def run_floods(connections: int, scores: int, tell: Callable[[str], Any] = print) -> bool:
    """Every flood in turn; whether another tenant's small score stayed within ``TIMES`` its idle time in each."""
    sound = True
    with tempfile.TemporaryDirectory(prefix="tailstack-floods-") as folder, served(
        Path(folder), TAILSTACK_AUTH="required", TAILSTACK_SHORT_WORKERS="2", TAILSTACK_MAX_TARGETS="50"
    ) as service:  # fmt: skip
        keys = {
            tenant: service.run("keys", "create", "--tenant", tenant, "--name", "flood", "--scope", "compute").strip()
            for tenant in ("greedy", "modest")
        }
        named = ask(
            "POST", f"{service.url}/v1/validations", json={"design": small_design()}, timeout=300,
            headers={"Authorization": f"Bearer {keys['greedy']}"},
        )  # fmt: skip
        place = Place(service, keys)
        seconds_of_small_scores(place, 10)
        for flood in list_floods(named.json()["design_sha256"]):
            outcome = run_flood(place, flood, connections, scores)
            tell(outcome.text())
            sound = sound and outcome.sound
    return sound

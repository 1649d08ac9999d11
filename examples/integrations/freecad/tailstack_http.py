"""A running tailstack service, and one thread that asks it: standard library only.

The same file lies in each folder of these examples, because each folder is installed by itself.
"""

from __future__ import annotations

import copy
import json
import math
import os
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import quote

ADDRESS = "http://127.0.0.1:8321"
STEP_MM = 0.1  # how far a bead is moved to see what moving it costs

Design = dict[str, Any]


class Refusal(Exception):
    """Why there is no answer, as sentences for the person at the screen; ``pointers`` lead into the design."""

    def __init__(self, sentence: str, pointers: tuple[str, ...] = (), slug: str = "") -> None:
        super().__init__(sentence)
        self.pointers = pointers
        self.slug = slug


class Service:
    """What of the HTTP API is needed here."""

    def __init__(self, address: str = "", seconds: float = 60.0) -> None:
        self.address = (address or os.environ.get("TAILSTACK_URL", "") or ADDRESS).rstrip("/")
        self.seconds = seconds

    def score(self, design: Design, *, losses: bool = True) -> dict[str, Any]:
        """The record of a score (schema tailstack/score/1), ``losses``: with the worst of them.  Raises Refusal."""
        return self._send("/v1/scores", {"design": design, "losses": losses})[1]

    def optimise(self, design: Design, seconds: float = 3600.0) -> dict[str, Any]:
        """The record of an optimisation (schema tailstack/optimisation/1), waited for.  Raises Refusal."""
        until = time.monotonic() + seconds
        status, record = self._send("/v1/optimisations", {"design": design}, {"Prefer": "wait=30"})
        while status == 202:  # a job; its path is the same until it ends
            if time.monotonic() > until:
                raise Refusal(f"the optimiser still works after {seconds:g} s; see tailstack jobs show {record['id']}")
            time.sleep(1.0)
            path = f"/v1/jobs/{record['id']}"
            state = self._send(path)[1]["state"]
            if state not in ("queued", "running"):
                status, record = self._send(f"{path}/result")
        return record

    def read_design(self, name: str, folder: str = "") -> Design:
        """A design from a file (YAML or JSON, relative to a folder), or ``example:NAME`` of the service's."""
        if name.startswith("example:"):
            return self._send("/v1/examples/" + quote(name.removeprefix("example:"), safe=""))[1]
        path = os.path.join(folder, os.path.expanduser(name))
        try:
            with open(path, encoding="utf-8") as file:
                text = file.read()
        except (OSError, UnicodeDecodeError) as error:
            raise Refusal(f"the design {path} cannot be read: {error}") from None
        form = "json" if path.lower().endswith(".json") else "yaml"
        record = self._send("/v1/conversions", {"format": form, "content": text, "to": "json"})[1]
        design: Design = json.loads(record["content"])
        return design

    def _send(self, path: str, body: Any = None, headers: dict[str, str] | None = None) -> tuple[int, dict[str, Any]]:
        data = None if body is None else json.dumps(body, allow_nan=False).encode()
        sent = {"Accept": "application/json", **(headers or {})}
        if data is not None:
            sent["Content-Type"] = "application/json"
        if key := os.environ.get("TAILSTACK_KEY"):
            sent["Authorization"] = f"Bearer {key}"
        try:
            request = urllib.request.Request(self.address + path, data, sent)
            with urllib.request.urlopen(request, timeout=self.seconds) as response:
                return response.status, json.loads(response.read())
        except urllib.error.HTTPError as error:
            raise _read_problem(error) from None
        except (OSError, ValueError) as error:
            reason = getattr(error, "reason", error)
            raise Refusal(
                f"no tailstack service answers at {self.address} ({reason}); start it with: tailstack serve"
            ) from None


def _read_problem(error: urllib.error.HTTPError) -> Refusal:
    """What the service said (RFC 9457): each problem with what cures it."""
    try:
        problem = json.loads(error.read())
        entries = problem.get("errors") or [{"detail": problem["detail"]}]
    except (ValueError, KeyError, TypeError, AttributeError, OSError):
        return Refusal(f"{error.url} answered {error.code} {error.reason}, which is no answer of tailstack")
    sentences = []
    for entry in entries[:5]:
        place = entry.get("pointer") or ""
        hint = entry.get("hint") or ""
        sentences.append(f"{place}: {entry['detail']}".removeprefix(": ") + (f" ({hint})" if hint else ""))
    more = f"; and {len(entries) - 5} more" if len(entries) > 5 else ""
    pointers = tuple(entry.get("pointer") or "" for entry in entries)
    return Refusal("; ".join(sentences) + more, pointers, str(problem.get("type", "")).rpartition("/")[2])


# --- designs --------------------------------------------------------------------------------------------


def with_beads(design: Design, beads: list[tuple[str, tuple[float, float, float]]]) -> Design:
    """The design with other beads: labels, and positions in con, mm.  Whatever else it says of beads stays."""
    changed = copy.deepcopy(design)
    others = {key: value for key, value in changed.get("fiducials", {}).items() if key not in ("file", "origin")}
    own = {point.get("label"): point for point in others.get("points") or ()}
    points = [{**own.get(label, {}), "label": label, "position_mm": list(position)} for label, position in beads]
    changed["fiducials"] = {**others, "points": points}
    return changed


def find_places(design: Any, path: str) -> list[tuple[Any, Any]]:
    """Where a path leads (``views.*.fiducial_noise_px``): containers, and the key in each.  Raises Refusal."""
    *steps, last = path.split(".")
    nodes = [design]
    for step in steps:
        nodes = [node[key] for node in nodes for key in _find_keys(node, step)]
    places = [(node, key) for node in nodes for key in _find_keys(node, last)]
    if not places:
        raise Refusal(f"the path {path} leads nowhere in the design; paths are written as for tailstack sweep --set")
    return places


def _find_keys(node: Any, step: str) -> list[Any]:
    """Fields of a mapping, or elements of a list by number, name or label; ``*`` is every one."""
    if isinstance(node, dict):
        return list(node) if step == "*" else [step] if step in node else []
    if not isinstance(node, list):
        return []
    if step == "*" or step.isdecimal():
        return [k for k in range(len(node)) if step in ("*", str(k))]
    items = [(k, item) for k, item in enumerate(node) if isinstance(item, dict)]
    return [k for k, item in items if step in (item.get("name"), item.get("label"))]


# --- what a score says ----------------------------------------------------------------------------------


def pick_target(score: dict[str, Any]) -> dict[str, Any]:
    """The target that decides: the one nearest to its limit or farthest above it, or with the largest P95."""
    targets: list[dict[str, Any]] = score["targets"]
    return max(targets, key=lambda target: (target["p95_mm"] / target["limit_mm"] if target.get("limit_mm") else 0.0,
                                            target["p95_mm"]))  # fmt: skip


def weigh_beads(service: Service, design: Design, target: dict[str, Any]) -> Iterator[tuple[str, float, float]]:
    """For each bead: its label, P95 without it (mm; infinite where nothing can be said then), mm per mm that it moves.

    The second is the length of the gradient of P95 by the bead's position, by steps of STEP_MM.  Each bead takes four
    scores.
    """

    def p95_mm(changed: Design) -> float:
        found = [item for item in service.score(changed, losses=False)["targets"] if item["name"] == target["name"]]
        return float(found[0]["p95_mm"])

    points = design["fiducials"]["points"]
    for number, point in enumerate(points):
        try:
            without = p95_mm(_with_points(design, points[:number] + points[number + 1 :]))
        except Refusal as refusal:
            if refusal.slug not in ("invalid-design", "ill-posed-geometry", "limit-exceeded", "method-out-of-range"):
                raise
            without = math.inf
        slopes = []
        for axis in range(3):
            position = list(point["position_mm"])
            position[axis] += STEP_MM
            shifted = {**point, "position_mm": position}
            try:
                after = p95_mm(_with_points(design, [*points[:number], shifted, *points[number + 1 :]]))
            except Refusal as refusal:
                if refusal.slug not in ("invalid-design", "ill-posed-geometry", "method-out-of-range"):
                    raise
                after = math.inf  # a step out of the image, say
            slopes.append((after - target["p95_mm"]) / STEP_MM)
        yield point["label"], without, math.hypot(*slopes)


def _with_points(design: Design, points: list[Any]) -> Design:
    return {**design, "fiducials": {**design["fiducials"], "points": points}}


# --- one request at a time ------------------------------------------------------------------------------


class Latest:
    """A thread that answers the latest question; one that is overtaken is given up after its next answer.

    ``answer`` gives its answers one after the other.  Nobody waits here: a program's own loop calls ``take``.
    """

    def __init__(self, answer: Callable[[Any], Iterator[Any]]) -> None:
        self._answer = answer
        self._wake = threading.Condition()
        self._question: Any = None
        self._asked = 0
        self._answered = 0
        self._answers: list[tuple[Any, Any]] = []
        self._thread: threading.Thread | None = None

    def ask(self, question: Any) -> None:
        """Put a question; what was asked before is of no interest any more."""
        with self._wake:
            self._question = question
            self._asked += 1
            self._answers.clear()
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name="tailstack", daemon=True)
                self._thread.start()
            self._wake.notify()

    def take(self) -> list[tuple[Any, Any]]:
        """What has been answered of the latest question: (question, answer or exception), oldest first."""
        with self._wake:
            answers, self._answers = self._answers, []
            return answers

    @property
    def is_busy(self) -> bool:
        """Whether the latest question is not answered to its end."""
        with self._wake:
            return self._answered < self._asked

    def _work(self) -> None:
        while True:
            with self._wake:
                while self._answered == self._asked:
                    self._wake.wait()
                number, question = self._asked, self._question
            try:
                for answer in self._answer(question):
                    if not self._keep(number, question, answer):
                        break
            except Exception as error:  # told to the person at the screen, by whoever takes it
                self._keep(number, question, error)
            with self._wake:
                self._answered = max(self._answered, number)

    def _keep(self, number: int, question: Any, answer: Any) -> bool:
        """Hand over an answer, unless something newer was asked."""
        with self._wake:
            if number == self._asked:
                self._answers.append((question, answer))
            return number == self._asked

"""A job computed on an engine here and now, without a database: asked, computed unit by unit, answered."""

from __future__ import annotations

import json
import time
import uuid
from collections import deque
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from typing import Any

from tailstack.errors import (
    DesignError,
    IllPosedError,
    InfeasibleError,
    LimitError,
    NotConvergedError,
    OutOfRangeError,
    Problem,
    TailstackError,
)

from ..problems import RequestError
from ..processes.frames import Died, GivenBack
from ..task import ADVANCE, Outcome, Task, UnitResult
from .engines.engine import Engine

PATIENCE_SECONDS = 60.0  # for an engine that has nothing to compute with
LOOK_SECONDS = 0.1
MOST_DEATHS, MOST_ATTEMPTS = 5, 25  # of one unit
EXIT_CODES = {
    kind.slug: kind.exit_code
    for kind in (
        DesignError, IllPosedError, InfeasibleError, LimitError, NotConvergedError, OutOfRangeError, RequestError,
    )
}  # fmt: skip

Report = Callable[[int, int], None]


class RefusedJob(TailstackError):
    """The problem document of a job that was refused, as an exception."""

    def __init__(self, document: dict[str, Any], exit_code: int) -> None:
        optional = {"file": None, "line": None, "column": None}
        super().__init__([Problem(**{**optional, **entry}) for entry in document["errors"]])
        self.slug, self.title, self.exit_code = document["type"].rpartition("/")[2], document["title"], exit_code


@dataclass(slots=True)
class _Unit:
    spec: bytes
    deaths: int = 0
    attempts: int = 0


def compute_job(engine: Engine, kind: str, request: bytes, report: Report | None = None) -> bytes:
    """The answer of a job, as its service would record it.

    request: canonical JSON.  ``report(done, expected)`` after every unit.  A unit whose process dies is computed again,
    up to ``MOST_DEATHS`` times.  Raises RefusedJob, and NotConvergedError where the engine has nothing to compute with
    or a unit takes every process with it.
    """
    results: list[UnitResult] = []
    while True:
        outcome = _compute_units(engine, kind, request, [ADVANCE], tuple(results), None)[0]
        if outcome.problem is not None:
            raise _read_refusal(outcome.problem)
        if outcome.answer is not None:
            return outcome.answer
        total = len(results) + len(outcome.more) + outcome.remaining
        done = len(results)

        def one_more(count: int, done: int = done, total: int = total) -> None:
            if report is not None:
                report(done + count, total)

        for spec, part in zip(
            outcome.more, _compute_units(engine, kind, request, outcome.more, (), one_more), strict=True
        ):
            if part.problem is not None:
                raise _read_refusal(part.problem)
            assert part.result is not None
            results.append(UnitResult(len(results), spec, part.result))


def _compute_units(
    engine: Engine, kind: str, request: bytes, specs: tuple[bytes, ...] | list[bytes], results: tuple[UnitResult, ...],
    report: Callable[[int], None] | None,
) -> list[Outcome]:  # fmt: skip
    """Outcomes of units in their order; twice as many are under way as can be computed side by side."""
    prefix = uuid.uuid4().hex
    waiting = deque((place, _Unit(spec)) for place, spec in enumerate(specs))
    away: dict[Future[Outcome], tuple[int, _Unit]] = {}
    found: dict[int, Outcome] = {}
    idle_since = time.monotonic()
    try:
        while len(found) < len(specs):
            while waiting and len(away) < 2 * engine.capacity:
                place, unit = waiting.popleft()
                unit.attempts += 1
                task = Task(kind, request, unit.spec, results)
                away[engine.submit(task, f"{prefix}-{place}-{unit.attempts}")] = place, unit
            if not away:
                if time.monotonic() - idle_since > PATIENCE_SECONDS:
                    raise _stuck_error(
                        f"engine {engine.name} has had nothing to compute with for {PATIENCE_SECONDS:.0f} s"
                    )
                time.sleep(LOOK_SECONDS)
                continue
            done, _ = wait(away, timeout=LOOK_SECONDS, return_when=FIRST_COMPLETED)
            for future in done:
                place, unit = away.pop(future)
                idle_since = time.monotonic()
                outcome = _take_outcome(future, unit)
                if outcome is None:
                    waiting.appendleft((place, unit))
                    continue
                found[place] = outcome
                if report is not None:
                    report(len(found))
    finally:
        for future in away:
            engine.kill(future)
    return [found[place] for place in range(len(specs))]


def _take_outcome(future: Future[Outcome], unit: _Unit) -> Outcome | None:
    """None where it is to be computed again.  Raises NotConvergedError, Defect."""
    try:
        return future.result()
    except Died as error:
        unit.deaths += 1
        if unit.deaths >= MOST_DEATHS:
            raise _stuck_error(f"{unit.deaths} processes ended under the same unit: {error}") from None
    except GivenBack as error:
        if unit.attempts >= MOST_ATTEMPTS:
            raise _stuck_error(f"a unit was given back {unit.attempts} times: {error}") from None
        time.sleep(LOOK_SECONDS)
    return None


def _stuck_error(detail: str) -> NotConvergedError:
    return NotConvergedError(Problem("", "engine", detail, "look at the engine, or leave --engine out"))


def _read_refusal(content: bytes) -> RefusedJob:
    document = json.loads(content)
    return RefusedJob(document, EXIT_CODES.get(document["type"].rpartition("/")[2], TailstackError.exit_code))

"""A job computed on an engine here and now, without a database: asked, computed unit by unit, answered."""

from __future__ import annotations

import json
import uuid
from collections import deque
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, wait

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

from ..clock import SYSTEM_CLOCK, Clock
from ..problems import RefusedAt, RequestError
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


def compute_job(
    engine: Engine, kind: str, request: bytes, report: Report | None = None, *, clock: Clock = SYSTEM_CLOCK
) -> bytes:
    """The answer of a job, as its service would record it.

    request: canonical JSON.  ``report(done, expected)`` after every unit.  A unit whose process dies is computed again,
    up to ``MOST_DEATHS`` times.  Raises RefusedAt, and NotConvergedError where the engine has nothing to compute with
    or a unit takes every process with it.
    """
    results: list[UnitResult] = []
    while True:
        (step,) = _compute_units(engine, [Task(kind, request, ADVANCE, tuple(results))], lambda count: None, clock)
        if step.answer is not None:
            return step.answer
        done, expected = len(results), len(results) + len(step.more) + step.remaining

        def report_units(count: int, done: int = done, expected: int = expected) -> None:
            if report is not None:
                report(done + count, expected)

        outcomes = _compute_units(engine, [Task(kind, request, spec) for spec in step.more], report_units, clock)
        for spec, outcome in zip(step.more, outcomes, strict=True):
            assert outcome.result is not None
            results.append(UnitResult(len(results), spec, outcome.result))


def _compute_units(engine: Engine, tasks: list[Task], report: Callable[[int], None], clock: Clock) -> list[Outcome]:
    """Outcomes in the order of their tasks; twice as many are under way as can be computed side by side.

    Raises RefusedAt for the first that is a refusal, NotConvergedError, Defect.
    """
    prefix = uuid.uuid4().hex
    waiting = deque(range(len(tasks)))
    attempts, deaths = [0] * len(tasks), [0] * len(tasks)
    away: dict[Future[Outcome], int] = {}
    outcomes: dict[int, Outcome] = {}
    busy_at = clock.monotonic()
    try:
        while len(outcomes) < len(tasks):
            while waiting and len(away) < 2 * engine.capacity:
                number = waiting.popleft()
                attempts[number] += 1
                away[engine.submit(tasks[number], f"{prefix}-{number}-{attempts[number]}")] = number
            if not away:
                if clock.monotonic() - busy_at > PATIENCE_SECONDS:
                    detail = f"engine {engine.name} has had nothing to compute with for {PATIENCE_SECONDS:.0f} s"
                    raise _stuck_error(detail)
                clock.sleep(LOOK_SECONDS)
                continue
            for future in wait(away, timeout=LOOK_SECONDS, return_when=FIRST_COMPLETED).done:
                number, busy_at = away.pop(future), clock.monotonic()
                try:
                    outcomes[number] = future.result()
                    report(len(outcomes))
                    continue
                except Died as error:
                    deaths[number] += 1
                    if deaths[number] >= MOST_DEATHS:
                        detail = f"{MOST_DEATHS} processes ended under the same unit: {error}"
                        raise _stuck_error(detail) from None
                except GivenBack as error:
                    if attempts[number] >= MOST_ATTEMPTS:
                        raise _stuck_error(f"a unit was given back {MOST_ATTEMPTS} times: {error}") from None
                    clock.sleep(LOOK_SECONDS)
                waiting.appendleft(number)
    finally:
        for future in away:
            engine.kill(future)
    ordered = [outcomes[number] for number in range(len(tasks))]
    for outcome in ordered:
        if outcome.problem is not None:
            raise _read_refusal(outcome.problem)
    return ordered


def _stuck_error(detail: str) -> NotConvergedError:
    return NotConvergedError(Problem("", "engine", detail, "look at the engine, or leave --engine out"))


def _read_refusal(content: bytes) -> RefusedAt:
    """The problem document of a job that was refused, as an exception."""
    document = json.loads(content)
    slug = document["type"].rpartition("/")[2]
    problems = [Problem(**{"file": None, "line": None, "column": None, **entry}) for entry in document["errors"]]
    return RefusedAt(problems, slug, document["title"], EXIT_CODES.get(slug, TailstackError.exit_code))

"""What is handed to a computing process, what comes back, and how a computation can fail.

Tasks and outcomes are frozen records of bytes, the same for every engine.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

NAMED = "design_sha256"  # field of a request, instead of ``design``: a design that was sent before, by its hash
Query = Sequence[tuple[str, str]]  # names and values, in the order in which they were sent
PERFORM = "tailstack_service.operations.perform:perform"  # computes the units of jobs
CHECK = "tailstack_service.operations.perform:check_once"  # calls the kernels that nearly every task needs
ADVANCE = b'{"what":"advance"}'  # the unit that looks at what is recorded and says what comes next


@dataclass(frozen=True, slots=True)
class RawRequest:
    """A body that has arrived, not yet looked into, and the query beside it."""

    form: str  # json, yaml, or the media type of something else that the operation takes
    body: bytes
    query: Query = ()
    base: bytes | None = None  # JSON of the design that the body names by its hash, when it was looked up
    as_job: bool = False  # whoever sent it asks for a job, where it could be answered at once


@dataclass(frozen=True, slots=True)
class UnitResult:
    """A recorded unit: its place in the job, what it was asked, what it found."""

    index: int
    spec: bytes
    result: bytes


@dataclass(frozen=True, slots=True)
class Task:
    """One unit of a job.  Its outcome depends on nothing else."""

    kind: str  # of the job: the name of its operation
    request: bytes  # canonical JSON, as accepted over HTTP
    spec: bytes  # canonical JSON: ADVANCE, or what an earlier advance asked for
    results: tuple[UnitResult, ...] = ()  # advance only: every unit recorded so far, in index order


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a task came to.  Exactly one of ``result``, ``more``, ``answer`` and ``problem`` is set."""

    cpu_seconds: float = 0.0
    result: bytes | None = None  # of a unit that is not an advance
    more: tuple[bytes, ...] = ()  # of an advance: specs of units that can run side by side, none of them recorded yet
    # and none twice; then it is asked again
    answer: bytes | None = None  # of an advance: the job's document, JSON as published
    problem: bytes | None = None  # the request was refused: a ProblemDocument as JSON, without instance
    remaining: int = 0  # of an advance that wants more: units expected after these, as far as is known
    note: str = ""  # of an advance: what comes next, in words


@dataclass(frozen=True, slots=True)
class Estimated:
    """A request that was read by the process that computes it: how long the rest will take, and the rest."""

    seconds: float  # of CPU
    compute: Callable[[], Any]


# States that a job does not leave
ENDED = frozenset({"succeeded", "failed", "cancelled"})


# --- failures ------------------------------------------------------------------------------------------------


class Died(Exception):
    """The process that was computing the task ended under it; no other task was in that process."""


class NotBegun(Died):
    """It ended before it took up the task."""


class PutBack(Exception):
    """The task was read, and the rest, which will take so many seconds, was left for later."""

    def __init__(self, seconds: float) -> None:
        super().__init__(seconds)
        self.seconds = seconds


class Defect(Exception):
    """The task raised what is not a refusal; the text is its traceback."""


class GivenBack(Exception):
    """The task was not computed, and not through any fault of its own."""


class OutOfDate(GivenBack):
    """Not computed, because the files of tailstack are no longer those that this process was started from."""

"""What is handed to a computing process, and what comes back: frozen records of bytes, the same for every engine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

Query = Sequence[tuple[str, str]]  # names and values, in the order in which they were sent
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

    kind: str  # of the job: a key of kinds.KINDS
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

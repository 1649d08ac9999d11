"""The record of a job as a client sees it: ``tailstack/job/1``, and pages of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from ..logs import moment
from ..operations.registry import OPERATIONS
from ..problems import ProblemDocument, ProblemEntry

if TYPE_CHECKING:
    from .store.jobs import Job

State = Literal["queued", "running", "succeeded", "failed", "cancelled"]
KINDS = tuple(operation.name for operation in OPERATIONS.values() if not operation.immediate)
JobKind = Annotated[str, Field(json_schema_extra={"enum": list(KINDS), "x-more-values": True})]
FIRST_GENERATION = 1


@dataclass(frozen=True, slots=True)
class JobProgress:
    """How far a job was when something was last recorded.  ``fraction`` is between 0 and 1."""

    fraction: float
    """How much is done, 0 to 1."""
    units_done: int
    """Units of work whose results are recorded."""
    units_expected: int
    """Units of work in all; grows when the job turns out to be longer."""
    note: str
    """What is being done, in words."""
    eta_seconds: float | None
    """Seconds to the end, at the pace so far; null when nobody can know."""


@dataclass(frozen=True, slots=True)
class JobLinks:
    """Paths of what belongs to a job.  ``result`` and ``report`` are null until it has succeeded."""

    self: str
    """Path of this record."""
    events: str
    """Path of the stream of events."""
    cancel: str
    """Path to post to in order to cancel."""
    result: str | None
    """Path of the result; null until it is there."""
    report: str | None
    """Path of the result as a report; null until it is there."""


@dataclass(frozen=True, slots=True)
class JobDocument:
    """A computation that was accepted.  Times are RFC 3339, UTC."""

    schema: Literal["tailstack/job/1"]
    """Name and version of this record's schema."""
    id: str
    """Id of the job, 26 characters that sort by time."""
    kind: JobKind
    """What is computed."""
    state: State
    """queued, running, or how it ended."""
    design_name: str
    """Name of the design."""
    created_at: str
    """When it was accepted, RFC 3339, UTC."""
    started_at: str | None
    """When a worker first took it, RFC 3339, UTC; null before."""
    finished_at: str | None
    """When it ended, RFC 3339, UTC; null before."""
    solver_version: str
    """Code that computes, or computed, this job: version and the first digits of its sources' SHA-256. All units of a
    job are of one."""
    recomputed: str | None
    """Said when another code took the job over, which then began anew; otherwise null."""
    cpu_seconds: float
    """CPU time of every unit recorded so far, s, those before an upgrade included."""
    progress: JobProgress
    """How far it was when something was last recorded."""
    problem: ProblemDocument | None
    """Why it failed; pointers lead into the request: /design/... Null unless it failed."""
    result_sha256: str | None
    """SHA-256 of the result's bytes, by which it is fetched; null until it is there."""
    links: JobLinks
    """Paths of what belongs to the job."""


@dataclass(frozen=True, slots=True)
class JobPage:
    """Jobs, newest first, and the path of the page after this one."""

    schema: Literal["tailstack/jobs/1"]
    """Name and version of this record's schema."""
    jobs: tuple[JobDocument, ...]
    """Jobs, newest first."""
    next: str | None
    """Path of the page after this one; null on the last."""


def job_document(job: Job, eta_seconds: float | None = None, place: Callable[[str], str] = str) -> JobDocument:
    """The record of a job from its row and, while it runs, the time to its end.

    place: a path of the service as its client sees it.
    """
    path = place(f"/v1/jobs/{job.id}")
    result = place(f"/v1/results/{job.result_sha256}") if job.result_sha256 else None
    problem = None if job.problem is None else problem_of(job.problem)
    return JobDocument(
        schema="tailstack/job/1",
        id=job.id,
        kind=job.kind,
        state=job.state,  # type: ignore[arg-type]
        design_name=job.design_name,
        created_at=moment(job.created_at),
        started_at=None if job.started_at is None else moment(job.started_at),
        finished_at=None if job.finished_at is None else moment(job.finished_at),
        solver_version=job.solver_version,
        recomputed=_describe_restart(job),
        cpu_seconds=round(job.cpu_seconds, 6),
        progress=_progress(job, eta_seconds),
        problem=problem and replace(problem, type=place(problem.type)),
        result_sha256=job.result_sha256,
        links=JobLinks(path, f"{path}/events", f"{path}/cancel", result, f"{result}/report" if result else None),
    )


def problem_of(stored: dict[str, Any]) -> ProblemDocument:
    """A problem document that was stored as plain data."""
    return ProblemDocument(**{**stored, "errors": tuple(ProblemEntry(**entry) for entry in stored["errors"])})


def _describe_restart(job: Job) -> str | None:
    if job.generation == FIRST_GENERATION:
        return None
    times = job.generation - FIRST_GENERATION
    often = "once" if times == 1 else f"{times} times"
    return f"begun anew {often} because another code took it over before it had finished; now {job.solver_version}"


def _progress(job: Job, eta_seconds: float | None) -> JobProgress:
    if job.state == "succeeded":
        return JobProgress(1.0, job.units_done, job.units_done, job.note, None)
    expected = max(job.units_expected, job.units_done, 1)
    # a job that runs is never quite done: its last unit is the one that puts the answer together
    fraction = round(min(job.units_done / expected, 0.999), 4)
    return JobProgress(fraction, job.units_done, expected, job.note, eta_seconds if job.state == "running" else None)

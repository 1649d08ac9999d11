from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.job_kind import check_job_kind
from ..models.job_kind import JobKind
from ..models.job_state import check_job_state
from ..models.job_state import JobState
from typing import cast
from typing import Literal, cast

if TYPE_CHECKING:
    from ..models.job_links import JobLinks
    from ..models.job_progress import JobProgress
    from ..models.problem import Problem


T = TypeVar("T", bound="Job")


@_attrs_define
class Job:
    """A computation that was accepted.  Times are RFC 3339, UTC.

    Attributes:
        schema (Literal['tailstack/job/1']): Name and version of this record's schema.
        id (str): Id of the job, 26 characters that sort by time.
        kind (JobKind): What is computed.
        state (JobState): queued, running, or how it ended.
        design_name (str): Name of the design.
        created_at (str): When it was accepted, RFC 3339, UTC.
        started_at (None | str): When a worker first took it, RFC 3339, UTC; null before.
        finished_at (None | str): When it ended, RFC 3339, UTC; null before.
        solver_version (str): Version of the solver that computes, or computed, this job.
        recomputed (None | str): Said when an upgrade of the solver made the job begin anew; otherwise null.
        cpu_seconds (float): CPU time of every unit recorded so far, s, those before an upgrade included.
        progress (JobProgress): How far a job was when something was last recorded.  ``fraction`` is between 0 and 1.
        problem (None | Problem): Why it failed; pointers lead into the request: /design/... Null unless it failed.
        result_sha256 (None | str): SHA-256 of the result's bytes, by which it is fetched; null until it is there.
        links (JobLinks): Paths of what belongs to a job.  ``result`` and ``report`` are null until it has succeeded.
    """

    schema: Literal["tailstack/job/1"]
    id: str
    kind: JobKind
    state: JobState
    design_name: str
    created_at: str
    started_at: None | str
    finished_at: None | str
    solver_version: str
    recomputed: None | str
    cpu_seconds: float
    progress: JobProgress
    problem: None | Problem
    result_sha256: None | str
    links: JobLinks

    def to_dict(self) -> dict[str, Any]:
        from ..models.job_links import JobLinks  # noqa: PLC0415
        from ..models.job_progress import JobProgress  # noqa: PLC0415
        from ..models.problem import Problem  # noqa: PLC0415

        schema = self.schema

        id = self.id

        kind: str = self.kind

        state: str = self.state

        design_name = self.design_name

        created_at = self.created_at

        started_at: None | str
        started_at = self.started_at

        finished_at: None | str
        finished_at = self.finished_at

        solver_version = self.solver_version

        recomputed: None | str
        recomputed = self.recomputed

        cpu_seconds = self.cpu_seconds

        progress = self.progress.to_dict()

        problem: dict[str, Any] | None
        if isinstance(self.problem, Problem):
            problem = self.problem.to_dict()
        else:
            problem = self.problem

        result_sha256: None | str
        result_sha256 = self.result_sha256

        links = self.links.to_dict()

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "schema": schema,
                "id": id,
                "kind": kind,
                "state": state,
                "design_name": design_name,
                "created_at": created_at,
                "started_at": started_at,
                "finished_at": finished_at,
                "solver_version": solver_version,
                "recomputed": recomputed,
                "cpu_seconds": cpu_seconds,
                "progress": progress,
                "problem": problem,
                "result_sha256": result_sha256,
                "links": links,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.job_links import JobLinks  # noqa: PLC0415
        from ..models.job_progress import JobProgress  # noqa: PLC0415
        from ..models.problem import Problem  # noqa: PLC0415

        d = dict(src_dict)
        schema = cast(Literal["tailstack/job/1"], d.pop("schema"))
        if schema != "tailstack/job/1":
            raise ValueError(f"schema must match const 'tailstack/job/1', got '{schema}'")

        id = d.pop("id")

        kind = check_job_kind(d.pop("kind"))

        state = check_job_state(d.pop("state"))

        design_name = d.pop("design_name")

        created_at = d.pop("created_at")

        def _parse_started_at(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        started_at = _parse_started_at(d.pop("started_at"))

        def _parse_finished_at(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        finished_at = _parse_finished_at(d.pop("finished_at"))

        solver_version = d.pop("solver_version")

        def _parse_recomputed(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        recomputed = _parse_recomputed(d.pop("recomputed"))

        cpu_seconds = d.pop("cpu_seconds")

        progress = JobProgress.from_dict(d.pop("progress"))

        def _parse_problem(data: object) -> None | Problem:
            if data is None:
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                problem_type_0 = Problem.from_dict(data)

                return problem_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(None | Problem, data)

        problem = _parse_problem(d.pop("problem"))

        def _parse_result_sha256(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        result_sha256 = _parse_result_sha256(d.pop("result_sha256"))

        links = JobLinks.from_dict(d.pop("links"))

        job = cls(
            schema=schema,
            id=id,
            kind=kind,
            state=state,
            design_name=design_name,
            created_at=created_at,
            started_at=started_at,
            finished_at=finished_at,
            solver_version=solver_version,
            recomputed=recomputed,
            cpu_seconds=cpu_seconds,
            progress=progress,
            problem=problem,
            result_sha256=result_sha256,
            links=links,
        )

        return job

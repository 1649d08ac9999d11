"""What programs do with the generated Python client: the main job against a real service, typed throughout.

Imported only where the client has been made: test_generated_client.py makes it, has mypy read this file beside it, and
calls every public function here with the fixtures that its arguments name.
"""

from __future__ import annotations

import hashlib
from contextlib import closing
from pathlib import Path

import httpx
import pytest
from served import Served
from service_scenes import ask, client_with, small_design, sound_design
from tailstack_client import AuthenticatedClient, Client
from tailstack_client.api.computations import (
    create_gate,
    create_optimisation,
    create_score,
    create_sweep,
    create_validation,
    create_verification,
)
from tailstack_client.api.information import get_problem_type, get_readiness
from tailstack_client.api.jobs import cancel_job, get_job, list_jobs
from tailstack_client.api.results import get_report, get_result
from tailstack_client.models import (
    Axis,
    Design,
    Gate,
    GateRequest,
    Job,
    JobPage,
    OptimisationRequest,
    Problem,
    ProblemType,
    Readiness,
    Score,
    ScoreRequest,
    Sweep,
    SweepRequest,
    Validation,
    ValidationRequest,
    Verification,
    VerificationRequest,
)
from tailstack_client.types import File

from tailstack_service.jobs.store.keys import create_key
from tailstack_service.jobs.store.schema import open_database
from tailstack_service.settings import Settings
from waiting import LIMIT_SECONDS, until


def _design(**changes: object) -> Design:
    return Design.from_dict(small_design(**changes))


def _awaited(client: AuthenticatedClient, job: object) -> Job:
    """The job when it has ended."""
    assert isinstance(job, Job)
    seen = [job]

    def ended() -> bool:
        now = get_job.sync(seen[-1].id, client=client)
        assert isinstance(now, Job)
        seen.append(now)
        return now.state not in ("queued", "running")

    until(ended, says=lambda: seen[-1])
    return seen[-1]


def service_is_ready(client: AuthenticatedClient) -> None:
    readiness = get_readiness.sync(client=client)
    assert isinstance(readiness, Readiness)
    assert readiness.status == "ready"


def main_job(client: AuthenticatedClient) -> None:
    """Validate, score, submit a check, poll, fetch the result and its report."""
    validation = create_validation.sync(client=client, body=ValidationRequest(_design()))
    assert isinstance(validation, Validation)
    assert validation.fiducials == 8
    score = create_score.sync(client=client, body=ScoreRequest(_design(), second_order=False))
    assert isinstance(score, Score)
    job = _awaited(
        client, create_verification.sync(client=client, body=VerificationRequest(_design(), trials=20_000, seed=7))
    )
    assert (job.state, job.kind, job.problem) == ("succeeded", "verification", None)
    assert job.progress.fraction == 1.0
    assert job.result_sha256 is not None
    response = get_result.sync_detailed(job.result_sha256, client=client)
    assert hashlib.sha256(response.content).hexdigest() == job.result_sha256
    check = response.parsed
    assert isinstance(check, Verification)
    low, high = check.targets[0].p95_interval_mm
    assert low < check.targets[0].p95_mm < high
    # two independent ways to one number: 20,000 trials know it to about a percent, the linear law to less here
    assert score.targets[0].p95_mm == pytest.approx(check.targets[0].p95_mm, rel=0.03)
    report = get_report.sync_detailed(job.result_sha256, client=client)
    assert report.status_code == 200
    assert report.content.lstrip().lower().startswith(b"<!doctype html")


def a_report_arrives_as_it_was_sent(service: Served, client: AuthenticatedClient) -> None:
    """Byte for byte, in every format."""
    body = VerificationRequest(_design(), trials=2000, seed=8)
    job = _awaited(client, create_verification.sync(client=client, body=body))
    assert job.result_sha256 is not None
    for form in ("html", "pdf", "xlsx", "json"):
        report = get_report.sync(job.result_sha256, client=client, format_=form)  # type: ignore[arg-type]
        assert isinstance(report, File), report
        url = f"{service.url}/v1/results/{job.result_sha256}/report?format={form}"
        assert report.payload.read() == ask("GET", url).content  # type: ignore[union-attr]


def waiting_gives_the_result_at_once(client: AuthenticatedClient) -> None:
    body = VerificationRequest(_design(), trials=5000, seed=3)
    answer = create_verification.sync(client=client, body=body, prefer="wait=60")
    assert isinstance(answer, Verification)
    assert (answer.seed, answer.trials) == (3, 5000)


def a_key_makes_one_job(client: AuthenticatedClient) -> None:
    body = VerificationRequest(_design(), trials=5000, seed=4)
    first, second = (create_verification.sync(client=client, body=body, idempotency_key="once") for _ in range(2))
    assert isinstance(first, Job)
    assert isinstance(second, Job)
    assert first.id == second.id
    other = VerificationRequest(_design(), trials=5000, seed=5)
    refused = create_verification.sync(client=client, body=other, idempotency_key="once")
    assert isinstance(refused, Problem)
    assert refused.status == 422


def sweep_and_gate(client: AuthenticatedClient) -> None:
    axis = Axis(pointer="/views/0/fiducial_noise_px", values=[0.1, 0.2, 0.4])
    job = _awaited(client, create_sweep.sync(client=client, body=SweepRequest(design=_design(), axes=[axis])))
    assert job.result_sha256 is not None
    assert isinstance(get_result.sync(job.result_sha256, client=client), Sweep)
    request = GateRequest.from_dict({"designs": [{"file": "a.yaml", "design": sound_design()}], "mode": "analytic"})
    gate = create_gate.sync(client=client, body=request)
    assert isinstance(gate, Gate)
    assert gate.exit_code == 0


def jobs_are_listed_and_cancelled(client: AuthenticatedClient) -> None:
    job = create_optimisation.sync(client=client, body=OptimisationRequest(_design(), seed=1, starts=4))
    assert isinstance(job, Job)
    cancelled = cancel_job.sync(job.id, client=client)
    assert isinstance(cancelled, Job)
    assert cancelled.state == "cancelled"
    page = list_jobs.sync(client=client, state="cancelled", limit=200)
    assert isinstance(page, JobPage)
    assert job.id in [entry.id for entry in page.jobs]
    again = get_job.sync("0" * 26, client=client)
    assert isinstance(again, Problem)
    assert again.status == 404


def a_refused_design_is_a_typed_problem(client: AuthenticatedClient) -> None:
    broken = small_design()
    broken["views"][0]["fiducial_noise_px"] = -1
    problem = create_score.sync(client=client, body=ScoreRequest(Design.from_dict(broken)))
    assert isinstance(problem, Problem)
    assert (problem.status, problem.type_) == (422, "/v1/problems/invalid-design")
    assert [entry.pointer for entry in problem.errors] == ["/design/views/0/fiducial_noise_px"]
    meaning = get_problem_type.sync(problem.type_.rpartition("/")[2], client=client)
    assert isinstance(meaning, ProblemType)
    assert meaning.status == problem.status


def a_job_that_fails_carries_its_problem(client: AuthenticatedClient) -> None:
    """No design within this box can meet a limit of a nanometre."""
    hopeless = _design(requirements=[{"name": "tip-accuracy", "limit_mm": 1e-6}])
    job = _awaited(
        client, create_optimisation.sync(client=client, body=OptimisationRequest(hopeless, seed=1, starts=1))
    )
    assert job.state == "failed"
    assert isinstance(job.problem, Problem)
    assert job.problem.type_ == "/v1/problems/infeasible"


def a_client_with_a_key_is_told_who_is_missing(tmp_path: Path) -> None:
    settings = Settings(auth="required", database=f"sqlite:///{tmp_path / 'jobs.sqlite3'}")
    with client_with(settings) as guarded:
        with closing(open_database(settings.database_url)) as db:
            _, key = create_key(db, tenant="a", name="test", scopes=("read",), days=1.0)
        url, patience = str(guarded.base_url), httpx.Timeout(LIMIT_SECONDS)
        with Client(base_url=url, timeout=patience) as nobody:
            refused = list_jobs.sync(client=nobody)  # type: ignore[arg-type]
            assert isinstance(refused, Problem)
            assert refused.status == 401
        with AuthenticatedClient(base_url=url, token=key, timeout=patience) as somebody:
            assert isinstance(list_jobs.sync(client=somebody), JobPage)

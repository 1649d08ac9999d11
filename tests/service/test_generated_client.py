"""The generated clients: not stale, and the Python one does the main job against a real service, typed throughout."""

from __future__ import annotations

import hashlib
import io
import json
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from html.parser import HTMLParser
from pathlib import Path
from typing import cast

import generate
import httpx
import node
import openpyxl
import pytest
from answers import ANSWERS, answers, differences, shape
from openapi_scenes import DOCUMENT, OPENAPI, needs_node
from pypdf import PdfReader
from served import Served, served
from service_scenes import client_with, coplanar_design, small_design
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

SECONDS = 300.0  # a cold compile cache takes a while
LARGEST_BYTES, MOST_FILES = 1_500_000, 300


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("client")) as service:
        yield service


@pytest.fixture(scope="module")
def client(service: Served) -> Iterator[AuthenticatedClient]:
    with Client(base_url=service.url, raise_on_unexpected_status=True, timeout=60) as client:  # type: ignore[arg-type]
        yield cast(AuthenticatedClient, client)  # nobody is asked for a key here


def design(**changes: object) -> Design:
    return Design.from_dict(small_design(**changes))


def awaited(client: AuthenticatedClient, job: object) -> Job:
    """The job when it has ended."""
    assert isinstance(job, Job)
    deadline = time.monotonic() + SECONDS
    while job.state in ("queued", "running"):
        assert time.monotonic() < deadline, job
        time.sleep(0.05)
        job = get_job.sync(job.id, client=client)
        assert isinstance(job, Job)
    return job


# --- not stale ----------------------------------------------------------------------------------------


def files_of(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and "__pycache__" not in path.parts
    }


@pytest.mark.long
def test_python_client_is_the_generated_one(tmp_path: Path) -> None:
    generate.make_python(tmp_path)
    assert files_of(generate.PYTHON) == files_of(tmp_path), "repeat: python openapi/generate.py"


def test_python_client_is_small_and_imports_whole() -> None:
    files = [path for path in generate.PYTHON.rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    assert len(files) < MOST_FILES
    assert sum(path.stat().st_size for path in files) < LARGEST_BYTES
    modules = sorted(
        ".".join(path.relative_to(generate.PYTHON).with_suffix("").parts) for path in files if path.suffix == ".py"
    )
    code = "\n".join(f"import {module.removesuffix('.__init__')}" for module in modules)
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], cwd=generate.PYTHON, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr


def test_every_operation_has_a_call_but_the_stream() -> None:
    made = {path.stem for path in (generate.PYTHON / "tailstack_client" / "api").rglob("*.py")} - {"__init__"}
    named = {operation["operationId"] for item in DOCUMENT["paths"].values() for operation in item.values()}
    assert named - made == {"get_job_events"}
    assert made <= named


@pytest.mark.long
@needs_node
def test_typescript_types_are_the_generated_ones(tmp_path: Path) -> None:
    generate.make_typescript(tmp_path / "tailstack.d.ts")
    assert (tmp_path / "tailstack.d.ts").read_bytes() == generate.TYPES.read_bytes(), (
        "repeat: python openapi/generate.py"
    )


@pytest.mark.long
@needs_node
def test_typescript_example_has_the_right_types() -> None:
    done = node.run("tsc", "--project", OPENAPI / "typescript")
    assert done.returncode == 0, done.stdout


WRONG = {
    "an option of another type": ("second_order: false", 'second_order: "no"'),
    "a field that is not there": ("job.progress.fraction", "job.progress.percentage"),
    "a state that is none": ('"queued"', '"waiting"'),
    "an option that is none": ("precision: 0.01, ", "precision: 0.01, colour: 3, "),
    "another answer": ('components["schemas"]["Verification"]', 'components["schemas"]["Check"]'),
    "another status": ("[202]", "[201]"),
    "a number without its unit": ("target.p95_mm", "target.p95"),
    "a result that may be null": ("if (job.links.result === null) ", "if (false) "),
}


@pytest.mark.long
@needs_node
def test_wrong_typescript_programs_are_refused(tmp_path: Path) -> None:
    """The example with one thing changed, many times over, in one run of the compiler."""
    example = (OPENAPI / "typescript" / "example.ts").read_text(encoding="utf-8")
    (tmp_path / "tailstack.d.ts").write_bytes(generate.TYPES.read_bytes())
    for number, (right, wrong) in enumerate(WRONG.values()):
        assert right in example
        (tmp_path / f"wrong{number}.ts").write_text(example.replace(right, wrong), encoding="utf-8")
    settings = json.loads((OPENAPI / "typescript" / "tsconfig.json").read_text(encoding="utf-8"))
    settings["files"] = [f"wrong{number}.ts" for number in range(len(WRONG))]
    (tmp_path / "tsconfig.json").write_text(json.dumps(settings), encoding="utf-8")
    done = node.run("tsc", "--project", tmp_path)
    assert done.returncode != 0
    found = {int(number) for number in re.findall(r"wrong(\d+)\.ts\(\d+,\d+\): error TS", done.stdout)}
    assert found == set(range(len(WRONG))), done.stdout


# --- the main job -------------------------------------------------------------------------------------


@pytest.mark.long
def test_service_is_ready(client: AuthenticatedClient) -> None:
    readiness = get_readiness.sync(client=client)
    assert isinstance(readiness, Readiness)
    assert readiness.status == "ready"


@pytest.mark.long
def test_main_job(client: AuthenticatedClient) -> None:
    """Validate, score, submit a check, poll, fetch the result and its report."""
    validation = create_validation.sync(client=client, body=ValidationRequest(design()))
    assert isinstance(validation, Validation)
    assert validation.fiducials == 8
    score = create_score.sync(client=client, body=ScoreRequest(design(), second_order=False))
    assert isinstance(score, Score)
    job = awaited(
        client, create_verification.sync(client=client, body=VerificationRequest(design(), trials=20_000, seed=7))
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


@pytest.mark.long
def test_a_report_arrives_whole_in_every_format(service: Served, client: AuthenticatedClient) -> None:
    """As it was sent, byte for byte, and other programs can open it."""
    body = VerificationRequest(design(), trials=2000, seed=8)
    job = awaited(client, create_verification.sync(client=client, body=body))
    assert job.result_sha256 is not None
    found: dict[str, bytes] = {}
    for form in ("html", "pdf", "xlsx", "json"):
        report = get_report.sync(job.result_sha256, client=client, format_=form)  # type: ignore[arg-type]
        assert isinstance(report, File), report
        found[form] = report.payload.read()  # type: ignore[union-attr]
        url = f"{service.url}/v1/results/{job.result_sha256}/report?format={form}"
        assert found[form] == httpx.get(url, trust_env=False, timeout=60).content

    pages = PdfReader(io.BytesIO(found["pdf"]), strict=True).pages
    assert "eight beads, two seats" in pages[0].extract_text()
    assert len(pages) >= 2
    book = openpyxl.load_workbook(io.BytesIO(found["xlsx"]))
    cells = [book["Record"].cell(row, 1).value for row in range(2, book["Record"].max_row + 1)]
    records = [json.loads(found["json"]), json.loads("".join(cells))]
    page = record_in_page(found["html"])
    assert [record["schema"] for record in records] == ["tailstack/verification/1"] * 2
    assert records[0] == records[1] == page


def record_in_page(html: bytes) -> object:
    """independent: the record in a page, by the parser of the standard library."""
    texts: list[str] = []

    class Reader(HTMLParser):
        inside = False

        def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
            self.inside = dict(attributes).get("id") == "tailstack-record"

        def handle_data(self, data: str) -> None:
            texts.extend([data] if self.inside else [])

    Reader().feed(html.decode())
    return json.loads("".join(texts))


def test_waiting_gives_the_result_at_once(client: AuthenticatedClient) -> None:
    body = VerificationRequest(design(), trials=5000, seed=3)
    answer = create_verification.sync(client=client, body=body, prefer="wait=60")
    assert isinstance(answer, Verification)
    assert (answer.seed, answer.trials) == (3, 5000)


def test_a_key_makes_one_job(client: AuthenticatedClient) -> None:
    body = VerificationRequest(design(), trials=5000, seed=4)
    first, second = (create_verification.sync(client=client, body=body, idempotency_key="once") for _ in range(2))
    assert isinstance(first, Job)
    assert isinstance(second, Job)
    assert first.id == second.id
    other = VerificationRequest(design(), trials=5000, seed=5)
    refused = create_verification.sync(client=client, body=other, idempotency_key="once")
    assert isinstance(refused, Problem)
    assert refused.status == 422


def test_sweep_and_gate(client: AuthenticatedClient) -> None:
    axis = Axis(pointer="/views/0/fiducial_noise_px", values=[0.1, 0.2, 0.4])
    job = awaited(client, create_sweep.sync(client=client, body=SweepRequest(design=design(), axes=[axis])))
    assert job.result_sha256 is not None
    assert isinstance(get_result.sync(job.result_sha256, client=client), Sweep)
    request = GateRequest.from_dict({"designs": [{"file": "a.yaml", "design": small_design()}], "mode": "analytic"})
    gate = create_gate.sync(client=client, body=request)
    assert isinstance(gate, Gate)
    assert gate.exit_code == 0


def test_jobs_are_listed_and_cancelled(client: AuthenticatedClient) -> None:
    job = create_optimisation.sync(client=client, body=OptimisationRequest(design(), seed=1, starts=4))
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


def test_a_refused_design_is_a_typed_problem(client: AuthenticatedClient) -> None:
    broken = small_design()
    broken["views"][0]["fiducial_noise_px"] = -1
    problem = create_score.sync(client=client, body=ScoreRequest(Design.from_dict(broken)))
    assert isinstance(problem, Problem)
    assert (problem.status, problem.type_) == (422, "/v1/problems/invalid-design")
    assert [entry.pointer for entry in problem.errors] == ["/design/views/0/fiducial_noise_px"]
    meaning = get_problem_type.sync(problem.type_.rpartition("/")[2], client=client)
    assert isinstance(meaning, ProblemType)
    assert meaning.status == problem.status


def test_what_only_computing_finds_is_a_typed_problem_too(client: AuthenticatedClient) -> None:
    """Eight fiducials in one plane fit the schema and determine no projection."""
    body = VerificationRequest(Design.from_dict(coplanar_design()))
    problem = create_verification.sync(client=client, body=body)
    assert isinstance(problem, Problem)
    assert problem.type_ == "/v1/problems/ill-posed-geometry"
    assert problem.errors[0].hint


@pytest.mark.long
def test_a_job_that_fails_carries_its_problem(client: AuthenticatedClient) -> None:
    """No design within this box can meet a limit of a nanometre."""
    hopeless = design(requirements=[{"name": "tip-accuracy", "limit_mm": 1e-6}])
    job = awaited(client, create_optimisation.sync(client=client, body=OptimisationRequest(hopeless, seed=1, starts=1)))
    assert job.state == "failed"
    assert isinstance(job.problem, Problem)
    assert job.problem.type_ == "/v1/problems/infeasible"


def test_a_client_with_a_key_is_told_who_is_missing(tmp_path: Path) -> None:
    settings = Settings(auth="required", database=f"sqlite:///{tmp_path / 'jobs.sqlite3'}")
    with client_with(settings) as guarded:
        with closing(open_database(settings.database_url)) as db:
            _, key = create_key(db, tenant="a", name="test", scopes=("read",), days=1.0)
        with Client(base_url=str(guarded.base_url)) as nobody:
            refused = list_jobs.sync(client=nobody)  # type: ignore[arg-type]
            assert isinstance(refused, Problem)
            assert refused.status == 401
        with AuthenticatedClient(base_url=str(guarded.base_url), token=key) as somebody:
            assert isinstance(list_jobs.sync(client=somebody), JobPage)


@pytest.mark.long
def test_committed_examples_of_answers_have_the_form_of_the_answers(service: Served) -> None:
    """What a service answers today is what the document shows; the optimiser's path is the processor's own."""
    fresh = dict(answers(DOCUMENT, service.url))
    shown = {path.stem: json.loads(path.read_text("utf-8")) for path in ANSWERS.glob("*.json")}
    again = "repeat: python openapi/answers.py URL"
    assert set(fresh) == set(shown), again
    for name, answer in fresh.items():
        assert shape(answer) == shape(shown[name]), f"{name}: {again}"
        if name != "create_optimisation":
            assert list(differences(answer, shown[name])) == [], f"{name}: {again}"
    best = [found["create_optimisation"]["cost_after"] for found in (fresh, shown)]
    assert best[0] == pytest.approx(best[1], rel=0.01)


def test_an_answer_that_says_something_else_would_be_noticed() -> None:
    shown = json.loads((ANSWERS / "create_score.json").read_text("utf-8"))
    fresh = json.loads(json.dumps(shown))
    fresh["targets"][0]["p95_mm"] *= 1.0001
    fresh["targets"][0]["bias_mm"][2] += 1e-12
    fresh["verdict"]["status"] = "fail"
    fresh["provenance"]["tailstack_version"] = "9"
    assert [line.split(":")[0] for line in differences(fresh, shown)] in (
        ["/targets/0/p95_mm", "/verdict/status"], ["/verdict/status", "/targets/0/p95_mm"]
    )  # fmt: skip

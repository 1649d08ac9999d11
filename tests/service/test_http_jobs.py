"""Jobs over HTTP with a worker beside the service: posted, waited for, followed, cancelled; results and their names."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import httpx
import pytest
from jsonschema import Draft202012Validator
from openapi_scenes import ended_job
from service_scenes import check_problem, client_with, limited, small_design
from starlette.requests import Request

import tailstack
import tailstack_service
from plain_data import read_cases
from tailstack import load_design, verify
from tailstack.design.write import data_to_yaml
from tailstack.errors import Problem, TailstackError
from tailstack_service.console.remote import RemoteService, ServerSentEvent, read_events
from tailstack_service.documents import to_json
from tailstack_service.http.answers import wait_seconds
from tailstack_service.jobs.store import jobs as stored
from tailstack_service.operations.rendering import MEDIA_TYPES, render
from tailstack_service.problems import StoreError, StoreUnavailable
from tailstack_service.processes.birth import running_code
from tailstack_service.schemas import json_schema
from tailstack_service.settings import Settings
from waiting import LIMIT_SECONDS, until

TOO_MANY = {"design": small_design(), "trials": 1_000_000_000}  # of which 0.8 GB of norms would be recorded
ENDLESS = {"design": small_design(), "trials": 400_000_000}  # minutes of computing
QUICK: dict[str, Any] = {"design": small_design(), "trials": 3000, "seed": 5}
UNKNOWN = "01k4z8t5r2w7x3y9v6n1m0q8pc"
HOST = Settings(max_trials=1_000_000_000, max_wait_seconds=600.0, worker_processes=1, lease_seconds=1.0)
CLIENT = {"settings": HOST, "worker": True}


@pytest.fixture(scope="module")
def without_worker() -> Iterator[httpx.Client]:
    with client_with(Settings(max_queued_jobs=4, max_wait_seconds=0.3)) as client:
        yield client


@pytest.fixture
def idle(without_worker: httpx.Client) -> Iterator[httpx.Client]:
    """A service without a worker: its jobs stay queued, until the test ends."""
    yield without_worker
    for job in without_worker.get("/v1/jobs?state=queued&limit=200").json()["jobs"]:
        assert without_worker.post(job["links"]["cancel"]).status_code == 202


def done(client: httpx.Client, path: str, body: dict[str, Any], **headers: str) -> httpx.Response:
    """A job that is waited for."""
    return client.post(path, json=body, headers={"Prefer": "wait=600", **headers})


def ended(client: httpx.Client, job_id: str) -> dict[str, Any]:
    return ended_job(client, f"/v1/jobs/{job_id}")


def check_job(job: dict[str, Any]) -> dict[str, Any]:
    Draft202012Validator(json_schema("job")).validate(job)
    return job


# --- posted and waited for ------------------------------------------------------------------------


@pytest.mark.long
def test_a_job_from_acceptance_to_its_result(client: httpx.Client) -> None:
    accepted = client.post("/v1/verifications", json=QUICK)
    assert accepted.status_code == 202
    job = check_job(accepted.json())
    assert accepted.headers["location"] == job["links"]["self"] == f"/v1/jobs/{job['id']}"
    assert int(accepted.headers["retry-after"]) >= 1
    assert (job["kind"], job["design_name"], job["result_sha256"]) == ("verification", small_design()["name"], None)
    finished = check_job(ended(client, job["id"]))
    assert (finished["state"], finished["progress"]["fraction"], finished["problem"]) == ("succeeded", 1.0, None)
    assert finished["created_at"] <= finished["started_at"] <= finished["finished_at"]
    redirect = client.get(f"/v1/jobs/{job['id']}/result")
    assert (redirect.status_code, redirect.headers["location"]) == (303, finished["links"]["result"])
    result = client.get(redirect.headers["location"])
    assert hashlib.sha256(result.content).hexdigest() == finished["result_sha256"]
    assert result.content == to_json(verify(load_design(QUICK["design"]), trials=3000, seed=5))
    assert (finished["solver_version"], finished["recomputed"]) == (running_code(), None)


def digest_of(package: ModuleType) -> str:
    """independent: names and contents of its files, hashed here."""
    total, root = hashlib.sha256(), Path(str(package.__file__)).parent
    for path in sorted(root.rglob("*.py"), key=lambda path: str(path)):
        content = path.read_bytes()
        total.update(f"{path.relative_to(root).as_posix()}\0{len(content)}\0".encode() + content)
    return total.hexdigest()


def test_a_record_names_the_sources_that_computed_it_and_a_worker_all_of_them(client: httpx.Client) -> None:
    record = done(client, "/v1/verifications", QUICK).json()
    solver, service = digest_of(tailstack), digest_of(tailstack_service)
    assert record["provenance"]["sources_sha256"] == solver
    every = hashlib.sha256(f"{solver} {service}".encode()).hexdigest()
    assert running_code() == f"{tailstack.__version__}+{every[:12]}"


def test_a_check_to_a_precision_is_that_of_the_command_line_whatever_the_operator_allows(client: httpx.Client) -> None:
    """When the precision is looked at, and so the interval, is the same everywhere."""
    body = {"design": small_design(), "precision": 0.02, "seed": 3}
    expected = to_json(verify(load_design(small_design()), precision=0.02, seed=3))
    assert done(client, "/v1/verifications", body).content == expected
    within = done(client, "/v1/verifications", {**body, "max_trials": 50_000}).json()
    assert within["max_trials"] == 50_000
    assert within["targets"][0]["p95_interval_mm"] != json.loads(expected)["targets"][0]["p95_interval_mm"]


def test_waiting_gives_the_result_itself(client: httpx.Client) -> None:
    response = done(client, "/v1/verifications", QUICK)
    assert response.status_code == 200
    assert response.headers["preference-applied"] == "wait=600"
    sha256 = hashlib.sha256(response.content).hexdigest()
    assert response.headers["content-location"] == f"/v1/results/{sha256}"
    assert response.headers["etag"] == f'"{sha256}"'
    Draft202012Validator(json_schema("verification")).validate(response.json())
    assert client.get(response.headers["location"]).json()["result_sha256"] == sha256


@pytest.mark.parametrize(("asked", "options"), read_cases("http", "queries"))
def test_a_design_as_yaml_with_options_in_the_query(client: httpx.Client, asked: str, options: dict[str, Any]) -> None:
    headers = {"Content-Type": "application/yaml", "Prefer": "wait=600"}
    response = client.post(asked, content=data_to_yaml(small_design()), headers=headers)
    assert response.status_code == 200, response.text
    assert response.content == done(client, asked.partition("?")[0], {"design": small_design(), **options}).content


@pytest.mark.long
def test_a_job_that_fails_answers_with_its_own_problem(client: httpx.Client) -> None:
    body = {"design": limited(0.15), "starts": 1}  # no contradiction in itself; only the search finds that nothing can
    response = done(client, "/v1/optimisations", body)
    assert response.status_code == 422, response.text
    waited = check_problem(response, 422, "infeasible")
    job = ended(client, response.headers["location"].rpartition("/")[2])
    assert (job["state"], job["problem"]["type"]) == ("failed", "/v1/problems/infeasible")
    assert check_problem(client.get(job["links"]["self"] + "/result"), 422, "infeasible")["errors"] == waited["errors"]


@pytest.mark.parametrize(
    ("said", "granted"),
    [
        (["wait=5"], 5), (["wait=60"], 30), (["wait=9999999999"], 30), (["wait=" + "9" * 2000], 30),
        (["wait=0000000000000000000005"], 5), (["wait=0"], 0), (["respond-async", 'WAIT="7"; x=y'], 7),
        (["wait=3, wait=9"], 3), (["wait="], None), (["wait=1.5"], None), (["waits=3"], None), ([], None),
        (["wait=soon"], None), (["wait=-1"], None), (["wait"], None), (["handling=lenient"], None), ([";;=="], None),
    ],
)  # fmt: skip
def test_a_wait_is_cut_to_the_limit(said: list[str], granted: int | None) -> None:
    headers = [(b"prefer", value.encode()) for value in said]
    assert wait_seconds(Request({"type": "http", "headers": headers}), 30.7) == granted


def test_who_cannot_wait_long_enough_gets_the_job(idle: httpx.Client) -> None:
    response = idle.post("/v1/verifications", json=QUICK, headers={"Prefer": "respond-async, wait=60"})
    assert (response.status_code, response.headers["preference-applied"]) == (202, "wait=0")
    unread = idle.post("/v1/verifications", json=QUICK, headers={"Prefer": "wait=soon"})
    assert (unread.status_code, "preference-applied" in unread.headers) == (202, False)


# --- refused before acceptance --------------------------------------------------------------------


def test_axes_of_a_sweep_are_checked_and_its_points_are_their_product(idle: httpx.Client) -> None:
    for axis, pointer, code in (
        ({"pointer": "/views/9/fiducial_noise_px", "values": [1]}, "/axes/0/pointer", None),
        ({"pointer": "/views/0/nothing", "values": [1]}, "/axes/0/pointer", None),
        ({"pointer": "views.AP.nothing", "values": [1]}, "/axes/0/pointer", None),
        ({"pointer": "/name", "values": [1]}, "/axes/0/pointer", None),
        ({"pointer": "/views/0", "values": [1]}, "/axes/0/pointer", None),
        ({"pointer": "/views/0/fiducial_noise_px", "start": 0.1, "stop": 0.2}, "/axes/0", "one-of"),
        ({"pointer": "/views/0/fiducial_noise_px", "values": [], "count": 2}, "/axes/0/values", "too-short"),
        ({"pointer": "/views/0/fiducial_noise_px", "values": [0.1], "count": 2}, "/axes/0", "one-of"),
        ({"pointer": "/views/0/fiducial_noise_px", "start": 0, "stop": 1, "count": 2001}, "/axes", "too-many"),
    ):
        response = idle.post("/v1/sweeps", json={"design": small_design(), "axes": [axis]})
        entry = check_problem(response, 422, "limit-exceeded" if code == "too-many" else "invalid-request")["errors"][0]
        assert entry["pointer"] == pointer
        assert code in (None, entry["code"])
    noise = [{"pointer": f"/views/{k}/fiducial_noise_px", "start": 0.1, "stop": 0.5, "count": 45} for k in (0, 1)]
    response = idle.post("/v1/sweeps", json={"design": small_design(), "axes": noise})
    entry = check_problem(response, 422, "limit-exceeded")["errors"][0]
    assert "45 × 45 = 2025" in entry["detail"]
    assert "TAILSTACK_MAX_SWEEP_POINTS" in entry["hint"]


def test_the_queue_of_a_tenant_is_bounded(idle: httpx.Client) -> None:
    jobs = [idle.post("/v1/verifications", json={**QUICK, "seed": seed}) for seed in range(4)]
    refused = idle.post("/v1/verifications", json=QUICK)
    check_problem(refused, 429, "queue-full")
    assert int(refused.headers["retry-after"]) > 0
    for job in jobs:
        assert idle.post(job.json()["links"]["cancel"]).status_code == 202
    again = idle.post("/v1/verifications", json=QUICK)
    assert again.status_code == 202


@pytest.mark.long
def test_a_tenant_has_so_many_cpu_seconds_an_hour() -> None:
    settings = Settings(cpu_seconds_per_hour=1e-6, worker_processes=1, max_wait_seconds=600.0)
    with client_with(settings, worker=True) as client:
        assert done(client, "/v1/verifications", QUICK).status_code == 200
        refused = client.post("/v1/verifications", json=QUICK)
        check_problem(refused, 429, "cpu-budget")
        assert int(refused.headers["retry-after"]) > 0
        assert client.post("/v1/scores", json={"design": small_design()}).status_code == 200


# --- idempotency ----------------------------------------------------------------------------------


def test_one_key_is_one_job(idle: httpx.Client) -> None:
    key = {"Idempotency-Key": "9b2f4d0c-order-17"}
    first, again = (idle.post("/v1/verifications", json=QUICK, headers=key) for _ in range(2))
    reordered = json.dumps(dict(reversed(QUICK.items()))).encode()
    third = idle.post(
        "/v1/verifications", content=reordered, headers={**key, "Content-Type": "application/json; charset=utf-8"}
    )
    assert {response.json()["id"] for response in (first, again, third)} == {first.json()["id"]}
    assert "idempotency-replayed" not in first.headers
    assert again.headers["idempotency-replayed"] == third.headers["idempotency-replayed"] == "true"
    other = idle.post("/v1/verifications", json={**QUICK, "seed": 6}, headers=key)
    check_problem(other, 422, "idempotency-conflict")
    check_problem(
        idle.post("/v1/optimisations", json={"design": small_design()}, headers=key), 422, "idempotency-conflict"
    )


def test_a_repeated_request_waits_for_the_first_one(client: httpx.Client) -> None:
    key = {"Idempotency-Key": "k" * 255}
    accepted = client.post("/v1/verifications", json=QUICK, headers=key)
    replayed = done(client, "/v1/verifications", QUICK, **key)
    assert (replayed.status_code, replayed.headers["idempotency-replayed"]) == (200, "true")
    assert replayed.headers["location"] == accepted.headers["location"]


def test_what_is_no_key_and_no_event_is_refused(idle: httpx.Client) -> None:
    for key in (b"", b"a b", b"x" * 256, "é".encode(), b"a\tb"):
        response = idle.post("/v1/verifications", json=QUICK, headers=[(b"Idempotency-Key", key)])
        assert check_problem(response, 422, "invalid-request")["errors"][0]["code"] == "bad-header"
    for last in ("x", "-1", "1.5", "9" * 16):
        job = idle.post("/v1/verifications", json={**QUICK, "seed": 70}, headers={"Idempotency-Key": "events"}).json()
        response = idle.get(f"/v1/jobs/{job['id']}/events", headers={"Last-Event-ID": last})
        check_problem(response, 422, "invalid-request")


# --- looked at ------------------------------------------------------------------------------------


def test_a_record_is_read_again_only_when_it_has_changed(client: httpx.Client) -> None:
    job = ended(client, done(client, "/v1/verifications", QUICK).headers["location"].rpartition("/")[2])
    record = client.get(job["links"]["self"])
    tag = record.headers["etag"]
    for sent in (tag, f"W/{tag}", f'"other", {tag}', "*"):
        unchanged = client.get(job["links"]["self"], headers={"If-None-Match": sent})
        assert (unchanged.status_code, unchanged.content, unchanged.headers["etag"]) == (304, b"", tag)
    assert client.get(job["links"]["self"], headers={"If-None-Match": '"other"'}).status_code == 200
    result = client.get(job["links"]["result"])
    assert "immutable" in result.headers["cache-control"]
    unchanged = client.get(job["links"]["result"], headers={"If-None-Match": result.headers["etag"]})
    assert (unchanged.status_code, unchanged.content) == (304, b"")


@pytest.mark.long
def test_a_running_job_tells_how_far_it_is_and_ends_when_it_is_cancelled(client: httpx.Client) -> None:
    job = client.post("/v1/verifications", json=ENDLESS).json()
    until(lambda: client.get(job["links"]["self"]).json()["progress"]["units_done"] >= 3)
    record = client.get(job["links"]["self"]).json()
    assert record["state"] == "running"
    assert 0 < record["progress"]["fraction"] < 1
    assert record["progress"]["eta_seconds"] > 0
    check_job(record)
    waiting = client.get(job["links"]["self"] + "/result")
    check_problem(waiting, 409, "not-finished")
    assert int(waiting.headers["retry-after"]) >= 1
    for _ in range(2):  # the second time nothing is left to do
        cancelled = client.post(job["links"]["cancel"])
        assert (cancelled.status_code, cancelled.json()["state"]) == (202, "cancelled")
    check_problem(client.get(job["links"]["self"] + "/result"), 409, "cancelled")
    after = client.post("/v1/verifications", json={**QUICK, "seed": 99}).json()
    assert ended(client, after["id"])["state"] == "succeeded"  # the only computing process is free again
    left = client.get(job["links"]["self"]).json()["progress"]
    assert left["units_done"] == cancelled.json()["progress"]["units_done"] < left["units_expected"]


def test_norms_that_nobody_could_put_together_are_refused_before_they_are_paid_for(client: httpx.Client) -> None:
    refused = client.post("/v1/verifications", json=TOO_MANY)
    check_problem(refused, 422, "limit-exceeded")
    (error,) = refused.json()["errors"]
    assert (error["pointer"], error["code"]) == ("/trials", "too-many")
    assert error["detail"].startswith("0.8 GB of norms would be kept of 1000000000 trials at a target")
    asked = {"design": small_design(), "precision": 1e-4, "max_trials": 1_000_000_000}
    assert client.post("/v1/verifications", json=asked).json()["errors"][0]["pointer"] == "/max_trials"
    most = int(error["detail"].rpartition(" ")[2])  # as many as are said to be possible are
    job = client.post("/v1/verifications", json={**TOO_MANY, "trials": most})
    assert job.status_code == 202
    client.post(job.json()["links"]["cancel"])


def test_what_has_ended_cannot_be_cancelled(client: httpx.Client) -> None:
    path = done(client, "/v1/verifications", QUICK).headers["location"]
    check_problem(client.post(path + "/cancel"), 409, "finished")


def test_pages_lead_to_every_job_once(idle: httpx.Client) -> None:
    made = []
    for seed in range(5):
        job = idle.post("/v1/verifications", json={**QUICK, "seed": 50 + seed}).json()
        made.append(job["id"])
        idle.post(job["links"]["cancel"])
    seen, path, pages = [], "/v1/jobs?limit=2&state=cancelled&kind=verification", 0
    while path:
        page = idle.get(path)
        Draft202012Validator(json_schema("jobs")).validate(page.json())
        seen += [job["id"] for job in page.json()["jobs"]]
        assert len(page.json()["jobs"]) <= 2
        path, pages = page.json()["next"], pages + 1
        assert page.headers.get("link") == (f'<{path}>; rel="next"' if path else None)
    assert pages >= 3
    assert seen[:5] == made[::-1]
    assert len(set(seen)) == len(seen)
    assert idle.get("/v1/jobs?kind=optimisation").json() == {"schema": "tailstack/jobs/1", "jobs": [], "next": None}


def test_an_empty_cursor_is_the_first_page(idle: httpx.Client) -> None:
    idle.post("/v1/verifications", json={"design": small_design(), "trials": 1000})
    first, empty = (idle.get(f"/v1/jobs?limit=1{cursor}").json() for cursor in ("", "&cursor="))
    assert len(first["jobs"]) == 1
    assert empty["jobs"][0]["id"] == first["jobs"][0]["id"]
    assert empty["next"] == first["next"]


@pytest.mark.parametrize(("query", "pointer"), read_cases("http", "questions"))
def test_bad_questions_about_jobs(idle: httpx.Client, query: str, pointer: str) -> None:
    document = check_problem(idle.get(f"/v1/jobs?{query}"), 422, "invalid-request")
    assert document["errors"][0]["pointer"] == pointer


@pytest.mark.parametrize(("method", "path"), read_cases("http", "of_a_job"))
@pytest.mark.parametrize("name", [UNKNOWN, "x", "%00", "..%2f..", "é" * 30, UNKNOWN.upper()])
def test_unknown_jobs_are_404(idle: httpx.Client, method: str, path: str, name: str) -> None:
    check_problem(idle.request(method, path.format(name)), 404, "not-found")


@pytest.mark.parametrize("name", ["0" * 64, "x", "%00", "A" * 64])
def test_unknown_results_are_404(idle: httpx.Client, name: str) -> None:
    for path in (f"/v1/results/{name}", f"/v1/results/{name}/report"):
        check_problem(idle.get(path), 404, "not-found")


# --- events ---------------------------------------------------------------------------------------


def events_of(client: httpx.Client, job_id: str, **headers: str) -> list[ServerSentEvent]:
    """Every event of a stream that ends by itself."""
    with client.stream("GET", f"/v1/jobs/{job_id}/events", headers=headers, timeout=LIMIT_SECONDS) as response:
        assert response.status_code == 200
        assert response.headers["content-type"] == "text/event-stream"
        return list(read_events(response))


def test_events_tell_the_whole_life_of_a_job(client: httpx.Client) -> None:
    job = client.post("/v1/verifications", json={**QUICK, "trials": 400_000}).json()
    events = list(RemoteService(str(client.base_url), key="").events(job["id"]))  # as the command line reads it
    assert events == events_of(client, job["id"])
    assert [event.id for event in events] == [str(k) for k in range(1, len(events) + 1)]
    states = [event.data["state"] for event in events if event.name == "state"]
    assert (states[0], states[-1]) == ("queued", "succeeded")
    assert all(event.data["job"] == job["id"] for event in events)
    done_so_far = [event.data["units_done"] for event in events if event.name == "progress"]
    assert done_so_far == sorted(done_so_far)
    assert len(done_so_far) >= 2
    assert events[-1].data["result_sha256"] == client.get(f"/v1/jobs/{job['id']}").json()["result_sha256"]


def test_a_stream_goes_on_where_it_was_left(client: httpx.Client) -> None:
    job = client.post("/v1/verifications", json={**QUICK, "seed": 12}).json()
    events = events_of(client, job["id"])
    assert events_of(client, job["id"], **{"Last-Event-ID": "2"}) == events[2:]
    seen = client.get(f"/v1/jobs/{job['id']}/events", headers={"Last-Event-ID": events[-1].id})
    assert (seen.status_code, seen.content) == (204, b"")


# --- reports --------------------------------------------------------------------------------------


@pytest.mark.long("pdf-application/pdf-%PDF-", "pdf&summary=true-application/pdf-%PDF-")
@pytest.mark.parametrize(
    ("form", "media", "head"),
    [
        ("html", "text/html", b"<!doctype html"),
        ("xlsx", "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet", b"PK\x03\x04"),
        ("json", "application/json", b"{"),
        ("pdf", "application/pdf", b"%PDF-"),
        ("pdf&summary=true", "application/pdf", b"%PDF-"),
    ],
)
def test_a_result_as_a_report(client: httpx.Client, form: str, media: str, head: bytes) -> None:
    job = ended(client, done(client, "/v1/verifications", QUICK).headers["location"].rpartition("/")[2])
    report = client.get(f"{job['links']['report']}?format={form}")
    if form.startswith("pdf") and report.status_code == 501:
        assert check_problem(report, 501, "pdf-unavailable")["errors"][0]["hint"]
        return
    assert report.status_code == 200, report.text
    assert report.headers["content-type"].startswith(media)
    assert report.content[: len(head)].lower() == head.lower()
    ending = ".summary.pdf" if "summary" in form else f".{form}"
    assert report.headers["content-disposition"].endswith(f'{ending}"')


@pytest.mark.long
@pytest.mark.parametrize("error", [StoreUnavailable, StoreError])
def test_who_waits_for_a_job_while_the_database_goes_away_is_told_of_the_job(
    error: type[TailstackError], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not 503: whoever sent it again would have it twice."""

    def away(*_: object) -> None:
        raise error(Problem("", "store-unavailable", "it stands still"))

    body = {"design": small_design(), "trials": 1000}
    with client_with() as client:
        monkeypatch.setattr(stored, "find_job", away)
        waited = client.post("/v1/verifications", json=body, headers={"Prefer": "wait=1"})
        monkeypatch.undo()
        assert waited.status_code == 202, waited.text
        assert client.get(waited.headers["location"]).json()["state"] == "queued"


# --- what is answered at once, as a report --------------------------------------------------------


@pytest.mark.parametrize("name", ["score", "layout"])
@pytest.mark.parametrize("form", ["html", "xlsx"])
def test_accept_asks_for_the_report_of_a_record(client: httpx.Client, name: str, form: str) -> None:
    sent = {"design": small_design()}
    record = client.post(f"/v1/{name}s", json=sent)
    answer = client.post(f"/v1/{name}s", json=sent, headers={"Accept": MEDIA_TYPES[form]})
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == MEDIA_TYPES[form]
    assert answer.content == render(name, record.content, form)
    assert "sandbox" in answer.headers["content-security-policy"]


def test_only_who_asks_for_a_report_is_answered_with_one(client: httpx.Client) -> None:
    for accept in ("*/*", "application/json, text/html", "text/html;q=0, */*", "image/png"):
        answer = client.post("/v1/scores", json={"design": small_design()}, headers={"Accept": accept})
        assert answer.json()["schema"] == "tailstack/score/1"
    headers = {"Accept": "text/html"}
    answer = client.post("/v1/validations", json={"design": small_design()}, headers=headers)
    assert answer.headers["content-type"] == "application/json"
    refused = client.post("/v1/scores", json={"design": small_design(targets=[])}, headers=headers)
    check_problem(refused, 422, "invalid-design")

"""schemathesis over the running service: every phase, every check, a fixed seed, thousands of requests.

It reads the document that the service itself gives, and a service with authentication, so that a route that
forgets to ask is found.  What the configuration tells it beyond that stands in schemathesis.toml, with reasons."""

from __future__ import annotations

import json
import socket
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import pytest
from openapi_scenes import ended_job, json_examples, light, operations, parameters
from served import Served, served
from service_scenes import client_of

from family import run_process
from plain_data import places_of, replaced, value_at
from tailstack_service.operations.example import EXAMPLE_DESIGN
from waiting import LIMIT_SECONDS

HERE = Path(__file__).resolve().parent

SEED = 20_260_131

LIMITS = {
    "TAILSTACK_AUTH": "required",
    "TAILSTACK_MAX_TRIALS": "40000",  # the fewest that the study of the paper takes
    "TAILSTACK_MAX_STARTS": "1",
    "TAILSTACK_MAX_SWEEP_POINTS": "5",
    "TAILSTACK_MAX_SECONDS": "10",
    "TAILSTACK_MAX_JOB_SECONDS": "30",
    "TAILSTACK_MAX_WAIT_SECONDS": "1",
    "TAILSTACK_MAX_QUEUED_JOBS": "1000000",  # a full queue would be 429 for everything that follows
    "TAILSTACK_MAX_BODY_BYTES": "100000",
    "TAILSTACK_MAX_FIDUCIALS": "30",
    "TAILSTACK_MAX_TARGETS": "4",
    "TAILSTACK_MAX_VIEWS": "4",
}

DEAR = ("/v1/optimisations", "/v1/studies/")  # to have before the run, which sends their examples like all others

UNREACHED = {"get_openapi"}  # the document is loaded before the run and is not part of it


def jobs_and_results(client: httpx.Client) -> tuple[list[str], list[str]]:
    """Ids of jobs of several kinds, of one that failed and of one that was cancelled; hashes of the results."""
    requests = [
        (path, light(example))
        for path, _, operation in operations() if not path.startswith(DEAR)
        for example in json_examples(operation).values()
    ]  # fmt: skip
    (verification,) = [body for path, body in requests if path == "/v1/verifications"]
    unreachable = {**verification, "trials": None, "precision": 1e-4, "max_trials": int(LIMITS["TAILSTACK_MAX_TRIALS"])}
    jobs: list[str] = []
    for path, body in [
        *requests,
        ("/v1/verifications", unreachable),
        ("/v1/verifications", {**verification, "seed": 99}),
    ]:
        response = client.post(path, json=body)
        assert response.status_code in (200, 202), response.text
        if response.status_code == 202:
            jobs.append(response.json()["id"])
    client.post(f"/v1/jobs/{jobs[-1]}/cancel")
    results = []
    for job_id in jobs:
        job = ended_job(client, f"/v1/jobs/{job_id}")
        results += [job["result_sha256"]] if job["result_sha256"] else []
    assert len(results) >= 5
    return jobs, results


def prepare(service: Served, key: str, directory: Path) -> tuple[Path, Path]:
    """The configuration file of this run, and the document that the service gives, which schemathesis itself would not
    wait for: the first time it is put together."""
    with client_of(service.url, headers={"Authorization": f"Bearer {key}"}) as c:
        jobs, results = jobs_and_results(c)
        document = directory / "openapi.json"
        document.write_bytes(c.get("/openapi.json").raise_for_status().content)
    text = (HERE / "schemathesis.toml").read_text(encoding="utf-8")
    for name, values in (("jobs", jobs), ("results", results)):
        text += f"\n[dictionaries.{name}]\nvalues = {json.dumps(values)}\n"
    path = directory / "schemathesis.toml"
    path.write_text(text, encoding="utf-8")
    return path, document


def report_of(service: Served, directory: Path, seed: int) -> tuple[dict[str, Any], str]:
    """What schemathesis found, as its own record and as text for people."""
    scopes = [part for scope in ("read", "compute", "metrics") for part in ("--scope", scope)]
    key = service.run("keys", "create", "--tenant", "a", "--name", "test", *scopes).strip()
    config, document = prepare(service, key, directory)
    record = directory / "report.json"
    command = [
        str(Path(sys.executable).parent / "schemathesis"), "--config-file", str(config), "run",
        str(document), "--seed", str(seed), "--report", "json", "--report-json-path", str(record),
        "--no-color", "--suppress-health-check", "too_slow",  # a clock: a busy machine is no fault of the service
    ]  # fmt: skip
    hooks = str(HERE / "schemathesis_hooks.py")
    variables = {**service.environment, "TAILSTACK_URL": service.url, "TAILSTACK_KEY": key, "TAILSTACK_HOOKS": hooks}
    done = run_process(*command, env=variables, cwd=directory, timeout=5 * LIMIT_SECONDS)
    assert record.is_file(), done.stdout + done.stderr
    return json.loads(record.read_text(encoding="utf-8")), done.stdout


@pytest.mark.long
@pytest.mark.hostile
def test_every_phase_finds_nothing(tmp_path: Path, run_seed: int) -> None:
    with served(tmp_path, **LIMITS) as service:
        report, text = report_of(service, tmp_path, SEED + run_seed)
        log = service.log.read_text(encoding="utf-8")
    cases = report["test_cases"]["generated"]
    print(f"schemathesis: {cases} requests")
    assert report["failures"] == [], text
    assert report["errors"] == [], text
    assert {name: phase["status"] for name, phase in report["phases"].items()} == dict.fromkeys(
        ("examples", "coverage", "fuzzing", "stateful"), "success"
    )
    assert report["operations"]["tested"] == report["operations"]["total"]
    assert cases >= 2000
    assert not unreached(report), "a run that never gets behind the readers proves little"
    assert "Traceback" not in log


def unreached(report: dict[str, Any]) -> set[str]:
    """Operations of which no request was accepted, or answered with a conflict, in any phase."""
    found = {
        f"{method.upper()} {path}"
        for path, method, operation in operations()
        if operation["operationId"] not in UNREACHED
    }
    for name, phases in report["valid_rates"].items():
        if any(phase["accepted"] or phase["conflicts"] for phase in phases.values()):
            found.discard(name)
    return found


# --- no route fetches an address that a user gave -------------------------------------------------


FORMATS = ("html", "pdf", "xlsx", "json")

KEPT_OPTIMISATIONS = 1  # of those that are accepted; the others are cancelled, for each takes seconds


@dataclass(slots=True)
class Canary:
    """A port at which nobody has a reason to ask; who asks waits there until he is looked at."""

    port: int
    places: list[str] = field(default_factory=list)

    def address(self, place: str) -> str:
        """A short one, since texts have limits; its number is that of the place."""
        self.places.append(place)
        return f"http://127.0.0.1:{self.port}/{len(self.places)}"


Way = tuple[str | int, ...]


def designs_in(request: Any) -> list[Way]:
    """The place of every design in a request."""
    needed = {"fiducials", "views"}
    return [
        way for way in places_of(request) if isinstance(found := value_at(request, way), dict) and needed <= {*found}
    ]


def texts(document: Any) -> list[Way]:
    """The place of every text in a document."""
    return [way for way in places_of(document) if isinstance(value_at(document, way), str)]


def baits(address: str) -> tuple[str, ...]:
    """What a careless reader, renderer or resolver would follow."""
    return address, f'<img src="{address}"><link rel=stylesheet href="{address}"><script src="{address}"></script>'


def free_texts(client: httpx.Client, bird: Canary) -> list[list[Way]]:
    """By the kind of bait: the places in the design of the examples at which the service takes it."""
    free: list[list[Way]] = [[] for _ in baits("")]
    for way in texts(EXAMPLE_DESIGN):
        for kind, bait in enumerate(baits(bird.address(f"design/{way}"))):
            answer = client.post("/v1/validations", json={"design": replaced(EXAMPLE_DESIGN, way, bait)})
            assert answer.status_code < 500, answer.text
            if answer.status_code == 200:
                free[kind].append(way)
    assert max(map(len, free)) > 3
    return free


def requests(body: Any, bird: Canary, name: str, free: list[list[Way]]) -> Iterator[tuple[int, Any, bool]]:
    """(kind of bait, body, whether it has to be accepted): with a bait in each text that is in no design or in none of
    the examples, and with all that is free in the designs."""
    designs = designs_in(body)
    known = {own + way for own in designs for way in texts(EXAMPLE_DESIGN)}
    for way in texts(body):
        if way not in known:
            for kind, bait in enumerate(baits(bird.address(f"{name}/{way}"))):
                yield kind, replaced(body, way, bait), False
    for kind, ways in enumerate(free if designs else ()):
        changed = body
        for way in ways:
            bait = baits(bird.address(f"{name}/{way}"))[kind]
            for own in designs:
                changed = replaced(changed, own + way, bait)
        yield kind, changed, True


@pytest.mark.long
def test_no_address_is_followed(tmp_path: Path) -> None:
    sent = accepted = 0
    queued = {"TAILSTACK_MAX_QUEUED_JOBS": "10000"}
    with socket.create_server(("127.0.0.1", 0)) as listener, served(tmp_path, **queued) as service:
        bird = Canary(listener.getsockname()[1])
        with client_of(service.url) as client:
            jobs: list[dict[str, Any]] = []
            free = free_texts(client, bird)
            for path, method, operation in operations():
                for name, example in json_examples(operation).items():
                    label = f"{operation['operationId']}/{name}"
                    for kind, body, is_free in requests(light(example), bird, label, free):
                        response = client.request(method, path, json=body)
                        sent += 1
                        assert response.status_code < (300 if is_free else 500), response.text
                        if response.status_code == 202:
                            jobs.append({**response.json(), "is_markup": kind == 1})
                sent += _in_parameters(client, bird, path, method, operation)
            sent += _in_yaml(client, bird)
            accepted = len(jobs)
            for result, is_markup in _results(client, jobs).items():
                # a text that is nothing but an address can be followed by a page; the slow forms are for what is markup
                for form in FORMATS if is_markup else ("html",):
                    report = client.get(f"{result}/report", params={"format": form})
                    assert report.status_code in (200, 501), report.text
                    sent += 1
        with socket.create_connection(("127.0.0.1", bird.port)) as connection:
            connection.sendall(b"the canary is awake")
            first, _ = listener.accept()
            with first:  # nobody was before it in the queue
                assert first.recv(200) == b"the canary is awake", bird.places
    print(f"{sent} requests with an address in them, {accepted} jobs accepted, 0 connections")
    assert sent > 200
    assert accepted > 20


def _in_parameters(client: httpx.Client, bird: Canary, path: str, method: str, operation: Any) -> int:
    """The address as every query parameter and in every header that the operation knows, and as its path."""
    address = bird.address(operation["operationId"])
    body = next(iter(json_examples(operation).values()), None)
    example = path
    for parameter in parameters(path, operation, "path"):
        example = example.replace("{" + parameter["name"] + "}", parameter["example"])
    tries: list[dict[str, Any]] = [{"params": {p["name"]: address}} for p in parameters(path, operation, "query")]
    tries += [{"headers": {p["name"]: address}} for p in parameters(path, operation, "header")]
    tries += [{"headers": {name: address}} for name in ("Origin", "Referer", "X-Forwarded-Host", "From", "Link")]
    for changes in tries:
        options: dict[str, Any] = {"json": light(body)} if body is not None else {}
        with client.stream(method, example, **options, **changes) as response:
            assert response.status_code < 500
            job = json.loads(response.read()) if response.status_code == 202 else None
        if job is not None:  # of the example as it is: what it computes holds no address
            assert client.post(job["links"]["cancel"]).status_code in (202, 409)
    return len(tries)


def _in_yaml(client: httpx.Client, bird: Canary) -> int:
    """Tags, includes and schemas of YAML and JSON that name an address."""
    address = bird.address("yaml")
    documents = [
        f"!include {address}\n",
        f"!!python/object/apply:urllib.request.urlopen ['{address}']\n",
        f"schema: tailstack/design/1\nname: a\nfiducials: {{file: '{address}'}}\n",
        json.dumps({"$schema": address, "$ref": address, "design": {"$ref": address}}),
        f'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b SYSTEM "{address}">]><a>&b;</a>',
    ]
    posts = [path for path, method, operation in operations() if method == "post" and json_examples(operation)]
    for path in posts:
        for document in documents:
            for media in ("application/yaml", "application/json"):
                response = client.post(path, content=document, headers={"Content-Type": media})
                assert 400 <= response.status_code < 500, response.text
    for document in documents:
        for path, body in (
            ("/v1/gates", {"designs": [{"file": "a", "text": document}], "mode": "analytic"}),
            ("/v1/conversions", {"format": "yaml", "content": document}),
        ):
            assert 400 <= client.post(path, json=body).status_code < 500
    return 2 * (len(posts) + 1) * len(documents)


def _results(client: httpx.Client, jobs: list[dict[str, Any]]) -> dict[str, bool]:
    """Paths of the results of the jobs, once each has ended, and whether markup was sent."""
    slow = [job for job in jobs if job["kind"] == "optimisation"][KEPT_OPTIMISATIONS:]
    for job in slow:
        assert client.post(job["links"]["cancel"]).status_code in (202, 409)
    found: dict[str, bool] = {}
    is_markup = {job["links"]["self"]: job["is_markup"] for job in jobs}
    for place in is_markup:
        job = ended_job(client, place)
        if job["state"] == "succeeded":
            path = job["links"]["result"]
            found[path] = found.get(path, False) or is_markup[place]
    assert found
    return found

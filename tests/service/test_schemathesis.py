"""schemathesis over the running service: every phase, every check, a fixed seed, thousands of requests.

It reads the document that the service itself gives, and a service with authentication, so that a route that
forgets to ask is found.  What the configuration tells it beyond that stands in schemathesis.toml, with reasons."""

from __future__ import annotations

import json
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
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
from waiting import LIMIT_SECONDS, until

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

UNREACHED = {"get_openapi"}  # the document is loaded before the run and is not part of it


def jobs_and_results(client: httpx.Client) -> tuple[list[str], list[str]]:
    """Ids of a job of each kind, of one that failed and of one that was cancelled; hashes of the results."""
    requests = [
        (path, light(example)) for path, _, operation in operations() for example in json_examples(operation).values()
    ]
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
    """A listener that nobody has a reason to connect to."""

    port: int
    seen: list[str] = field(default_factory=list)
    places: list[str] = field(default_factory=list)

    def address(self, place: str) -> str:
        """A short one, since texts have limits; its number is that of the place."""
        self.places.append(place)
        return f"http://127.0.0.1:{self.port}/{len(self.places)}"


@contextmanager
def canary() -> Iterator[Canary]:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        found, stopping = Canary(listener.getsockname()[1]), threading.Event()
        listener.settimeout(0.1)

        def listen() -> None:
            while not stopping.is_set():
                try:
                    connection, _ = listener.accept()
                except TimeoutError:
                    continue
                with connection:
                    connection.settimeout(LIMIT_SECONDS)
                    found.seen.append(connection.recv(200).decode("latin-1"))

        thread = threading.Thread(target=listen, daemon=True)
        thread.start()
        try:
            yield found
        finally:
            stopping.set()
            thread.join()


Way = tuple[str | int, ...]


def designs_in(request: Any) -> list[Way]:
    """The place of every design in a request."""
    needed = {"fiducials", "views"}
    return [
        way for way in places_of(request) if isinstance(found := value_at(request, way), dict) and needed <= {*found}
    ]


def form_of(design: Any) -> str:
    """Equal for designs that have texts at the same places."""
    return repr(sorted(map(str, texts(design))))


def texts(document: Any) -> list[Way]:
    """The place of every text in a document."""
    return [way for way in places_of(document) if isinstance(value_at(document, way), str)]


def baits(address: str) -> tuple[str, ...]:
    """What a careless reader, renderer or resolver would follow."""
    return address, f'<img src="{address}"><link rel=stylesheet href="{address}"><script src="{address}"></script>'


def requests(
    body: dict[str, Any], bird: Canary, name: str, free: dict[str, list[list[Way]]]
) -> Iterator[tuple[Way, str, list[Any]]]:
    """(place, design, bodies): the place of a text, in a design that is new the place in it, and the body with each
    bait there; without a place the body with all that is free in the designs that are known."""
    known = {}
    for way in designs_in(body):
        text = form_of(value_at(body, way))
        if text in free:
            known[way] = free[text]
        else:
            free[text] = [[] for _ in baits("")]
    for way in texts(body):
        inside = next((own for own in designs_in(body) if way[: len(own)] == own), None)
        if inside in known:
            continue
        design = "" if inside is None else form_of(value_at(body, inside))
        address = bird.address(f"{name}/" + "/".join(map(str, way)))
        yield way[len(inside or ()) :], design, [replaced(body, way, bait) for bait in baits(address)]
    if known:
        whole = []
        for kind in range(len(baits(""))):
            changed, addresses = body, dict[Way, str]()  # one for a place, for two designs share names of targets
            for own, places in known.items():
                for way in places[kind]:
                    address = addresses.get(way) or bird.address(f"{name}/" + "/".join(map(str, own + way)))
                    addresses[way] = address
                    changed = replaced(changed, own + way, baits(address)[kind])
            whole.append(changed)
        yield (), "", whole


@pytest.mark.long
def test_no_address_is_followed(tmp_path: Path) -> None:
    sent = accepted = 0
    with canary() as bird, served(tmp_path, TAILSTACK_MAX_QUEUED_JOBS="10000") as service:
        with client_of(service.url) as client:
            jobs: list[dict[str, Any]] = []
            free: dict[str, list[list[Way]]] = {}  # by design: where the first operation took each kind of bait
            for path, method, operation in operations():
                for name, example in json_examples(operation).items():
                    for way, design, bodies in requests(
                        light(example), bird, f"{operation['operationId']}/{name}", free
                    ):
                        for kind, body in enumerate(bodies):
                            response = client.request(method, path, json=body)
                            sent += 1
                            assert response.status_code < 500, response.text
                            if response.status_code < 300 and design:
                                free[design][kind].append(way)
                            if response.status_code == 202:
                                jobs.append({**response.json(), "is_markup": kind == 1})
                            assert way or response.status_code < 300, response.text
                sent += _in_parameters(client, bird, path, method, operation)
            sent += _in_yaml(client, bird)
            accepted = len(jobs)
            for result, is_markup in _results(client, jobs).items():
                # a text that is nothing but an address can be followed by a page; the slow forms are for what is markup
                for form in FORMATS if is_markup else ("html",):
                    report = client.get(f"{result}/report", params={"format": form})
                    assert report.status_code in (200, 501), report.text
                    sent += 1
        assert bird.seen == [], bird.places
        with socket.create_connection(("127.0.0.1", bird.port)) as connection:
            connection.sendall(b"the canary is awake")
        until(lambda: bird.seen, says=lambda: "the canary would not have noticed")
        assert bird.seen == ["the canary is awake"]  # nobody was before it in the queue
    print(f"{sent} requests with an address in them, {accepted} jobs accepted, 0 connections")
    assert sent > 200
    assert accepted > 20
    assert max(len(places) for kinds in free.values() for places in kinds) > 3


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

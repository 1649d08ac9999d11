"""schemathesis over the running service: every phase, every check, a fixed seed, thousands of requests.

It reads the document that the service itself gives, and a service with authentication, so that a route that
forgets to ask is found.  What the configuration tells it beyond that stands in schemathesis.toml, with reasons.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import httpx
import pytest
from openapi_scenes import ended_job, json_examples, light, operations
from served import Served, served
from service_scenes import client_of

from family import run_process
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
        "--no-color",
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

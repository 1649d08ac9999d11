"""Places for whoever stays connected: a tenant has a share, so that nobody keeps the others out."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import jwt
import pytest
from service_scenes import check_problem, client_with, small_design

from tailstack_service.settings import Settings
from waiting import until

SECRET = "a shared secret of at least 32 bytes"
NEVER = 4_102_444_800  # the year 2100
LONG = {"design": small_design(), "trials": 3000}


def token(tenant: str) -> dict[str, str]:
    claims = {"iss": "tests", "aud": "tailstack", "tenant": tenant, "scope": "read compute", "exp": NEVER}
    return {"Authorization": f"Bearer {jwt.encode(claims, SECRET, algorithm='HS256')}"}


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """A service without a worker: jobs stay queued, and streams open."""
    secret: Path = tmp_path_factory.mktemp("keys") / "secret"
    secret.write_text(SECRET, encoding="utf-8")
    settings = Settings(
        auth="required", jwt_key_file=str(secret), jwt_algorithm="HS256", jwt_issuer="tests", max_streams=5,
        max_tenant_streams=2, max_wait_seconds=600.0,
    )  # fmt: skip
    with client_with(settings) as client:
        yield client


@contextlib.contextmanager
def streams(client: httpx.Client, path: str, count: int, headers: dict[str, str]) -> Iterator[None]:
    with contextlib.ExitStack() as stack:
        opened = [stack.enter_context(client.stream("GET", path, headers=headers)) for _ in range(count)]
        lines = [stream.iter_lines() for stream in opened]  # kept: one that is dropped closes its stream
        assert [next(each) for each in lines] == ["retry: 1000"] * count
        yield


def job_of(client: httpx.Client, headers: dict[str, str], seed: int) -> dict[str, Any]:
    job: dict[str, Any] = client.post("/v1/verifications", json={**LONG, "seed": seed}, headers=headers).json()
    return job


def test_one_tenant_cannot_take_all_places(client: httpx.Client) -> None:
    a, b, c = (token(name) for name in "abc")
    jobs = {name: job_of(client, headers, 1) for name, headers in (("a", a), ("b", b), ("c", c))}
    paths = {name: job["links"]["events"] for name, job in jobs.items()}
    with streams(client, paths["a"], 2, a):
        refused = client.get(paths["a"], headers=a)
        document = check_problem(refused, 429, "too-many-streams")
        assert document["errors"][0]["detail"] == "2 event streams and waits of one tenant are open, the limit"
        assert "TAILSTACK_MAX_TENANT_STREAMS" in document["errors"][0]["hint"]
        assert int(refused.headers["retry-after"]) > 0
        waited = client.post("/v1/verifications", json={**LONG, "seed": 2}, headers={**a, "Prefer": "wait=600"})
        assert waited.status_code == 202, "a wait is a wish, and has the same places"  # longer than the client waits
        with streams(client, paths["b"], 2, b), streams(client, paths["c"], 1, c):
            busy = check_problem(client.get(paths["c"], headers=c), 503, "busy")
            assert busy["errors"][0]["detail"] == "5 event streams and waits are open, the limit"
    client.post(jobs["a"]["links"]["cancel"], headers=a)
    answers: list[httpx.Response] = []

    def let_in() -> bool:
        answers.append(client.get(paths["a"], headers=a))
        return answers[-1].status_code == 200

    until(let_in, says=lambda: answers[-1].text)  # the service notices when it next has something to say
    assert '"state":"cancelled"' in answers[-1].text


def test_who_is_alone_has_all_places() -> None:
    """Without authentication there is one tenant."""
    with client_with(Settings(max_streams=3, max_tenant_streams=1)) as client:
        path = job_of(client, {}, 1)["links"]["events"]
        with streams(client, path, 3, {}):
            check_problem(client.get(path), 503, "busy")

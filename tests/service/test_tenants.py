"""One tenant cannot reach another's jobs and results on any route, and nobody gets in without a good credential.

What is tried is generated from the OpenAPI document: an operation that this file does not know how to address fails.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import httpx
import jwt
import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from openapi_scenes import ended_job, is_secured, json_examples, light, operations, parameters
from served import Served, served
from service_scenes import check_problem, client_of

from waiting import until

NEVER = 4_102_444_800  # s since 1970: the year 2100
ISSUER, AUDIENCE = "https://identity.example", "tailstack"
SECURED = {o["operationId"]: (path, method, o) for path, method, o in operations() if is_secured(o)}
OPEN = {o["operationId"]: path for path, _, o in operations() if not is_secured(o)}
ADDRESSED = {name: entry for name, entry in SECURED.items() if "{" in entry[0]}
CREATING = {name: entry for name, entry in SECURED.items() if entry[1] == "post" and name not in ADDRESSED}
LISTING = {name: entry for name, entry in SECURED.items() if entry[1] == "get" and name not in ADDRESSED}
CHEAP = {"create_verification", "create_sweep", "create_gate"}  # who owns a job is asked whatever its kind
OWNED = {"id": "job", "sha256": "result"}  # path parameters that name what belongs to somebody
WORDS = {"name", "slug"}  # path parameters that name what belongs to everybody
VARYING = {"date", "x-request-id"}


@dataclass(frozen=True, slots=True)
class Property:
    """What tenant A owns, and what nobody owns."""

    job: dict[str, str]  # by kind
    result: dict[str, str]

    def values(self, parameter: str) -> dict[str, str]:
        found: dict[str, str] = getattr(self, OWNED[parameter])
        return found


@dataclass(frozen=True, slots=True)
class Place:
    """A service with authentication, and credentials of all sorts."""

    service: Served
    client: httpx.Client
    private_key: rsa.RSAPrivateKey
    keys: dict[str, str]

    def ask(self, name: str, values: dict[str, str], credential: str | None, **headers: str) -> httpx.Response:
        """Call an operation with path parameters filled in and the first example as body."""
        path, method, operation = SECURED[name]
        sent = headers if credential is None else {"Authorization": credential, **headers}
        body = next((light(value) for value in json_examples(operation).values()), None)
        return self.client.request(method, path.format(**values), json=body, headers=sent)

    def token(self, tenant: str = "a", key: Any = None) -> str:
        """A JSON Web Token of a tenant."""
        claims = {"iss": ISSUER, "aud": AUDIENCE, "tenant": tenant, "scope": "read compute metrics", "exp": NEVER}
        return jwt.encode(claims, key or self.private_key, algorithm="RS256")


def bearer(credential: str) -> str:
    return f"Bearer {credential}"


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    directory = tmp_path_factory.mktemp("tenants")
    private = rsa.generate_private_key(public_exponent=65537, key_size=2048)
    public = private.public_key().public_bytes(
        serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo
    )
    key_file = directory / "public.pem"
    key_file.write_bytes(public)
    settings = {
        "TAILSTACK_AUTH": "required",
        "TAILSTACK_JWT_KEY_FILE": str(key_file),
        "TAILSTACK_JWT_ISSUER": ISSUER,
        "TAILSTACK_JWT_AUDIENCE": AUDIENCE,
    }
    with served(directory, **settings) as service, client_of(service.url) as c:
        every = ("--scope", "read", "--scope", "compute", "--scope", "metrics")
        keys = {tenant: _key(service, tenant, *every) for tenant in ("a", "b")}
        keys["revoked"] = _key(service, "a", *every)
        service.run("keys", "revoke", keys["revoked"].split("_")[1])
        keys["expired"] = _key(service, "a", *every, "--days", "1e-6")
        keys |= {scope: _key(service, "a", "--scope", scope) for scope in ("read", "compute", "metrics")}
        expired = {"Authorization": bearer(keys["expired"])}  # after a millionth of a day
        until(lambda: c.get("/v1/jobs", headers=expired).status_code == 401)
        yield Place(service, c, private, keys)


def _key(service: Served, tenant: str, *arguments: str) -> str:
    return service.run("keys", "create", "--tenant", tenant, "--name", "test", *arguments).strip()


@pytest.fixture(scope="module")
def owned(place: Place) -> Property:
    """A job of some kinds, computed, and the result of each: the first example of an operation that is a job."""
    jobs: dict[str, str] = {}
    results: dict[str, str] = {}
    pending = []
    for name in sorted(CHEAP):
        path, _, operation = CREATING[name]
        for example in json_examples(operation).values():
            response = place.client.post(path, json=light(example), headers={"Authorization": bearer(place.keys["a"])})
            assert response.status_code in (200, 202), response.text
            if response.status_code == 202:
                pending.append(response.headers["location"])
                break
    for location in pending:
        job = ended_job(place.client, location, Authorization=bearer(place.keys["a"]))
        assert job["state"] == "succeeded", job
        jobs[job["kind"]] = job["id"]
        results[job["kind"]] = job["result_sha256"]
    return Property(jobs, results)


def answer(response: httpx.Response, identity: str) -> tuple[int, dict[str, str], bytes]:
    """Everything that came back, but for what is different each time, and for the identity that was asked for."""
    request_id = response.headers.get("x-request-id", "")
    body = response.content.replace(request_id.encode() or b"-", b"REQUEST").replace(identity.encode(), b"IDENTITY")
    headers = {name: value.replace(identity, "IDENTITY") for name, value in response.headers.items()}
    return response.status_code, {n: v for n, v in headers.items() if n not in VARYING}, body


def unknown(identity: str) -> str:
    """Something of the same form that nobody has."""
    return identity[:-1] + ("0" if identity[-1] != "0" else "1")


def test_every_operation_can_be_addressed() -> None:
    """A new operation needs a decision: to whom does what it names belong?"""
    for name, (path, _, operation) in ADDRESSED.items():
        for parameter in parameters(path, operation, "path"):
            assert parameter["name"] in OWNED, f"{name}: who owns the {parameter['name']} in {path}?"
    assert set(LISTING) == {"list_jobs", "get_metrics"}, "a new operation lists something: of whom?"
    assert set(ADDRESSED) >= {"get_job", "get_job_events", "cancel_job", "get_job_result", "get_result", "get_report"}
    for name, path in OPEN.items():
        named = {part[1:-1] for part in path.split("/") if part.startswith("{")}
        assert named <= WORDS, f"{name} asks nobody who they are, and names {named}"


@pytest.mark.long("get_report")
@pytest.mark.parametrize("name", ADDRESSED)
def test_what_belongs_to_another_is_what_never_was(place: Place, owned: Property, name: str) -> None:
    """An operation answers another tenant what it answers about something that nobody has."""
    path, _, operation = ADDRESSED[name]
    (parameter,) = parameters(path, operation, "path")
    for kind, identity in owned.values(parameter["name"]).items():
        values = {parameter["name"]: identity}
        own = place.ask(name, values, bearer(place.keys["a"]))
        assert own.status_code not in (401, 403, 404), (kind, own.text)
        nothing = {parameter["name"]: unknown(identity)}
        for credential in (bearer(place.keys["b"]), bearer(place.token(tenant="b"))):
            others = place.ask(name, values, credential)
            assert others.status_code == 404, (kind, others.text)
            never = place.ask(name, nothing, credential)
            assert answer(others, identity) == answer(never, unknown(identity))
        tagged = place.ask(name, values, bearer(place.keys["b"]), **{"If-None-Match": f'"{identity}", *'})
        assert tagged.status_code == 404


@pytest.mark.parametrize("name", LISTING)
def test_lists_hold_nothing_of_another(place: Place, owned: Property, name: str) -> None:
    path, _, _ = LISTING[name]
    secrets = [*owned.job.values(), *owned.result.values()]
    own = place.client.get(path, headers={"Authorization": bearer(place.keys["a"])})
    if name == "list_jobs":
        assert all(identity in own.text for identity in owned.job.values())
    stranger = place.client.get(path, headers={"Authorization": bearer(place.keys["b"])})
    assert stranger.status_code == 200
    assert not [secret for secret in secrets if secret in stranger.text]


def test_a_cursor_of_another_leads_to_nothing_of_theirs(place: Place, owned: Property) -> None:
    ours = {"Authorization": bearer(place.keys["a"])}
    page = place.client.get("/v1/jobs", params={"limit": 1}, headers=ours).json()
    assert page["next"]
    theirs = place.client.get(page["next"], headers={"Authorization": bearer(place.keys["b"])})
    assert theirs.status_code in (200, 422)
    assert not [identity for identity in owned.job.values() if identity in theirs.text]


@pytest.mark.parametrize("tenant", ["A", "a ", " a", "a\u200b", "á", "a/../a", "%61", "a'--", "*", "%", "_"])
def test_a_tenant_of_a_similar_name_is_another(place: Place, owned: Property, tenant: str) -> None:
    credential = bearer(place.token(tenant=tenant))
    assert place.client.get("/v1/jobs", headers={"Authorization": credential}).text.count('"id"') == 0
    assert place.ask("get_job", {"id": owned.job["verification"]}, credential).status_code in (401, 404)


def bad_credentials(place: Place) -> dict[str, dict[str, str]]:
    """Headers that must not let anybody in, by what is wrong with them: of each way in one, and what is no way in.

    test_http_access.py has more of each on one route.
    """
    good, other = place.keys["a"], rsa.generate_private_key(public_exponent=65537, key_size=2048)
    return {
        "no credential": {},
        "key in a header of another name": {"X-API-Key": good},
        "key as a cookie": {"Cookie": f"Authorization={good}"},
        "key without Bearer": {"Authorization": good},
        "revoked key": {"Authorization": bearer(place.keys["revoked"])},
        "expired key": {"Authorization": bearer(place.keys["expired"])},
        "token of another": {"Authorization": bearer(place.token(key=other))},
    }


def test_nobody_gets_in_with_a_bad_credential_on_any_route(place: Place, owned: Property) -> None:
    for what, headers in bad_credentials(place).items():
        for name, (path, _, operation) in SECURED.items():
            named = [parameter["name"] for parameter in parameters(path, operation, "path")]
            answers = set()
            for known in (True, False):
                found = {p: owned.values(p)["verification"] for p in named}
                values = {p: identity if known else unknown(identity) for p, identity in found.items()}
                response = place.ask(name, values, None, **headers)
                assert response.status_code == 401, (what, name, response.text)
                assert response.headers["content-type"] == "application/problem+json"
                assert response.headers["www-authenticate"].startswith("Bearer")
                for secret in [value.split()[-1] for value in headers.values() if value.split()]:
                    assert len(secret) < 20 or secret not in response.text
                status, kept, body = answer(response, next(iter(values.values()), "-"))
                answers.add((status, tuple(sorted(kept.items())), body))
            assert len(answers) == 1, (what, name)


def test_the_key_in_the_query_is_not_a_credential(place: Place) -> None:
    assert place.client.get(f"/v1/jobs?api_key={place.keys['a']}").status_code == 401


@pytest.mark.parametrize("scope", ["read", "compute", "metrics"])
def test_a_key_opens_only_what_its_scope_says(place: Place, owned: Property, scope: str) -> None:
    for name, (path, method, operation) in SECURED.items():
        needed = "metrics" if name == "get_metrics" else "compute" if method == "post" else "read"
        values = {p["name"]: owned.values(p["name"])["verification"] for p in parameters(path, operation, "path")}
        response = place.ask(name, values, bearer(place.keys[scope]))
        if needed == scope:
            assert response.status_code not in (401, 403), (name, response.text)
            if response.status_code == 202:  # nobody waits for what it would compute
                key = {"Authorization": bearer(place.keys[scope])}
                place.client.post(f"{response.headers['location']}/cancel", headers=key)
            continue
        assert needed in check_problem(response, 403, "forbidden")["errors"][0]["detail"], name
        assert f'scope="{needed}"' in response.headers["www-authenticate"]

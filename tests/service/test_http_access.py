"""Who may ask: API keys, JSON Web Tokens, scopes, tenants; and what web pages cannot do to a service without them."""

from __future__ import annotations

import base64
import hmac
import json
import logging
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import jwt
import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa
from service_scenes import check_problem, client_with, small_design
from starlette.requests import Request

from plain_data import read_cases
from tailstack_service.http import access
from tailstack_service.http.access import Access, Tokens
from tailstack_service.jobs.store.database import Database
from tailstack_service.jobs.store.keys import Key, create_key
from tailstack_service.jobs.store.schema import open_database
from tailstack_service.problems import RequestError, TransportError
from tailstack_service.settings import Settings
from turned_clock import TurnedClock
from waiting import until_async

BODY = {"design": small_design()}
IN_2100 = 4_102_444_800  # s since 1970: PyJWT reads the time itself, so no token of these tests gets old
ISSUER = "https://login.example.org/"


@dataclass(frozen=True, slots=True)
class Guarded:
    """A service that asks who is there, and its database."""

    client: httpx.Client
    db: Database
    private_key: str

    def key(self, *scopes: str, tenant: str = "metrology") -> str:
        _, secret = create_key(self.db, tenant=tenant, name="test", scopes=scopes, days=1.0)
        return secret

    def token(self, algorithm: str = "RS256", key: Any = None, **changes: Any) -> str:
        claims = {"iss": ISSUER, "aud": "tailstack", "exp": IN_2100, "sub": "metrology", "scope": "compute read"}
        claims = {name: value for name, value in {**claims, **changes}.items() if value is not None}
        return jwt.encode(claims, key or self.private_key, algorithm=algorithm)


def pem_of(key: Any) -> tuple[str, bytes]:
    """Private and public half as PEM."""
    private = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    public = key.public_key().public_bytes(serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo)
    return private.decode(), public


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    folder = tmp_path_factory.mktemp("guarded")
    private, public = pem_of(rsa.generate_private_key(65537, 2048))
    (folder / "public.pem").write_bytes(public)
    settings = Settings(
        database=f"sqlite:///{folder / 'jobs.sqlite3'}", auth="required", jwt_key_file=str(folder / "public.pem"),
        jwt_issuer=ISSUER, max_queued_jobs=100,
    )  # fmt: skip
    with client_with(settings) as client, closing(open_database(settings.database_url)) as db:
        yield Guarded(client, db, private)


def bearer(credential: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {credential}"}


# --- keys -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("header", [None, "", "Bearer", "Basic dTpw", "tsk_x", "Bearer tsk_", "Bearer x y",
                                    "Bearer " + "x" * 9000, "Bearer tsk_000000000000_" + "a" * 43])  # fmt: skip
def test_without_a_credential_of_ours_nothing_is_answered(guarded: Guarded, header: str | None) -> None:
    headers = {} if header is None else {"Authorization": header}
    for method, path in (
        ("POST", "/v1/scores"),
        ("GET", "/v1/jobs"),
        ("GET", "/metrics"),
        ("GET", "/v1/jobs/x/events"),
    ):
        response = guarded.client.request(method, path, headers=headers)
        check_problem(response, 401, "unauthenticated")
        assert response.headers["www-authenticate"].startswith("Bearer realm=")


def test_two_credentials_are_none(guarded: Guarded) -> None:
    good, bad = f"Bearer {guarded.key('read')}", "Bearer tsk_000000000000_" + "a" * 43
    assert guarded.client.get("/v1/jobs", headers=[("Authorization", good)]).status_code == 200
    for value in (good.removeprefix("Bearer "), f"{good}, {good}", f"{good}, {bad}"):
        response = guarded.client.get("/v1/jobs", headers={"Authorization": value})
        check_problem(response, 401, "unauthenticated")
    for pair in ((good, bad), (bad, good), (good, good), (good, "")):
        response = guarded.client.get("/v1/jobs", headers=[("Authorization", value) for value in pair])
        assert "2 Authorization headers" in check_problem(response, 401, "unauthenticated")["errors"][0]["detail"]
        assert 'error="invalid_request"' in response.headers["www-authenticate"]


@pytest.mark.parametrize("path", ["/health/live", "/health/ready", "/version", "/openapi.json", "/v1/schemas",
                                  "/v1/schemas/design", "/v1/problems/busy", "/docs",
                                  "/docs/swagger-ui.css"])  # fmt: skip
def test_what_anybody_may_read(guarded: Guarded, path: str) -> None:
    assert guarded.client.get(path).status_code == 200


def test_no_credential_is_ever_told_again(
    guarded: Guarded, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(logging.getLogger("tailstack"), "propagate", True)
    caplog.set_level(logging.DEBUG, "tailstack")  # the commands, run by other tests of this process, set a level there
    caplog.set_level(logging.DEBUG)
    secret, token = guarded.key("read"), guarded.token(aud="another")
    answers = [
        guarded.client.get("/v1/jobs", headers=bearer(secret)),
        guarded.client.get("/metrics", headers=bearer(secret)),
        guarded.client.get("/v1/jobs", headers=bearer(token)),
        guarded.client.get("/v1/jobs", headers=bearer(secret[:-1] + "_")),
    ]
    told = caplog.text + "".join(answer.text + str(answer.headers) for answer in answers)
    assert any(record.name == "tailstack.service" for record in caplog.records)
    for part in (secret.split("_", 2)[2], token, token.split(".")[1]):
        assert part not in told
        assert part not in "".join(str(record.__dict__) for record in caplog.records)


# --- tokens ---------------------------------------------------------------------------------------


def test_a_token_lets_in_as_its_tenant(guarded: Guarded) -> None:
    accepted = guarded.client.post("/v1/verifications", json=BODY, headers=bearer(guarded.token(tenant="imaging")))
    assert accepted.status_code == 202
    path = accepted.headers["location"]
    assert guarded.client.get(path, headers=bearer(guarded.token(tenant="imaging"))).status_code == 200
    assert guarded.client.get(path, headers=bearer(guarded.token(sub="imaging"))).status_code == 200
    assert guarded.client.get(path, headers=bearer(guarded.token())).status_code == 404
    listed = guarded.token(scope=None, scopes=["read"], tenant="imaging")
    assert guarded.client.get(path, headers=bearer(listed)).status_code == 200
    check_problem(guarded.client.post("/v1/scores", json=BODY, headers=bearer(listed)), 403, "forbidden")
    check_problem(guarded.client.get(path, headers=bearer(guarded.token(scope=None))), 403, "forbidden")


@pytest.mark.parametrize("name", ["metrology", "local", "token:metrology"])
def test_the_tenant_of_a_token_is_none_of_a_key(guarded: Guarded, name: str) -> None:
    """Whoever issues tokens names their tenants, and gets at nothing of the operator's own by a name."""
    ours = [guarded.key("read", "compute", tenant="metrology"), guarded.key("read", "compute", tenant="local")]
    theirs = guarded.token(tenant=name)
    for mine, stranger in [(key, theirs) for key in ours] + [(theirs, key) for key in ours]:
        accepted = guarded.client.post("/v1/verifications", json=BODY, headers=bearer(mine))
        assert guarded.client.get(accepted.headers["location"], headers=bearer(mine)).status_code == 200
        assert guarded.client.get(accepted.headers["location"], headers=bearer(stranger)).status_code == 404


@pytest.mark.parametrize(
    "changes",
    [
        {"exp": 1}, {"exp": None}, {"iss": "https://elsewhere.example.org/"}, {"iss": None}, {"aud": "another"},
        {"aud": None}, {"sub": None}, {"sub": "x" * 200}, {"tenant": 7}, {"tenant": ""}, {"nbf": 4e9},
        {"tenant": "a\nb"},
    ],
)  # fmt: skip
def test_tokens_that_are_not_accepted(guarded: Guarded, changes: dict[str, Any]) -> None:
    response = guarded.client.get("/v1/jobs", headers=bearer(guarded.token(**changes)))
    check_problem(response, 401, "unauthenticated")


def part(data: str | bytes) -> str:
    """A part of a token."""
    return base64.urlsafe_b64encode(data if isinstance(data, bytes) else data.encode()).decode().rstrip("=")


def test_what_a_stranger_wrote_into_a_token_is_not_said_again(guarded: Guarded) -> None:
    """The parser's own words may hold it: claims, header, where it stopped."""
    mark = "zzz-a-strangers-words-zzz"
    strange = json.dumps({"alg": mark, "typ": mark, "kid": mark, "crit": [mark]})
    tokens = [
        guarded.token(aud=mark), guarded.token(iss=mark), guarded.token(exp=mark), guarded.token(nbf=mark),
        guarded.token(iat=mark), mark, f"{mark}.{mark}.{mark}",
        f"{part(mark)}.{part(mark)}.{part(mark)}",
        f"{part(strange)}.{part(json.dumps({'aud': mark}))}.x",
        f"{part(json.dumps({'alg': 'RS256', 'crit': [mark], mark: 1}))}.{part('{}')}.x",
    ]  # fmt: skip
    for token in tokens:
        response = guarded.client.get("/v1/jobs", headers=bearer(token))
        check_problem(response, 401, "unauthenticated")
        assert mark not in response.text + str(response.headers)


def test_only_the_one_algorithm_and_the_one_key(guarded: Guarded) -> None:
    stranger = rsa.generate_private_key(65537, 2048)
    other, _ = pem_of(stranger)
    brought = {"jwk": json.loads(jwt.algorithms.RSAAlgorithm.to_jwk(stranger.public_key())), "kid": "../../dev/null"}
    _, public = pem_of(serialization.load_pem_private_key(guarded.private_key.encode(), None))
    claims = {"iss": ISSUER, "aud": "tailstack", "exp": IN_2100, "sub": "x", "scope": "read"}
    # the classic confusion: the public key, which everybody knows, used as a shared secret; and no signature at all
    signed = f"{part(json.dumps({'alg': 'HS256', 'typ': 'JWT'}))}.{part(json.dumps(claims))}"
    forged = f"{signed}.{part(hmac.digest(public, signed.encode(), 'sha256'))}"
    head, _, signature = guarded.token().split(".")
    for token in (
        guarded.token(key=other), guarded.token("RS512"), guarded.token("PS256"), forged, "a.b.c",
        *(jwt.encode(claims, other, "RS256", headers={name: value}) for name, value in brought.items()),
        *(f"{head}.{part(json.dumps(claims))}.{each}" for each in (signature, "")),
        f"{part(json.dumps({'alg': 'none'}))}.{part(json.dumps(claims))}.",
    ):  # fmt: skip
        check_problem(guarded.client.get("/v1/jobs", headers=bearer(token)), 401, "unauthenticated")


def tokens_with(tmp_path: Path, content: bytes, algorithm: Any, **changes: str) -> Tokens:
    path = tmp_path / "key"
    path.write_bytes(content)
    settings = Settings(auth="required", jwt_key_file=str(path), jwt_issuer=ISSUER, jwt_algorithm=algorithm)
    return Tokens(settings.model_copy(update=changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("algorithm", "key"),
    [("ES256", ec.generate_private_key(ec.SECP256R1())), ("EdDSA", ed25519.Ed25519PrivateKey.generate())],
)
def test_other_algorithms_by_setting(guarded: Guarded, tmp_path: Path, algorithm: str, key: Any) -> None:
    private, public = pem_of(key)
    tokens = tokens_with(tmp_path, public, algorithm)
    assert tokens.caller(guarded.token(algorithm, private)).tenant == "token:metrology"
    with pytest.raises(TransportError):
        tokens.caller(guarded.token())


def test_a_shared_secret_is_long(guarded: Guarded, tmp_path: Path) -> None:
    tokens = tokens_with(tmp_path, b"0123456789abcdef" * 2 + b"\n", "HS256")
    assert tokens.caller(guarded.token("HS256", "0123456789abcdef" * 2)).scopes == {"compute", "read"}
    with pytest.raises(RequestError, match="at least 32"):
        tokens_with(tmp_path, b"0123456789abcdef" + b"\n" * 40, "HS256")


def test_a_file_of_several_keys(tmp_path: Path) -> None:
    keys = {name: rsa.generate_private_key(65537, 2048) for name in ("old", "new")}
    entries = [
        {**json.loads(jwt.algorithms.RSAAlgorithm.to_jwk(key.public_key())), "kid": name, "use": "sig", "alg": "RS256"}
        for name, key in keys.items()
    ]
    tokens = tokens_with(tmp_path, json.dumps({"keys": entries}).encode(), "RS256")
    claims = {"iss": ISSUER, "aud": "tailstack", "exp": IN_2100, "sub": "x"}
    for name, key in keys.items():
        assert tokens.caller(jwt.encode(claims, key, "RS256", headers={"kid": name})).tenant == "token:x"
    for wrong in ({"kid": "lost"}, {}, {"kid": "old"}):
        with pytest.raises(TransportError):
            tokens.caller(jwt.encode(claims, keys["new"], "RS256", headers=wrong))


@pytest.mark.parametrize(
    ("content", "algorithm", "changes"),
    [
        (b"not a key", "RS256", {}), (b"{}", "RS256", {}), (b'{"keys": []}', "RS256", {}), (b"", "ES256", {}),
        (b"x" * 40, "HS256", {"jwt_issuer": ""}), (b"x" * 40, "HS256", {"jwt_audience": ""}),
        (b"x" * 40, "HS256", {"jwt_key_file": "/nowhere/key"}),
    ],
)  # fmt: skip
def test_settings_that_cannot_work_are_refused_at_the_start(
    tmp_path: Path, content: bytes, algorithm: str, changes: dict[str, str]
) -> None:
    with pytest.raises(RequestError, match="TAILSTACK_JWT_"):
        tokens_with(tmp_path, content, algorithm, **changes)


# --- without authentication -----------------------------------------------------------------------


CLIENT = {"settings": Settings(allowed_hosts="design-host, cad.example.org")}


@pytest.mark.parametrize("host", read_cases("http", "hosts"))
def test_a_name_that_is_not_this_machine_is_refused(client: httpx.Client, host: str) -> None:
    for method, path in (("GET", "/v1/jobs"), ("GET", "/version"), ("POST", "/v1/scores"), ("GET", "/nowhere")):
        check_problem(client.request(method, path, headers={"Host": host}), 421, "wrong-host")


@pytest.mark.parametrize("host", ["localhost", "LOCALHOST:1", "127.0.0.1", "127.1.2.3:80", "[::1]:8321", "localhost.",
                                  "design-host", "CAD.example.org:8321"])  # fmt: skip
def test_names_of_this_machine(client: httpx.Client, host: str) -> None:
    assert client.get("/v1/jobs", headers={"Host": host}).status_code == 200


@pytest.mark.parametrize("origin", ["http://{}", "https://{}", "HTTP://{}", "http://{}.evil.org", "//{}", "{}", "null",
                                    "https://evil.example.org", "http://localhost:1", "http://127.0.0.1", "http://[",
                                    "http://[::1", "", "\xff://\xff"])  # fmt: skip
def test_a_page_is_our_own_by_its_scheme_its_name_and_its_port(client: httpx.Client, origin: str) -> None:
    """Another server may answer on the same port with TLS.  What another's page asks for it cannot read."""
    host = f"{client.base_url.host}:{client.base_url.port}"
    told = {b"Origin": origin.format(host).encode("latin-1")}
    expected = (404, "not-found") if origin.lower() == "http://{}" else (403, "forbidden")
    check_problem(client.post("/nowhere", headers=told), *expected)
    read = client.get("/v1/jobs", headers=told)
    assert read.status_code == 200
    assert not [name for name in read.headers if name.startswith("access-control")]


@pytest.mark.parametrize("site", ["cross-site", "same-site", "anything else"])
def test_a_browser_that_says_whose_page_it_is_is_believed(client: httpx.Client, site: str) -> None:
    refused = client.post("/v1/scores", json=BODY, headers={"Sec-Fetch-Site": site})
    assert "Sec-Fetch-Site" in check_problem(refused, 403, "forbidden")["errors"][0]["detail"]
    assert client.get("/v1/jobs", headers={"Sec-Fetch-Site": site}).status_code == 200
    for own in ("same-origin", "none"):
        assert client.post("/v1/scores", json=BODY, headers={"Sec-Fetch-Site": own}).status_code == 200


def test_a_credential_that_is_not_needed_is_not_looked_at(client: httpx.Client) -> None:
    assert client.get("/v1/jobs", headers=bearer("whatever")).status_code == 200


async def test_a_key_is_looked_up_once_in_a_while_and_refused_when_it_is_not_there_any_more() -> None:
    asked: list[str] = []

    async def find(presented: str) -> Key | None:
        asked.append(presented)
        return Key("0", "a", "n", ("read",), 0.0, 1.0, None) if len(asked) < 3 else None

    noted: list[tuple[str, str, str]] = []

    async def note(key_id: str, tenant: str, address: str) -> None:
        noted.append((key_id, tenant, address))

    clock = TurnedClock()
    guard = Access(Settings(auth="required"), find, note, clock)
    scope = {"type": "http", "headers": [(b"authorization", b"bearer tsk_1")], "client": ("192.0.2.1", 1)}

    for times in (1, 2):
        for _ in range(5):
            assert (await guard.admit(Request(scope), "read")).tenant == "a"
        assert asked == ["tsk_1"] * times
        clock.turn(access.KEY_SECONDS)
    with pytest.raises(TransportError):
        await guard.admit(Request(scope), "read")
    await until_async(lambda: noted)
    assert noted == [("0", "a", "192.0.2.1")]

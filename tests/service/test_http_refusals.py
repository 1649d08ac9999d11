"""Whatever is wrong with a request is a problem document that says where, and never a 5xx."""

from __future__ import annotations

import asyncio
import gc
import json
import logging
import pickle
import socket
from collections.abc import Callable, Iterator
from datetime import date
from functools import partial
from itertools import product
from typing import Any

import httpx
import pytest
from service_scenes import check_problem, client_with, coplanar_design, read_answer, small_design
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from plain_data import read_cases, replaced
from tailstack.errors import DesignError, IllPosedError, Problem
from tailstack_service.gate.request import admit_gate, read_gate
from tailstack_service.http.app import create_app
from tailstack_service.operations import perform
from tailstack_service.operations.content import canonical
from tailstack_service.operations.request import DesignReferenceUnresolved
from tailstack_service.problems import CATALOGUE, RefusedAt
from tailstack_service.processes.task import RawRequest
from tailstack_service.settings import Settings
from waiting import LIMIT_SECONDS, until

JSON = {"Content-Type": "application/json"}
YAML = {"Content-Type": "application/yaml"}
AXES = [{"pointer": "/views/0/target_noise_px", "values": [0.1, 0.2]}]
OPTIONS: dict[str, dict[str, Any]] = {"/v1/sweeps": {"axes": AXES}}  # without which a request is not complete
NO_DESIGNS: tuple[Any, ...] = (None, [], "x", 3, True)
POSTS = ("/v1/scores", "/v1/validations", "/v1/verifications", "/v1/optimisations", "/v1/sweeps", "/v1/reports")


def changed(path: str, value: Any) -> dict[str, Any]:
    """The small design with one value replaced."""
    return replaced(small_design(), [int(step) if step.isdigit() else step for step in path.split("/")], value)


def test_nothing_of_a_refused_request_is_kept(client: httpx.Client) -> None:
    """A body that a cycle of references holds stays until the next full collection, some hundred requests later."""
    design = small_design()
    sha256 = client.post("/v1/validations", json={"design": design}).json()["design_sha256"]
    refused: list[tuple[str, str, Any, int]] = [
        (f"/v1/scores/batch?design_sha256={sha256}", "text/csv", b"nothing\n1\n", 422),
        ("/v1/scores", "application/json", {"design_sha256": "0" * 64}, 404),
        ("/v1/scores", "application/json", {"design": {**design, "views": []}}, 422),
        ("/v1/scores", "application/yaml", b"a: [1,", 400),
        ("/v1/verifications", "application/json", {"design": design, "trials": 10**12}, 422),
    ]

    def kept(beside: tuple[RawRequest, ...] = ()) -> tuple[RawRequest, ...]:
        found = (each for each in gc.get_objects() if isinstance(each, RawRequest))
        return tuple(each for each in found if all(each is not other for other in beside))

    gc.collect()
    others = kept()  # of other tests
    gc.disable()
    try:
        for path, media, body, status in refused:
            content = body if isinstance(body, bytes) else json.dumps(body).encode()
            assert client.post(path, content=content, headers={"Content-Type": media}).status_code == status
            # The answer may be here before the frames that made it have ended; a cycle would stay
            until(lambda: not kept(others), partial("{}: {} is kept".format, path, media))
    finally:
        gc.enable()


@pytest.mark.parametrize("path", POSTS)
@pytest.mark.parametrize(
    ("body", "status", "pointer", "code"),
    [
        (b"", 400, "", "empty-document"),
        (b"   \n", 400, "", "empty-document"),
        (b"{", 400, "", "json-syntax"),
        (b"{'design': 1}", 400, "", "json-syntax"),
        (b'{"design": {}} trailing', 400, "", "json-syntax"),
        (b'{"design": {}, "design": {}}', 400, "", "duplicate-key"),
        (b"\xff\xff{}", 400, "", "not-text"),
        (b'{"design": "\x00"}', 400, "", "not-text"),
        (b"[]", 422, "", "wrong-type"),
        (b"null", 422, "", "wrong-type"),
        (b"3", 422, "", "wrong-type"),
        (b"{}", 422, "", "missing-field"),
        (b'{"desing": {}}', 422, "/desing", "unknown-field"),
        (b'{"design": {}, "x~/y": 1}', 422, "/x~0~1y", "unknown-field"),
    ],
)
def test_a_body_that_is_no_request(
    client: httpx.Client, path: str, body: bytes, status: int, pointer: str, code: str
) -> None:
    slug = {400: "malformed-document", 422: "invalid-request"}[status]
    first = check_problem(client.post(path, content=body, headers=JSON), status, slug)["errors"][0]
    assert (first["pointer"], first["code"]) == (pointer, code)
    assert code != "json-syntax" or first["line"] == 1


@pytest.mark.parametrize("path", POSTS)
@pytest.mark.parametrize(("where", "value", "code"), read_cases("http", "fields"))
def test_a_bad_field_is_pointed_at_in_the_body_that_was_sent(
    client: httpx.Client, path: str, where: str, value: Any, code: str
) -> None:
    document = check_problem(
        client.post(path, json={**OPTIONS.get(path, {}), "design": changed(where, value)}), 422, "invalid-design"
    )
    assert (document["errors"][0]["pointer"], document["errors"][0]["code"]) == ("/design/" + where, code)


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999", "9" * 400])
def test_numbers_that_are_not_finite_are_pointed_at(client: httpx.Client, number: str) -> None:
    text = json.dumps({"design": changed("views/0/target_noise_px", "@")}).replace('"@"', number)
    document = check_problem(client.post("/v1/scores", content=text, headers=JSON), 422, "invalid-design")
    assert document["errors"][0]["pointer"] == "/design/views/0/target_noise_px"


LONG = "12345678901234567890123" + "7" * 377


@pytest.mark.parametrize("sign", ["", "-"])
def test_whole_numbers_beyond_every_range_are_told_as_they_came(client: httpx.Client, sign: str) -> None:
    design = json.dumps(changed("views/0/target_noise_px", "@")).replace('"@"', sign + LONG)
    small = json.dumps(small_design())
    policy = f'{{"schema": "tailstack/policy/1", "verification": {{"max_trials": {sign}{LONG}}}}}'
    for path, text, headers in (
        ("/v1/scores", f'{{"design": {design}}}', JSON),
        ("/v1/scores", design, YAML),
        ("/v1/verifications", f'{{"design": {small}, "trials": {sign}{LONG}}}', JSON),
        ("/v1/verifications", f'{{"design": {small}, "precision": {sign}{LONG}}}', JSON),
        ("/v1/sweeps", f'{{"design": {small}, "axes": [{{"pointer": "/a", "values": [{sign}{LONG}]}}]}}', JSON),
        ("/v1/gates", f'{{"designs": [{{"file": "a", "design": {small}}}], "policy": {policy}}}', JSON),
        ("/v1/gates", f'{{"designs": [{{"file": "a", "design": {small}}}], "seed": {sign}{LONG}}}', JSON),
    ):
        response = client.post(path, content=text, headers=headers)
        assert response.status_code == 422, response.text
        entry = response.json()["errors"][0]
        assert f"got {sign}1234567890123456789" in entry["detail"]
        assert "(400 digits)" in entry["detail"]
        assert "inf" not in entry["detail"].replace("infinite", "")


@pytest.mark.parametrize(
    ("path", "design", "slug", "pointer"),
    [
        *(("/v1/scores", design, "invalid-design", "") for design in NO_DESIGNS),
        *(
            ("/v1/scores", small_design(fiducials={"file": name}), "invalid-design", "/fiducials/file")
            for name in ("secret.csv", "/etc/passwd.csv", "../x.mrk.json", "C:\\x.csv", "http://127.0.0.1/x.csv")
        ),
        *(
            (path, coplanar_design(), "ill-posed-geometry", "/fiducials")
            for path in ("/v1/validations", "/v1/scores", "/v1/verifications")
        ),
        ("/v1/optimisations", small_design(optimise=None), "invalid-design", ""),
    ],
)
def test_a_design_that_cannot_be_used(client: httpx.Client, path: str, design: Any, slug: str, pointer: str) -> None:
    """No mapping; with a file of ours, which is never read for a stranger; that determines nothing; without freedom."""
    document = check_problem(client.post(path, json={"design": design}), 422, slug)
    assert document["errors"][0]["pointer"] == f"/design{pointer}"
    assert (document["errors"][0]["code"] == "file-refused") == pointer.endswith("/file")
    assert document["errors"][0]["hint"] or not pointer


@pytest.mark.parametrize(("path", "options", "pointer"), read_cases("http", "options"))
def test_bad_options_are_pointed_at(client: httpx.Client, path: str, options: dict[str, Any], pointer: str) -> None:
    document = check_problem(client.post(path, json={"design": small_design(), **options}), 422, "invalid-request")
    assert [entry["pointer"] for entry in document["errors"]] == [pointer]


@pytest.mark.parametrize(
    ("path", "options", "pointer", "rule", "arrived"),
    [
        ("/v1/sweeps", {"axes": []}, "/axes", "at least 1 entry", "an empty list"),
        ("/v1/sweeps", {"axes": [{"pointer": "/a", "values": [1]}] * 7}, "/axes", "at most 6 entries", "a list of 7"),
        ("/v1/sweeps", {"axes": [{"pointer": "/a", "values": []}]}, "/axes/0/values", "at least 1", "an empty list"),
        ("/v1/sweeps", {"axes": [{"pointer": "", "values": [1]}]}, "/axes/0/pointer", "must not be empty", '""'),
        ("/v1/sweeps", {"axes": [{"pointer": "x" * 501, "values": [1]}]}, "/axes/0/pointer", "at most 500", "xxx"),
        ("/v1/reports", {"parts": []}, "/parts", "at least 1 entry", "an empty list"),
        ("/v1/reports", {"parts": ["score"] * 4}, "/parts", "at most 3 entries", "a list of 4"),
    ],
)
def test_lists_and_texts_of_a_wrong_length_are_told_in_our_words(
    client: httpx.Client, path: str, options: dict[str, Any], pointer: str, rule: str, arrived: str
) -> None:
    document = check_problem(client.post(path, json={"design": small_design(), **options}), 422, "invalid-request")
    (entry,) = document["errors"]
    assert entry["pointer"] == pointer
    assert rule in entry["detail"].partition("; got ")[0]
    assert arrived in entry["detail"].partition("; got ")[2]
    example = json.loads(entry["hint"].removeprefix("for example: "))
    assert list(example) == [pointer.rpartition("/")[2]]


@pytest.mark.long
def test_no_words_of_the_library_that_checks_reach_anybody(client: httpx.Client) -> None:
    """Every way in which an option can be of the wrong type or size, by every value of a wrong kind."""
    wrong: tuple[Any, ...] = (
        None,
        True,
        -1,
        0,
        1.5,
        2**63,
        "",
        "x" * 5000,
        [],
        ["x"] * 50,
        [[]],
        {},
        {"a": 1},
        [{}],
        [{"pointer": 3}],
    )
    names = ("second_order", "trials", "precision", "seed", "method", "starts", "axes", "check", "parts")
    for path in POSTS:
        for name in names:
            for value in wrong:
                answer = client.post(path, json={"design": {}, name: value}).text
                for word in ("List should", "Input should", "String should", "Value error", "valid "):
                    assert word not in answer, (path, name, value, answer)


@pytest.mark.parametrize("path", POSTS)
@pytest.mark.parametrize(("kinds", "encodings"), read_cases("http", "media"))
def test_other_content_types_are_415(client: httpx.Client, path: str, kinds: list[str], encodings: list[str]) -> None:
    """Of two types neither counts, and of two encodings the second counts too."""
    headers = [*(("Content-Type", kind) for kind in kinds), *(("Content-Encoding", one) for one in encodings)]
    refused = check_problem(client.post(path, content=b"{}", headers=headers), 415, "unsupported-media-type")
    assert ("Content-Encoding" in refused["errors"][0]["detail"]) == bool(encodings)


def test_what_no_reader_takes_is_refused(client: httpx.Client) -> None:
    include = b"!include http://127.0.0.1/x"
    for text in (b"a: [", b"a: 1\na: 2", b"!!python/object:os.system x", include, b"*x", b"--- 1\n--- 2", b"\t- x: y"):
        check_problem(client.post("/v1/validations", content=text, headers=YAML), 400, "malformed-document")
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 12)]
    check_problem(client.post("/v1/validations", content="\n".join(lines), headers=YAML), 422, "limit-exceeded")
    check_problem(client.post("/v1/scores", content=b'{"design":' + b"[" * 90_000, headers=JSON), 422, "limit-exceeded")
    for path, body in product(("/v1/gates", "/v1/conversions"), (b"[]", b"null", b"3", b'"x"', b"{}", b'{"": [[]]}')):
        check_problem(client.post(path, content=body, headers=JSON), 422, "invalid-request")


def test_a_name_that_no_field_has_is_a_limit_of_what_can_be_read(client: httpx.Client) -> None:
    """The schema of a patch allows any name: JSON that fits it is not malformed."""
    name, patch = "k" * 210, {"views": [{"k" * 101: 1}]}
    body = {"design": small_design(), "patch": patch}
    document = check_problem(client.post("/v1/verifications", json=body), 422, "limit-exceeded")
    assert [(error["pointer"], error["code"]) for error in document["errors"]] == [("/patch/views/0", "key-too-long")]
    check_problem(
        client.post("/v1/scores/batch", json={**body, "patch": {}, "table": {name: [1]}}), 422, "limit-exceeded"
    )
    check_problem(client.post("/v1/validations", content=f"{name}: 1", headers=YAML), 422, "limit-exceeded")


def test_a_target_that_a_score_is_to_tell_is_one_of_the_design(client: httpx.Client) -> None:
    design = small_design()
    told = client.post("/v1/scores", json={"design": design, "targets": []}).json()
    assert told == client.post("/v1/scores", json={"design": design}).json()  # it decides, and is told
    body = {"design": design, "targets": ["nowhere"]}
    document = check_problem(client.post("/v1/scores", json=body), 422, "invalid-design")
    assert [(error["pointer"], error["code"]) for error in document["errors"]] == [
        ("/design/targets", "unknown-target")
    ]


def test_unknown_addresses_are_404_and_other_methods_405_with_the_allowed_ones(client: httpx.Client) -> None:
    for method, path in (("GET", "/v1"), ("POST", "/v2/scores"), ("GET", "/%00")):
        check_problem(client.request(method, path), 404, "not-found")
    for method, path, allowed in (
        ("GET", "/v1/scores", "POST"),
        ("DELETE", "/v1/verifications", "POST"),
        ("POST", "/version", "GET"),
    ):
        response = client.request(method, path)
        check_problem(response, 405, "method-not-allowed")
        assert response.headers["allow"] == allowed


def test_query_parameters_that_mean_nothing_are_refused(client: httpx.Client) -> None:
    body = {"design": small_design()}
    for method, target, pointer in (
        ("POST", "/v1/scores?second_order=true", "/second_order"),
        ("GET", "/v1/jobs?state=queued&stat=x", "/stat"),
        ("GET", "/v1/jobs?a/b~c=x", "/a~1b~0c"),
        ("POST", "/v1/jobs/01k4z8t5r2w7x3y9v6n1m0q8pc/cancel?now=1", "/now"),
        ("GET", f"/v1/results/{'a' * 64}/report?fmt=pdf", "/fmt"),
        ("GET", f"/v1/results/{'a' * 64}/report?format=", "/format"),
        ("GET", f"/v1/results/{'a' * 64}/report?format=docx", "/format"),
        ("GET", f"/v1/results/{'a' * 64}/report?format=xlsx&summary=true", "/summary"),
        ("GET", f"/v1/results/{'a' * 64}/report?format=pdf&summary=yes", "/summary"),
        ("GET", "/v1/jobs/01k4z8t5r2w7x3y9v6n1m0q8pc/events?after=2", "/after"),
    ):
        response = client.request(method, target, json=body if method == "POST" else None)
        document = check_problem(response, 422, "invalid-request")
        assert document["errors"][0]["pointer"] == pointer
    check_problem(client.post("/v1/scores?x=1", content=b"a: 1", headers=YAML), 422, "invalid-request")
    check_problem(client.post("/v1/scores?second_order=maybe", content=b"a: 1", headers=YAML), 422, "invalid-request")


def test_every_type_of_problem_has_a_page(client: httpx.Client) -> None:
    for slug, entry in CATALOGUE.items():
        page = client.get(f"/v1/problems/{slug}").json()
        assert page["status"] == entry.status
        assert page["meaning"]
        assert page["cure"]


def test_request_ids_are_echoed_or_made(client: httpx.Client) -> None:
    assert client.get("/version", headers={"X-Request-ID": "abc-1"}).headers["x-request-id"] == "abc-1"
    for offered in ("", "x" * 65, "a b", "a\tb"):
        made = client.get("/version", headers={"X-Request-ID": offered}).headers["x-request-id"]
        assert len(made) == 32
        assert made != offered


# --- limits ---------------------------------------------------------------------------------------

SMALL = Settings(max_body_bytes=20_000, max_fiducials=10, max_targets=3, max_trials=5000, max_starts=2, max_views=2)


@pytest.fixture(scope="module")
def bounded() -> Iterator[httpx.Client]:
    with client_with(SMALL) as client:
        yield client


def check_limit(response: Any, status: int, limit: str, arrived: str, setting: str) -> None:
    entry = check_problem(response, status, "limit-exceeded")["errors"][0]
    assert limit in entry["detail"]
    assert arrived in entry["detail"]
    assert setting in entry["hint"]


def test_bodies_over_the_limit_are_413(bounded: httpx.Client) -> None:
    bodies: dict[str, Any] = {"20001": b" " * 20_001, "45000": (b" " * 5000 for _ in range(9))}
    for arrived, body in bodies.items():
        response = bounded.post("/v1/scores", content=body, headers=JSON)
        check_limit(response, 413, "20000", arrived, "TAILSTACK_MAX_BODY_BYTES")


def test_an_announced_flood_is_refused_unread(bounded: httpx.Client) -> None:
    address = (bounded.base_url.host, bounded.base_url.port)
    head = b"POST /v1/scores HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    head += b"Content-Length: 99999999999\r\n\r\n"
    with socket.create_connection(address, timeout=LIMIT_SECONDS) as connection:
        connection.sendall(head)
        status, rest = read_answer(connection)
    assert status.startswith(b"HTTP/1.1 413 ")
    assert b"99999999999 bytes were announced" in rest


REGION = {"box": {"centre_mm": [0, 0, 60], "size_mm": [9, 9, 9], "points_per_axis": 2}}
VIEWS = small_design()["views"]


@pytest.mark.parametrize(
    ("path", "changes", "options", "pointer", "limit", "arrived", "setting"),
    [
        ("/v1/scores", {"fiducials": {"points": [{"position_mm": [k, (k * k) % 7, -k]} for k in range(11)]}}, {},
         "/design/fiducials/points", "10", "11", "FIDUCIALS"),
        ("/v1/scores", {"targets": [{"name": "t", "region": REGION}]}, {}, "/design/targets", "3", "8", "TARGETS"),
        ("/v1/scores", {"views": [*VIEWS, {**VIEWS[0], "name": "third"}]}, {}, "/design/views", "2", "3", "VIEWS"),
        ("/v1/verifications", {}, {"trials": 5001}, "/trials", "5000", "5001", "TRIALS"),
        ("/v1/optimisations", {}, {"starts": 3}, "/starts", "2", "3", "STARTS"),
        ("/v1/optimisations", {"optimise": {**small_design()["optimise"], "starts": 9}}, {},
         "/design/optimise/starts", "2", "9", "STARTS"),
    ],
    ids=["fiducials", "targets", "views", "trials", "starts", "starts of the design"],
)  # fmt: skip
def test_more_than_the_operator_allows_is_refused(
    bounded: httpx.Client, path: str, changes: dict[str, Any], options: dict[str, Any], pointer: str, limit: str,
    arrived: str, setting: str,
) -> None:  # fmt: skip
    response = bounded.post(path, json={"design": small_design(**changes), **options})
    check_limit(response, 422, limit, arrived, f"TAILSTACK_MAX_{setting}")
    assert response.json()["errors"][0]["pointer"] == pointer


CHECKED = {"design": small_design(), "precision": 0.05}


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("/v1/verifications", CHECKED),
        ("/v1/reports", CHECKED),
        ("/v1/comparisons", {"first": small_design(), "second": small_design(), "precision": 0.05}),
        ("/v1/sweeps", {"design": small_design(), "check": "verification", "axes": AXES}),
    ],
)
def test_a_check_that_may_draw_more_than_the_operator_allows_is_refused(
    bounded: httpx.Client, path: str, body: dict[str, Any]
) -> None:
    """Its default is 4,194,304 wherever it is computed; what the refusal says to send is accepted."""
    response = bounded.post(path, json=body)
    check_limit(response, 422, "5000", "4194304", "TAILSTACK_MAX_TRIALS")
    [entry] = response.json()["errors"]
    assert (entry["pointer"], entry["code"]) == ("/max_trials", "too-many")
    assert "max_trials: 5000" in entry["hint"]
    check_limit(bounded.post(path, json={**body, "max_trials": 5001}), 422, "5000", "5001", "TAILSTACK_MAX_TRIALS")
    assert bounded.post(path, json={**body, "max_trials": 5000}).status_code == 202


def test_what_draws_to_no_precision_is_not_held_to_the_default(bounded: httpx.Client) -> None:
    for body in ({"trials": 5000}, {"method": "radial"}):
        assert bounded.post("/v1/verifications", json={"design": small_design(), **body}).status_code == 202
    parts = {"design": small_design(), "parts": ["score"]}
    assert bounded.post("/v1/reports", json=parts).status_code == 202


# --- defects of the service itself, and odd paths -------------------------------------------------


class Broken(Response):
    """Fails before its first byte."""

    async def __call__(self, *_: Any) -> None:
        raise RuntimeError("before the head")


async def raising(_request: Request) -> Response:
    raise RuntimeError("in the endpoint")


async def unsendable(_request: Request) -> Response:
    return Broken()


async def torn(_request: Request) -> Response:
    """Fails after its head has left."""

    class Torn(Response):
        async def __call__(self, _scope: Any, _receive: Any, send: Callable[[Any], Any]) -> None:
            await send({"type": "http.response.start", "status": 200, "headers": []})
            raise RuntimeError("after the head")

    return Torn()


def asked(endpoint: Callable[[Request], Any]) -> httpx.Response:
    """The answer of this endpoint, put at /added."""
    app = create_app(Settings(), warm_up=False)
    app.router.routes.append(Route("/added", endpoint))

    async def run() -> httpx.Response:
        transport = httpx.ASGITransport(app, raise_app_exceptions=False)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            return await client.get("/added", headers={"X-Request-ID": "from-a-test"})

    return asyncio.run(run())


@pytest.mark.parametrize("endpoint", [raising, unsendable])
def test_a_defect_is_a_problem_with_the_id_of_its_log_line(
    endpoint: Callable[[Request], Any], caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO, "tailstack.service"):
        answer = asked(endpoint)
    document = check_problem(answer, 500, "internal-error")
    assert document["request_id"] == answer.headers["x-request-id"] == "from-a-test"
    assert "RuntimeError" not in answer.text
    failed, answered = [vars(record) for record in caplog.records if record.name == "tailstack.service"]
    assert (failed["action"], failed["request"], failed["exc_info"][0]) == ("failed", "from-a-test", RuntimeError)
    assert (answered["action"], answered["status"]) == ("answered", 500)


def test_a_defect_after_the_head_is_logged_and_nothing_is_sent_behind_it(caplog: pytest.LogCaptureFixture) -> None:
    app = create_app(Settings(), warm_up=False)
    app.router.routes.append(Route("/added", torn))
    scope = {
        "type": "http", "method": "GET", "path": "/added", "query_string": b"", "headers": [(b"host", b"localhost")],
    }  # fmt: skip
    sent: list[str] = []

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": b""}

    async def send(message: Any) -> None:
        sent.append(message["type"])

    with caplog.at_level(logging.INFO, "tailstack.service"):
        asyncio.run(app(scope, receive, send))
    assert sent == ["http.response.start"]  # uvicorn closes the connection
    assert [vars(record)["action"] for record in caplog.records if record.name == "tailstack.service"] == [
        "failed",
        "answered",
    ]


@pytest.mark.parametrize(("path", "instance"), read_cases("http", "instances"))
def test_instance_is_the_path_as_a_uri_reference(client: httpx.Client, path: str, instance: str) -> None:
    document = check_problem(client.get(path, headers={"Host": "localhost"}), 404, "not-found")
    assert document["instance"] == instance


# --- refusals at their place ----------------------------------------------------------------------


NOWHERE = "0" * 64


def test_a_refusal_is_placed_once_and_keeps_what_it_is() -> None:
    error = IllPosedError([Problem("/fiducials", "coplanar", "all in one plane", "move one"), Problem("", "x", "y")])
    placed = RefusedAt.place(error, "/second")
    assert [problem.pointer for problem in placed.problems] == ["/second/fiducials", "/second"]
    assert (placed.slug, placed.title, placed.exit_code) == ("ill-posed-geometry", error.title, 3)
    assert RefusedAt.place(placed, "/design") is placed
    assert [problem.pointer for problem in error.problems] == ["/fiducials", ""], "the error itself stays as it was"


def test_a_refusal_crosses_a_pipe_whole() -> None:
    placed = RefusedAt.place(DesignError(Problem("/views/0", "wrong-type", "a mapping", "", "d.yaml", 3, 1)), "/design")
    there = pickle.loads(pickle.dumps(placed))
    assert isinstance(there, RefusedAt)
    assert (there.problems, there.slug, there.title, there.exit_code, str(there)) == (
        placed.problems, placed.slug, placed.title, placed.exit_code, str(placed),
    )  # fmt: skip


@pytest.mark.parametrize("operation", ["score", "verification", "batch"])
def test_a_design_that_is_named_is_asked_for_whatever_reads_it(operation: str) -> None:
    body = {
        "design_sha256": NOWHERE,
        **({"table": {"/views/0/fiducial_noise_px": [0.1]}} if operation == "batch" else {}),
    }
    sent = RawRequest("json", canonical(body))
    found = perform.perform_call(lambda: perform.receive(operation, sent, Settings()))
    assert isinstance(found, DesignReferenceUnresolved)
    assert pickle.loads(pickle.dumps(found)).sha256 == NOWHERE


def test_an_admitted_gate_is_the_one_that_its_content_describes() -> None:
    """What is judged at once and what a job would read are one gate."""
    design = {"file": "a.yaml", "text": json.dumps(small_design())}
    admitted = admit_gate({"designs": [design], "mode": "analytic"}, today=date(2026, 11, 21))
    again = read_gate(admitted.content)
    assert (again.seed, again.mode, again.today) == (admitted.gate.seed, admitted.gate.mode, admitted.gate.today)
    assert [entry.design.sha256 for entry in again.designs if entry.design] == [
        entry.design.sha256 for entry in admitted.gate.designs if entry.design
    ]
    assert admitted.terms["policy_sha256"] == again.policy.sha256

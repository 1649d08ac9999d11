"""No route fetches an address that a user gave: every text of every request example is replaced by one, in turn.

A design that several operations take has its texts replaced one by one for the first of them; of the others those that
were accepted there are replaced at once, for each job costs four reports.
"""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import pytest
from openapi_scenes import ended_job, json_examples, light, operations, parameters
from served import served
from service_scenes import client_of

from plain_data import places_of, replaced, value_at
from waiting import LIMIT_SECONDS, until

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

"""Requests that name a design by its hash, or say only what differs from one.

Designs are kept for that, a while and in bounds.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
import sqlalchemy as sa
from service_scenes import check_problem, client_with, small_design
from store_scenes import Clock

from plain_data import read_cases
from tailstack.errors import Problem
from tailstack_service.http import service
from tailstack_service.http.service import CLOSING_SECONDS, FRESH_SECONDS, PAUSE_SECONDS, KeptDesigns
from tailstack_service.jobs.store import results, tables, upkeep
from tailstack_service.jobs.store.database import Database, writing
from tailstack_service.operations.request import merge
from tailstack_service.problems import StoreUnavailable
from tailstack_service.settings import Settings
from turned_clock import TurnedClock
from waiting import until_async

MOVED = [12.0, -31.0, -44.0]
NOWHERE = "0" * 64


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> str:
    return f"sqlite:///{tmp_path_factory.mktemp('partial') / 'jobs.sqlite3'}"


@pytest.fixture(scope="module")
def client(database: str) -> Iterator[httpx.Client]:
    with client_with(Settings(database=database, worker_processes=1), worker=True) as client:
        yield client


def score(client: httpx.Client, **body: Any) -> httpx.Response:
    return client.post("/v1/scores", json=body)


def sha256_of(response: httpx.Response) -> str:
    assert response.status_code == 200, response.text
    return response.json()["provenance"]["design_sha256"]


@pytest.mark.long
def test_a_patch_of_a_named_design_is_answered_like_the_whole_design(client: httpx.Client) -> None:
    """independent: the patched design is written out by hand."""
    name = sha256_of(score(client, design=small_design()))
    patch = {
        "name": "looser", "targets": [{"name": "tip", "position_mm": MOVED}],
        "interfaces": {
            "connector_flange": None, "structure_connector": {"tolerances": {"rz": {"half_width_deg": 0.4}}},
        },
    }  # fmt: skip
    whole = small_design(name="looser", targets=[{"name": "tip", "position_mm": MOVED}])
    del whole["interfaces"]["connector_flange"]
    whole["interfaces"]["structure_connector"]["tolerances"]["rz"]["half_width_deg"] = 0.4

    expected = score(client, design=whole)
    assert sha256_of(expected) != name
    assert score(client, design_sha256=name, patch=patch).content == expected.content
    assert score(client, design=small_design(), patch=patch).content == expected.content
    assert score(client, design_sha256=name).content == score(client, design=small_design()).content


@pytest.mark.parametrize("escaped", [True, False])
def test_a_patch_may_write_its_letters_as_escapes(client: httpx.Client, escaped: bool) -> None:
    """independent: the patched design is written out; what a body holds is read in another way where escapes are."""
    body = json.dumps({"design": small_design(), "patch": {"name": "Träger"}}, ensure_ascii=escaped).encode()
    patched = client.post("/v1/scores", content=body, headers={"Content-Type": "application/json"})
    assert sha256_of(patched) == sha256_of(score(client, design=small_design(name="Träger")))


@pytest.mark.parametrize(("target", "patch", "merged"), read_cases("http", "patches"))
def test_patches_are_those_of_rfc_7396(target: Any, patch: Any, merged: Any) -> None:
    """published: RFC 7396, appendix A, every row."""
    before = json.dumps(target)
    assert merge(target, patch) == merged
    assert json.dumps(target) == before


@pytest.mark.long
def test_the_hash_still_works_after_a_restart_and_at_another_process(client: httpx.Client, database: str) -> None:
    name = sha256_of(score(client, design=small_design(name="kept")))
    with client_with(Settings(database=database, worker_processes=1)) as another:
        assert sha256_of(score(another, design_sha256=name)) == name


def test_a_design_that_is_not_kept_is_asked_for_whole(client: httpx.Client) -> None:
    problem = check_problem(score(client, design_sha256=NOWHERE, patch={}), 404, "unknown-design")
    assert problem["errors"][0]["pointer"] == "/design_sha256"
    assert "send the design whole" in problem["errors"][0]["hint"]


def test_a_patched_design_of_a_score_is_not_kept_but_that_of_a_job_is(client: httpx.Client) -> None:
    body = {"design": small_design(), "patch": {"name": "a frame of a drag"}}
    name = sha256_of(client.post("/v1/scores", json=body))
    check_problem(score(client, design_sha256=name), 404, "unknown-design")
    assert client.post("/v1/verifications", json={**body, "trials": 1000}).status_code == 202
    assert sha256_of(score(client, design_sha256=name)) == name


@pytest.mark.long
def test_none_is_kept_where_the_operator_says_so(tmp_path: Path) -> None:
    with client_with(Settings(database=f"sqlite:///{tmp_path / 'jobs.sqlite3'}", max_kept_designs=0)) as client:
        name = sha256_of(score(client, design=small_design()))
        check_problem(score(client, design_sha256=name), 404, "unknown-design")


def test_another_tenants_design_is_one_that_never_was(store: Database) -> None:
    results.keep_designs(store, [("a", NOWHERE, b"{}")], 10)
    assert results.read_design(store, "a", NOWHERE) == b"{}"
    assert results.read_design(store, "b", NOWHERE) is None


def test_a_design_that_was_changed_in_the_database_is_not_used(store: Database) -> None:
    results.keep_designs(store, [("a", NOWHERE, b'{"name":"a"}')], 10)
    with writing(store) as connection:
        connection.execute(sa.update(tables.designs).values(body=b'{"name":"b"}'))
    assert results.read_design(store, "a", NOWHERE) is None
    results.keep_designs(store, [("a", NOWHERE, b'{"name":"a"}')], 10)
    assert results.read_design(store, "a", NOWHERE) == b'{"name":"a"}'


def test_a_design_that_is_sent_again_stays_and_old_ones_go(store: Database, clock: Clock) -> None:
    for name in ("1", "2", "1", "3"):
        clock.advance(60)
        results.keep_designs(store, [("a", name * 64, b"{}")], 2)
    assert [results.read_design(store, "a", name * 64) is not None for name in "123"] == [True, False, True]
    assert upkeep.purge(store, 30.0).designs == 0
    clock.advance(40 * 86_400)
    results.keep_designs(store, [("a", "3" * 64, b"{}")], 2)
    assert upkeep.purge(store, 30.0).designs == 1
    assert [results.read_design(store, "a", name * 64) is not None for name in "13"] == [False, True]


def test_a_refusal_points_into_the_patched_design(client: httpx.Client) -> None:
    name = sha256_of(score(client, design=small_design()))
    views = small_design()["views"]
    views[1]["fiducial_noise_px"] = -1.0
    patch = {"views": views, "targets": None, "interfaces": {"connector_flange": {"tolerances": {"qx": {}}}}}
    problem = check_problem(score(client, design_sha256=name, patch=patch), 422, "invalid-design")
    places = ("views/1/fiducial_noise_px", "interfaces/connector_flange/tolerances/qx", "targets")
    assert {entry["pointer"] for entry in problem["errors"]} == {f"/design/{place}" for place in places}


@pytest.mark.parametrize(
    ("body", "pointer", "code"),
    [
        ({"design": small_design(), "design_sha256": NOWHERE}, "/design_sha256", "one-of"),
        ({"design_sha256": "7a"}, "/design_sha256", "bad-text"),
        ({"design_sha256": 7}, "/design_sha256", "bad-text"),
        ({"patch": {}}, "", "missing-field"),
        ({"design": small_design(), "patch": []}, "/patch", "wrong-type"),
        ({"design": small_design(), "patch": None}, "/patch", "wrong-type"),
        ({"design": small_design(), "path": {}}, "/path", "unknown-field"),
    ],
)  # fmt: skip
def test_what_cannot_be_meant_is_refused(client: httpx.Client, body: dict[str, Any], pointer: str, code: str) -> None:
    problem = check_problem(client.post("/v1/scores", json=body), 422, "invalid-request")
    assert [(entry["pointer"], entry["code"]) for entry in problem["errors"]] == [(pointer, code)]


@pytest.mark.parametrize(("path", "options"), read_cases("http", "patched"))
def test_every_operation_on_one_design_takes_a_patch(client: httpx.Client, path: str, options: dict[str, Any]) -> None:
    """The same request as the whole design: a job of the one is the job of the other."""
    name = sha256_of(score(client, design=small_design()))
    whole = {"design": small_design(name="patched"), **options}
    parts = {"design_sha256": name, "patch": {"name": "patched"}, **options}
    key = {} if path in ("/v1/validations", "/v1/layouts") else {"Idempotency-Key": path}
    first, second = (client.post(path, json=body, headers=key) for body in (whole, parts))
    assert first.status_code in (200, 202), first.text
    assert (second.status_code, second.headers.get("location")) == (first.status_code, first.headers.get("location"))
    if key:
        assert second.headers["idempotency-replayed"] == "true"
        client.post(f"{first.headers['location']}/cancel")  # nobody waits for what it would compute
    else:
        assert second.content == first.content


# --- designs that are kept ------------------------------------------------------------------------


class Table:
    """Stands for the database of several API processes."""

    def __init__(self) -> None:
        self.rows: dict[tuple[str, str], bytes] = {}
        self.writes: list[int] = []
        self.broken = False

    async def read(self, tenant: str, sha256: str) -> bytes | None:
        return self.rows.get((tenant, sha256))

    async def write(self, entries: list[tuple[str, str, bytes]]) -> None:
        self.writes.append(len(entries))
        if self.broken:
            raise StoreUnavailable(Problem("", "store-unavailable", "gone"))
        self.rows |= {(tenant, sha256): body for tenant, sha256, body in entries}


async def test_a_design_is_found_at_once_where_it_came_and_soon_elsewhere() -> None:
    table, clock = Table(), TurnedClock()
    here, there = (KeptDesigns(table.read, table.write, clock=clock) for _ in range(2))
    here.keep("a", [("1", b"{}")])
    assert table.rows == {}
    assert await here.find("a", "1") == b"{}"
    assert await found_later(there, "a", "1", clock, lambda: table.rows) == b"{}"
    assert await found_later(there, "b", "1", clock) is None


async def found_later(
    designs: KeptDesigns, tenant: str, sha256: str, clock: TurnedClock, written: Callable[[], object] = lambda: True
) -> bytes | None:
    """A design that is not there yet: whoever asks for it looks a second time, after several writes."""
    asking = asyncio.ensure_future(designs.find(tenant, sha256))
    await clock.until_waits_async(4 * PAUSE_SECONDS)
    clock.turn(PAUSE_SECONDS)
    await until_async(written)
    clock.turn(3 * PAUSE_SECONDS)
    return await asking


async def written(table: Table, count: int, clock: TurnedClock) -> None:
    """Let the pause pass until there were so many writes."""
    await clock.until_waits_async(PAUSE_SECONDS)
    clock.turn(PAUSE_SECONDS)
    await until_async(lambda: len(table.writes) == count)


async def test_what_comes_together_is_written_together_and_once_and_after_long_again() -> None:
    """By then the database may have forgotten it."""
    table, clock = Table(), TurnedClock()
    here = KeptDesigns(table.read, table.write, clock=clock)
    for name in "1231":
        here.keep("a", [(name, b"{}")])
    await written(table, 1, clock)
    clock.turn(FRESH_SECONDS - 0.001)
    here.keep("a", [("1", b"{}")])
    assert not here._waiting
    clock.turn(0.002)
    here.keep("a", [("1", b"{}")])
    await written(table, 2, clock)
    await here.close()
    assert table.writes == [3, 1]


async def test_a_design_that_is_gone_is_written_again_when_it_is_sent_again() -> None:
    table, clock = Table(), TurnedClock()
    here = KeptDesigns(table.read, table.write, clock=clock)
    here.keep("a", [("1", b"{}")])
    await written(table, 1, clock)
    table.rows.clear()
    assert await found_later(here, "a", "1", clock) is None
    here.keep("a", [("1", b"{}")])
    await here.close()
    assert table.rows == {("a", "1"): b"{}"}


async def test_a_database_that_does_not_answer_holds_no_stop_up() -> None:
    table, clock = Table(), TurnedClock()

    async def never(entries: list[tuple[str, str, bytes]]) -> None:
        await asyncio.get_running_loop().create_future()

    here = KeptDesigns(table.read, never, clock=clock)
    here.keep("a", [("1", b"{}")])
    closing = asyncio.create_task(here.close())
    await clock.until_waits_async(CLOSING_SECONDS)
    assert not closing.done()
    clock.turn(CLOSING_SECONDS)
    await closing


async def test_without_a_database_little_is_remembered_and_nobody_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "MOST_WAITING", 3)
    table = Table()
    table.broken = True
    here = KeptDesigns(table.read, table.write)
    here.keep("a", [(name, b"{}") for name in "12345"])
    await here.close()
    assert table.writes == [3]
    assert await here.find("a", "5") is None

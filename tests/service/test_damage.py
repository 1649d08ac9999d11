"""Stored bytes that were changed behind the service's back: not served, not computed with, not passed on."""

from __future__ import annotations

import hashlib
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from service_scenes import client_of, client_with, small_design
from store_scenes import Clock, claim, claim_one, find, finish, record, split, submit, url_of

from tailstack_service.cli.main import main
from tailstack_service.http.server import running_service
from tailstack_service.jobs.store import events, jobs, results, upkeep, usage
from tailstack_service.jobs.store.database import Database, writing
from tailstack_service.problems import DamagedStore
from tailstack_service.settings import Settings
from waiting import until

BODY = {"design": small_design(), "trials": 1000}
FORGED = b'{"schema":"tailstack/verification/1","p95_mm":0.0}'


def change(db: Database, statement: str, value: bytes) -> None:
    with writing(db) as connection:
        mark = "?" if db.dialect == "sqlite" else "%s"
        assert connection.exec_driver_sql(statement.replace("?", mark), (value,)).rowcount == 1


# --- over HTTP, with a worker ---------------------------------------------------------------------


@pytest.mark.long
def test_a_changed_result_is_refused_its_job_says_so_and_asked_again_it_is_computed_anew(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "jobs.sqlite3"
    settings = Settings(database=f"sqlite:///{path}", worker_processes=1, max_wait_seconds=600.0)
    keyed = {"Idempotency-Key": "one", "Prefer": "wait=600"}
    with (
        running_service(settings, worker=True, worker_log=tmp_path / "worker.log") as (host, port),
        client_of(f"http://{host}:{port}") as client,
    ):
        until(lambda: client.get("/health/ready").status_code == 200)
        first = client.post("/v1/verifications", json=BODY, headers=keyed)
        assert first.status_code == 200, first.text
        result, job = first.headers["content-location"], first.headers["location"]
        tag = {"If-None-Match": client.get(result).headers["etag"]}
        assert client.get(result, headers=tag).status_code == 304
        with closing(sqlite3.connect(path)) as other, other:
            other.execute("UPDATE results SET body = ?", (FORGED,))

        for _ in range(2):  # and it stays so
            for address, headers in ((result, {}), (result, tag), (f"{result}/report", {}), (f"{job}/result", {})):
                refused = client.get(address, headers=headers)
                assert refused.status_code == 503, (address, refused.text)
                assert refused.json()["type"] == "/v1/problems/store-error"
                assert "immutable" not in refused.headers.get("cache-control", "")
        document = client.get(job).json()
        assert (document["state"], document["problem"]["type"]) == ("failed", "/v1/problems/store-error")
        assert result.rpartition("/")[2] in document["problem"]["detail"]
        assert document["result_sha256"] is None
        stream = client.get(f"{job}/events").text
        assert stream.count("event: state") >= 3
        assert '"failed"' in stream
        assert any(record.__dict__.get("action") == "damaged" for record in caplog.records)
        assert "tailstack_jobs_damaged 1.0" in client.get("/metrics").text
        assert main(["jobs", "show", job.rpartition("/")[2], "--url", str(client.base_url)]) == 0

        again = client.post("/v1/verifications", json=BODY, headers=keyed)
        assert again.status_code == 200, again.text
        assert again.headers["location"] != job
        assert again.content == first.content
        assert client.get(result).content == first.content


def test_garbage_is_not_served_to_who_waits_for_it(tmp_path: Path) -> None:
    with client_with(Settings(database=f"sqlite:///{tmp_path / 'jobs.sqlite3'}")) as client:
        missing = client.get("/v1/results/" + "0" * 64)
        assert missing.status_code == 404


# --- in the store ---------------------------------------------------------------------------------


def finished_job(db: Database, answer: bytes = b'{"answer":1}', **changes: Any) -> jobs.Job:
    made = split(db, 1, **changes)
    finish(db, answer)
    assert find(db, made).state == "succeeded"
    return find(db, made)


def test_every_job_of_every_tenant_that_came_to_it_fails(store: Database, clock: Clock) -> None:
    mine = [finished_job(store), finished_job(store)]
    theirs = finished_job(store, tenant="other")
    apart = finished_job(store, b'{"answer":2}')
    ended, name = clock.now, str(mine[0].result_sha256)
    clock.advance(5)
    change(store, "UPDATE results SET body = ? WHERE sha256 = '" + name + "'", FORGED)
    with pytest.raises(DamagedStore, match=name):
        results.read_result(store, "acme", name)
    for job in (*mine, theirs):
        seen = find(store, job)
        assert (seen.state, seen.result_sha256, seen.finished_at) == ("failed", None, ended)
        assert seen.problem is not None
        assert seen.problem["type"] == "/v1/problems/store-error"
        told = events.read_events(store, job.tenant, job.id, job.last_event, 9)
        assert [(event.name, event.data["state"]) for event in told] == [("state", "failed")]
    with pytest.raises(DamagedStore):
        results.read_result(store, "other", name)
    assert results.read_result(store, "stranger", name) is None
    assert find(store, apart).state == "succeeded"
    assert [check.name for check in upkeep.check_database(store) if not check.ok] == []
    assert usage.read_figures(store).damaged_jobs == 3

    healed = finished_job(store)
    kept = results.read_result(store, "acme", name)
    assert kept is not None
    assert (healed.result_sha256, kept.body) == (name, b'{"answer":1}')
    upkeep.purge(store, 1e-9)
    clock.advance(10)
    assert upkeep.purge(store, 1e-9).jobs > 0
    assert usage.read_figures(store).damaged_jobs == 0


def test_an_answer_that_is_computed_again_is_stored_over_changed_bytes(store: Database) -> None:
    """Nobody had looked at it in between."""
    name = str(finished_job(store).result_sha256)
    change(store, "UPDATE results SET body = ?", FORGED)
    finished_job(store)
    kept = results.read_result(store, "acme", name)
    assert kept is not None
    assert hashlib.sha256(kept.body).hexdigest() == name


def test_an_answer_that_is_gone_is_told_apart_from_one_that_never_was(tmp_path: Path, migrated_file: Path) -> None:
    from tailstack_service.jobs.store.schema import open_database

    path = tmp_path / "a.sqlite3"
    path.write_bytes(migrated_file.read_bytes())
    with closing(open_database(f"sqlite:///{path}")) as db:
        job = finished_job(db)
        with closing(sqlite3.connect(path)) as other, other:  # which knows of no foreign keys
            other.execute("DELETE FROM results")
        with pytest.raises(DamagedStore):
            results.read_result(db, "acme", str(job.result_sha256))
        assert find(db, job).state == "failed"


def test_a_key_whose_job_lost_its_answer_makes_a_fresh_job(store: Database) -> None:
    job = finished_job(store, idempotency_key="k")
    change(store, "UPDATE results SET body = ?", FORGED)
    assert results.mend(store) == (1, 1)
    assert results.mend(store) == (0, 0)
    again = submit(store, idempotency_key="k")
    assert again.id != job.id


@pytest.mark.parametrize(
    ("statement", "code"),
    [
        ("UPDATE units SET result = ? WHERE number = 1", "damaged-part"),
        ("UPDATE requests SET body = ?", "damaged-request"),
    ],
)
def test_nothing_is_computed_from_changed_requests_or_parts(
    store: Database, clock: Clock, statement: str, code: str
) -> None:
    job = split(store, 2, idempotency_key="k")
    for held in claim(store, limit=2):
        assert record(store, held, result=b"result of " + held.spec)
    clock.advance(1)
    sound = submit(store, request=b'{"design":{"of":"another"}}')
    change(
        store,
        statement + (f" AND job_id = '{job.id}'" if "number" in statement else f" WHERE job_id = '{job.id}'"),
        FORGED,
    )
    wrong = [check.name for check in upkeep.check_database(store) if not check.ok]
    assert len(wrong) == 1
    assert "hash" in wrong[0]
    assert claim(store) == []  # the job that came first fails
    assert claim_one(store).job_id == sound.id
    failed = find(store, job)
    assert failed.state == "failed"
    assert failed.problem is not None
    assert failed.problem["errors"][0]["code"] == code
    assert submit(store, idempotency_key="k").id != job.id


def test_what_is_damaged_is_found_and_mended(
    store: Database, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("TAILSTACK_DATABASE", url_of(store))
    name = str(finished_job(store).result_sha256)
    change(store, "UPDATE results SET body = ?", FORGED)
    assert main(["db", "check"]) == 3
    assert name in capsys.readouterr().out
    assert main(["db", "mend"]) == 0
    assert "1 damaged answers deleted; 1 jobs" in capsys.readouterr().out
    assert main(["db", "check"]) == 0

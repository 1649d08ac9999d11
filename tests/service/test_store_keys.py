"""API keys: shown once, found by their secret only, refused when revoked or expired.

Who did what to keys and policies is there for an auditor, without a secret, and never without bounds.
"""

from __future__ import annotations

import hashlib
import json
import os
import pwd
import re
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import pytest
import sqlalchemy as sa
from service_scenes import client_with, limited
from store_scenes import Clock

from plain_data import problems_of, read_cases
from tailstack.errors import Problem
from tailstack_service.jobs.store import audit, tables, upkeep
from tailstack_service.jobs.store.database import Database, reading
from tailstack_service.jobs.store.keys import Key, create_key, find_key, list_keys, revoke_key
from tailstack_service.jobs.store.schema import open_database
from tailstack_service.problems import RequestError, StoreUnavailable
from tailstack_service.settings import Settings
from waiting import until

DAY = 86_400.0
SECRET = re.compile(r"tsk_[0-9a-f]{12}_[A-Za-z0-9_-]{43}")


def make(db: Database, **changes: object) -> tuple[Key, str]:
    given: dict[str, object] = {"tenant": "acme", "name": "CAD plug-in", "scopes": ("read", "compute"), "days": 30.0}
    return create_key(db, **(given | changes))  # type: ignore[arg-type]


def test_a_key_is_found_by_its_secret_only(store: Database, clock: Clock) -> None:
    key, secret = make(store, scopes=("metrics", "read"))
    other, _ = make(store, tenant="other")
    assert SECRET.fullmatch(secret)
    assert key == Key(key.id, "acme", "CAD plug-in", ("read", "metrics"), clock.now, clock.now + 30 * DAY, None)
    assert find_key(store, secret) == key
    digits = secret.rpartition("_")[2] if secret.count("_") == 2 else secret[17:]
    forged = [
        "", "tsk_", key.id, secret[:-1], secret + "A", secret[:-1] + ("A" if secret[-1] != "A" else "B"),
        f"tsk_{other.id}_{digits}", f"tsk_{'0' * 12}_{digits}", secret.upper(), f" {secret}", secret + "\n",
        secret.replace("tsk", "TSK"), "tsk_" + "\0" * 56, "é" * 60,
    ]  # fmt: skip
    assert [find_key(store, text) for text in forged] == [None] * len(forged)


def test_secrets_are_not_kept(store: Database) -> None:
    key, secret = make(store)
    with reading(store) as connection:
        row = connection.execute(sa.select(tables.keys)).one()
    assert row.secret_sha256 == hashlib.sha256(secret.encode()).hexdigest()
    assert not any(secret[17:] in str(value) for value in row)
    assert secret not in repr(list_keys(store))
    assert row.secret_sha256 not in repr(list_keys(store))
    assert len({make(store)[1] for _ in range(10)}) == 10
    assert key.id in secret


def test_a_revoked_key_is_refused_at_once(store: Database, clock: Clock) -> None:
    key, secret = make(store)
    kept, kept_secret = make(store)
    clock.advance(5)
    revoked = revoke_key(store, key.id)
    assert revoked is not None
    assert revoked.revoked_at == clock.now
    assert find_key(store, secret) is None
    assert find_key(store, kept_secret) == kept
    clock.advance(5)
    assert revoke_key(store, key.id) == revoked  # the first time counts
    assert revoke_key(store, "nobody") is None
    assert [action for action, *_ in seen(store)] == ["key-created", "key-created", "key-revoked"]
    assert [(listed.id, state) for listed, state in list_keys(store)].count((key.id, "revoked")) == 1


def test_an_expired_key_is_refused(store: Database, clock: Clock) -> None:
    key, secret = make(store, days=0.5)
    clock.advance(DAY / 2 - 1)
    assert find_key(store, secret) == key
    clock.advance(1)
    assert find_key(store, secret) is None
    assert [state for _, state in list_keys(store)] == ["expired"]


def test_keys_are_listed_by_tenant_the_oldest_first(store: Database, clock: Clock) -> None:
    made = []
    for number in range(4):
        clock.advance(1)
        made.append(make(store, tenant=("acme", "other")[number % 2])[0])
    assert [key for key, _ in list_keys(store)] == made
    assert [key for key, _ in list_keys(store, "other")] == made[1::2]
    assert list_keys(store, "nobody") == []


@pytest.mark.parametrize(("changes", "pointers"), read_cases("keys", "keys"))
def test_a_key_that_cannot_be_is_refused(store: Database, changes: dict[str, object], pointers: list[str]) -> None:
    assert [problem.pointer for problem in problems_of(make, store, **changes, error=RequestError)] == pointers
    assert list_keys(store) == []
    assert seen(store) == []


def test_the_life_of_a_key_on_the_command_line(
    store: Database, clock: Clock, command: Callable[..., tuple[int, str, str]]
) -> None:
    code, out, err = command("keys", "list")
    assert (code, out) == (0, "")
    assert "tailstack keys create" in err

    code, out, err = command("keys", "create", "--tenant", "acme", "--name", "CAD", "--scope", "read", "--days", "2")
    assert code == 0
    assert SECRET.fullmatch(out.rstrip("\n"))  # stdout holds the secret and nothing else
    assert "Authorization: Bearer tsk_" in err
    assert out.strip() not in err
    secret, key_id = out.strip(), out[4:16]
    clock.now = list_keys(store)[0][0].created_at  # the command used the real time
    found = find_key(store, secret)
    assert found is not None
    assert (found.scopes, found.expires_at) == (("read",), pytest.approx(clock.now + 2 * DAY))

    code, out, err = command("keys", "list")
    assert code == 0
    assert key_id in out
    assert secret[17:] not in out + err
    listed = json.loads(command("keys", "list", "--json", "--tenant", "acme")[1])
    assert [(entry["id"], entry["scopes"], entry["state"]) for entry in listed] == [(key_id, ["read"], "active")]
    assert set(listed[0]) == {*Key.__dataclass_fields__, "state"}
    assert json.loads(command("keys", "list", "--json", "--tenant", "nobody")[1]) == []

    code, out, err = command("keys", "revoke", key_id)
    assert (code, out) == (0, "")
    assert find_key(store, secret) is None
    assert "revoked" in command("keys", "list")[1]


def test_usage_errors_name_what_to_type(command: Callable[..., tuple[int, str, str]]) -> None:
    for arguments, words in (
        (("keys",), "tailstack keys --help"),
        (("keys", "create", "--tenant", "A B", "--name", "x"), "--tenant metrology"),
        (("keys", "create", "--tenant", "a", "--name", "x", "--scope", "all"), "--scope read --scope compute"),
        (("keys", "revoke", "nobody"), "tailstack keys list"),
    ):
        code, out, err = command(*arguments)
        assert (code, out) == (2, "")
        assert words in err


# --- who did what ---------------------------------------------------------------------------------


HOUR = 3_600.0
TERMS = {"policy_sha256": "a" * 64, "policy_name": "p", "fail_level": "error"}


def seen(db: Database, **choice: Any) -> list[tuple[str, str, str]]:
    return [(e.action, e.tenant, e.subject) for e in audit.list_entries(db, limit=10_000, **choice)]


@pytest.mark.long("postgresql")
def test_an_operator_who_makes_and_revokes_keys_is_named(
    store: Database, command: Callable[..., tuple[int, str, str]]
) -> None:
    me = pwd.getpwuid(os.getuid()).pw_name
    secret = command("keys", "create", "--tenant", "acme", "--name", "CAD plug-in")[1].strip()
    key_id = secret[4:16]
    command("keys", "create", "--tenant", "other", "--name", "x")
    command("keys", "revoke", secret)  # a leaked one revokes its key
    command("keys", "revoke", key_id)  # a second time changes nothing
    assert command("keys", "revoke", "0" * 12)[0] == 2
    code, out, _ = command("keys", "log", "--json")
    told = json.loads(out)
    assert code == 0
    assert [(e["action"], e["tenant"]) for e in told] == [
        ("key-created", "acme"), ("key-created", "other"), ("key-revoked", "acme")
    ]  # fmt: skip
    assert all(e["actor"].startswith(f"{me}@") for e in told)
    assert told[0]["subject"] == told[2]["subject"] == key_id
    assert told[0]["detail"]["scopes"] == ["read", "compute"]
    assert all(re.match(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d", e["at"]) for e in told)
    text = command("keys", "log", "--tenant", "acme")[1]
    assert "key-revoked" in text
    assert "other" not in text
    only = command("keys", "log", "--action", "key-revoked")[1]
    assert "key-created" not in only
    for shown in (out, text, only):
        assert secret[17:] not in shown


def test_the_use_of_a_key_is_noted_once_an_hour_and_address(store: Database, clock: Clock) -> None:
    clock.now = 500_000 * HOUR
    for _ in range(3):
        for address in ("192.0.2.1", "192.0.2.2"):
            audit.note_use(store, "k", "acme", address)
            clock.advance(60)
    assert [entry.detail for entry in audit.list_entries(store, limit=9)] == [
        {"address": "192.0.2.1"}, {"address": "192.0.2.2"}
    ]  # fmt: skip
    clock.advance(HOUR)
    audit.note_use(store, "k", "acme", "192.0.2.1")
    assert len(seen(store)) == 3


def test_who_uses_a_key_from_everywhere_does_not_fill_the_database(store: Database, clock: Clock) -> None:
    clock.now = 500_000 * HOUR
    for number in range(audit.MOST_AN_HOUR + 20):
        audit.note_use(store, "k", "acme", f"2001:db8::{number:x}")
        audit.note_policy(store, "key k", "acme", {**TERMS, "policy_sha256": f"{number:064d}"})
    audit.note_use(store, "k2", "other", "192.0.2.1")
    found = audit.list_entries(store, tenant="acme", limit=10_000)
    assert len(found) == 2 * (audit.MOST_AN_HOUR + 1)
    assert sum("omitted" in entry.detail for entry in found) == 2
    assert seen(store, tenant="other") == [("key-used", "other", "k2")]


def test_a_policy_is_noted_when_it_changes(store: Database, clock: Clock) -> None:
    softer = {**TERMS, "policy_sha256": "b" * 64}
    for terms in (TERMS, TERMS, softer, softer, {**softer, "fail_level": "warning"}, TERMS):
        clock.advance(1)
        audit.note_policy(store, "key k", "acme", terms)
    audit.note_policy(store, "key o", "other", TERMS)
    found = audit.list_entries(store, tenant="acme", limit=99)
    assert [entry.subject[0] for entry in found] == ["a", "b", "b", "a"]
    assert [entry.detail["changed"] for entry in found] == [
        [], ["policy_sha256"], ["fail_level"], ["fail_level", "policy_sha256"]
    ]  # fmt: skip
    assert found[1].detail["before"] == TERMS
    assert len(seen(store, tenant="other")) == 1


def test_entries_are_kept_for_their_time(store: Database, clock: Clock) -> None:
    create_key(store, tenant="acme", name="x", scopes=("read",), days=1)
    assert upkeep.purge(store, 30.0, 30.0).audit_entries == 0
    clock.advance(40 * DAY)
    create_key(store, tenant="other", name="x", scopes=("read",), days=1)
    assert upkeep.purge(store, 30.0, 30.0).audit_entries == 1
    assert [tenant for _, tenant, _ in seen(store)] == ["other"]


# --- over HTTP ------------------------------------------------------------------------------------


def gate(client: httpx.Client, **changes: Any) -> None:
    body = {"designs": [{"file": "a.yaml", "design": limited(5.0)}], "mode": "analytic", **changes}
    response = client.post("/v1/gates", json=body)
    assert response.status_code == 200, response.text


@pytest.mark.long
def test_a_key_that_is_used_and_a_policy_that_is_changed_over_http(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'jobs.sqlite3'}"
    with closing(open_database(url, migrate=True)) as db:
        key, secret = create_key(db, tenant="acme", name="x", scopes=("read", "compute"), days=1)
        with client_with(Settings(database=url, auth="required")) as client:
            client.headers["Authorization"] = f"Bearer {secret}"
            for _ in range(3):
                assert client.get("/v1/jobs").status_code == 200
            until(lambda: ("key-used", "acme", key.id) in seen(db))
            gate(client)
            gate(client)
            policy = {"schema": "tailstack/policy/1", "name": "soft", "guard_band_percent": 0.0}
            gate(client, policy=policy)
            gate(client, policy=policy)
            gate(client, policy=policy, fail_level="warning")
        found = audit.list_entries(db, limit=99)
    used = [entry for entry in found if entry.action == "key-used"]
    assert 1 <= len(used) <= 2  # an hour may end in between
    assert used[0].detail == {"address": "127.0.0.1"}
    changes = [entry for entry in found if entry.action == "policy-changed"]
    assert [(entry.actor, entry.detail["changed"]) for entry in changes] == [
        (f"key {key.id}", []),
        (f"key {key.id}", ["policy_name", "policy_sha256"]),
        (f"key {key.id}", ["fail_level"]),
    ]
    assert secret[17:] not in repr(found)


@pytest.mark.long
def test_a_gate_is_answered_where_it_cannot_be_noted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def away(*_: object) -> None:
        raise StoreUnavailable(Problem("", "store-unavailable", "it is away"))

    monkeypatch.setattr(audit, "note_policy", away)
    with client_with(Settings(database=f"sqlite:///{tmp_path / 'jobs.sqlite3'}")) as client:
        gate(client)
    assert any(record.__dict__.get("action") == "not-audited" for record in caplog.records)

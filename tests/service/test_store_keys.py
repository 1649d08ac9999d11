"""API keys: shown once, found by their secret only, refused when revoked or expired."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable

import pytest
import sqlalchemy as sa
from store_scenes import Clock

from tailstack_service.jobs.store import tables
from tailstack_service.jobs.store.database import Database, reading
from tailstack_service.jobs.store.keys import Key, create_key, find_key, list_keys, revoke_key
from tailstack_service.problems import RequestError

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


@pytest.mark.parametrize(
    ("changes", "pointers"),
    [
        ({"tenant": "Acme"}, ["/tenant"]),
        ({"tenant": ""}, ["/tenant"]),
        ({"tenant": "a" * 65}, ["/tenant"]),
        ({"tenant": "a\0"}, ["/tenant"]),
        ({"name": ""}, ["/name"]),
        ({"name": "a\nb"}, ["/name"]),
        ({"name": "a" * 101}, ["/name"]),
        ({"scopes": ()}, ["/scopes"]),
        ({"scopes": ("read", "write")}, ["/scopes"]),
        ({"days": 0.0}, ["/days"]),
        ({"days": 4_000.0}, ["/days"]),
        ({"days": float("nan")}, ["/days"]),
        ({"days": float("inf")}, ["/days"]),
        ({"name": "right-to-left \u202e"}, ["/name"]),
        ({"tenant": "/", "name": "", "scopes": ("x",), "days": -1.0}, ["/tenant", "/name", "/scopes", "/days"]),
    ],
)  # fmt: skip
def test_a_key_that_cannot_be_is_refused(store: Database, changes: dict[str, object], pointers: list[str]) -> None:
    with pytest.raises(RequestError) as caught:
        make(store, **changes)
    assert [problem.pointer for problem in caught.value.problems] == pointers
    assert list_keys(store) == []


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


def test_a_leaked_secret_revokes_its_key(store: Database, command: Callable[..., tuple[int, str, str]]) -> None:
    key, secret = make(store)
    assert command("keys", "revoke", secret)[0] == 0
    assert list_keys(store)[0][1] == "revoked"
    assert list_keys(store)[0][0].id == key.id


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

"""Make, list and revoke the API keys of a service with TAILSTACK_AUTH=required, and read who did so (the audit log)."""

from __future__ import annotations

import argparse
import sys
from contextlib import closing
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from tailstack.errors import Problem
from tailstack.results.json_text import write_json

from ..console.command_line import Answer, add_database, program, read_settings, whole
from ..problems import RequestError, StoreError
from ..rendering.text import draw_table

if TYPE_CHECKING:
    from ..jobs.store.database import Database

HELP = "make, list or revoke API keys; who did what"
ACTIONS = ("key-created", "key-revoked", "key-used", "policy-changed")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    create = actions.add_parser("create", help="make a key; its secret is printed once")
    create.add_argument("--tenant", metavar="T", required=True, help="whose jobs it reaches")
    create.add_argument("--name", metavar="N", required=True, help="who or what uses it, for the list")
    words = "read, compute or metrics; may be repeated (default: read and compute)"
    create.add_argument("--scope", action="append", metavar="S", help=words)
    create.add_argument("--days", type=float, default=365.0, metavar="D", help="good for D days (default %(default)g)")
    list_ = actions.add_parser("list", help="every key, without secrets")
    list_.add_argument("--tenant", metavar="T", help="only this tenant's")
    list_.add_argument("--json", action="store_true", help="as JSON")
    revoke = actions.add_parser("revoke", help="refuse a key from now on")
    revoke.add_argument("id", metavar="ID", help="as tailstack keys list shows it, or the secret itself")
    log = actions.add_parser("log", help="who made, revoked or first used keys, and changed policies of gates")
    log.add_argument("--tenant", metavar="T", help="only what concerns this tenant")
    log.add_argument("--action", dest="only", metavar="A", choices=ACTIONS, help=f"only {', '.join(ACTIONS)}")
    log.add_argument("--days", type=float, default=30.0, metavar="D", help="of the last D days (default %(default)g)")
    log.add_argument("--limit", type=whole(1), default=1000, metavar="N", help="the last N (default %(default)s)")
    log.add_argument("--json", action="store_true", help="as JSON")
    for action in (create, list_, revoke, log):
        add_database(action)


def run(arguments: argparse.Namespace) -> Answer:
    with closing(_open(read_settings(arguments).database_url, reads=arguments.action in ("list", "log"))) as db:
        return {"create": _create, "list": _list, "revoke": _revoke, "log": _log}[arguments.action](db, arguments)


def _open(url: str, *, reads: bool) -> Database:
    """What only reads does not change the file; a database that nobody has made yet is made, and holds no key."""
    from ..jobs.store.schema import open_database

    try:
        return open_database(url, read_only=True) if reads else open_database(url, migrate=True)
    except StoreError as error:
        if not reads or error.problems[0].code not in ("no-database", "no-schema"):
            raise
    return open_database(url, migrate=True)


def _create(db: Database, arguments: argparse.Namespace) -> Answer:
    from ..jobs.store.keys import create_key

    scopes = tuple(arguments.scope or ("read", "compute"))
    key, secret = create_key(db, tenant=arguments.tenant, name=arguments.name, scopes=scopes, days=arguments.days)
    print(
        f"key {key.id} of tenant {key.tenant}, scopes {', '.join(key.scopes)}, good until {_day(key.expires_at)}.\n"
        "The line on stdout is its secret: it is shown this once. Send it with every request:\n"
        f"  Authorization: Bearer tsk_{key.id}_...",
        file=sys.stderr,
    )
    return Answer(secret + "\n")


def _list(db: Database, arguments: argparse.Namespace) -> Answer:
    from ..jobs.store.keys import list_keys

    keys = list_keys(db, arguments.tenant)
    if arguments.json:
        return Answer(write_json([{**asdict(key), "state": state} for key, state in keys]).encode())
    if not keys:
        print(f"there are no keys; to make one: {program()} keys create --tenant T --name N", file=sys.stderr)
        return Answer("")
    rows = [
        (key.id, key.tenant, key.name, " ".join(key.scopes), _day(key.created_at), _day(key.expires_at), state)
        for key, state in keys
    ]
    return Answer(draw_table(("id", "tenant", "name", "scopes", "created", "expires", "state"), rows, left=7) + "\n")


def _revoke(db: Database, arguments: argparse.Namespace) -> Answer:
    from ..jobs.store.keys import read_key_id, revoke_key

    key_id = read_key_id(arguments.id)
    key = revoke_key(db, key_id)
    if key is None:
        raise RequestError(Problem("", "unknown-key", f"there is no key {key_id[:40]!r}", "tailstack keys list"))
    print(
        f"key {key.id} of tenant {key.tenant} is refused from now on (running services notice within 5 s)",
        file=sys.stderr,
    )
    return Answer("")


def _log(db: Database, arguments: argparse.Namespace) -> Answer:
    from ..jobs.store import audit
    from ..logs import moment

    since = db.clock.time() - arguments.days * 86_400.0
    entries = audit.list_entries(db, tenant=arguments.tenant, action=arguments.only, since=since, limit=arguments.limit)
    if arguments.json:
        return Answer(write_json([{**asdict(entry), "at": moment(entry.at)} for entry in entries], indent=2).encode())
    rows = [
        (moment(entry.at), entry.actor, entry.action, entry.tenant, entry.subject, _describe_detail(entry.detail))
        for entry in entries
    ]
    return Answer(draw_table(("at", "who", "what", "tenant", "which", "detail"), rows, left=6) + "\n" if rows else "")


def _describe_detail(detail: dict[str, Any]) -> str:
    """A detail on a line: of a policy, which of its terms changed."""
    if "terms" in detail:
        return f"changed: {', '.join(detail['changed'])}" if detail["before"] is not None else "the first"
    return write_json(detail)


def _day(epoch_seconds: float) -> str:
    from datetime import UTC, datetime

    return datetime.fromtimestamp(epoch_seconds, UTC).strftime("%Y-%m-%d")

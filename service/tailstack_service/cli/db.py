"""Create and check the database of jobs of TAILSTACK_DATABASE (empty: a SQLite file of yours)."""

from __future__ import annotations

import argparse
import sys
from contextlib import closing

from ..console.command_line import NOT_EVALUATED, PASS, Answer, add_database, read_settings

HELP = "migrate or check the database of jobs"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    migrate = actions.add_parser("migrate", help="create the tables, or bring them to this version")
    check = actions.add_parser("check", help="look at every job, unit and result; exit code 3 if one is wrong")
    for action in (migrate, check):
        add_database(action)


def run(arguments: argparse.Namespace) -> Answer:
    from ..jobs.store import schema

    url = read_settings(arguments).database_url
    if arguments.action == "migrate":
        before, after = schema.migrate_database(url)
        words = "already at" if before == after else "created with" if before is None else f"from {before} to"
        print(f"{_hide_password(url)}: {words} schema version {after}", file=sys.stderr)
        return Answer("")
    return _check(url)


def _check(url: str) -> Answer:
    from ..jobs.store import upkeep
    from ..jobs.store.database import connect

    with closing(connect(url, read_only=True)) as db:
        checks = upkeep.check_database(db)
    lines = [f"{'ok  ' if entry.ok else 'FAIL'}  {entry.name}: {entry.detail}\n" for entry in checks]
    sound = all(entry.ok for entry in checks)
    lines.append(f"{_hide_password(url)}: {'sound' if sound else 'not sound'}\n")
    return Answer("".join(lines), PASS if sound else NOT_EVALUATED)


def _hide_password(url: str) -> str:
    from ..jobs.store.database import parse_url

    return parse_url(url).set(drivername=parse_url(url).get_backend_name()).render_as_string(hide_password=True)

"""Look at the jobs of a running service, follow one to its end, or cancel it. A key is taken from TAILSTACK_KEY."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, get_args
from urllib.parse import quote, urlencode

from tailstack.results.digits import percent
from tailstack.results.json_text import write_json

from ..console.command_line import NOT_EVALUATED, PASS, Answer, whole
from ..console.progress import Progress, say
from ..jobs.document import KINDS, State
from ..rendering.text import draw_table

if TYPE_CHECKING:
    from ..console.remote import RemoteService

HELP = "jobs of a running service: list, show, follow, cancel"
PAGE = 200
# What to type after a refusal of one job, by its class
HINTS = {"not-found": "tailstack jobs list shows the ids of yours", "finished": "tailstack jobs show {id}"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    list_ = actions.add_parser("list", help="jobs, newest first")
    list_.add_argument("--state", choices=get_args(State), help="only jobs in this state")
    list_.add_argument("--kind", choices=KINDS, help="only jobs of this kind")
    list_.add_argument("--limit", type=whole(1), default=50, metavar="N", help="at most N (default %(default)s)")
    show = actions.add_parser("show", help="one job in full")
    follow = actions.add_parser("follow", help="progress until the job ends, also across restarts")
    cancel = actions.add_parser("cancel", help="stop a job; nothing of it is recorded any more")
    for action in (show, follow, cancel):
        action.add_argument("id", metavar="ID", help="as tailstack jobs list shows it")
    for action in (list_, show, follow, cancel):
        action.add_argument("--url", metavar="URL", help="the service (default TAILSTACK_URL, or this machine's)")
        action.add_argument("--json", action="store_true", help="records as JSON (tailstack schema job)")


def run(arguments: argparse.Namespace) -> Answer:
    from ..console.remote import RemoteError, RemoteService
    from ..settings import refuse_unknown

    refuse_unknown(os.environ)
    service = RemoteService(arguments.url)
    try:
        return ACTIONS[arguments.action](service, arguments)
    except RemoteError as error:
        if "id" in arguments and error.slug in HINTS:
            hint = HINTS[error.slug].format(id=arguments.id)
            error.problems = tuple(replace(problem, hint=hint) for problem in error.problems)
        raise


def _list(service: RemoteService, arguments: argparse.Namespace) -> Answer:
    query = {"limit": min(arguments.limit, PAGE), "state": arguments.state, "kind": arguments.kind}
    path: str | None = "/v1/jobs?" + urlencode({name: value for name, value in query.items() if value is not None})
    records: list[dict[str, Any]] = []
    while path is not None and len(records) < arguments.limit:
        page = service.ask_record("GET", path)
        records += page["jobs"]
        path = page["next"]
    records = records[: arguments.limit]
    if arguments.json:
        return Answer(write_json(records).encode())
    if not records:
        command = f"curl {service.url}/v1/verifications -H 'Content-Type: application/yaml' --data-binary @design.yaml"
        print(f"there are no such jobs; to make one: {command}", file=sys.stderr)
        return Answer("")
    return Answer(jobs_text(records))


def _record(record: dict[str, Any], arguments: argparse.Namespace, code: int = PASS) -> Answer:
    if arguments.json:
        return Answer(write_json(record).encode(), code)
    return Answer(job_text(record), code)


def _path(arguments: argparse.Namespace) -> str:
    return "/v1/jobs/" + quote(arguments.id, safe="")


def _follow(service: RemoteService, arguments: argparse.Namespace) -> Answer:
    """Exit code 0 when the job has succeeded, that of its problem when it failed, 3 when it was cancelled."""
    from ..console.remote import EXIT_CODE

    record = service.ask_record("GET", _path(arguments))
    what = f"{record['kind']} {record['id']}"
    with Progress(what) as progress:
        for name, data in ((event.name, event.data) for event in service.events(record["id"])):
            if name == "progress":
                done, expected = data["units_done"], max(data["units_expected"], 1)
                progress.report(done, expected, ", ".join(filter(None, (f"unit {done} of {expected}", data["note"]))))
            elif name == "recomputed":
                say(f"{what}: begun anew: the solver was upgraded from {data['from']} to {data['to']}")
            else:
                say(f"{what}: {data.get('state', name)}")
    record = service.ask_record("GET", _path(arguments))
    if record["state"] == "succeeded":
        return _record(record, arguments)
    slug = record["problem"]["type"].rpartition("/")[2] if record["problem"] else ""
    return _record(record, arguments, EXIT_CODE.get(slug, NOT_EVALUATED))


ACTIONS: dict[str, Callable[[RemoteService, argparse.Namespace], Answer]] = {
    "list": _list,
    "show": lambda service, arguments: _record(service.ask_record("GET", _path(arguments)), arguments),
    "follow": _follow,
    "cancel": lambda service, arguments: _record(service.ask_record("POST", _path(arguments) + "/cancel"), arguments),
}


# --- as text ----------------------------------------------------------------------------------------------


def jobs_text(records: Sequence[Mapping[str, Any]]) -> str:
    """One line a job."""
    rows = [
        (
            record["id"], record["kind"], record["state"], record["design_name"],
            _second(record["created_at"]), f"{percent(record['progress']['fraction'], 0)} %",
        )
        for record in records
    ]  # fmt: skip
    header = ("id", "kind", "state", "design", "created (UTC)", "done")
    return draw_table(header, rows, left=5, whole=(0, 1, 2, 4)) + "\n"


def job_text(record: Mapping[str, Any]) -> str:
    """Everything about one job."""
    progress = record["progress"]
    lines = [
        ("id", record["id"]),
        ("kind", record["kind"]),
        ("design", record["design_name"]),
        ("state", record["state"]),
        ("progress", progress_text(record)),
        ("created", _second(record["created_at"])),
        ("started", _second(record["started_at"])),
        ("finished", _second(record["finished_at"])),
        ("solver", record["solver_version"]),
        ("note", record["recomputed"] or progress["note"]),
        ("result", record["links"]["result"]),
    ]
    text = "".join(f"{name:<10}{value}\n" for name, value in lines if value)
    if record["problem"] is not None:
        text += "".join(
            f"{'problem':<10}{error['pointer']}{': ' if error['pointer'] else ''}{error['detail']}\n"
            + (f"{'':<10}hint: {error['hint']}\n" if error["hint"] else "")
            for error in record["problem"]["errors"]
        )
    return text


def progress_text(record: Mapping[str, Any]) -> str:
    """``40 %, unit 4 of 10, about 2 s left``."""
    progress = record["progress"]
    parts = [f"{percent(progress['fraction'], 0)} %", f"unit {progress['units_done']} of {progress['units_expected']}"]
    if progress["eta_seconds"]:
        parts.append(f"about {max(progress['eta_seconds'], 1):.0f} s left")
    return ", ".join(parts)


def _second(moment: str | None) -> str:
    return "" if moment is None else moment[:19].replace("T", " ")

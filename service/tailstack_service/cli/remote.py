"""A running service seen from the command line: requests, problems as exceptions, jobs followed to their end."""

from __future__ import annotations

import hashlib
import http.client
import json
import os
import sys
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from tailstack.errors import IllPosedError, InfeasibleError, NotConvergedError, OutOfRangeError, Problem, TailstackError
from tailstack.json_text import write_json

from ..console.answer import BAD_INPUT, NOT_EVALUATED
from ..console.progress import Progress
from ..job_document import ENDED
from ..names import KEY, URL

DEFAULT_URL = "http://127.0.0.1:8321"
SECONDS = 30.0  # for an answer that does not wait for anything
SENDING_SECONDS = 120.0  # for the service to accept a request, or to answer it at once
SILENCE_SECONDS = 45.0  # an event stream says something more often than that
LARGEST_EVENT = 1_000_000
FIRST_PAUSE, LONGEST_PAUSE = 0.5, 10.0
# A service gives its hints to whoever speaks HTTP; these are for whoever types commands, by code of the problem
HINTS = {
    "unauthenticated": f"set {KEY} to an API key (an operator makes one: tailstack keys create) or a JSON Web Token",
    "missing-scope": f"set {KEY} to a key with that scope (an operator makes one: tailstack keys create --scope S)",
    "foreign-origin": "name the service itself with --url",
    "wrong-host": "name the service with --url as its operator does (TAILSTACK_ALLOWED_HOSTS)",
    "not-found": "is this the address of a tailstack service? --url names another",
}
OPTIONAL = {"file": None, "line": None, "column": None}
EXIT_CODE = {kind.slug: kind.exit_code for kind in (IllPosedError, InfeasibleError, NotConvergedError, OutOfRangeError)}


class RemoteError(TailstackError):
    """A refusal that a service sent, or that it could not be reached (status 0)."""

    def __init__(self, slug: str, title: str, status: int, problems: tuple[Problem, ...]) -> None:
        super().__init__(problems)
        self.slug, self.title, self.status = slug, title, status
        later = status == 0 or status in (408, 409, 429) or status >= 500
        self.exit_code = EXIT_CODE.get(slug, NOT_EVALUATED if later else BAD_INPUT)


@dataclass(frozen=True, slots=True)
class Reply:
    status: int
    headers: Mapping[str, str]  # names in small letters
    body: bytes

    def json(self) -> Any:
        return json.loads(self.body)


@dataclass(frozen=True, slots=True)
class Event:
    """One server-sent event."""

    id: str
    name: str
    data: dict[str, Any]


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    """A redirect could carry the key to another host; the one that the service sends is followed by hand."""

    def redirect_request(self, *_: Any) -> None:
        return None


class Service:
    """A service at a URL; the key comes from TAILSTACK_KEY and is never shown.  Raises RemoteError for a bad URL.

    Without a URL it is that of TAILSTACK_URL, otherwise the one that ``tailstack serve`` has on this machine.
    """

    def __init__(self, url: str | None = None, key: str | None = None) -> None:
        url = os.environ.get(URL, "").strip() or DEFAULT_URL if url is None else url
        parts = urllib.parse.urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            detail = f"{url[:200]!r} is not the URL of a service"
            problem = Problem("", "bad-url", detail, f"for example {DEFAULT_URL}")
            raise RemoteError("invalid-request", "The request is not valid", 400, (problem,))
        self.url = url.rstrip("/")
        self._key = key if key is not None else os.environ.get(KEY, "").strip()
        loopback = parts.hostname in ("localhost", "127.0.0.1", "::1")
        if self._key and parts.scheme == "http" and not loopback:
            print(f"warning: {KEY} is sent to {parts.hostname} unencrypted; use https", file=sys.stderr)
        proxies: dict[str, str] | None = {} if loopback else None
        self._opener = urllib.request.build_opener(urllib.request.ProxyHandler(proxies), _NoRedirect())

    def ask(
        self, method: str, path: str, data: Any = None, *, headers: Mapping[str, str] | None = None,
        seconds: float = SECONDS,
    ) -> Reply:  # fmt: skip
        """The answer to a request; ``data`` goes as JSON.  Raises RemoteError for a refusal and a silent service."""
        body = None if data is None else write_json(data).encode()
        sent = {"Accept": "application/json, */*"} | ({} if body is None else {"Content-Type": "application/json"})
        with self._open(method, path, body, {**sent, **(headers or {})}, seconds) as answer:
            try:
                content = answer.read()
            except (OSError, http.client.HTTPException) as error:
                raise self._unreachable(error) from None
            status, named = answer.status, {name.lower(): value for name, value in answer.headers.items()}
        if status == 303 and named.get("location", "").startswith("/"):
            return self.ask("GET", named["location"], seconds=seconds)
        if status >= 400:
            raise read_refusal(status, content)
        return Reply(status, named, content)

    def _open(self, method: str, path: str, body: bytes | None, headers: Mapping[str, str], seconds: float) -> Any:
        request = urllib.request.Request(self.url + path, body, dict(headers), method=method)
        if self._key:
            request.add_unredirected_header("Authorization", f"Bearer {self._key}")
        try:
            return self._opener.open(request, timeout=seconds)
        except urllib.error.HTTPError as error:
            return error  # an answer like any other
        except (OSError, http.client.HTTPException) as error:
            raise self._unreachable(error) from None

    def _unreachable(self, error: Exception) -> RemoteError:
        reason = getattr(error, "reason", None) or getattr(error, "strerror", None) or error
        problem = Problem(
            "", "unreachable", f"no answer from {self.url}: {reason}",
            "start one with tailstack serve, or name another (--url; of sweep and gate: --remote)",
        )  # fmt: skip
        return RemoteError("unreachable", "The service cannot be reached", 0, (problem,))

    def events(self, job_id: str, *, patience: float = 60.0) -> Iterator[Event]:
        """What happens to a job, from its first event to its last; a stream that breaks is taken up where it ended.

        Raises RemoteError when the service refuses, or does not come back within ``patience`` seconds.
        """
        last, pause, silent_since = "", FIRST_PAUSE, time.monotonic()
        while True:
            try:
                headers = {"Accept": "text/event-stream"} | ({"Last-Event-ID": last} if last else {})
                with self._open("GET", f"/v1/jobs/{job_id}/events", None, headers, SILENCE_SECONDS) as answer:
                    if answer.status == 204:
                        return
                    if answer.status != 200:
                        raise read_refusal(answer.status, answer.read(LARGEST_EVENT))
                    for event in read_events(answer):
                        last, pause, silent_since = event.id, FIRST_PAUSE, time.monotonic()
                        yield event
                        if event.name == "state" and event.data.get("state") in ENDED:
                            return
            except (OSError, http.client.HTTPException):
                pass
            except RemoteError as error:
                if error.status not in (0, 503) or time.monotonic() - silent_since > patience:
                    raise
            time.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE)


def read_events(lines: Any) -> Iterator[Event]:
    """Events of a stream of byte lines (HTML standard, 9.2.6).  One that is cut off by the end is dropped."""
    fields: dict[str, list[str]] = {}
    last = ""
    while line := lines.readline(LARGEST_EVENT):
        text = line.decode("utf-8").rstrip("\r\n")
        if text:
            name, _, value = text.partition(":")
            if name:
                fields.setdefault(name, []).append(value.removeprefix(" "))
            continue
        last = fields.get("id", [last])[-1]
        if "data" in fields:
            yield Event(last, fields.get("event", ["message"])[-1], json.loads("\n".join(fields["data"])))
        fields = {}


def read_refusal(status: int, content: bytes) -> RemoteError:
    """What a problem document says, as an exception; anything else is told by its status."""
    try:
        document = json.loads(content)
        told = (Problem(**{**OPTIONAL, **entry}) for entry in document["errors"])
        problems = tuple(replace(problem, hint=HINTS.get(problem.code, problem.hint)) for problem in told)
        return RemoteError(document["type"].rpartition("/")[2], document["title"], status, problems)
    except (ValueError, KeyError, TypeError, AttributeError):
        problem = Problem("", "unexpected-answer", f"status {status}, and not a problem document: is this a tailstack?")
        return RemoteError("unexpected-answer", "The service gave an unexpected answer", status, (problem,))


def compute_remotely(service: Service, path: str, request: dict[str, Any], progress: Progress) -> bytes:
    """The document that a service makes of a request.  Ctrl-C cancels the job.  Raises RemoteError."""
    reply = service.ask("POST", path, request, seconds=SENDING_SECONDS)
    if reply.status != 202:
        return reply.body
    job = reply.json()
    place = f"/v1/jobs/{job['id']}"
    try:
        for event in service.events(job["id"]):
            if event.name == "progress":
                progress.report(event.data["units_done"], event.data["units_expected"], f"job {job['id']}")
        job = service.ask("GET", place).json()
    except KeyboardInterrupt:
        _cancel(service, place)
        raise
    if job["state"] != "succeeded":
        raise _unfinished_error(job)
    body = service.ask("GET", f"/v1/results/{job['result_sha256']}").body
    if hashlib.sha256(body).hexdigest() != job["result_sha256"]:
        raise _damage_error(job)
    return body


def _cancel(service: Service, place: str) -> None:
    """Nobody waits for the job any more."""
    try:
        service.ask("POST", place + "/cancel", seconds=5.0)
    except RemoteError:
        return


def _damage_error(job: dict[str, Any]) -> RemoteError:
    """An answer that is not the one that was recorded, changed where it is stored or on its way."""
    detail = f"the answer of job {job['id']} arrived changed: its SHA-256 is not {job['result_sha256']}"
    problem = Problem("", "damaged-answer", detail, "ask again; a proxy in between must pass bytes on as they are")
    return RemoteError("store-error", "The answer is damaged", 0, (problem,))


def _unfinished_error(job: dict[str, Any]) -> RemoteError:
    """A job that failed with its own problem, or was cancelled."""
    document = job["problem"]
    if document is None:
        detail = f"job {job['id']} is {job['state']}: there is no answer"
        problem = Problem("", "not-finished", detail, "start it again")
        return RemoteError("not-finished", f"The {job['kind']} was not finished", 0, (problem,))
    problems = tuple(Problem(**{**OPTIONAL, **entry}) for entry in document["errors"])
    return RemoteError(document["type"].rpartition("/")[2], document["title"], 0, problems)

"""A running service seen from the command line: requests, problems as exceptions, jobs followed to their end."""

from __future__ import annotations

import hashlib
import json
import os
import ssl
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any

import httpx
from httpx_sse import EventSource

from tailstack.errors import IllPosedError, InfeasibleError, NotConvergedError, OutOfRangeError, Problem, TailstackError
from tailstack.results.json_text import write_json

from ..clock import SYSTEM_CLOCK, Clock
from ..environment import KEY, URL
from ..processes.task import ENDED
from .command_line import BAD_INPUT, NOT_EVALUATED

Report = Callable[[float, float], None]  # done, of how much

DEFAULT_URL = "http://127.0.0.1:8321"
SECONDS = 30.0  # for an answer that does not wait for anything
SENDING_SECONDS = 120.0  # for the service to accept a request, or to answer it at once
SILENCE_SECONDS = 45.0  # an event stream says something more often than that
EVENT_STREAM = "text/event-stream"
LOOPBACK = ("localhost", "127.0.0.1", "::1")
LARGEST_PORT = 65_535
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
        later = status < 400 or status in (408, 409, 429) or status >= 500
        self.exit_code = EXIT_CODE.get(slug, NOT_EVALUATED if later else BAD_INPUT)


@dataclass(frozen=True, slots=True)
class ServerSentEvent:
    """One server-sent event."""

    id: str
    name: str
    data: dict[str, Any]


class RemoteService:
    """A service at a URL; the key comes from TAILSTACK_KEY and is never shown.  Raises RemoteError for a bad URL.

    Without a URL it is that of TAILSTACK_URL, otherwise the one that ``tailstack serve`` has on this machine.
    """

    def __init__(self, url: str | None = None, key: str | None = None, *, clock: Clock = SYSTEM_CLOCK) -> None:
        self._clock = clock
        url = os.environ.get(URL, "").strip() or DEFAULT_URL if url is None else url
        self.url = url.rstrip("/")
        parts = _address(url)
        key = key if key is not None else os.environ.get(KEY, "").strip()
        loopback = parts.host in LOOPBACK
        if key and parts.scheme == "http" and not loopback:
            print(f"warning: {KEY} is sent to {parts.host} unencrypted; use https", file=sys.stderr)
        try:
            self._client = httpx.Client(
                headers={"Authorization": f"Bearer {key}"} if key else None,
                follow_redirects=False,  # one could carry the key to another host; that of the service is followed here
                limits=httpx.Limits(max_keepalive_connections=0),  # a service may close one that waits, unseen
                trust_env=not loopback,  # proxies
                verify=ssl.create_default_context() if parts.scheme == "https" else False,  # the system's authorities
            )
        except (ImportError, ValueError) as error:  # a kind of proxy that is not known, or not installed
            detail = f"the proxy of the environment cannot be used: {error}"
            raise _bad_request("bad-proxy", detail, f"name an http:// proxy, or {parts.host} in NO_PROXY") from None

    def ask(self, method: str, path: str, data: Any = None, *, seconds: float = SECONDS) -> httpx.Response:
        """The answer to a request; ``data`` goes as JSON.  Raises RemoteError for a refusal and a silent service."""
        body = None if data is None else write_json(data).encode()
        headers = {"Accept": "application/json, */*"} | ({} if body is None else {"Content-Type": "application/json"})
        with self._answer(method, path, body, headers, seconds) as answer:
            answer.read()
        if answer.status_code == 303 and answer.headers.get("location", "").startswith("/"):
            # below a path the service says it with that path, or without it where it was not told of it
            below = httpx.URL(self.url).path.rstrip("/")
            location = answer.headers["location"]
            location = location.removeprefix(below) if location.startswith(f"{below}/") else location
            return self.ask("GET", location, seconds=seconds)
        if answer.status_code >= 400:
            raise read_refusal(answer.status_code, answer.content)
        return answer

    def ask_record(self, method: str, path: str) -> dict[str, Any]:
        """The record that answers a request.  Raises what ``ask`` raises, also for an answer that is none."""
        return read_record(self.ask(method, path))

    @contextmanager
    def _answer(
        self, method: str, path: str, body: bytes | None, headers: Mapping[str, str], seconds: float
    ) -> Iterator[httpx.Response]:
        """An answer whose body is still to come.  Raises RemoteError if it does not come, or breaks off."""
        try:
            with self._client.stream(method, self.url + path, content=body, headers=headers, timeout=seconds) as answer:
                yield answer
        except httpx.HTTPError as error:
            detail = f"no answer from {self.url}: {error or type(error).__name__}"
            hint = "start one with tailstack serve, or name another (--url; of gate: --remote)"
            problem = Problem("", "unreachable", detail, hint)
            raise RemoteError("unreachable", "The service cannot be reached", 0, (problem,)) from None

    def events(self, job_id: str, *, patience: float = 60.0) -> Iterator[ServerSentEvent]:
        """What happens to a job, from its first event to its last; a stream that breaks is taken up where it ended.

        Raises RemoteError when the service refuses, or does not come back within ``patience`` seconds.
        """
        last, pause = "", FIRST_PAUSE
        lost_since: float | None = None
        while True:
            headers = {"Accept": EVENT_STREAM} | ({"Last-Event-ID": last} if last else {})
            try:
                with self._answer("GET", f"/v1/jobs/{job_id}/events", None, headers, SILENCE_SECONDS) as answer:
                    if answer.status_code == 204:
                        return
                    if answer.status_code != 200 or not answer.headers.get("content-type", "").startswith(EVENT_STREAM):
                        raise read_refusal(answer.status_code, answer.read())
                    lost_since = None
                    for event in read_events(answer):
                        last, pause = event.id, FIRST_PAUSE
                        yield event
                        if event.name == "state" and event.data.get("state") in ENDED:
                            return
            except RemoteError as error:
                lost_since = self._clock.monotonic() if lost_since is None else lost_since
                if error.status not in (0, 503) or self._clock.monotonic() - lost_since > patience:
                    raise
            self._clock.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE)


def _address(url: str) -> httpx.URL:
    """The parts of a URL.  Raises RemoteError for one that names no service."""
    detail = f"{url[:200]!r} is not the URL of a service"
    with suppress(httpx.InvalidURL):
        parts = httpx.URL(url)
        if parts.scheme in ("http", "https") and parts.host and (parts.port or 1) <= LARGEST_PORT:
            if not parts.userinfo:
                return parts
            detail = f"the URL of a service carries no name or password; the key is in {KEY}"
    raise _bad_request("bad-url", detail, f"for example {DEFAULT_URL}")


def _bad_request(code: str, detail: str, hint: str) -> RemoteError:
    return RemoteError("invalid-request", "The request is not valid", 400, (Problem("", code, detail, hint),))


def read_events(answer: httpx.Response) -> Iterator[ServerSentEvent]:
    """Events of a stream, those with data.  One that is cut off by the end is dropped."""
    for event in EventSource(answer).iter_sse():
        if event.data:
            yield ServerSentEvent(event.id, event.event, event.json())


def read_record(answer: httpx.Response) -> dict[str, Any]:
    """A JSON object of tailstack's.  Raises RemoteError for anything else, such as a page of a proxy."""
    with suppress(ValueError):
        record = answer.json()
        if isinstance(record, dict) and "schema" in record:
            return record
    raise read_refusal(answer.status_code, b"")


def read_refusal(status: int, content: bytes) -> RemoteError:
    """What a problem document says, as an exception; anything else is told by its status."""
    try:
        document = json.loads(content)
        problems = tuple(Problem(**{**OPTIONAL, **entry}) for entry in document["errors"])
        problems = tuple(replace(problem, hint=HINTS.get(problem.code, problem.hint)) for problem in problems)
        return RemoteError(document["type"].rpartition("/")[2], document["title"], status, problems)
    except (ValueError, KeyError, TypeError, AttributeError):
        problem = Problem("", "unexpected-answer", f"status {status}, and no document of ours: is this a tailstack?")
        return RemoteError("unexpected-answer", "The service gave an unexpected answer", status, (problem,))


def compute_remotely(service: RemoteService, path: str, request: dict[str, Any], report: Report | None) -> bytes:
    """The document that a service makes of a request; ``report``: how far it is.  Ctrl-C cancels the job.

    Raises RemoteError.
    """
    reply = service.ask("POST", path, request, seconds=SENDING_SECONDS)
    if reply.status_code != 202:
        return reply.content
    job = read_record(reply)
    place = f"/v1/jobs/{job['id']}"
    try:
        for event in service.events(job["id"]):
            if event.name == "progress" and report is not None:
                report(event.data["units_done"], event.data["units_expected"])
        job = service.ask_record("GET", place)
    except KeyboardInterrupt:
        with suppress(RemoteError):  # nobody waits for the job any more
            service.ask("POST", place + "/cancel", seconds=5.0)
        raise
    if job["state"] != "succeeded":
        raise _unfinished_error(job)
    body = service.ask("GET", f"/v1/results/{job['result_sha256']}").content
    if hashlib.sha256(body).hexdigest() != job["result_sha256"]:  # changed where it is stored or on its way
        detail = f"the answer of job {job['id']} arrived changed: its SHA-256 is not {job['result_sha256']}"
        problem = Problem("", "damaged-answer", detail, "ask again; a proxy in between must pass bytes on as they are")
        raise RemoteError("store-error", "The answer is damaged", 0, (problem,))
    return body


def unexpected_error(url: str, wanted: str, reason: ValueError) -> RemoteError:
    """An answer that is something else than was asked for."""
    detail = f"{url} answered with something that is not {wanted}: {str(reason).splitlines()[0]}"
    problem = Problem("", "unexpected-answer", detail, "is it a tailstack of this version? tailstack version")
    return RemoteError("unexpected-answer", "The service gave an unexpected answer", 0, (problem,))


def _unfinished_error(job: dict[str, Any]) -> RemoteError:
    """A job that failed with its own problem, or was cancelled."""
    document = job["problem"]
    if document is None:
        detail = f"job {job['id']} is {job['state']}: there is no answer"
        problem = Problem("", "not-finished", detail, "start it again")
        return RemoteError("not-finished", f"The {job['kind']} was not finished", 0, (problem,))
    problems = tuple(Problem(**{**OPTIONAL, **entry}) for entry in document["errors"])
    return RemoteError(document["type"].rpartition("/")[2], document["title"], 0, problems)

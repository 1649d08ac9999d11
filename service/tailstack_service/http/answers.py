"""Records as HTTP responses, the request headers that bear on them, and the paths that they name.

Those are ``Prefer: wait`` (RFC 7240), ``Idempotency-Key`` and ``If-None-Match``.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any
from urllib.parse import quote

from starlette.requests import Request
from starlette.responses import Response

from tailstack.errors import Problem

from ..documents import to_json
from ..environment import variable
from ..problems import RequestError, SettingsError
from ..settings import Settings

JSON = "application/json"
LONGEST_KEY = 255
DIGITS = 9
_PREFERENCE = re.compile(
    r'\s*(?P<name>[!#$%&\'*+\-.^_`|~0-9A-Za-z]+)\s*(?:=\s*(?:"(?P<quoted>[^"]*)"|(?P<token>[^\s;,"]*)))?\s*'
)
_TAG = re.compile(r'(?:W/)?"(?P<opaque>[^"]*)"')


def path_of(request: Request) -> str:
    """The path that was asked for, as a URI reference says it, whatever Host says."""
    return quote(request.scope["path"], safe="/:@!$&'()*+,;=", errors="replace")


def record_response(record: Any, status: int = 200, headers: Mapping[str, str] | None = None) -> Response:
    return Response(to_json(record), status, headers, JSON)


def tagged_response(
    request: Request, body: bytes, media_type: str, headers: Mapping[str, str], tag: str | None = None
) -> Response:
    """200 with a strong entity tag, or 304 for a client that has these very bytes.  ``tag`` is their hash, if known."""
    tag = tag or hashlib.sha256(body).hexdigest()[:32]
    headers = {**headers, "ETag": f'"{tag}"'}
    if matches_tag(request, tag):
        return Response(b"", 304, headers)
    return Response(body, 200, headers, media_type)


def read_preferences(request: Request) -> dict[str, str]:
    """Preferences by their names, with their values (RFC 7240); of two with one name the first counts."""
    preferences: dict[str, str] = {}
    for part in ",".join(request.headers.getlist("prefer")).split(","):
        if preference := _PREFERENCE.match(part):
            value = preference["token"] or "" if preference["quoted"] is None else preference["quoted"]
            preferences.setdefault(preference["name"].lower(), value)
    return preferences


def wait_seconds(request: Request, limit: float) -> int | None:
    """Seconds that the caller is willing to wait, at most ``limit``; None without such a wish.

    A preference that cannot be read is no preference (RFC 7240, 2): nothing is raised.
    """
    value = read_preferences(request).get("wait", "")
    if not re.fullmatch(r"[0-9]+", value):
        return None
    digits = value.lstrip("0")[:DIGITS]  # of what is longer, all that counts is that it is over the limit
    return min(int(digits or "0"), int(limit))


def asks_for_job(request: Request) -> bool:
    """Whether Prefer asks for a job where the answer could come at once: respond-async, or wait=N (RFC 7240)."""
    return not {"respond-async", "wait"}.isdisjoint(read_preferences(request))


def idempotency_key(request: Request) -> str | None:
    """The key, if one was sent.  Raises RequestError for one that is empty, too long or not of visible characters."""
    keys = request.headers.getlist("idempotency-key")
    if not keys:
        return None
    key = keys[0]
    if len(keys) > 1 or not 1 <= len(key) <= LONGEST_KEY or not re.fullmatch(r"[!-~]+", key):
        detail = f"an Idempotency-Key has 1 to {LONGEST_KEY} visible ASCII characters, and is sent once"
        raise RequestError(Problem("", "bad-header", detail, "a random UUID serves well"))
    return key


def matches_tag(request: Request, tag: str) -> bool:
    """Whether If-None-Match holds the entity tag (weak comparison, RFC 9110, 13.1.2)."""
    tags = ",".join(request.headers.getlist("if-none-match")).strip()
    return tags == "*" or any(entry["opaque"] == tag for entry in _TAG.finditer(tags))


def takes(request: Request, header: str, wanted: str) -> bool:
    """Whether a list of what a client takes names this, and not with the weight 0 (RFC 9110, 12.4.2)."""
    for part in ",".join(request.headers.getlist(header)).lower().split(","):
        name, _, weight = part.partition(";")
        if name.strip() == wanted:
            return weight.replace(" ", "").rstrip("0.") != "q="
    return False


# --- below which path clients see this service ---------------------------------------------------------

# Where a proxy gives it a part of an address, https://host/tailstack, what the service says of its own paths, in
# headers and records, begins with that path.  Requests are answered whether the proxy cuts it off or not.
LONGEST_ROOT = 200
_PREFIX = re.compile(r"(/(?!\.{1,2}(/|$))[A-Za-z0-9._~-]+)+")
_root: ContextVar[str] = ContextVar("root", default="")


def place(path: str) -> str:
    """A path of this service as the client of the request that is being answered sees it."""
    return _root.get() + path


def cut_root(path: str) -> str:
    """The path of a route from the one that the client asked for."""
    return path.removeprefix(_root.get()) or "/"


@contextmanager
def seen_below(root: str) -> Iterator[None]:
    """Meanwhile clients see the paths of this service below this one."""
    token = _root.set(root)
    try:
        yield
    finally:
        _root.reset(token)


def read_root_path(settings: Settings) -> str:
    """The path below which clients see the service, "" for none.  Raises SettingsError."""
    root = settings.root_path.rstrip("/")
    if root and (len(root) > LONGEST_ROOT or not _PREFIX.fullmatch(root)):
        detail = f"{variable('root_path')} must be a path such as /tailstack; got {settings.root_path[:80]!r}"
        raise SettingsError(Problem("", "bad-setting", detail, "docs/deploy.md, Below a path"))
    return root

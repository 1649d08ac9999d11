"""Pages of other sites that an operator lets call the API: cross-origin resource sharing, for the origins listed."""

from __future__ import annotations

import re
from urllib.parse import urlsplit

from starlette.middleware.cors import CORSMiddleware
from starlette.types import ASGIApp, Receive, Scope, Send

from tailstack.errors import Problem

from ..environment import variable
from ..problems import SettingsError
from ..settings import Settings

METHODS = ("GET", "POST")
SENT = ("Authorization", "Content-Type", "Idempotency-Key", "If-None-Match", "Last-Event-ID", "Prefer", "X-Request-ID")
SEEN = (
    "Allow", "Content-Disposition", "Content-Location", "ETag", "Idempotency-Replayed", "Link", "Location",
    "Preference-Applied", "Retry-After", "WWW-Authenticate", "X-Request-ID",
)  # fmt: skip
PREFLIGHT_SECONDS = 600  # for which a browser need not ask again
DEFAULT_PORTS = {"http": 80, "https": 443}
_HOST = re.compile(r"[a-z0-9._-]+|\[[0-9a-f:.]+\]")


class Origins:
    """Tells browsers that pages of the listed origins may send requests here and read the answers, refusals included.

    No cookie is ever looked at, so none is allowed.  A preflight of any other origin is what OPTIONS is otherwise.
    """

    def __init__(self, app: ASGIApp, origins: frozenset[str]) -> None:
        self._app = app
        self._origins = frozenset(origin.encode() for origin in origins)
        self._sharing = CORSMiddleware(
            app,
            allow_origins=origins,
            allow_methods=METHODS,
            allow_headers=SENT,
            expose_headers=SEEN,
            allow_private_network=True,  # from a public page to a service on loopback: it is listed
            max_age=PREFLIGHT_SECONDS,
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        stranger = scope["type"] == "http" and dict(scope["headers"]).get(b"origin") not in self._origins
        preflight = stranger and scope["method"] == "OPTIONS"
        await (self._app if preflight else self._sharing)(scope, receive, send)


def read_origins(settings: Settings) -> frozenset[str]:
    """The origins whose pages may call the API, as browsers send them.  Raises SettingsError."""
    origins = [origin.strip() for origin in settings.allowed_origins.split(",")]
    return frozenset(_read_origin(origin) for origin in origins if origin)


def _read_origin(text: str) -> str:
    if text in ("*", "null"):
        raise _setting_error(f"{text!r} stands for pages that nobody knows", "list each origin by its name")
    try:
        parts = urlsplit(text)
        port = parts.port
    except ValueError:
        raise _setting_error(f"{text[:80]!r} is no origin", HINT) from None
    host = parts.netloc.lower().rpartition(":")[0] if port is not None else parts.netloc.lower()
    rest = parts.path or parts.query or parts.fragment
    if parts.scheme not in DEFAULT_PORTS or not _HOST.fullmatch(host) or rest:
        raise _setting_error(f"{text[:80]!r} is no origin", HINT)
    return f"{parts.scheme}://{host}" + ("" if port in (None, DEFAULT_PORTS[parts.scheme]) else f":{port}")


HINT = "an origin is http:// or https://, a host and perhaps a port: https://cad.example.org"


def _setting_error(detail: str, hint: str) -> SettingsError:
    return SettingsError(Problem("", "bad-setting", f"{variable('allowed_origins')}: {detail}", hint))

"""Below which path clients see this service, where a proxy gives it a part of an address: https://host/tailstack.

What the service says of its own paths, in headers and records, begins with that path.  Requests are answered whether
the proxy cuts it off or not.
"""

from __future__ import annotations

import re
from contextvars import ContextVar

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from tailstack.errors import Problem

from ..environment import variable
from ..problems import SettingsError
from ..settings import Settings

LONGEST = 200
_PREFIX = re.compile(r"(/(?!\.{1,2}(/|$))[A-Za-z0-9._~-]+)+")
_LEAD = (b"location", b"content-location")
_root: ContextVar[str] = ContextVar("root", default="")


def place(path: str) -> str:
    """A path of this service as the client of the request that is being answered sees it."""
    return _root.get() + path


def cut_root(path: str) -> str:
    """The path of a route from the one that the client asked for."""
    return path.removeprefix(_root.get()) or "/"


class Prefix:
    """Tells routes and answers below which path the client sees them."""

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self._app, self._root = app, read_root_path(settings)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        root = self._root
        if not root or scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        path = scope["path"]
        whole = path if path.startswith(f"{root}/") else root + ("/" if path == root else path)
        lead = root.encode()

        async def send_below(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [(name, _begin_with(lead, name, value)) for name, value in message["headers"]]
            await send(message)

        token = _root.set(root)
        try:
            await self._app({**scope, "path": whole, "root_path": root}, receive, send_below)
        finally:
            _root.reset(token)


def _begin_with(lead: bytes, name: bytes, value: bytes) -> bytes:
    """The value of a header with the paths in it below ``lead``."""
    name = name.lower()
    if name in _LEAD and value.startswith(b"/"):
        return lead + value
    return value.replace(b"</", b"<" + lead + b"/") if name == b"link" else value


def read_root_path(settings: Settings) -> str:
    """The path below which clients see the service, "" for none.  Raises SettingsError."""
    root = settings.root_path.rstrip("/")
    if root and (len(root) > LONGEST or not _PREFIX.fullmatch(root)):
        detail = f"{variable('root_path')} must be a path such as /tailstack; got {settings.root_path[:80]!r}"
        raise SettingsError(Problem("", "bad-setting", detail, "docs/deploy.md, Below a path"))
    return root

"""Below which path clients see this service, where a proxy gives it a part of an address: https://host/tailstack.

What the service says of its own paths, in headers and records, begins with that path.  Requests are answered whether
the proxy cuts it off or not.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from contextvars import ContextVar
from ipaddress import IPv4Network, IPv6Network, ip_address, ip_network

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from tailstack.errors import Problem

from ..environment import variable
from ..problems import SettingsError
from ..settings import Settings

FORWARDED = b"x-forwarded-prefix"
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
    """Tells routes and answers below which path the client sees them: the setting, or the word of a trusted proxy."""

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self._app = app
        self._root = read_root_path(settings)
        self._proxies = read_proxies(settings)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        root = self._find_root(scope) if scope["type"] == "http" else ""
        if not root:
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

    def _find_root(self, scope: Scope) -> str:
        given = [value.decode("latin-1") for name, value in scope["headers"] if name == FORWARDED]
        if given and self._is_trusted(scope.get("client")):
            prefix: str = given[-1].strip().rstrip("/")
            if len(prefix) <= LONGEST and (not prefix or _PREFIX.fullmatch(prefix)):
                return prefix
        return self._root

    def _is_trusted(self, client: Iterable[object] | None) -> bool:
        try:
            address = ip_address(str(next(iter(client or ()), "")))
        except ValueError:  # a socket without an address
            return False
        return any(address in network for network in self._proxies)


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


def read_proxies(settings: Settings) -> tuple[IPv4Network | IPv6Network, ...]:
    """The networks of proxies whose X-Forwarded-Prefix is believed.  Raises SettingsError."""
    networks: list[IPv4Network | IPv6Network] = []
    for text in (entry.strip() for entry in settings.trusted_proxies.split(",")):
        try:
            networks += [ip_network(text, strict=False)] if text else []
        except ValueError:
            detail = f"{variable('trusted_proxies')}: {text[:80]!r} is no address and no network"
            raise SettingsError(Problem("", "bad-setting", detail, "such as 127.0.0.1 or 10.0.0.0/8")) from None
    return tuple(networks)

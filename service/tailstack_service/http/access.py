"""Who may ask: API keys and JSON Web Tokens; without authentication, only programs on this machine.

Nothing here writes a credential into a log, an error or a label.
"""

from __future__ import annotations

import asyncio
import hashlib
import ipaddress
import json
import logging
import re
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from starlette.requests import Request

from tailstack.errors import Problem, TailstackError

from ..clock import SYSTEM_CLOCK, Clock
from ..environment import variable
from ..jobs.store.keys import SCOPES, Key
from ..problems import SettingsError, TransportError
from ..settings import Settings

log = logging.getLogger("tailstack.service")
LOCAL_TENANT = "local"
TOKEN_TENANT = "token:"  # before the tenant of a token, which whoever issues it names; no tenant of a key has a colon
KEY_PREFIX = "tsk_"
KEY_SECONDS = 5.0  # a revoked key works no longer than this
LARGEST_MEMORY = 10_000  # keys
CLOCK_SECONDS = 10  # by which the clock of who issues tokens may be off
LONGEST_CREDENTIAL = 8_000
LEAST_SECRET_BYTES = 32  # RFC 7518, 3.2: a key of HS256 has at least the size of the hash
SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
OWN_SITES = frozenset({b"same-origin", b"none"})  # none: the person themselves, or a program that says nothing
LARGEST_PORT = 65_535
_HOST = re.compile(r"(?:(?P<name>[A-Za-z0-9._-]+)|\[(?P<address>[0-9A-Fa-f:.]+)\])(?::(?P<port>[0-9]{0,5}))?")


@dataclass(frozen=True, slots=True)
class Caller:
    """Whoever sent a request, as far as the service cares."""

    tenant: str
    scopes: frozenset[str]
    name: str  # for the log: the id of a key, never its secret
    key_id: str | None = None


FindKey = Callable[[str], Awaitable[Key | None]]
RecordUse = Callable[[str, str, str], Awaitable[None]]  # of a key: its id, its tenant, the address that it came from
LOCAL = Caller(LOCAL_TENANT, frozenset(SCOPES), LOCAL_TENANT)


class Access:
    """Admits requests.

    ``find_key`` looks an API key up by its secret, without a cache.  ``record_use`` writes the first use of a key from
    an address in an hour into the audit log.
    """

    def __init__(
        self, settings: Settings, find_key: FindKey, record_use: RecordUse, clock: Clock = SYSTEM_CLOCK
    ) -> None:
        self._clock = clock
        self.required = settings.auth == "required"
        self._find_key = find_key
        self._record_use = record_use
        self._recorded_uses: set[tuple[str, str, int]] = set()
        self._tasks: set[asyncio.Task[None]] = set()  # asyncio keeps none by itself
        self._hosts = frozenset(name.strip().lower() for name in settings.allowed_hosts.split(",") if name.strip())
        self._tokens = read_token_settings(settings)
        self._known: dict[bytes, tuple[float, Caller]] = {}

    def check_address(self, method: str, headers: Mapping[bytes, bytes], scheme: str = "http") -> None:
        """Refuse what a web page could have sent to a service without authentication.

        A page can make a browser call loopback under a name of its own (DNS rebinding), which shows in Host, or
        from its own origin, which shows in Origin and in Sec-Fetch-Site.  ``scheme``: of the request; a page of this
        very host and port under another one is another's.  Raises TransportError 421 and 403.
        """
        if self.required:
            return
        host, origin = headers.get(b"host"), headers.get(b"origin")
        if host is not None and not _names_this_machine(host, self._hosts):
            detail = f"the Host header says {host.decode('latin-1')[:80]!r}, and that is not this machine"
            hint = f"use 127.0.0.1 or localhost, or add the name to {variable('allowed_hosts')}"
            raise TransportError("wrong-host", detail, hint)
        if method in SAFE_METHODS:
            return
        if origin is not None and not _is_own_origin(origin, scheme, host or b""):
            raise _origin_error(f"a page of {origin.decode('latin-1')[:80]!r}")
        site = headers.get(b"sec-fetch-site", b"none").strip().lower()
        if site not in OWN_SITES:
            raise _origin_error(f"a page (Sec-Fetch-Site: {site.decode('latin-1')[:20]})")

    async def admit(self, request: Request, scope: str) -> Caller:
        """The caller, who has the scope.  Raises TransportError 401 (who?) and 403 (not that)."""
        caller = await self._caller(request) if self.required else LOCAL
        if caller.key_id is not None:
            self._record(caller.key_id, caller.tenant, "unknown" if request.client is None else request.client.host)
        if scope not in caller.scopes:
            detail = f"this needs the scope {scope}; {caller.name} has {', '.join(sorted(caller.scopes)) or 'none'}"
            challenge = f'Bearer error="insufficient_scope", scope="{scope}"'
            hint, headers = f"use a key with the scope {scope}", {"WWW-Authenticate": challenge}
            raise TransportError("forbidden", detail, hint, headers, code="missing-scope")
        return caller

    def _record(self, key_id: str, tenant: str, address: str) -> None:
        """Write a use into the audit log beside the request, which does not wait for it."""
        use = key_id, address, int(self._clock.time() // 3600)
        if use in self._recorded_uses:
            return
        if len(self._recorded_uses) >= LARGEST_MEMORY:
            self._recorded_uses.clear()
        self._recorded_uses.add(use)

        async def record() -> None:
            try:
                await self._record_use(key_id, tenant, address)
            except TailstackError as error:  # the next request with this key tries again
                self._recorded_uses.discard(use)
                fields = {"action": "not-audited", "tenant": tenant, "detail": f"key {key_id}"}
                log.warning("the use of a key is not in the audit log: %s", error, extra=fields)

        task = asyncio.create_task(record())
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _caller(self, request: Request) -> Caller:
        headers = request.headers.getlist("authorization")
        if len(headers) > 1:
            raise credential_error(f"{len(headers)} Authorization headers arrived; one is sent", "invalid_request")
        kind, _, credential = "".join(headers).partition(" ")
        credential = credential.strip()
        if not kind:
            raise credential_error("no Authorization header arrived", error="")
        if kind.lower() != "bearer" or not credential:
            raise credential_error("the Authorization header is not of the form: Bearer CREDENTIAL", "invalid_request")
        if len(credential) > LONGEST_CREDENTIAL or not credential.isascii():
            raise credential_error("the credential cannot be one of ours")
        if credential.startswith(KEY_PREFIX):
            return await self._find_caller(credential)
        if self._tokens is None:
            raise credential_error("the credential is not an API key, and JSON Web Tokens are not set up here")
        return self._tokens.caller(credential)

    async def _find_caller(self, secret: str) -> Caller:
        digest, now = hashlib.sha256(secret.encode()).digest(), self._clock.monotonic()
        until, caller = self._known.get(digest, (0.0, LOCAL))
        if now < until:
            return caller
        self._known.pop(digest, None)
        record = await self._find_key(secret)
        if record is None:
            raise credential_error("the API key is unknown, revoked or expired")
        caller = Caller(record.tenant, frozenset(record.scopes), f"key {record.id}", record.id)
        if len(self._known) >= LARGEST_MEMORY:
            self._known.clear()
        self._known[digest] = (now + KEY_SECONDS, caller)
        return caller


def _names_this_machine(host: bytes, hosts: frozenset[str]) -> bool:
    """Whether a Host header (RFC 9110, 7.2: name or address, perhaps a port) names this machine, or one of these."""
    parts = _HOST.fullmatch(host.decode("latin-1"))
    if parts is None or int(parts["port"] or 0) > LARGEST_PORT:
        return False
    name = (parts["name"] or parts["address"]).lower().rstrip(".")
    return is_loopback(name) or name in hosts


def _origin_error(who: str) -> TransportError:
    detail = f"{who} may not change anything here"
    return TransportError("forbidden", detail, "call the service from a program", code="foreign-origin")


def _is_own_origin(origin: bytes, scheme: str, host: bytes) -> bool:
    try:
        parts = urlsplit(origin.decode("latin-1"))
        return parts.scheme == scheme and parts.netloc.lower() == host.decode("latin-1").lower() != ""
    except ValueError:
        return False


class UnknownKey(Exception):
    """A token names a key that is not in the file."""


class Tokens:
    """JSON Web Tokens of one issuer, signed by one algorithm.  Raises SettingsError for settings that cannot work."""

    def __init__(self, settings: Settings) -> None:
        self.algorithm, self.issuer, self.audience = settings.jwt_algorithm, settings.jwt_issuer, settings.jwt_audience
        if not self.issuer:
            raise _setting_error("jwt_issuer", "must be set beside the key: a token of another issuer is not accepted")
        if not self.audience:
            raise _setting_error("jwt_audience", "must not be empty: a token meant for another service is not accepted")
        self._keys = _read_keys(Path(settings.jwt_key_file), self.algorithm)

    def caller(self, token: str) -> Caller:
        """The caller that a valid token names.  Raises TransportError 401."""
        import jwt

        try:
            claims = jwt.decode(
                token, self._key(jwt.get_unverified_header(token).get("kid")), algorithms=[self.algorithm],
                audience=self.audience, issuer=self.issuer, leeway=CLOCK_SECONDS,
                options={"require": ["iss", "aud", "exp"]},
            )  # fmt: skip
        except (jwt.PyJWTError, UnknownKey) as error:
            raise credential_error(f"the JSON Web Token is not accepted: {_reason(error)}") from None
        tenant = claims.get("tenant", claims.get("sub"))
        if not isinstance(tenant, str) or not 1 <= len(tenant) <= 128 or not tenant.isprintable():
            raise credential_error("the JSON Web Token names no tenant: it needs the claim tenant, or sub")
        return Caller(TOKEN_TENANT + tenant, _scopes(claims), f"token of {tenant}")

    def _key(self, name: object) -> Any:
        """The key that the token names; one that is alone needs no name."""
        if len(self._keys) == 1 and (name is None or None in self._keys):
            return next(iter(self._keys.values()))
        if name not in self._keys:
            raise UnknownKey
        return self._keys[name]


def _reason(error: Exception) -> str:
    """What is wrong with a token, in our words: the parser's may repeat what a stranger wrote into it."""
    import jwt

    reasons: dict[type[Exception], str] = {
        jwt.ExpiredSignatureError: "it has expired (exp)",
        jwt.ImmatureSignatureError: "it is not yet valid (nbf, iat)",
        jwt.InvalidAudienceError: "it is meant for another service (aud)",
        jwt.InvalidIssuerError: "another issuer made it (iss)",
        jwt.MissingRequiredClaimError: "it lacks one of iss, aud and exp",
        jwt.InvalidAlgorithmError: "it was signed by another algorithm (alg)",
        jwt.InvalidSignatureError: "the signature is not that of its issuer's key",
        UnknownKey: "it was signed with a key that is not in the file (kid)",
    }
    return next((reason for kind, reason in reasons.items() if isinstance(error, kind)), "it cannot be read")


def read_token_settings(settings: Settings) -> Tokens | None:
    """What reads tokens, if any are to be accepted.  Raises SettingsError for settings that cannot work."""
    return Tokens(settings) if settings.auth == "required" and settings.jwt_key_file else None


def _scopes(claims: Mapping[str, Any]) -> frozenset[str]:
    """``scope`` is a text of words (RFC 8693); some issuers write a list called ``scopes``."""
    claim = claims.get("scope", claims.get("scopes", ""))
    words = claim.split() if isinstance(claim, str) else claim if isinstance(claim, list) else ()
    return frozenset(word for word in words if word in SCOPES)


def _read_keys(path: Path, algorithm: str) -> dict[str | None, Any]:
    """Keys by their id; that of a PEM file or a shared secret has none.  Raises SettingsError."""
    import jwt

    try:
        content = path.read_bytes()
    except OSError as error:
        raise _setting_error("jwt_key_file", f"cannot be read: {path}: {error.strerror or error}") from None
    if algorithm == "HS256":
        secret = content.strip()
        if len(secret) < LEAST_SECRET_BYTES:
            detail = f"holds {len(secret)} bytes; a shared secret has at least {LEAST_SECRET_BYTES}"
            raise _setting_error("jwt_key_file", detail)
        return {None: secret}
    try:
        if content.lstrip().startswith(b"{"):
            entries = jwt.PyJWKSet.from_dict(json.loads(content)).keys
            keys: dict[str | None, Any] = {k.key_id: k for k in entries if k.algorithm_name == algorithm}
        else:
            keys = {None: jwt.get_algorithm_by_name(algorithm).prepare_key(content)}
    except (ValueError, jwt.PyJWTError) as error:
        raise _setting_error("jwt_key_file", f"is neither a PEM public key nor a JWKS file: {error}") from None
    if not keys:
        raise _setting_error("jwt_key_file", f"holds no key for {algorithm}")
    return keys


def _setting_error(name: str, detail: str) -> SettingsError:
    hint = "docs/security.md shows the whole way"
    return SettingsError(Problem("", "bad-setting", f"{variable(name)} {detail}", hint))


def credential_error(detail: str, error: str = "invalid_token") -> TransportError:
    """401 with the challenge of RFC 6750."""
    challenge = 'Bearer realm="tailstack"' + (f', error="{error}"' if error else "")
    hint = "send Authorization: Bearer <API key or JSON Web Token>"
    return TransportError("unauthenticated", detail, hint, {"WWW-Authenticate": challenge})


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach the address."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False

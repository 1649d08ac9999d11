"""Request headers that are wishes: ``Prefer: wait`` (RFC 7240), ``Idempotency-Key``, ``If-None-Match``."""

from __future__ import annotations

import re

from starlette.requests import Request

from tailstack.errors import Problem

from ..problems import RequestError

LONGEST_KEY = 255
DIGITS = 9
_PREFERENCE = re.compile(
    r'\s*(?P<name>[!#$%&\'*+\-.^_`|~0-9A-Za-z]+)\s*(?:=\s*(?:"(?P<quoted>[^"]*)"|(?P<token>[^\s;,"]*)))?\s*'
)
_TAG = re.compile(r'(?:W/)?"(?P<opaque>[^"]*)"')


def wait_seconds(request: Request, limit: float) -> int | None:
    """Seconds that the caller is willing to wait, at most ``limit``; None without such a wish.

    A preference that cannot be read is no preference (RFC 7240, 2): nothing is raised.  The first one counts.
    """
    for part in ",".join(request.headers.getlist("prefer")).split(","):
        found = _PREFERENCE.match(part)
        if found and found["name"].lower() == "wait":
            value = found["quoted"] if found["quoted"] is not None else found["token"] or ""
            if not re.fullmatch(r"[0-9]+", value):
                return None
            digits = value.lstrip("0")[:DIGITS]  # of what is longer, all that counts is that it is over the limit
            return min(int(digits or "0"), int(limit))
    return None


def idempotency_key(request: Request) -> str | None:
    """The key, if one was sent.  Raises RequestError for one that is empty, too long or not of visible characters."""
    sent = request.headers.getlist("idempotency-key")
    if not sent:
        return None
    key = sent[0]
    if len(sent) > 1 or not 1 <= len(key) <= LONGEST_KEY or not re.fullmatch(r"[!-~]+", key):
        detail = f"an Idempotency-Key has 1 to {LONGEST_KEY} visible ASCII characters, and is sent once"
        raise RequestError(Problem("", "bad-header", detail, "a random UUID serves well"))
    return key


def matches(request: Request, tag: str) -> bool:
    """Whether If-None-Match holds the entity tag (weak comparison, RFC 9110, 13.1.2)."""
    sent = ",".join(request.headers.getlist("if-none-match")).strip()
    return sent == "*" or any(found["opaque"] == tag for found in _TAG.finditer(sent))

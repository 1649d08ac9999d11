"""Partial documents: a design named by its hash or sent whole, and what differs from it (RFC 7396)."""

from __future__ import annotations

import re
from typing import Any

from tailstack.errors import Problem

from ..problems import RequestError

NAMED, PATCH = "design_sha256", "patch"  # fields of a request, beside or instead of ``design``
SHA256 = re.compile("[0-9a-f]{64}")


def merge(target: Any, patch: Any) -> Any:
    """JSON merge patch (RFC 7396): null removes, objects are merged, anything else takes the place of what was there.

    Lists are replaced whole.  ``target`` is left as it is.
    """
    if not isinstance(patch, dict):
        return patch
    merged = dict(target) if isinstance(target, dict) else {}
    for key, value in patch.items():
        if value is None:
            merged.pop(key, None)
        else:
            merged[key] = merge(merged.get(key), value)
    return merged


def refuse_partial(data: dict[str, Any]) -> None:
    """Refuse what a body has instead of the design, or beside it, where it means none.  Raises RequestError."""
    from tailstack.design.reading import show  # which loads what --help can do without

    name, patch = data.get(NAMED), data.get(PATCH, {})
    if NAMED in data and "design" in data:
        detail = f"give design or {NAMED}; both arrived"
        raise RequestError(Problem(f"/{NAMED}", "one-of", detail, "the patch is applied to the one that is given"))
    if NAMED in data and not (isinstance(name, str) and SHA256.fullmatch(name)):
        detail = f"a SHA-256 has 64 hexadecimal digits, in small letters; got {show(name)}"
        raise RequestError(Problem(f"/{NAMED}", "bad-text", detail, f"{NAMED} of an answer is one"))
    if not isinstance(patch, dict):
        detail = f"a patch of a design is an object (JSON merge patch, RFC 7396); got {show(patch)}"
        raise RequestError(Problem(f"/{PATCH}", "wrong-type", detail, 'for example {"name": "another"}'))
    if NAMED not in data and "design" not in data:
        detail = f"there is no design for the patch: give design or {NAMED}"
        raise RequestError(Problem("", "missing-field", detail, f"{NAMED} names a design that was sent before"))

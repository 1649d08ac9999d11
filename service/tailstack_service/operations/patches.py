"""Partial documents: a design named by its hash or sent whole, and what differs from it (RFC 7396)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from tailstack.errors import Problem, TailstackError

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


@dataclass(frozen=True, slots=True)
class PartialDocument:
    """What a request says of its design otherwise than by the whole of it."""

    sha256: str | None  # of the design that it begins from; None: it is in the request
    patch: dict[str, Any]

    def mention(self, error: TailstackError) -> None:
        """Let a refusal of the patched design say which of its problems came through the patch."""
        error.problems = tuple(map(self._mention, error.problems))

    def _mention(self, problem: Problem) -> Problem:
        place = find_in_patch(self.patch, problem.pointer) if self.patch else None
        if place is None:
            return problem
        at, whole = place
        words = "this came through the patch, at" if whole else "the patch changes what is here, at"
        return replace(problem, detail=f"{problem.detail}; {words} /{PATCH}{at}")


def find_in_patch(patch: dict[str, Any], pointer: str) -> tuple[str, bool] | None:
    """Where a patch speaks of a place of the patched document, and whether what is there came from the patch alone.

    None if it leaves the place as it was.
    """
    node: Any = patch
    at = ""
    for step in pointer.split("/")[1:]:
        name = step.replace("~1", "/").replace("~0", "~")
        if isinstance(node, dict):
            if name not in node:
                return None
            node = node[name]
        elif isinstance(node, list) and name.isdecimal() and int(name) < len(node):
            node = node[int(name)]
        else:
            break
        at = f"{at}/{step}"
    return at, not isinstance(node, dict)


def read_partial(data: dict[str, Any], fields: Sequence[str]) -> PartialDocument | None:
    """What a body has instead of the design, or beside it; None if that is the design alone.  Raises RequestError."""
    if tuple(fields) != ("design",) or not {NAMED, PATCH} & data.keys():
        return None
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
    return PartialDocument(name, patch)

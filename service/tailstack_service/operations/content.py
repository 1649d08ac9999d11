"""Requests and specs as bytes: one way to write them, so that equal requests have equal hashes."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from tailstack.results.json_text import write_json

if TYPE_CHECKING:
    from tailstack.design import Design


def canonical(data: Any) -> bytes:
    """JSON with sorted keys and no spaces, UTF-8.  Raises ValueError for a number that JSON cannot hold."""
    return write_json(data, sort_keys=True).encode()


def design_of(request: dict[str, Any]) -> Design:
    """The design of a request, which was held to the service's limits when the request was accepted.

    The last few are kept: a job's units come to a process one after the other.
    """
    return loaded_design(canonical(request["design"]))


@lru_cache(maxsize=8)
def loaded_design(content: bytes) -> Design:
    """The design in canonical JSON.  Raises DesignError, LimitError."""
    from tailstack.design import load_design
    from tailstack.design.reading import DEFAULT_LIMITS

    limits = replace(DEFAULT_LIMITS, document_bytes=max(len(content), DEFAULT_LIMITS.document_bytes))
    return load_design(json.loads(content), allow_files=False, limits=limits)

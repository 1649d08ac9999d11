"""Published schemas by name: of the design, of every operation's record, of policies, jobs and problems."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from typing import Any

from tailstack.results.json_text import write_json

from .documents import Draft, from_json, from_plain, published_schema, record_json_schema
from .jobs.document import JobDocument, JobPage
from .operations.registry import OPERATIONS
from .problems import ProblemDocument

RECORDS: dict[str, Callable[[], type]] = {
    **{name: operation.record for name, operation in OPERATIONS.items()},
    "job": lambda: JobDocument,
    "jobs": lambda: JobPage,
    "problem": lambda: ProblemDocument,
}

TITLES: dict[str, str] = {
    "design": "the design document: what a user writes",
    **{name: operation.title for name, operation in OPERATIONS.items()},
    "policy": "what a gate judges by: rules, limits, classes of designs",
    "waivers": "findings that a gate accepts for now",
    "job": "a computation that was accepted over HTTP: state, progress, problem, links",
    "jobs": "a page of jobs, newest first",
    "problem": "every refusal (RFC 9457), over HTTP and with --json",
    "presets": "published C-arm geometries, the names that `preset` takes",
}


def read_record(name: str, content: bytes) -> Any:
    """The record of a published document.  Raises pydantic's ValidationError."""
    return from_json(RECORDS[name](), content)


def record_of(name: str, data: Any) -> Any:
    """The record of a published document given as plain data.  Raises pydantic's ValidationError."""
    return from_plain(RECORDS[name](), data)


def _preset_schema() -> dict[str, Any]:
    """Every name that the field ``preset`` of a view takes, with its numbers and source."""
    from tailstack.design import list_presets

    def entry(preset: dict[str, Any]) -> dict[str, Any]:
        size = preset["image_size_px"]
        numbers = [
            f"source-detector {preset['source_detector_mm']:g} mm",
            f"source-isocentre {preset['source_isocentre_mm']:g} mm" if preset["source_isocentre_mm"] else "",
            f"pixel {preset['pixel_mm']:g} mm" if preset["pixel_mm"] else "",
            f"image {size[0]} x {size[1]} px" if size else "",
            f"the view must state {', '.join(preset['view_must_state'])}" if preset["view_must_state"] else "",
        ]
        words = "; ".join(part for part in numbers if part) + f". Source: {preset['source']}."
        remark = preset["remark"]
        return {
            "const": preset["name"],
            "title": preset["title"],
            "description": words + (f" {remark[0].upper()}{remark[1:]}." if remark else ""),
        }

    return {
        "title": "Preset",
        "description": "Published C-arm geometries: the names that the field `preset` of a view takes.",
        "type": "string",
        "oneOf": [entry(preset) for preset in list_presets()],
    }


@cache
def _schema_text(name: str, draft: Draft) -> str:
    from tailstack.design import design_json_schema

    from .gate.rules import policy_json_schema
    from .gate.waivers import waivers_json_schema

    makers: dict[str, Callable[[], dict[str, Any]]] = {
        "design": design_json_schema,
        "presets": _preset_schema,
        "policy": policy_json_schema,
        "waivers": waivers_json_schema,
    }
    body = makers[name]() if name in makers else record_json_schema(RECORDS[name]())
    return write_json(published_schema(name, body, draft))


def json_schema(name: str, draft: Draft = "2020-12") -> dict[str, Any]:
    """The published JSON Schema of a document, in draft 2020-12 or 7.

    Raises KeyError for a name that is not published.
    """
    if name not in TITLES:
        raise KeyError(name)
    schema: dict[str, Any] = json.loads(_schema_text(name, draft))
    return schema

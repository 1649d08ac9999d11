"""What others build on is still there: Python's names, fields of records, flags (docs/stability.md)."""

from __future__ import annotations

import json
from typing import Any

import pytest

import surface

LISTED: dict[str, dict[str, list[str]]] = json.loads(surface.PLACE.read_text(encoding="utf-8"))


def check(kind: str, now: dict[str, list[str]]) -> None:
    """Nothing that is listed is gone, and what there is has its entry."""
    assert surface.gone({kind: LISTED[kind]}, {kind: now}) == [], "deprecate it first: docs/stability.md"
    assert list(now) == list(LISTED[kind]), "python .ci/release/surface.py adds what is new"


def test_names_flags_and_documents_are_those_that_are_listed() -> None:
    check("python", surface.python_names())
    check("flags", surface.flags())
    assert list(LISTED["fields"]) == sorted({*surface.RECORDS, *surface.DOCUMENTS})


@pytest.mark.parametrize("name", LISTED["fields"])
def test_fields_of(name: str) -> None:
    check("fields", {**LISTED["fields"], name: surface.fields_in(name)})


def test_what_is_gone_is_named() -> None:
    listed = {"python": {"score": ["design", "losses"], "verify": []}, "flags": {"gate": ["--json"]}}
    now = {"python": {"score": ["design", "more"]}, "flags": {"gate": ["--json", "--new"]}}
    assert surface.gone(listed, now) == ["python: score losses", "python: verify"]


def test_a_type_inside_itself_is_walked_once() -> None:
    """By hand."""
    schema: dict[str, Any] = {
        "$ref": "#/$defs/Part",
        "$defs": {
            "Part": {
                "properties": {
                    "name": {"type": "string"},
                    "parts": {"type": "array", "items": {"$ref": "#/$defs/Part"}},
                    "size_mm": {"anyOf": [{"type": "null"}, {"properties": {"x": {"type": "number"}}}]},
                    "by_name": {"additionalProperties": {"properties": {"y": {}}}},
                }
            }
        },
    }
    assert list(surface.fields_of(schema)) == ["name", "parts", "size_mm", "size_mm.x", "by_name", "by_name{}.y"]

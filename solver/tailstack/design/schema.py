"""The published JSON Schema of the design document."""

from __future__ import annotations

from typing import Any

from .document import DesignDocument

SCHEMA_ID = "urn:tailstack:schema:design:1"


def design_json_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of ``tailstack/design/1``; every field with description, unit, default and example.

    An optional field is left out rather than null, so the null alternatives that pydantic writes are dropped.
    Rules across fields (unique names, references, coverage factors) are in the descriptions.
    """
    schema = without_null(DesignDocument.model_json_schema(by_alias=True))
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": SCHEMA_ID,
        "title": "tailstack design, version 1",
        "description": "A reference structure on a robot, seen by two or more X-ray views. Lengths in mm, angles in "
        "degrees, images in px: the unit is in every field name. Frames: con (connector: fiducials, targets, "
        "interface pivots, views; LPS), flange, tcp. T_ab maps coordinates in b to coordinates in a. Tolerances are "
        "half-widths. Unknown fields, NaN and infinities are refused.",
    }
    return {**head, **{key: value for key, value in schema.items() if key not in head}}


def without_null(node: Any) -> Any:
    """A schema of pydantic's without the null alternatives: an optional field is left out, not null."""
    if isinstance(node, list):
        return [without_null(item) for item in node]
    if not isinstance(node, dict):
        return node
    node = {key: without_null(value) for key, value in node.items() if not (key == "default" and value is None)}
    options = node.get("anyOf")
    if isinstance(options, list) and {"type": "null"} in options:
        rest = [option for option in options if option != {"type": "null"}]
        del node["anyOf"]
        node = {**(rest[0] if len(rest) == 1 else {"anyOf": rest}), **node}
    return node

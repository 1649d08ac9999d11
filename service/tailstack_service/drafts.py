"""JSON Schemas in the draft that a reader knows: 2020-12 as they are written here, 7 for the editors.

The language server that VS Code, Neovim and others read YAML with understands draft 7 in full and later ones in part.
"""

from __future__ import annotations

import re
from typing import Any, Literal, get_args

Draft = Literal["2020-12", "7"]
DRAFTS: tuple[Draft, ...] = get_args(Draft)
DIALECTS: dict[Draft, str] = {
    "2020-12": "https://json-schema.org/draft/2020-12/schema",
    "7": "http://json-schema.org/draft-07/schema#",
}
LISTS = ("oneOf", "anyOf", "allOf", "prefixItems")  # keywords whose value is a list of schemas
SINGLE = ("items", "additionalProperties", "not")  # keywords whose value is a schema, or true or false


def published_schema(name: str, body: dict[str, Any], draft: Draft) -> dict[str, Any]:
    """A schema of draft 2020-12 under its published name, in a draft."""
    head = {"$schema": DIALECTS[draft], "$id": f"urn:tailstack:schema:{name}:1"}
    body = {key: value for key, value in body.items() if key not in head}
    return {**head, **(_in_draft_7(body) if draft == "7" else body)}


def _in_draft_7(schema: dict[str, Any]) -> dict[str, Any]:
    """A schema of draft 2020-12, of the keywords that pydantic writes, with the same meaning in draft 7."""
    made: dict[str, Any] = {}
    for keyword, value in schema.items():
        if keyword == "properties":
            made[keyword] = {name: _without_title(_in_draft_7(part)) for name, part in value.items()}
        elif keyword == "$defs":
            made["definitions"] = {name: _in_draft_7(part) | _title_of(name) for name, part in value.items()}
        elif keyword in LISTS:
            made[keyword] = [_in_draft_7(part) for part in value]
        elif keyword in SINGLE and isinstance(value, dict):
            made[keyword] = _in_draft_7(value)
        elif keyword == "$ref":
            made[keyword] = value.replace("#/$defs/", "#/definitions/")
        else:
            made[keyword] = value
    if (places := made.pop("prefixItems", None)) is not None:
        # a vector whose length is fixed: its elements are mostly all alike, and are then described once
        alike = all(place == places[0] for place in places) and made.get("maxItems") == len(places)
        made |= {"items": places[0]} if alike else {"items": places, "additionalItems": made.get("items", True)}
    if "$ref" in made and len(made) > 1:
        made = {"allOf": [{"$ref": made.pop("$ref")}], **made}  # beside a reference draft 7 reads nothing
    return made


def _without_title(schema: dict[str, Any]) -> dict[str, Any]:
    """A property without the title that pydantic makes of its name: the editor shows the name already."""
    return {keyword: value for keyword, value in schema.items() if keyword != "title"}


def _title_of(name: str) -> dict[str, str]:
    """What the editor writes above a description: TargetDocument is a Target, PresetView a Preset view."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name.removesuffix("Document"))
    return {"title": words[0] + words[1:].lower()}

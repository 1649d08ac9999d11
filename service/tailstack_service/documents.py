"""Records as JSON: written, read back, described.

The records are the frozen dataclasses of :mod:`tailstack.results` and of this package; pydantic is used
on them only to write JSON Schemas and to turn them into plain data.  A number that is not finite never leaves:
JSON has no such number, and a result that holds one is a defect to be reported, not shipped.
"""

from __future__ import annotations

import json
import re
from functools import cache
from types import GenericAlias
from typing import Any, Literal, TypeVar, get_args

from pydantic import ConfigDict, TypeAdapter
from pydantic.json_schema import GenerateJsonSchema

from tailstack.fields import read_texts
from tailstack.results.json_text import write_json

R = TypeVar("R")


@cache
def _reader(kind: Any) -> TypeAdapter[Any]:
    """Made when first needed: all of them together take a noticeable part of a start."""
    return TypeAdapter(kind)


@cache
def _writer(kind: Any) -> TypeAdapter[Any]:
    """A number that is none stays what it is."""
    return _configure(kind, ConfigDict(ser_json_inf_nan="constants"))


def _configure(kind: type, config: ConfigDict) -> TypeAdapter[Any]:
    """Of a tuple of one record: a dataclass has no place for a configuration."""
    single: Any = GenericAlias(tuple, (kind,))
    return TypeAdapter(single, config=config)


def plain(record: Any) -> Any:
    """A record as JSON's own types; a whole number in a field of floats is a float, as it is when read back."""
    return _writer(type(record)).dump_python((record,), mode="json")[0]  # type: ignore[arg-type]


def to_json(record: Any) -> bytes:
    """A record as it leaves the program, by command and over HTTP alike: what is stored, hashed and compared.

    Compact UTF-8, fields in their declared order.  Raises ValueError if it holds a number that JSON cannot hold.
    """
    return write_json(plain(record)).encode()


def from_json(kind: type[R], content: bytes) -> R:
    """The record that :func:`to_json` wrote.

    Raises ValueError, of which pydantic's ValidationError is one.
    """
    return from_plain(kind, json.loads(content))


def from_plain(kind: type[R], data: Any) -> R:
    """The record given as plain data.  Raises pydantic's ValidationError."""
    record: R = _reader(kind).validate_python(data)  # type: ignore[arg-type]
    return record


def record_json_schema(record: type) -> dict[str, Any]:
    """The JSON Schema of a record as it is written, each property with the text that stands below its field."""
    made = _configure(record, ConfigDict()).json_schema(mode="serialization", schema_generator=_DescribedSchema)
    definitions = made["$defs"]
    schema = definitions.pop(made["prefixItems"][0]["$ref"].rpartition("/")[2])
    for each in (schema, *definitions.values()):
        if "properties" in each:  # answers always carry every field, and no other
            each |= {"required": list(each["properties"]), "additionalProperties": False}
    return {**schema, **({"$defs": definitions} if definitions else {})}


class _DescribedSchema(GenerateJsonSchema):
    def dataclass_schema(self, schema: Any) -> dict[str, Any]:
        made, texts = super().dataclass_schema(schema), read_texts(schema["cls"])
        for name, each in made["properties"].items():
            each["description"] = texts[name]
        return made


# JSON Schemas are written in draft 2020-12, and published in draft 7, too: the language server that VS Code, Neovim and
# others read YAML with understands that one in full and later ones in part.
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
            made[keyword] = {name: _in_draft_7(part) for name, part in value.items()}
            for part in made[keyword].values():
                part.pop("title", None)  # which pydantic makes of the name: the editor shows that already
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


def _title_of(name: str) -> dict[str, str]:
    """What the editor writes above a description: TargetDocument is a Target, PresetView a Preset view."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name.removesuffix("Document"))
    return {"title": words[0] + words[1:].lower()}

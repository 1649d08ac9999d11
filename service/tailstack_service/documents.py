"""Records as JSON: written, read back, described.

The records are the frozen dataclasses of :mod:`tailstack.results` and of this package; pydantic is used
on them only to write JSON Schemas and to turn them into plain data.  A number that is not finite never leaves:
JSON has no such number, and a result that holds one is a defect to be reported, not shipped.
"""

from __future__ import annotations

import ast
import inspect
import json
import sys
from functools import cache
from itertools import pairwise
from typing import Any, TypeVar

from pydantic import ConfigDict, TypeAdapter
from pydantic.json_schema import GenerateJsonSchema

from tailstack.json_text import write_json
from tailstack.results.older import in_words_of_today

R = TypeVar("R")

_ADAPTERS: dict[type, TypeAdapter[Any]] = {}


def _adapter(kind: type) -> TypeAdapter[Any]:
    """Made when first needed: all of them together take a noticeable part of a start."""
    if kind not in _ADAPTERS:
        _ADAPTERS[kind] = TypeAdapter(kind)
    return _ADAPTERS[kind]


_WRITERS: dict[type, TypeAdapter[Any]] = {}


def _writer(kind: type) -> TypeAdapter[Any]:
    """Of a tuple of one record: a dataclass has no place to say that a number that is none stays what it is."""
    if kind not in _WRITERS:
        _WRITERS[kind] = TypeAdapter(tuple[kind], config=ConfigDict(ser_json_inf_nan="constants"))  # type: ignore[valid-type]
    return _WRITERS[kind]


def plain(record: Any) -> Any:
    """A record as JSON's own types; a whole number in a field of floats is a float, as it is when read back."""
    return _writer(type(record)).dump_python((record,), mode="json")[0]


def to_json(record: Any) -> bytes:
    """A record as it leaves the program, by command and over HTTP alike: what is stored, hashed and compared.

    Compact UTF-8, fields in their declared order.  Raises ValueError if it holds a number that JSON cannot hold.
    """
    return write_json(plain(record)).encode()


def from_json(kind: type[R], content: bytes) -> R:
    """The record that :func:`to_json` of this version or an older one wrote.

    Raises ValueError, of which pydantic's ValidationError is one.
    """
    return from_plain(kind, json.loads(content))


def from_plain(kind: type[R], data: Any) -> R:
    """The record given as plain data.  Raises pydantic's ValidationError."""
    record: R = _adapter(kind).validate_python(in_words_of_today(data))
    return record


def record_json_schema(record: type) -> dict[str, Any]:
    """The JSON Schema of a record as it is written, each property with the text that stands below its field."""
    schema = _adapter(record).json_schema(mode="serialization", schema_generator=_DescribedSchema)
    _require_all(schema)
    for definition in schema.get("$defs", {}).values():
        _require_all(definition)
    return schema


class _DescribedSchema(GenerateJsonSchema):
    """Pydantic's schema, where each property of a record is described by the text below its field in the source."""

    def dataclass_schema(self, schema: Any) -> dict[str, Any]:
        made = super().dataclass_schema(schema)
        for name, words in _texts_below_fields(schema["cls"].__module__).get(schema["cls"].__name__, {}).items():
            if name in made.get("properties", {}):
                made["properties"][name]["description"] = words
        return made


@cache
def _texts_below_fields(module: str) -> dict[str, dict[str, str]]:
    """By class and field, the string literals that stand below the fields of a module's classes."""
    texts: dict[str, dict[str, str]] = {}
    tree = ast.parse(inspect.getsource(sys.modules[module]))
    for kind in (node for node in tree.body if isinstance(node, ast.ClassDef)):
        for field, below in pairwise(kind.body):
            match field, below:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(words))):
                    texts.setdefault(kind.name, {})[name] = " ".join(words.split())
    return texts


def _require_all(schema: dict[str, Any]) -> None:
    """Answers always carry every field, and no other."""
    if "properties" in schema:
        schema["required"] = list(schema["properties"])
        schema["additionalProperties"] = False

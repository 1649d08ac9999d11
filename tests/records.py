"""Every record of a document, with its fields, and every number in them that has a unit: from the schema itself."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo


def records_below(root: type[BaseModel]) -> list[type[BaseModel]]:
    """The record and those of its fields, each once."""
    found: dict[type[BaseModel], None] = {}

    def visit(kind: Any) -> None:
        if isinstance(kind, type) and issubclass(kind, BaseModel) and kind not in found:
            found[kind] = None
            for info in kind.model_fields.values():
                visit(info.annotation)
        for part in get_args(kind):
            visit(part)

    visit(root)
    return list(found)


def fields_of(record: type[BaseModel]) -> dict[str, FieldInfo]:
    """By the names that documents have."""
    return {info.alias or name: info for name, info in record.model_fields.items()}


def examples_with(record: type[BaseModel], unit: str) -> Iterator[tuple[str, Any]]:
    """Fields that have a unit in their name, and an example of each that is not 0: of one unit only, which is more than
    the name (``n`` is a number) and divides nothing (a cost per mm is converted the other way)."""
    for name, info in fields_of(record).items():
        if (
            "deg_mm" not in name
            and name != unit
            and f"per_{unit}" not in name
            and re.search(rf"(^|_){unit}(_|$)", name)
            and info.examples
        ):
            yield name, _nonzero(info.examples[0])


def _nonzero(value: Any) -> Any:
    if isinstance(value, list):
        return [_nonzero(each) for each in value]
    return value or 2.5


def words_of(kind: Any) -> list[str]:
    """What a field takes of a choice of words."""
    if get_origin(kind) is Literal:
        return [each for each in get_args(kind) if isinstance(each, str)]
    if isinstance(kind, type) and hasattr(kind, "__members__"):
        return [str(each.value) for each in kind.__members__.values()]
    return [word for part in get_args(kind) for word in words_of(part)]


def sample_of(kind: Any) -> Any:
    """A value that a field of this type takes: the example of each of its fields, those that are required alone."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return {
            name: info.examples[0] if info.examples else sample_of(info.annotation)
            for name, info in fields_of(kind).items() if info.is_required()
        }  # fmt: skip
    parts = [part for part in get_args(kind) if part is not type(None)]
    if get_origin(kind) is list:
        return [sample_of(parts[0])]
    return sample_of(parts[0]) if parts else None

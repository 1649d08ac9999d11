from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast

if TYPE_CHECKING:
    from ..models.schema_entry import SchemaEntry


T = TypeVar("T", bound="SchemaList")


@_attrs_define
class SchemaList:
    """
    Attributes:
        schemas (list[SchemaEntry]): Every published schema.
    """

    schemas: list[SchemaEntry]

    def to_dict(self) -> dict[str, Any]:
        from ..models.schema_entry import SchemaEntry  # noqa: PLC0415

        schemas = []
        for schemas_item_data in self.schemas:
            schemas_item = schemas_item_data.to_dict()
            schemas.append(schemas_item)

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "schemas": schemas,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.schema_entry import SchemaEntry  # noqa: PLC0415

        d = dict(src_dict)
        schemas = []
        _schemas = d.pop("schemas")
        for schemas_item_data in _schemas:
            schemas_item = SchemaEntry.from_dict(schemas_item_data)

            schemas.append(schemas_item)

        schema_list = cls(
            schemas=schemas,
        )

        return schema_list

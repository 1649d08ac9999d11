from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset


T = TypeVar("T", bound="SchemaEntry")


@_attrs_define
class SchemaEntry:
    """
    Attributes:
        name (str): Name of the schema.
        title (str): What it is the schema of.
        url (str): Path where it is served.
    """

    name: str
    title: str
    url: str

    def to_dict(self) -> dict[str, Any]:
        name = self.name

        title = self.title

        url = self.url

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "name": name,
                "title": title,
                "url": url,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        name = d.pop("name")

        title = d.pop("title")

        url = d.pop("url")

        schema_entry = cls(
            name=name,
            title=title,
            url=url,
        )

        return schema_entry

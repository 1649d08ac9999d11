from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset


T = TypeVar("T", bound="ExampleEntry")


@_attrs_define
class ExampleEntry:
    """
    Attributes:
        name (str): Name of the example.
        title (str): Name of its design.
        description (str): What it shows; may be empty.
        url (str): Path of the design.
    """

    name: str
    title: str
    description: str
    url: str

    def to_dict(self) -> dict[str, Any]:
        name = self.name

        title = self.title

        description = self.description

        url = self.url

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "name": name,
                "title": title,
                "description": description,
                "url": url,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        name = d.pop("name")

        title = d.pop("title")

        description = d.pop("description")

        url = d.pop("url")

        example_entry = cls(
            name=name,
            title=title,
            description=description,
            url=url,
        )

        return example_entry

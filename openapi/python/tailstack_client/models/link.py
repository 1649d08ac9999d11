from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset


T = TypeVar("T", bound="Link")


@_attrs_define
class Link:
    """
    Attributes:
        path (str): Path on this service.
        title (str): What is there.
    """

    path: str
    title: str

    def to_dict(self) -> dict[str, Any]:
        path = self.path

        title = self.title

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "path": path,
                "title": title,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        path = d.pop("path")

        title = d.pop("title")

        link = cls(
            path=path,
            title=title,
        )

        return link

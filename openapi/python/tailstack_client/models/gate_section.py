from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset


T = TypeVar("T", bound="GateSection")


@_attrs_define
class GateSection:
    """One section of a design document, by its content: how a design is found again in a baseline.

    Attributes:
        name (str): Name of the section.
        sha256 (str): SHA-256 of its canonical content, hexadecimal.
    """

    name: str
    sha256: str

    def to_dict(self) -> dict[str, Any]:
        name = self.name

        sha256 = self.sha256

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "name": name,
                "sha256": sha256,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        name = d.pop("name")

        sha256 = d.pop("sha256")

        gate_section = cls(
            name=name,
            sha256=sha256,
        )

        return gate_section

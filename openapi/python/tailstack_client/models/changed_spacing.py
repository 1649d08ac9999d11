from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset


T = TypeVar("T", bound="ChangedSpacing")


@_attrs_define
class ChangedSpacing:
    """Locators that could be spread about their centre, by which factor.

    Attributes:
        contributor (str): structure_connector or connector_flange.
        label (str): What the document calls the interface.
        scale (float): Factor by which its locators were spread about their centre.
    """

    contributor: str
    label: str
    scale: float

    def to_dict(self) -> dict[str, Any]:
        contributor = self.contributor

        label = self.label

        scale = self.scale

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "contributor": contributor,
                "label": label,
                "scale": scale,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        contributor = d.pop("contributor")

        label = d.pop("label")

        scale = d.pop("scale")

        changed_spacing = cls(
            contributor=contributor,
            label=label,
            scale=scale,
        )

        return changed_spacing

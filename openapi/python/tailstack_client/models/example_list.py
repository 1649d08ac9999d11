from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast

if TYPE_CHECKING:
    from ..models.example_entry import ExampleEntry


T = TypeVar("T", bound="ExampleList")


@_attrs_define
class ExampleList:
    """
    Attributes:
        examples (list[ExampleEntry]): Every example that is one design.
    """

    examples: list[ExampleEntry]

    def to_dict(self) -> dict[str, Any]:
        from ..models.example_entry import ExampleEntry  # noqa: PLC0415

        examples = []
        for examples_item_data in self.examples:
            examples_item = examples_item_data.to_dict()
            examples.append(examples_item)

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "examples": examples,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.example_entry import ExampleEntry  # noqa: PLC0415

        d = dict(src_dict)
        examples = []
        _examples = d.pop("examples")
        for examples_item_data in _examples:
            examples_item = ExampleEntry.from_dict(examples_item_data)

            examples.append(examples_item)

        example_list = cls(
            examples=examples,
        )

        return example_list

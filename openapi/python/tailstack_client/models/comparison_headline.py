from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.comparison_headline_status import check_comparison_headline_status
from ..models.comparison_headline_status import ComparisonHeadlineStatus
from typing import cast


T = TypeVar("T", bound="ComparisonHeadline")


@_attrs_define
class ComparisonHeadline:
    """The first page of a comparison.

    Attributes:
        status (ComparisonHeadlineStatus): The verdict on the second design.
        sentence (str): The comparison in a sentence.
        matters (list[str]): What matters most, at most three sentences.
    """

    status: ComparisonHeadlineStatus
    sentence: str
    matters: list[str]

    def to_dict(self) -> dict[str, Any]:
        status: str = self.status

        sentence = self.sentence

        matters = self.matters

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "status": status,
                "sentence": sentence,
                "matters": matters,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        status = check_comparison_headline_status(d.pop("status"))

        sentence = d.pop("sentence")

        matters = cast(list[str], d.pop("matters"))

        comparison_headline = cls(
            status=status,
            sentence=sentence,
            matters=matters,
        )

        return comparison_headline

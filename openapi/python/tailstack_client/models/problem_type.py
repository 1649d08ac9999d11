from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset


T = TypeVar("T", bound="ProblemType")


@_attrs_define
class ProblemType:
    """One class of refusal: what it means and what to do about it.

    Attributes:
        slug (str): Last part of the problem's type.
        title (str): What it is, the same for every occurrence.
        status (int): HTTP status that it comes with.
        meaning (str): What it means.
        cure (str): What to do about it.
    """

    slug: str
    title: str
    status: int
    meaning: str
    cure: str

    def to_dict(self) -> dict[str, Any]:
        slug = self.slug

        title = self.title

        status = self.status

        meaning = self.meaning

        cure = self.cure

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "slug": slug,
                "title": title,
                "status": status,
                "meaning": meaning,
                "cure": cure,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        slug = d.pop("slug")

        title = d.pop("title")

        status = d.pop("status")

        meaning = d.pop("meaning")

        cure = d.pop("cure")

        problem_type = cls(
            slug=slug,
            title=title,
            status=status,
            meaning=meaning,
            cure=cure,
        )

        return problem_type

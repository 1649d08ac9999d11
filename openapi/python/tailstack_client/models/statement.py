from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.statement_about import check_statement_about
from ..models.statement_about import StatementAbout
from typing import cast


T = TypeVar("T", bound="Statement")


@_attrs_define
class Statement:
    """Something that can be said of the tables, with the numbers it rests on.

    Attributes:
        about (StatementAbout): What of the tables it is about.
        sentence (str): The statement.
        values (list[float]): The numbers that it rests on, in its order.
    """

    about: StatementAbout
    sentence: str
    values: list[float]

    def to_dict(self) -> dict[str, Any]:
        about: str = self.about

        sentence = self.sentence

        values = self.values

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "about": about,
                "sentence": sentence,
                "values": values,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        about = check_statement_about(d.pop("about"))

        sentence = d.pop("sentence")

        values = cast(list[float], d.pop("values"))

        statement = cls(
            about=about,
            sentence=sentence,
            values=values,
        )

        return statement

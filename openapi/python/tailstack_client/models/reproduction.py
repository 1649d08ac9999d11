from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="Reproduction")


@_attrs_define
class Reproduction:
    """How to get the same numbers again.

    Attributes:
        commands (list[str]):
        seed (int | None):
        statement (str):
    """

    commands: list[str]
    seed: int | None
    statement: str

    def to_dict(self) -> dict[str, Any]:
        commands = self.commands

        seed: int | None
        seed = self.seed

        statement = self.statement

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "commands": commands,
                "seed": seed,
                "statement": statement,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        commands = cast(list[str], d.pop("commands"))

        def _parse_seed(data: object) -> int | None:
            if data is None:
                return data
            return cast(int | None, data)

        seed = _parse_seed(d.pop("seed"))

        statement = d.pop("statement")

        reproduction = cls(
            commands=commands,
            seed=seed,
            statement=statement,
        )

        return reproduction

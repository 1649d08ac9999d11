from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="Version")


@_attrs_define
class Version:
    """
    Attributes:
        tailstack (str): Version of the service and its solver.
        python (str): Version of Python that runs it.
        documents (list[str]): Value of the field `schema` of each document that this version reads and writes.
    """

    tailstack: str
    python: str
    documents: list[str]

    def to_dict(self) -> dict[str, Any]:
        tailstack = self.tailstack

        python = self.python

        documents = self.documents

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "tailstack": tailstack,
                "python": python,
                "documents": documents,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        tailstack = d.pop("tailstack")

        python = d.pop("python")

        documents = cast(list[str], d.pop("documents"))

        version = cls(
            tailstack=tailstack,
            python=python,
            documents=documents,
        )

        return version

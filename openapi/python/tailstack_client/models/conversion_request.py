from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.conversion_request_format import check_conversion_request_format
from ..models.conversion_request_format import ConversionRequestFormat
from ..models.conversion_request_to import check_conversion_request_to
from ..models.conversion_request_to import ConversionRequestTo
from ..types import UNSET, Unset
from typing import cast


T = TypeVar("T", bound="ConversionRequest")


@_attrs_define
class ConversionRequest:
    """
    Attributes:
        format_ (ConversionRequestFormat): What the content is; yaml and json are designs.
        content (str): The text of the file.
        to (ConversionRequestTo | Unset): What to make of it; a design becomes a design, or its fiducials. Default:
            'yaml'.
    """

    format_: ConversionRequestFormat
    content: str
    to: ConversionRequestTo | Unset = "yaml"

    def to_dict(self) -> dict[str, Any]:
        format_: str = self.format_

        content = self.content

        to: str | Unset = UNSET
        if not isinstance(self.to, Unset):
            to = self.to

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "format": format_,
                "content": content,
            }
        )
        if to is not UNSET:
            field_dict["to"] = to

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        format_ = check_conversion_request_format(d.pop("format"))

        content = d.pop("content")

        _to = d.pop("to", UNSET)
        to: ConversionRequestTo | Unset
        if isinstance(_to, Unset):
            to = UNSET
        else:
            to = check_conversion_request_to(_to)

        conversion_request = cls(
            format_=format_,
            content=content,
            to=to,
        )

        return conversion_request

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="ImagedPoint")


@_attrs_define
class ImagedPoint:
    """A fiducial or target in one image, without noise; a fiducial as the structure sits with its known bias.

    Attributes:
        label (str): Label of the fiducial, or name of the target.
        image_px (list[float] | None): Its image, px; null behind the source.
        inside (bool): Whether the image is on the detector, as far as the view states its size.
        used (bool): Whether the view's estimate uses it: false for a fiducial that `views[].sees` leaves out. Default:
            True.
    """

    label: str
    image_px: list[float] | None
    inside: bool
    used: bool = True

    def to_dict(self) -> dict[str, Any]:
        label = self.label

        image_px: list[float] | None
        if isinstance(self.image_px, list):
            image_px = []
            for image_px_type_0_item_data in self.image_px:
                image_px_type_0_item: float
                image_px_type_0_item = image_px_type_0_item_data
                image_px.append(image_px_type_0_item)

        else:
            image_px = self.image_px

        inside = self.inside

        used = self.used

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "label": label,
                "image_px": image_px,
                "inside": inside,
                "used": used,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        label = d.pop("label")

        def _parse_image_px(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                image_px_type_0 = []
                _image_px_type_0 = data
                for image_px_type_0_item_data in _image_px_type_0:

                    def _parse_image_px_type_0_item(data: object) -> float:
                        return cast(float, data)

                    image_px_type_0_item = _parse_image_px_type_0_item(image_px_type_0_item_data)

                    image_px_type_0.append(image_px_type_0_item)

                return image_px_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        image_px = _parse_image_px(d.pop("image_px"))

        inside = d.pop("inside")

        used = d.pop("used")

        imaged_point = cls(
            label=label,
            image_px=image_px,
            inside=inside,
            used=used,
        )

        return imaged_point

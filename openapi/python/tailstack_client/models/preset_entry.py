from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="PresetEntry")


@_attrs_define
class PresetEntry:
    """A published C-arm geometry; what its source does not state is null, and a view has to state it.

    Attributes:
        name (str): What the field `preset` of a view takes.
        title (str): The device.
        source_detector_mm (float): Distance from the X-ray source to the detector, mm.
        source_isocentre_mm (float | None): Distance from the X-ray source to the isocentre, mm.
        pixel_mm (float | None): Pixel pitch at the detector, mm.
        image_size_px (list[int] | None): Width and height of the image, px.
        view_must_state (list[str]): Fields that a view with this preset has to state itself.
        source (str): Where the numbers are from.
        remark (str): What is to be known about them; may be empty.
    """

    name: str
    title: str
    source_detector_mm: float
    source_isocentre_mm: float | None
    pixel_mm: float | None
    image_size_px: list[int] | None
    view_must_state: list[str]
    source: str
    remark: str

    def to_dict(self) -> dict[str, Any]:
        name = self.name

        title = self.title

        source_detector_mm = self.source_detector_mm

        source_isocentre_mm: float | None
        source_isocentre_mm = self.source_isocentre_mm

        pixel_mm: float | None
        pixel_mm = self.pixel_mm

        image_size_px: list[int] | None
        if isinstance(self.image_size_px, list):
            image_size_px = []
            for image_size_px_type_0_item_data in self.image_size_px:
                image_size_px_type_0_item: int
                image_size_px_type_0_item = image_size_px_type_0_item_data
                image_size_px.append(image_size_px_type_0_item)

        else:
            image_size_px = self.image_size_px

        view_must_state = self.view_must_state

        source = self.source

        remark = self.remark

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "name": name,
                "title": title,
                "source_detector_mm": source_detector_mm,
                "source_isocentre_mm": source_isocentre_mm,
                "pixel_mm": pixel_mm,
                "image_size_px": image_size_px,
                "view_must_state": view_must_state,
                "source": source,
                "remark": remark,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        name = d.pop("name")

        title = d.pop("title")

        source_detector_mm = d.pop("source_detector_mm")

        def _parse_source_isocentre_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        source_isocentre_mm = _parse_source_isocentre_mm(d.pop("source_isocentre_mm"))

        def _parse_pixel_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        pixel_mm = _parse_pixel_mm(d.pop("pixel_mm"))

        def _parse_image_size_px(data: object) -> list[int] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                image_size_px_type_0 = []
                _image_size_px_type_0 = data
                for image_size_px_type_0_item_data in _image_size_px_type_0:

                    def _parse_image_size_px_type_0_item(data: object) -> int:
                        return cast(int, data)

                    image_size_px_type_0_item = _parse_image_size_px_type_0_item(image_size_px_type_0_item_data)

                    image_size_px_type_0.append(image_size_px_type_0_item)

                return image_size_px_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[int] | None, data)

        image_size_px = _parse_image_size_px(d.pop("image_size_px"))

        view_must_state = cast(list[str], d.pop("view_must_state"))

        source = d.pop("source")

        remark = d.pop("remark")

        preset_entry = cls(
            name=name,
            title=title,
            source_detector_mm=source_detector_mm,
            source_isocentre_mm=source_isocentre_mm,
            pixel_mm=pixel_mm,
            image_size_px=image_size_px,
            view_must_state=view_must_state,
            source=source,
            remark=remark,
        )

        return preset_entry

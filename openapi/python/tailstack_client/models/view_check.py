from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="ViewCheck")


@_attrs_define
class ViewCheck:
    """Visibility of the fiducials in one view, at the biased geometry.

    Attributes:
        view (str): Name of the view.
        checked (bool): false: the size of the image is not stated, so that only depths and distances were looked at.
        depth_range_mm (list[float]): Smallest and largest depth of a fiducial in front of the source, along the
            principal ray, mm.
        outside (list[str]): Labels of fiducials whose image lies outside the detector.
        smallest_margin_px (float | None): Smallest distance of a fiducial's image from the image's edge, px, negative
            outside; null where the size is not stated.
        closest_pair (list[str]): Labels of the two fiducials whose images are closest.
        closest_pair_px (float): Distance of their images, px.
    """

    view: str
    checked: bool
    depth_range_mm: list[float]
    outside: list[str]
    smallest_margin_px: float | None
    closest_pair: list[str]
    closest_pair_px: float

    def to_dict(self) -> dict[str, Any]:
        view = self.view

        checked = self.checked

        depth_range_mm = []
        for depth_range_mm_item_data in self.depth_range_mm:
            depth_range_mm_item: float
            depth_range_mm_item = depth_range_mm_item_data
            depth_range_mm.append(depth_range_mm_item)

        outside = self.outside

        smallest_margin_px: float | None
        smallest_margin_px = self.smallest_margin_px

        closest_pair = []
        for closest_pair_item_data in self.closest_pair:
            closest_pair_item: str
            closest_pair_item = closest_pair_item_data
            closest_pair.append(closest_pair_item)

        closest_pair_px = self.closest_pair_px

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "view": view,
                "checked": checked,
                "depth_range_mm": depth_range_mm,
                "outside": outside,
                "smallest_margin_px": smallest_margin_px,
                "closest_pair": closest_pair,
                "closest_pair_px": closest_pair_px,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        view = d.pop("view")

        checked = d.pop("checked")

        depth_range_mm = []
        _depth_range_mm = d.pop("depth_range_mm")
        for depth_range_mm_item_data in _depth_range_mm:

            def _parse_depth_range_mm_item(data: object) -> float:
                return cast(float, data)

            depth_range_mm_item = _parse_depth_range_mm_item(depth_range_mm_item_data)

            depth_range_mm.append(depth_range_mm_item)

        outside = cast(list[str], d.pop("outside"))

        def _parse_smallest_margin_px(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        smallest_margin_px = _parse_smallest_margin_px(d.pop("smallest_margin_px"))

        closest_pair = []
        _closest_pair = d.pop("closest_pair")
        for closest_pair_item_data in _closest_pair:

            def _parse_closest_pair_item(data: object) -> str:
                return cast(str, data)

            closest_pair_item = _parse_closest_pair_item(closest_pair_item_data)

            closest_pair.append(closest_pair_item)

        closest_pair_px = d.pop("closest_pair_px")

        view_check = cls(
            view=view,
            checked=checked,
            depth_range_mm=depth_range_mm,
            outside=outside,
            smallest_margin_px=smallest_margin_px,
            closest_pair=closest_pair,
            closest_pair_px=closest_pair_px,
        )

        return view_check

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast

if TYPE_CHECKING:
    from ..models.imaged_point import ImagedPoint


T = TypeVar("T", bound="ImagedView")


@_attrs_define
class ImagedView:
    """One view: how it images, and what is where in its image.

    Attributes:
        view (str): Name of the view.
        projection (list[list[float]]): 3x4: nominal position of a fiducial in con (mm, 1) to (u w, v w, w), px; the
            known bias is in it.
        target_projection (list[list[float]]): 3x4: the same for what does not sit on the structure, such as targets.
        image_size_px (list[float] | None): Width and height of the image, px; null where the design does not state
            them.
        margin_px (float): Distance from the edge that the optimiser keeps, px.
        source_mm (list[float]): The X-ray source in con, mm.
        fiducials (list[ImagedPoint]): Images of the fiducials.
        targets (list[ImagedPoint]): Images of the targets.
    """

    view: str
    projection: list[list[float]]
    target_projection: list[list[float]]
    image_size_px: list[float] | None
    margin_px: float
    source_mm: list[float]
    fiducials: list[ImagedPoint]
    targets: list[ImagedPoint]

    def to_dict(self) -> dict[str, Any]:
        from ..models.imaged_point import ImagedPoint  # noqa: PLC0415

        view = self.view

        projection = []
        for projection_item_data in self.projection:
            projection_item = []
            for projection_item_item_data in projection_item_data:
                projection_item_item: float
                projection_item_item = projection_item_item_data
                projection_item.append(projection_item_item)

            projection.append(projection_item)

        target_projection = []
        for target_projection_item_data in self.target_projection:
            target_projection_item = []
            for target_projection_item_item_data in target_projection_item_data:
                target_projection_item_item: float
                target_projection_item_item = target_projection_item_item_data
                target_projection_item.append(target_projection_item_item)

            target_projection.append(target_projection_item)

        image_size_px: list[float] | None
        if isinstance(self.image_size_px, list):
            image_size_px = []
            for image_size_px_type_0_item_data in self.image_size_px:
                image_size_px_type_0_item: float
                image_size_px_type_0_item = image_size_px_type_0_item_data
                image_size_px.append(image_size_px_type_0_item)

        else:
            image_size_px = self.image_size_px

        margin_px = self.margin_px

        source_mm = []
        for source_mm_item_data in self.source_mm:
            source_mm_item: float
            source_mm_item = source_mm_item_data
            source_mm.append(source_mm_item)

        fiducials = []
        for fiducials_item_data in self.fiducials:
            fiducials_item = fiducials_item_data.to_dict()
            fiducials.append(fiducials_item)

        targets = []
        for targets_item_data in self.targets:
            targets_item = targets_item_data.to_dict()
            targets.append(targets_item)

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "view": view,
                "projection": projection,
                "target_projection": target_projection,
                "image_size_px": image_size_px,
                "margin_px": margin_px,
                "source_mm": source_mm,
                "fiducials": fiducials,
                "targets": targets,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.imaged_point import ImagedPoint  # noqa: PLC0415

        d = dict(src_dict)
        view = d.pop("view")

        projection = []
        _projection = d.pop("projection")
        for projection_item_data in _projection:
            projection_item = []
            _projection_item = projection_item_data
            for projection_item_item_data in _projection_item:

                def _parse_projection_item_item(data: object) -> float:
                    return cast(float, data)

                projection_item_item = _parse_projection_item_item(projection_item_item_data)

                projection_item.append(projection_item_item)

            projection.append(projection_item)

        target_projection = []
        _target_projection = d.pop("target_projection")
        for target_projection_item_data in _target_projection:
            target_projection_item = []
            _target_projection_item = target_projection_item_data
            for target_projection_item_item_data in _target_projection_item:

                def _parse_target_projection_item_item(data: object) -> float:
                    return cast(float, data)

                target_projection_item_item = _parse_target_projection_item_item(target_projection_item_item_data)

                target_projection_item.append(target_projection_item_item)

            target_projection.append(target_projection_item)

        def _parse_image_size_px(data: object) -> list[float] | None:
            if data is None:
                return data
            try:
                if not isinstance(data, list):
                    raise TypeError()
                image_size_px_type_0 = []
                _image_size_px_type_0 = data
                for image_size_px_type_0_item_data in _image_size_px_type_0:

                    def _parse_image_size_px_type_0_item(data: object) -> float:
                        return cast(float, data)

                    image_size_px_type_0_item = _parse_image_size_px_type_0_item(image_size_px_type_0_item_data)

                    image_size_px_type_0.append(image_size_px_type_0_item)

                return image_size_px_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(list[float] | None, data)

        image_size_px = _parse_image_size_px(d.pop("image_size_px"))

        margin_px = d.pop("margin_px")

        source_mm = []
        _source_mm = d.pop("source_mm")
        for source_mm_item_data in _source_mm:

            def _parse_source_mm_item(data: object) -> float:
                return cast(float, data)

            source_mm_item = _parse_source_mm_item(source_mm_item_data)

            source_mm.append(source_mm_item)

        fiducials = []
        _fiducials = d.pop("fiducials")
        for fiducials_item_data in _fiducials:
            fiducials_item = ImagedPoint.from_dict(fiducials_item_data)

            fiducials.append(fiducials_item)

        targets = []
        _targets = d.pop("targets")
        for targets_item_data in _targets:
            targets_item = ImagedPoint.from_dict(targets_item_data)

            targets.append(targets_item)

        imaged_view = cls(
            view=view,
            projection=projection,
            target_projection=target_projection,
            image_size_px=image_size_px,
            margin_px=margin_px,
            source_mm=source_mm,
            fiducials=fiducials,
            targets=targets,
        )

        return imaged_view

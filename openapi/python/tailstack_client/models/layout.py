from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast
from typing import Literal, cast

if TYPE_CHECKING:
    from ..models.imaged_view import ImagedView
    from ..models.layout_scene_type_0 import LayoutSceneType0
    from ..models.placed_point import PlacedPoint
    from ..models.provenance import Provenance


T = TypeVar("T", bound="Layout")


@_attrs_define
class Layout:
    """Where fiducials and targets are, in space and in every image.

    Attributes:
        schema (Literal['tailstack/layout/1']): Name and version of this record's schema.
        fiducials (list[PlacedPoint]): Fiducials in the order of the design.
        targets (list[PlacedPoint]): Targets, regions expanded to their samples.
        views (list[ImagedView]): One for each view.
        scene (LayoutSceneType0 | None): What reports and the web page turn in space, if it was asked for: its shape may
            change with the version.
        provenance (Provenance): Which design, by which version, under which model, and what is not included.
    """

    schema: Literal["tailstack/layout/1"]
    fiducials: list[PlacedPoint]
    targets: list[PlacedPoint]
    views: list[ImagedView]
    scene: LayoutSceneType0 | None
    provenance: Provenance

    def to_dict(self) -> dict[str, Any]:
        from ..models.imaged_view import ImagedView  # noqa: PLC0415
        from ..models.layout_scene_type_0 import LayoutSceneType0  # noqa: PLC0415
        from ..models.placed_point import PlacedPoint  # noqa: PLC0415
        from ..models.provenance import Provenance  # noqa: PLC0415

        schema = self.schema

        fiducials = []
        for fiducials_item_data in self.fiducials:
            fiducials_item = fiducials_item_data.to_dict()
            fiducials.append(fiducials_item)

        targets = []
        for targets_item_data in self.targets:
            targets_item = targets_item_data.to_dict()
            targets.append(targets_item)

        views = []
        for views_item_data in self.views:
            views_item = views_item_data.to_dict()
            views.append(views_item)

        scene: dict[str, Any] | None
        if isinstance(self.scene, LayoutSceneType0):
            scene = self.scene.to_dict()
        else:
            scene = self.scene

        provenance = self.provenance.to_dict()

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "schema": schema,
                "fiducials": fiducials,
                "targets": targets,
                "views": views,
                "scene": scene,
                "provenance": provenance,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.imaged_view import ImagedView  # noqa: PLC0415
        from ..models.layout_scene_type_0 import LayoutSceneType0  # noqa: PLC0415
        from ..models.placed_point import PlacedPoint  # noqa: PLC0415
        from ..models.provenance import Provenance  # noqa: PLC0415

        d = dict(src_dict)
        schema = cast(Literal["tailstack/layout/1"], d.pop("schema"))
        if schema != "tailstack/layout/1":
            raise ValueError(f"schema must match const 'tailstack/layout/1', got '{schema}'")

        fiducials = []
        _fiducials = d.pop("fiducials")
        for fiducials_item_data in _fiducials:
            fiducials_item = PlacedPoint.from_dict(fiducials_item_data)

            fiducials.append(fiducials_item)

        targets = []
        _targets = d.pop("targets")
        for targets_item_data in _targets:
            targets_item = PlacedPoint.from_dict(targets_item_data)

            targets.append(targets_item)

        views = []
        _views = d.pop("views")
        for views_item_data in _views:
            views_item = ImagedView.from_dict(views_item_data)

            views.append(views_item)

        def _parse_scene(data: object) -> LayoutSceneType0 | None:
            if data is None:
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                scene_type_0 = LayoutSceneType0.from_dict(data)

                return scene_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(LayoutSceneType0 | None, data)

        scene = _parse_scene(d.pop("scene"))

        provenance = Provenance.from_dict(d.pop("provenance"))

        layout = cls(
            schema=schema,
            fiducials=fiducials,
            targets=targets,
            views=views,
            scene=scene,
            provenance=provenance,
        )

        return layout

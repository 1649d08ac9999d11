from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.study_views_error import check_study_views_error
from ..models.study_views_error import StudyViewsError
from typing import cast
from typing import Literal, cast

if TYPE_CHECKING:
    from ..models.provenance import Provenance
    from ..models.view_map import ViewMap


T = TypeVar("T", bound="StudyViews")


@_attrs_define
class StudyViews:
    """Which view buys most.

    Attributes:
        schema (Literal['tailstack/study-views/1']): Name and version of this record's schema.
        error (StudyViewsError): Error that is studied: tcp (at the tool) or localisation (of the target).
        cone_deg (float): How far each view was turned, deg.
        step_deg (float): Step of these maps, deg.
        p95_mm (float): P95 of the error as designed, by first order, at the target where it is largest, mm.
        target (str): That target.
        views (list[ViewMap]): Every view of the design, turned by itself.
        further (None | ViewMap): A view more, a copy of the first aimed one with a beam of its own; null where no view
            is aimed.
        conclusions (list[str]): What it comes to for a designer; what buys most comes first.
        provenance (Provenance): Which design, by which version, under which model, and what is not included.
    """

    schema: Literal["tailstack/study-views/1"]
    error: StudyViewsError
    cone_deg: float
    step_deg: float
    p95_mm: float
    target: str
    views: list[ViewMap]
    further: None | ViewMap
    conclusions: list[str]
    provenance: Provenance

    def to_dict(self) -> dict[str, Any]:
        from ..models.provenance import Provenance  # noqa: PLC0415
        from ..models.view_map import ViewMap  # noqa: PLC0415

        schema = self.schema

        error: str = self.error

        cone_deg = self.cone_deg

        step_deg = self.step_deg

        p95_mm = self.p95_mm

        target = self.target

        views = []
        for views_item_data in self.views:
            views_item = views_item_data.to_dict()
            views.append(views_item)

        further: dict[str, Any] | None
        if isinstance(self.further, ViewMap):
            further = self.further.to_dict()
        else:
            further = self.further

        conclusions = self.conclusions

        provenance = self.provenance.to_dict()

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "schema": schema,
                "error": error,
                "cone_deg": cone_deg,
                "step_deg": step_deg,
                "p95_mm": p95_mm,
                "target": target,
                "views": views,
                "further": further,
                "conclusions": conclusions,
                "provenance": provenance,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.provenance import Provenance  # noqa: PLC0415
        from ..models.view_map import ViewMap  # noqa: PLC0415

        d = dict(src_dict)
        schema = cast(Literal["tailstack/study-views/1"], d.pop("schema"))
        if schema != "tailstack/study-views/1":
            raise ValueError(f"schema must match const 'tailstack/study-views/1', got '{schema}'")

        error = check_study_views_error(d.pop("error"))

        cone_deg = d.pop("cone_deg")

        step_deg = d.pop("step_deg")

        p95_mm = d.pop("p95_mm")

        target = d.pop("target")

        views = []
        _views = d.pop("views")
        for views_item_data in _views:
            views_item = ViewMap.from_dict(views_item_data)

            views.append(views_item)

        def _parse_further(data: object) -> None | ViewMap:
            if data is None:
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                further_type_0 = ViewMap.from_dict(data)

                return further_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(None | ViewMap, data)

        further = _parse_further(d.pop("further"))

        conclusions = cast(list[str], d.pop("conclusions"))

        provenance = Provenance.from_dict(d.pop("provenance"))

        study_views = cls(
            schema=schema,
            error=error,
            cone_deg=cone_deg,
            step_deg=step_deg,
            p95_mm=p95_mm,
            target=target,
            views=views,
            further=further,
            conclusions=conclusions,
            provenance=provenance,
        )

        return study_views

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.explanation_kind import check_explanation_kind
from ..models.explanation_kind import ExplanationKind
from typing import cast


T = TypeVar("T", bound="Explanation")


@_attrs_define
class Explanation:
    """How large one contributor alone would have to be for the measurements to be plausible.

    Attributes:
        kind (ExplanationKind): factor: on the declared tolerance or noise of a contributor; value: fixed, of one
            component.
        target (str): Name of the target.
        contributor (str): Source of error.
        component (str): Its component.
        unit (str): Unit of the values: deg or mm; empty for a factor.
        declared (float | None): Declared half-width, in `unit`; 1 for a factor; null where none is declared.
        most_plausible (float | None): The most plausible factor or value, in `unit`; null: none explains the
            difference.
        intervals (list[list[float]]): 95 % intervals of it, in `unit`; empty when none does. The last end may be the
            end of the search.
        search_end (float): Largest factor or value that was tried, in `unit`.
        explains (str): Which tests it is held against.
        label (str): What people call the source: the label that the design gives an interface, otherwise its name or
            words for it. Default: ''.
    """

    kind: ExplanationKind
    target: str
    contributor: str
    component: str
    unit: str
    declared: float | None
    most_plausible: float | None
    intervals: list[list[float]]
    search_end: float
    explains: str
    label: str = ""

    def to_dict(self) -> dict[str, Any]:
        kind: str = self.kind

        target = self.target

        contributor = self.contributor

        component = self.component

        unit = self.unit

        declared: float | None
        declared = self.declared

        most_plausible: float | None
        most_plausible = self.most_plausible

        intervals = []
        for intervals_item_data in self.intervals:
            intervals_item = []
            for intervals_item_item_data in intervals_item_data:
                intervals_item_item: float
                intervals_item_item = intervals_item_item_data
                intervals_item.append(intervals_item_item)

            intervals.append(intervals_item)

        search_end = self.search_end

        explains = self.explains

        label = self.label

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "kind": kind,
                "target": target,
                "contributor": contributor,
                "component": component,
                "unit": unit,
                "declared": declared,
                "most_plausible": most_plausible,
                "intervals": intervals,
                "search_end": search_end,
                "explains": explains,
                "label": label,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        kind = check_explanation_kind(d.pop("kind"))

        target = d.pop("target")

        contributor = d.pop("contributor")

        component = d.pop("component")

        unit = d.pop("unit")

        def _parse_declared(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        declared = _parse_declared(d.pop("declared"))

        def _parse_most_plausible(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        most_plausible = _parse_most_plausible(d.pop("most_plausible"))

        intervals = []
        _intervals = d.pop("intervals")
        for intervals_item_data in _intervals:
            intervals_item = []
            _intervals_item = intervals_item_data
            for intervals_item_item_data in _intervals_item:

                def _parse_intervals_item_item(data: object) -> float:
                    return cast(float, data)

                intervals_item_item = _parse_intervals_item_item(intervals_item_item_data)

                intervals_item.append(intervals_item_item)

            intervals.append(intervals_item)

        search_end = d.pop("search_end")

        explains = d.pop("explains")

        label = d.pop("label")

        explanation = cls(
            kind=kind,
            target=target,
            contributor=contributor,
            component=component,
            unit=unit,
            declared=declared,
            most_plausible=most_plausible,
            intervals=intervals,
            search_end=search_end,
            explains=explains,
            label=label,
        )

        return explanation

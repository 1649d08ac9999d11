from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="ChangedTolerance")


@_attrs_define
class ChangedTolerance:
    """A half-width that was free.  ``at_target_*_mm``: what it moves the worst target by, half-width times lever.

    Attributes:
        contributor (str): structure_connector or connector_flange.
        component (str): rx ... tz, or the name of a locator.
        label (str): What the document calls the interface, and the component.
        unit (str): Unit of the half-widths: deg or mm.
        before_half_width (float): Half-width before, in `unit`.
        after_half_width (float): Half-width after, in `unit`.
        at_target_before_mm (float): What the half-width before moves the worst target by, half-width times lever, mm.
        at_target_mm (float): What the half-width after moves the worst target by, mm.
        cost_before (float | None): Cost of the half-width before, in the unit of the design's prices; null: it has no
            price (zero, or tighter than every grade).
        cost_after (float): Cost of the half-width after, in the unit of the design's prices.
        grade (None | str): Process grade that was chosen from a table; null without a table.
    """

    contributor: str
    component: str
    label: str
    unit: str
    before_half_width: float
    after_half_width: float
    at_target_before_mm: float
    at_target_mm: float
    cost_before: float | None
    cost_after: float
    grade: None | str

    def to_dict(self) -> dict[str, Any]:
        contributor = self.contributor

        component = self.component

        label = self.label

        unit = self.unit

        before_half_width = self.before_half_width

        after_half_width = self.after_half_width

        at_target_before_mm = self.at_target_before_mm

        at_target_mm = self.at_target_mm

        cost_before: float | None
        cost_before = self.cost_before

        cost_after = self.cost_after

        grade: None | str
        grade = self.grade

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "contributor": contributor,
                "component": component,
                "label": label,
                "unit": unit,
                "before_half_width": before_half_width,
                "after_half_width": after_half_width,
                "at_target_before_mm": at_target_before_mm,
                "at_target_mm": at_target_mm,
                "cost_before": cost_before,
                "cost_after": cost_after,
                "grade": grade,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        contributor = d.pop("contributor")

        component = d.pop("component")

        label = d.pop("label")

        unit = d.pop("unit")

        before_half_width = d.pop("before_half_width")

        after_half_width = d.pop("after_half_width")

        at_target_before_mm = d.pop("at_target_before_mm")

        at_target_mm = d.pop("at_target_mm")

        def _parse_cost_before(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        cost_before = _parse_cost_before(d.pop("cost_before"))

        cost_after = d.pop("cost_after")

        def _parse_grade(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        grade = _parse_grade(d.pop("grade"))

        changed_tolerance = cls(
            contributor=contributor,
            component=component,
            label=label,
            unit=unit,
            before_half_width=before_half_width,
            after_half_width=after_half_width,
            at_target_before_mm=at_target_before_mm,
            at_target_mm=at_target_mm,
            cost_before=cost_before,
            cost_after=cost_after,
            grade=grade,
        )

        return changed_tolerance

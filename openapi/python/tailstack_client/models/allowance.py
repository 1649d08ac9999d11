from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from ..models.allowance_status import AllowanceStatus
from ..models.allowance_status import check_allowance_status
from typing import cast


T = TypeVar("T", bound="Allowance")


@_attrs_define
class Allowance:
    """How far one half-width could go by itself, to first order, everything else as it is; and what it costs.

    Of the requirement on the error at this target that is nearest to its limit, or furthest beyond it.

        Attributes:
            target (str): Name of the target.
            contributor (str): Source of error: structure_connector, fiducial_manufacturing, ...
            component (str): Its component; all for a line of sources that are alike.
            unit (str): Unit of the half-widths: deg, mm, px or N.
            half_width (float): Half-width as it is, in `unit`.
            requirement (None | str): Requirement at this target that is nearest to its limit, or furthest beyond; null: no
                pooled requirement names this target.
            status (AllowanceStatus): spare: the half-width may grow; too wide: it must shrink; zero is not enough: nor
                would a perfect part do; no influence; no requirement.
            at_limit (float | None): Half-width at which the requirement's quantile is at its limit, in `unit`; null where
                there is none.
            slack (float | None): `at_limit` less `half_width`, in `unit`: negative where it has to shrink; null where there
                is no such half-width.
            cost (float | None): Cost by the price in the design's optimise section; null: no price.
            smallest (float | None): Lower bound in the optimise section, in `unit`; null: none.
            largest (float | None): Upper bound in the optimise section, in `unit`; null: none.
            label (str): What people call the source: the label that the design gives an interface, otherwise its name or
                words for it. Default: ''.
    """

    target: str
    contributor: str
    component: str
    unit: str
    half_width: float
    requirement: None | str
    status: AllowanceStatus
    at_limit: float | None
    slack: float | None
    cost: float | None
    smallest: float | None
    largest: float | None
    label: str = ""

    def to_dict(self) -> dict[str, Any]:
        target = self.target

        contributor = self.contributor

        component = self.component

        unit = self.unit

        half_width = self.half_width

        requirement: None | str
        requirement = self.requirement

        status: str = self.status

        at_limit: float | None
        at_limit = self.at_limit

        slack: float | None
        slack = self.slack

        cost: float | None
        cost = self.cost

        smallest: float | None
        smallest = self.smallest

        largest: float | None
        largest = self.largest

        label = self.label

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "target": target,
                "contributor": contributor,
                "component": component,
                "unit": unit,
                "half_width": half_width,
                "requirement": requirement,
                "status": status,
                "at_limit": at_limit,
                "slack": slack,
                "cost": cost,
                "smallest": smallest,
                "largest": largest,
                "label": label,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        target = d.pop("target")

        contributor = d.pop("contributor")

        component = d.pop("component")

        unit = d.pop("unit")

        half_width = d.pop("half_width")

        def _parse_requirement(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        requirement = _parse_requirement(d.pop("requirement"))

        status = check_allowance_status(d.pop("status"))

        def _parse_at_limit(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        at_limit = _parse_at_limit(d.pop("at_limit"))

        def _parse_slack(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        slack = _parse_slack(d.pop("slack"))

        def _parse_cost(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        cost = _parse_cost(d.pop("cost"))

        def _parse_smallest(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        smallest = _parse_smallest(d.pop("smallest"))

        def _parse_largest(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        largest = _parse_largest(d.pop("largest"))

        label = d.pop("label")

        allowance = cls(
            target=target,
            contributor=contributor,
            component=component,
            unit=unit,
            half_width=half_width,
            requirement=requirement,
            status=status,
            at_limit=at_limit,
            slack=slack,
            cost=cost,
            smallest=smallest,
            largest=largest,
            label=label,
        )

        return allowance

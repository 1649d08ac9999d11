from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="CountTried")


@_attrs_define
class CountTried:
    """The best design with so many fiducials, by the closed form.

    Attributes:
        fiducials (int): How many fiducials.
        cost (float | None): Cost, fiducials included; null: nothing feasible was found.
        worst_ratio (float | None): Largest quantile over its limit; null: nothing feasible was found.
        note (str): What happened, where there is no cost.
    """

    fiducials: int
    cost: float | None
    worst_ratio: float | None
    note: str

    def to_dict(self) -> dict[str, Any]:
        fiducials = self.fiducials

        cost: float | None
        cost = self.cost

        worst_ratio: float | None
        worst_ratio = self.worst_ratio

        note = self.note

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "fiducials": fiducials,
                "cost": cost,
                "worst_ratio": worst_ratio,
                "note": note,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        fiducials = d.pop("fiducials")

        def _parse_cost(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        cost = _parse_cost(d.pop("cost"))

        def _parse_worst_ratio(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        worst_ratio = _parse_worst_ratio(d.pop("worst_ratio"))

        note = d.pop("note")

        count_tried = cls(
            fiducials=fiducials,
            cost=cost,
            worst_ratio=worst_ratio,
            note=note,
        )

        return count_tried

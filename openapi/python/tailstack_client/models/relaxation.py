from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="Relaxation")


@_attrs_define
class Relaxation:
    """A lower bound of the cost that no design within the given freedom (as said) can undercut.

    Attributes:
        kind (str): How the bound was found (convex allocation, monotone cuts over grades), or why there is none.
        cost (float | None): Cost of the optimum that it is compared with; null without a bound.
        lower_bound (float | None): Cost that no design within the given freedom can undercut; null without a bound.
        gap_percent (float | None): How far the optimum is above the bound, %; null without a bound.
        statement (str): What the bound holds for, in a sentence.
    """

    kind: str
    cost: float | None
    lower_bound: float | None
    gap_percent: float | None
    statement: str

    def to_dict(self) -> dict[str, Any]:
        kind = self.kind

        cost: float | None
        cost = self.cost

        lower_bound: float | None
        lower_bound = self.lower_bound

        gap_percent: float | None
        gap_percent = self.gap_percent

        statement = self.statement

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "kind": kind,
                "cost": cost,
                "lower_bound": lower_bound,
                "gap_percent": gap_percent,
                "statement": statement,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        kind = d.pop("kind")

        def _parse_cost(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        cost = _parse_cost(d.pop("cost"))

        def _parse_lower_bound(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        lower_bound = _parse_lower_bound(d.pop("lower_bound"))

        def _parse_gap_percent(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        gap_percent = _parse_gap_percent(d.pop("gap_percent"))

        statement = d.pop("statement")

        relaxation = cls(
            kind=kind,
            cost=cost,
            lower_bound=lower_bound,
            gap_percent=gap_percent,
            statement=statement,
        )

        return relaxation

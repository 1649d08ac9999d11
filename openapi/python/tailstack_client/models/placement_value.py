from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="PlacementValue")


@_attrs_define
class PlacementValue:
    """What the placement bought, against a textbook layout and against careless ones, tolerances optimised alike.

    Attributes:
        textbook (str): What the textbook layout is, or why there is none.
        textbook_objective (float | None): Its objective, tolerances optimised; null: it cannot meet the limit.
        careless_layouts (int): Random layouts that keep the rules.
        careless_infeasible (int): How many of them cannot meet the limit.
        careless_median (float | None): Median objective of those that can; null where none can.
        careless_worst (float | None): Largest objective of those that can; null where none can.
        best (float): Objective of the optimum, by the same closed form.
        sentence (str): The comparison as a sentence.
    """

    textbook: str
    textbook_objective: float | None
    careless_layouts: int
    careless_infeasible: int
    careless_median: float | None
    careless_worst: float | None
    best: float
    sentence: str

    def to_dict(self) -> dict[str, Any]:
        textbook = self.textbook

        textbook_objective: float | None
        textbook_objective = self.textbook_objective

        careless_layouts = self.careless_layouts

        careless_infeasible = self.careless_infeasible

        careless_median: float | None
        careless_median = self.careless_median

        careless_worst: float | None
        careless_worst = self.careless_worst

        best = self.best

        sentence = self.sentence

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "textbook": textbook,
                "textbook_objective": textbook_objective,
                "careless_layouts": careless_layouts,
                "careless_infeasible": careless_infeasible,
                "careless_median": careless_median,
                "careless_worst": careless_worst,
                "best": best,
                "sentence": sentence,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        textbook = d.pop("textbook")

        def _parse_textbook_objective(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        textbook_objective = _parse_textbook_objective(d.pop("textbook_objective"))

        careless_layouts = d.pop("careless_layouts")

        careless_infeasible = d.pop("careless_infeasible")

        def _parse_careless_median(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        careless_median = _parse_careless_median(d.pop("careless_median"))

        def _parse_careless_worst(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        careless_worst = _parse_careless_worst(d.pop("careless_worst"))

        best = d.pop("best")

        sentence = d.pop("sentence")

        placement_value = cls(
            textbook=textbook,
            textbook_objective=textbook_objective,
            careless_layouts=careless_layouts,
            careless_infeasible=careless_infeasible,
            careless_median=careless_median,
            careless_worst=careless_worst,
            best=best,
            sentence=sentence,
        )

        return placement_value

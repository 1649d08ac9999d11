from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast

if TYPE_CHECKING:
    from ..models.aimed_view import AimedView


T = TypeVar("T", bound="ViewSearch")


@_attrs_define
class ViewSearch:
    """Where views were free: what became of them, and what that rests on.

    Attributes:
        views (list[AimedView]): The views that were free.
        scored (int): Ways to aim them that were scored with everything else as it was.
        solved (int): Ways to aim them at which everything else was optimised.
        refused (int): How many of these gave no design: what they hide, or a limit out of reach.
        objective_as_aimed (float | None): Objective by the closed form with the views as they were; null: no design
            there, they may not stay so, or one was added.
        objective (float): Objective by the closed form with the views of the new design.
        sentence (str): The same in words, and that it is the best of what was tried.
    """

    views: list[AimedView]
    scored: int
    solved: int
    refused: int
    objective_as_aimed: float | None
    objective: float
    sentence: str

    def to_dict(self) -> dict[str, Any]:
        from ..models.aimed_view import AimedView  # noqa: PLC0415

        views = []
        for views_item_data in self.views:
            views_item = views_item_data.to_dict()
            views.append(views_item)

        scored = self.scored

        solved = self.solved

        refused = self.refused

        objective_as_aimed: float | None
        objective_as_aimed = self.objective_as_aimed

        objective = self.objective

        sentence = self.sentence

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "views": views,
                "scored": scored,
                "solved": solved,
                "refused": refused,
                "objective_as_aimed": objective_as_aimed,
                "objective": objective,
                "sentence": sentence,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.aimed_view import AimedView  # noqa: PLC0415

        d = dict(src_dict)
        views = []
        _views = d.pop("views")
        for views_item_data in _views:
            views_item = AimedView.from_dict(views_item_data)

            views.append(views_item)

        scored = d.pop("scored")

        solved = d.pop("solved")

        refused = d.pop("refused")

        def _parse_objective_as_aimed(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        objective_as_aimed = _parse_objective_as_aimed(d.pop("objective_as_aimed"))

        objective = d.pop("objective")

        sentence = d.pop("sentence")

        view_search = cls(
            views=views,
            scored=scored,
            solved=solved,
            refused=refused,
            objective_as_aimed=objective_as_aimed,
            objective=objective,
            sentence=sentence,
        )

        return view_search

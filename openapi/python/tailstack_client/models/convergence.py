from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast

if TYPE_CHECKING:
    from ..models.convergence_point import ConvergencePoint


T = TypeVar("T", bound="Convergence")


@_attrs_define
class Convergence:
    """How the sampled P95 at one target settled.

    Attributes:
        target (str): Name of the target.
        confidence (float): Confidence of each interval by itself, 0 to 1.
        points (list[ConvergencePoint]): P95 of ever more trials.
    """

    target: str
    confidence: float
    points: list[ConvergencePoint]

    def to_dict(self) -> dict[str, Any]:
        from ..models.convergence_point import ConvergencePoint  # noqa: PLC0415

        target = self.target

        confidence = self.confidence

        points = []
        for points_item_data in self.points:
            points_item = points_item_data.to_dict()
            points.append(points_item)

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "target": target,
                "confidence": confidence,
                "points": points,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.convergence_point import ConvergencePoint  # noqa: PLC0415

        d = dict(src_dict)
        target = d.pop("target")

        confidence = d.pop("confidence")

        points = []
        _points = d.pop("points")
        for points_item_data in _points:
            points_item = ConvergencePoint.from_dict(points_item_data)

            points.append(points_item)

        convergence = cls(
            target=target,
            confidence=confidence,
            points=points,
        )

        return convergence

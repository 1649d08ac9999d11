from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast

if TYPE_CHECKING:
    from ..models.beam_angle import BeamAngle
    from ..models.beam_direction import BeamDirection


T = TypeVar("T", bound="ViewMap")


@_attrs_define
class ViewMap:
    """P95 over the direction of one view's beam, everything else as designed.

    Attributes:
        view (str): Name of the view that turns; of a view more, of the one that it is a copy of.
        reason (None | str): Why the view is left as it is; null where it turns.
        cone_deg (float): How far it turns from where it is designed, deg.
        step_deg (float): Step of the map, deg.
        directions (list[BeamDirection]): All directions of the map, those that turn least first.
        best (BeamDirection | None): The allowed direction with the smallest P95; null where none is allowed.
        turn_deg (float | None): Angle between the designed beam and the best one, deg.
        angles (list[BeamAngle]): Between the best beam and those of the other views.
        sentence (str): What the map says.
    """

    view: str
    reason: None | str
    cone_deg: float
    step_deg: float
    directions: list[BeamDirection]
    best: BeamDirection | None
    turn_deg: float | None
    angles: list[BeamAngle]
    sentence: str

    def to_dict(self) -> dict[str, Any]:
        from ..models.beam_angle import BeamAngle  # noqa: PLC0415
        from ..models.beam_direction import BeamDirection  # noqa: PLC0415

        view = self.view

        reason: None | str
        reason = self.reason

        cone_deg = self.cone_deg

        step_deg = self.step_deg

        directions = []
        for directions_item_data in self.directions:
            directions_item = directions_item_data.to_dict()
            directions.append(directions_item)

        best: dict[str, Any] | None
        if isinstance(self.best, BeamDirection):
            best = self.best.to_dict()
        else:
            best = self.best

        turn_deg: float | None
        turn_deg = self.turn_deg

        angles = []
        for angles_item_data in self.angles:
            angles_item = angles_item_data.to_dict()
            angles.append(angles_item)

        sentence = self.sentence

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "view": view,
                "reason": reason,
                "cone_deg": cone_deg,
                "step_deg": step_deg,
                "directions": directions,
                "best": best,
                "turn_deg": turn_deg,
                "angles": angles,
                "sentence": sentence,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        from ..models.beam_angle import BeamAngle  # noqa: PLC0415
        from ..models.beam_direction import BeamDirection  # noqa: PLC0415

        d = dict(src_dict)
        view = d.pop("view")

        def _parse_reason(data: object) -> None | str:
            if data is None:
                return data
            return cast(None | str, data)

        reason = _parse_reason(d.pop("reason"))

        cone_deg = d.pop("cone_deg")

        step_deg = d.pop("step_deg")

        directions = []
        _directions = d.pop("directions")
        for directions_item_data in _directions:
            directions_item = BeamDirection.from_dict(directions_item_data)

            directions.append(directions_item)

        def _parse_best(data: object) -> BeamDirection | None:
            if data is None:
                return data
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                best_type_0 = BeamDirection.from_dict(data)

                return best_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            return cast(BeamDirection | None, data)

        best = _parse_best(d.pop("best"))

        def _parse_turn_deg(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        turn_deg = _parse_turn_deg(d.pop("turn_deg"))

        angles = []
        _angles = d.pop("angles")
        for angles_item_data in _angles:
            angles_item = BeamAngle.from_dict(angles_item_data)

            angles.append(angles_item)

        sentence = d.pop("sentence")

        view_map = cls(
            view=view,
            reason=reason,
            cone_deg=cone_deg,
            step_deg=step_deg,
            directions=directions,
            best=best,
            turn_deg=turn_deg,
            angles=angles,
            sentence=sentence,
        )

        return view_map

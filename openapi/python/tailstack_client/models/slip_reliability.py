from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="SlipReliability")


@_attrs_define
class SlipReliability:
    """What becomes of a slip of one fiducial's image in one view: a test of its residuals at the level of 0.1 % notices
    it in 80 % of cases, or it does not.

        Attributes:
            view (str): Name of the view.
            fiducial (str): Label of the fiducial.
            slip_px (float | None): Smallest slip that is noticed whatever its direction, px; null where a slip in some
                direction never is.
            effect_mm (float | None): Largest error at the tool that a slip does which is not noticed, mm; null where there
                is no bound.
            target (str): Target at which it does.
    """

    view: str
    fiducial: str
    slip_px: float | None
    effect_mm: float | None
    target: str

    def to_dict(self) -> dict[str, Any]:
        view = self.view

        fiducial = self.fiducial

        slip_px: float | None
        slip_px = self.slip_px

        effect_mm: float | None
        effect_mm = self.effect_mm

        target = self.target

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "view": view,
                "fiducial": fiducial,
                "slip_px": slip_px,
                "effect_mm": effect_mm,
                "target": target,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        view = d.pop("view")

        fiducial = d.pop("fiducial")

        def _parse_slip_px(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        slip_px = _parse_slip_px(d.pop("slip_px"))

        def _parse_effect_mm(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        effect_mm = _parse_effect_mm(d.pop("effect_mm"))

        target = d.pop("target")

        slip_reliability = cls(
            view=view,
            fiducial=fiducial,
            slip_px=slip_px,
            effect_mm=effect_mm,
            target=target,
        )

        return slip_reliability

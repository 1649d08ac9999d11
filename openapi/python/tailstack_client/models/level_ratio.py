from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, BinaryIO, TextIO, TYPE_CHECKING, Generator

from attrs import define as _attrs_define
from attrs import field as _attrs_field

from ..types import UNSET, Unset

from typing import cast


T = TypeVar("T", bound="LevelRatio")


@_attrs_define
class LevelRatio:
    """S4: what an installation level does to error and reprojection error where there is no noise.

    Attributes:
        level (str): Installation level of S4.
        rotation_deg (float): About each axis, deg.
        translation_mm (float): Along (1, 1, 1), mm.
        error_mm (float): Norm of the localisation error without noise, mm.
        reprojection_estimated_px (float): Reprojection error with the matrices estimated at this level, as the chain
            does, px.
        reprojection_noisy_px (float): The same with 2 px of noise: mean over trials, px.
        reprojection_kept_px (float): Reprojection error with the matrices of L0 kept: RMS over fiducials and views, px.
        mm_per_px (float | None): Error over the latter, mm per px; null at L0.
    """

    level: str
    rotation_deg: float
    translation_mm: float
    error_mm: float
    reprojection_estimated_px: float
    reprojection_noisy_px: float
    reprojection_kept_px: float
    mm_per_px: float | None

    def to_dict(self) -> dict[str, Any]:
        level = self.level

        rotation_deg = self.rotation_deg

        translation_mm = self.translation_mm

        error_mm = self.error_mm

        reprojection_estimated_px = self.reprojection_estimated_px

        reprojection_noisy_px = self.reprojection_noisy_px

        reprojection_kept_px = self.reprojection_kept_px

        mm_per_px: float | None
        mm_per_px = self.mm_per_px

        field_dict: dict[str, Any] = {}

        field_dict.update(
            {
                "level": level,
                "rotation_deg": rotation_deg,
                "translation_mm": translation_mm,
                "error_mm": error_mm,
                "reprojection_estimated_px": reprojection_estimated_px,
                "reprojection_noisy_px": reprojection_noisy_px,
                "reprojection_kept_px": reprojection_kept_px,
                "mm_per_px": mm_per_px,
            }
        )

        return field_dict

    @classmethod
    def from_dict(cls: type[T], src_dict: Mapping[str, Any]) -> T:
        d = dict(src_dict)
        level = d.pop("level")

        rotation_deg = d.pop("rotation_deg")

        translation_mm = d.pop("translation_mm")

        error_mm = d.pop("error_mm")

        reprojection_estimated_px = d.pop("reprojection_estimated_px")

        reprojection_noisy_px = d.pop("reprojection_noisy_px")

        reprojection_kept_px = d.pop("reprojection_kept_px")

        def _parse_mm_per_px(data: object) -> float | None:
            if data is None:
                return data
            return cast(float | None, data)

        mm_per_px = _parse_mm_per_px(d.pop("mm_per_px"))

        level_ratio = cls(
            level=level,
            rotation_deg=rotation_deg,
            translation_mm=translation_mm,
            error_mm=error_mm,
            reprojection_estimated_px=reprojection_estimated_px,
            reprojection_noisy_px=reprojection_noisy_px,
            reprojection_kept_px=reprojection_kept_px,
            mm_per_px=mm_per_px,
        )

        return level_ratio

"""Published C-arm geometries.  A number that a source does not state is absent, never guessed."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from ..tables import read_table


@dataclass(frozen=True, slots=True)
class Preset:
    """One geometry as published: lengths in mm, image in px (width, height)."""

    name: str
    title: str
    source_detector_mm: float
    source_isocentre_mm: float | None
    pixel_mm: float | None
    image_size_px: tuple[int, int]
    source: str
    remark: str = ""

    @property
    def missing(self) -> tuple[str, ...]:
        """Fields that a view with this preset has to state itself."""
        return tuple(name for name in ("source_isocentre_mm", "pixel_mm") if getattr(self, name) is None)


PRESETS = {
    name: Preset(name, **{**given, "image_size_px": tuple(given["image_size_px"])})
    for name, given in read_table("presets").items()
}


def list_presets() -> list[dict[str, Any]]:
    """All presets as plain data, sources included, with the fields a view must add itself."""
    return [{**asdict(preset), "view_must_state": list(preset.missing)} for preset in PRESETS.values()]

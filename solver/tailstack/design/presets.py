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
    view_must_state: tuple[str, ...] = ()  # fields that the source does not, so a view with this preset has to


PRESETS = {
    name: Preset(
        name,
        **{**given, "image_size_px": tuple(given["image_size_px"])},
        view_must_state=tuple(field for field in ("source_isocentre_mm", "pixel_mm") if given[field] is None),
    )
    for name, given in read_table("presets").items()
}


def list_presets() -> list[dict[str, Any]]:
    """All presets as plain data, sources included, with the fields a view must add itself."""
    return [asdict(preset) for preset in PRESETS.values()]

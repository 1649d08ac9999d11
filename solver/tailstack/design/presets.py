"""Published C-arm geometries.  A number that a source does not state is absent, never guessed."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from ..tables import read_table


@dataclass(frozen=True, slots=True)
class PresetEntry:
    """A published C-arm geometry; what its source does not state is null, and a view has to state it."""

    name: str
    """What the field `preset` of a view takes."""
    title: str
    """The device."""
    source_detector_mm: float
    """Distance from the X-ray source to the detector, mm."""
    source_isocentre_mm: float | None
    """Distance from the X-ray source to the isocentre, mm."""
    pixel_mm: float | None
    """Pixel pitch at the detector, mm."""
    image_size_px: tuple[int, int]
    """Width and height of the image, px."""
    view_must_state: tuple[str, ...]
    """Fields that a view with this preset has to state itself."""
    source: str
    """Where the numbers are from."""
    remark: str = ""
    """What is to be known about them; may be empty."""


PRESETS = {
    name: PresetEntry(
        name,
        **{**given, "image_size_px": tuple(given["image_size_px"])},
        view_must_state=tuple(field for field in ("source_isocentre_mm", "pixel_mm") if given[field] is None),
    )
    for name, given in read_table("presets").items()
}


def list_presets() -> list[dict[str, Any]]:
    """All presets as plain data, sources included, with the fields a view must add itself."""
    return [asdict(preset) for preset in PRESETS.values()]

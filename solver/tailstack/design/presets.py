"""Published C-arm geometries.  A number that a source does not state is absent, never guessed."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Preset:
    """One geometry as published: lengths in mm, image in px (width, height)."""

    name: str
    title: str
    source_detector_mm: float
    source_isocentre_mm: float | None
    pixel_mm: float | None
    image_size_px: tuple[int, int] | None
    source: str
    remark: str = ""

    @property
    def missing(self) -> tuple[str, ...]:
        """Fields that a view with this preset has to state itself."""
        return tuple(
            name for name in ("source_isocentre_mm", "pixel_mm", "image_size_px") if getattr(self, name) is None
        )


PRESETS: dict[str, Preset] = {
    preset.name: preset
    for preset in (
        Preset(
            "siemens-cios-fusion",
            "Siemens Cios Fusion (mobile, flat panel)",
            1020.0,
            None,
            0.194,
            (1536, 1536),
            "rg2/xreg, xregCIOSFusionDICOM.cpp; data layout of the DeepFluoro collection",
            "the distance from source to isocentre is not published with it; arcadelab/deepdrr models 530 mm",
        ),
        Preset(
            "siemens-cios-fusion-deepdrr",
            "Siemens Cios Fusion as modelled in deepdrr",
            1020.0,
            530.0,
            0.194,
            (1536, 1536),
            "arcadelab/deepdrr, mobile_carm.py",
            "the 530 mm are that model's, not the maker's",
        ),
        Preset(
            "generic-mobile-c-arm",
            "Generic mobile C-arm",
            1259.65,
            742.5,
            0.3,
            (1440, 1440),
            "public code for an unnamed device",
        ),
        Preset(
            "siemens-xa-a",
            "Siemens XA angiography, geometry A",
            1148.0,
            809.89,
            None,
            (512, 512),
            "DICOM header dump in public code",
            "the pixel pitch is not in the dump",
        ),
        Preset(
            "siemens-xa-b",
            "Siemens XA angiography, geometry B",
            1175.0,
            720.0,
            None,
            (512, 512),
            "DICOM header dump in public code",
            "the pixel pitch is not in the dump",
        ),
        Preset(
            "diffdrr-user",
            "Geometry of a DiffDRR user",
            1085.6,
            595.0,
            0.40625,
            (512, 512),
            "DiffDRR issue 324",
        ),
        Preset(
            "deepdrr-example",
            "Example geometry of deepdrr",
            1200.0,
            None,
            0.33,
            (512, 512),
            "arcadelab/deepdrr, README",
            "the distance from source to isocentre is not stated",
        ),
    )
}


def list_presets() -> list[dict[str, Any]]:
    """All presets as plain data, sources included, with the fields a view must add itself."""
    return [{**asdict(preset), "view_must_state": list(preset.missing)} for preset in PRESETS.values()]

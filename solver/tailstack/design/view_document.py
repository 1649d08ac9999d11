"""Views of the document: four ways to say where an X-ray source and its detector are."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Discriminator, Field, Tag, model_validator

from .fields import (
    Angles,
    Direction,
    Distance,
    Entry,
    ImagePoint,
    ImageSize,
    Matrix34,
    Matrix44,
    Name,
    PixelPitch,
    Pixels,
    Point,
    Quaternion,
    Record,
    Rotation3,
    exactly_one,
    refusal,
)
from .presets import PRESETS

ALONG = {"AP": (0.0, 1.0, 0.0), "LAT": (-1.0, 0.0, 0.0)}  # beam directions in con


class _AnyView(Record):
    name: Name = Field(description="What you call this view; unique.", examples=["AP"])
    fiducial_noise_px: Pixels = Field(
        description="Standard deviation of a fiducial's measured image, per coordinate (not per point), px. "
        "Well-segmented 3 mm beads: 0.05 best, 0.3 typical, 0.5 clinical, 1.0 stress.",
        examples=[0.3],
    )
    target_noise_px: Pixels = Field(
        description="Standard deviation of the target's measured image, per coordinate, px. Independent of the "
        "fiducials' noise.",
        examples=[0.3],
    )


class _Aimed(_AnyView):
    """Where the beam goes: an orientation by name, or two directions."""

    model_config = ConfigDict(json_schema_extra=exactly_one("orientation", "beam_direction"))

    orientation: Literal["AP", "LAT"] | None = Field(
        default=None,
        description="AP: the beam runs along +y of con. LAT: along -x. In both, u runs right, v down (along -z). Give "
        "either this or beam_direction.",
        examples=["AP"],
    )
    beam_direction: Direction | None = Field(
        default=None,
        description="Direction from the source to the detector, in con; any length. Instead of orientation.",
        examples=[[0.0, 1.0, 0.0]],
    )
    up_direction: Direction = Field(
        default=(0.0, 0.0, 1.0),
        description="Direction in con that is up in the image (v runs the other way). Default z.",
        examples=[[0.0, 0.0, 1.0]],
    )
    isocentre_mm: Point = Field(
        default=(0.0, 0.0, 0.0),
        description="Where the beam's axis passes, in con, mm. Default the origin.",
        examples=[[0.0, 0.0, -30.0]],
    )

    @model_validator(mode="after")
    def _one_direction(self) -> _Aimed:
        if (self.orientation is None) == (self.beam_direction is None):
            given = "both" if self.orientation is not None else "neither"
            raise refusal(
                "one-of", f"give exactly one of orientation and beam_direction; {given} arrived", "orientation: AP"
            )
        b, u = self.beam, self.up_direction
        cross = (b[1] * u[2] - b[2] * u[1], b[2] * u[0] - b[0] * u[2], b[0] * u[1] - b[1] * u[0])
        size_b, size_u, size_c = [max(map(abs, v)) for v in (b, u, cross)]
        if size_b == 0 or size_u == 0 or size_c < 1e-6 * size_b * size_u:
            raise refusal(
                "parallel-directions",
                f"beam direction {list(b)} and up_direction {list(u)} must be two different directions, not zero",
                "choose an up_direction across the beam",
                "up_direction",
            )
        return self

    @property
    def beam(self) -> tuple[float, float, float]:
        """Direction of the beam in con."""
        if self.beam_direction is not None:
            return self.beam_direction
        return ALONG[self.orientation or "AP"]


class PresetView(_Aimed):
    """A published C-arm, aimed.  Any of its numbers can be overridden."""

    preset: str = Field(
        description="Name of a published geometry; `tailstack schema presets` lists them with their sources.",
        examples=["siemens-cios-fusion"],
        json_schema_extra={"enum": list(PRESETS)},
    )
    source_detector_mm: Distance | None = Field(
        default=None, description="Overrides the preset's. mm.", examples=[1020.0]
    )
    source_isocentre_mm: Distance | None = Field(
        default=None, description="Overrides the preset's; required where the preset has none. mm.", examples=[700.0]
    )
    pixel_mm: PixelPitch | None = Field(
        default=None, description="Overrides the preset's pixel pitch, mm.", examples=[0.194]
    )
    image_size_px: ImageSize | None = Field(
        default=None, description="Overrides the preset's image size [width, height], px.", examples=[[1536, 1536]]
    )
    principal_point_px: ImagePoint | None = Field(
        default=None,
        description="Foot of the perpendicular from the source to the detector, px; pixel centres are integers, the "
        "first is (0, 0). Default the image centre.",
        examples=[[767.5, 767.5]],
    )


class DistanceView(_Aimed):
    """A C-arm by the numbers of its data sheet, aimed."""

    source_detector_mm: Distance = Field(description="Source to detector, mm.", examples=[1020.0])
    source_isocentre_mm: Distance = Field(description="Source to isocentre_mm, mm.", examples=[700.0])
    pixel_mm: PixelPitch = Field(description="Pixel pitch at the detector (square pixels), mm.", examples=[0.194])
    image_size_px: ImageSize = Field(description="Image [width, height], px.", examples=[[1536, 1536]])
    principal_point_px: ImagePoint | None = Field(
        default=None,
        description="Foot of the perpendicular from the source to the detector, px; pixel centres are integers, the "
        "first is (0, 0). Default the image centre.",
        examples=[[767.5, 767.5]],
    )

    @model_validator(mode="after")
    def _detector_behind_isocentre(self) -> DistanceView:
        if self.source_isocentre_mm >= self.source_detector_mm:
            raise refusal(
                "distance-order",
                f"the isocentre lies between source and detector: source_isocentre_mm {self.source_isocentre_mm} is "
                f"not below source_detector_mm {self.source_detector_mm}",
                at="source_isocentre_mm",
            )
        return self


class Intrinsics(Record):
    """Pinhole intrinsics: u = fx x/z + skew y/z + cx, v = fy y/z + cy."""

    focal_px: ImagePoint = Field(
        description="[fx, fy], px: source-detector distance over pixel.", examples=[[5258, 5258]]
    )
    principal_point_px: ImagePoint = Field(description="[cx, cy], px.", examples=[[767.5, 767.5]])
    skew_px: Entry = Field(default=0.0, description="Skew of the pixel axes, px. Default 0.", examples=[0.0])

    @model_validator(mode="after")
    def _focal_not_zero(self) -> Intrinsics:
        if min(map(abs, self.focal_px)) < 1:
            raise refusal(
                "out-of-range", f"focal lengths must be at least 1 px; got {list(self.focal_px)}", at="focal_px"
            )
        return self


class Pose(Record):
    """A rigid transform as one rotation, in one of three forms, and a translation."""

    rotation_deg: Angles | None = Field(
        default=None,
        description="[rx, ry, rz] in degrees, composed as R = Rx(rx) Ry(ry) Rz(rz).",
        examples=[[0.0, 0.0, 90.0]],
    )
    rotation: Rotation3 | None = Field(
        default=None, description="Rotation matrix, row by row.", examples=[[[1, 0, 0], [0, 1, 0], [0, 0, 1]]]
    )
    quaternion_wxyz: Quaternion | None = Field(
        default=None, description="Unit quaternion, scalar first.", examples=[[1.0, 0.0, 0.0, 0.0]]
    )
    translation_mm: Point = Field(
        default=(0.0, 0.0, 0.0), description="Added after the rotation, mm.", examples=[[0.0, 0.0, 120.0]]
    )

    @model_validator(mode="after")
    def _one_rotation(self) -> Pose:
        given = [n for n in ("rotation_deg", "rotation", "quaternion_wxyz") if getattr(self, n) is not None]
        if len(given) > 1:
            raise refusal("one-of", f"give one rotation; {' and '.join(given)} arrived", "keep one of them", given[1])
        return self


def _pose_kind(value: Any) -> str | None:
    if isinstance(value, list | tuple):
        return "<matrix>"
    return "<pose>" if isinstance(value, dict | Pose) else None


Transform = Annotated[
    Annotated[Matrix44, Tag("<matrix>")] | Annotated[Pose, Tag("<pose>")],
    Discriminator(
        _pose_kind,
        custom_error_type="wrong-type",
        custom_error_message="a transform is a 4x4 matrix or a mapping with a rotation and translation_mm",
    ),
]


class PinholeView(_AnyView):
    """Calibrated camera: intrinsics and the pose that maps con to the camera frame."""

    intrinsics: Intrinsics = Field(description="Pinhole intrinsics, px.")
    pose: Transform = Field(
        description="T_camera_con: maps con coordinates to the camera frame (source at the origin, z towards the "
        "detector, x along u, y along v). A 4x4 matrix (mm) or a rotation and translation_mm."
    )
    image_size_px: ImageSize | None = Field(
        default=None,
        description="Image [width, height], px. Without it the field of view is not checked.",
        examples=[[1536, 1536]],
    )


class MatrixView(_AnyView):
    """A calibrated 3x4 projection."""

    projection: Matrix34 = Field(
        description="P, row by row: maps (X, Y, Z, 1), con mm, to homogeneous px. Scale and sign are free; the sign is "
        "chosen so that the fiducials lie in front of the source.",
        examples=[[[5257.73, 767.5, 0.0, 537250.0], [0.0, 767.5, -5257.73, 537250.0], [0.0, 1.0, 0.0, 700.0]]],
    )
    image_size_px: ImageSize | None = Field(
        default=None,
        description="Image [width, height], px. Without it the field of view is not checked.",
        examples=[[1536, 1536]],
    )


VIEW_KINDS: dict[str, type[_AnyView]] = {
    "<projection>": MatrixView,
    "<intrinsics>": PinholeView,
    "<preset>": PresetView,
    "<distances>": DistanceView,
}
_TAGS: dict[type, str] = {kind: tag for tag, kind in VIEW_KINDS.items()}
_TELLS = {
    "projection": "<projection>",
    "intrinsics": "<intrinsics>",
    "pose": "<intrinsics>",
    "preset": "<preset>",
    "source_detector_mm": "<distances>",
    "source_isocentre_mm": "<distances>",
    "pixel_mm": "<distances>",
}


def _view_kind(value: Any) -> str | None:
    if isinstance(value, dict):
        return next((tag for field, tag in _TELLS.items() if field in value), None)
    return _TAGS.get(type(value))


def view_class(data: Any) -> type[_AnyView] | None:
    """The class that a view of plain data is of, by the fields it has."""
    return VIEW_KINDS.get(_view_kind(data) or "")


ViewDocument = Annotated[
    Annotated[PresetView, Tag("<preset>")]
    | Annotated[DistanceView, Tag("<distances>")]
    | Annotated[PinholeView, Tag("<intrinsics>")]
    | Annotated[MatrixView, Tag("<projection>")],
    Discriminator(
        _view_kind,
        custom_error_type="view-geometry",
        custom_error_message="a view is a mapping that gives its geometry by preset, or by source_detector_mm, "
        "source_isocentre_mm, pixel_mm and image_size_px, or by intrinsics and pose, or by projection",
    ),
]

"""The design document, ``tailstack/design/1``: what a user writes, field by field.

Angles are in degrees and lengths in millimetres here and nowhere else; :mod:`.compile` converts once.
The published JSON Schema is generated from these classes, so every field carries its description, its
unit (in its name), its default and an example.  First come the four ways to say where an X-ray source and its detector
are, then installation and execution errors, then the document as a whole.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import date
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import ConfigDict, Discriminator, Field, Tag, model_validator

from ..effects import with_sections
from ..field_names import write_value
from ..fields import (
    BOUNDED_WORDS,
    COVERAGE_WORDS,
    KEEP_ONE,
    LAW_WORDS,
    AnyLaw,
    CoverageFactor,
    Direction,
    Distance,
    Entry,
    Force,
    HalfWidth,
    HalfWidths,
    ImagePoint,
    ImageSize,
    Length,
    Matrix34,
    Name,
    PixelPitch,
    Pixels,
    Point,
    RandomLaw,
    Record,
    Rotation3,
    Transform,
    are_parallel,
    exactly_one,
    leave_out_later,
    not_both,
    one_of,
    only_one,
    refusal,
    refuse_repeated,
    share,
    with_law,
)
from ..geometry.arrays import Array
from ..geometry.rotation import RotationForm
from ..laws import RISKS, Drawn
from ..measures import MEASURE, STATED, StatedName
from ..ranges import (
    BEAD_PLACE_MM,
    COMPLIANCE,
    COUNT,
    DETECTOR_MM,
    EXTENT_MM,
    FOCAL_PX,
    FOOT_SD_PX,
    HAND_EYE_DEG,
    HAND_EYE_MM,
    ISOCENTRE_MM,
    KNOWN_HAND_EYE_DEG,
    KNOWN_HAND_EYE_MM,
    LEVEL,
    LIMIT_DEG,
    LIMIT_MM,
    LOAD_HALF_WIDTH_N,
    LOAD_N,
    SCATTER_MM,
    SEAT_MM,
    SHARE,
    SKEW_PX,
    TARGET_MM,
    YIELD,
    AnySize,
)
from ..statistic import HIGHEST, STATISTIC, STATISTICS, StatisticName, pooled_quantile
from ..system import DEFAULT_ESTIMATOR, Estimator, Reading, Triangulation
from ..tolerances import Bias, HowOften, Tolerances, level_field, refuse_indefinite
from ..units import LENGTHS_MM
from .bead_noise import BeadNoise
from .features import Feature, refuse_overheld
from .optimise_document import Optimise
from .presets import PRESETS
from .review import Review

if TYPE_CHECKING:
    RiskName = str
else:
    RiskName = Literal[RISKS]
FOOT_PX = AnySize("principal-point judges it by the middle of the image")
_FileName = Annotated[str, Field(min_length=1, max_length=400)]
ALONG = {"AP": (0.0, 1.0, 0.0), "LAT": (-1.0, 0.0, 0.0)}  # beam directions in con


class IntrinsicsPrior(Record):
    """How well the intrinsics of a view are known before its fiducials are seen, as standard deviations."""

    focal_rel_sd: Annotated[float, Field(ge=1e-6, le=1), SHARE] = Field(examples=[0.01])
    """Standard deviation of the focal length, as a part of it: 0.01 is 1 %."""
    principal_point_px_sd: Annotated[float, Field(ge=1e-3, le=1e4), FOOT_SD_PX] = Field(examples=[10.0])
    """Standard deviation of each coordinate of the principal point, px."""


_Moment = Annotated[float, Field(ge=-1e6, le=1e6)]
_Moments = Annotated[tuple[_Moment, _Moment], Field(strict=False)]
NoiseShape = Annotated[
    tuple[_Moments, _Moments], Field(strict=False), AnySize("a shape: the mean of its two variances is 1")
]
ROUNDED = 1e-3  # by which a shape may miss that mean


def _check_noise_shape(rows: Sequence[Sequence[float]], kind: str) -> None:
    """Refuse what is no covariance of u and v, or says how large noise is beside the field that does."""
    at, matrix = f"{kind}_noise_shape", np.array(rows)
    if abs(matrix[0, 1] - matrix[1, 0]) > ROUNDED:
        detail = f"u with v is {matrix[0, 1]:g}, v with u is {matrix[1, 0]:g}"
        raise refusal("not-a-covariance", detail, "a covariance is symmetric", at)
    if not (mean := matrix.trace() / 2) > 0 or matrix.diagonal().min() < 0:
        raise refusal("not-a-covariance", "no variance is negative, and one is above 0", f"{at}: [[1, 0], [0, 1]]", at)
    scale = np.sqrt(np.where(matrix.diagonal() > 0, matrix.diagonal(), mean))
    coefficients = matrix / np.outer(scale, scale)
    refuse_indefinite(np.where(np.eye(2) > 0, 1.0, coefficients), ("u", "v"), at)
    if abs(mean - 1) > ROUNDED:
        cure = f"{at}: {write_value((matrix / mean).tolist(), 4)}; its size, if it was in px^2, is {kind}_noise_px: "
        detail = f"the mean of its two variances is {mean:.4g}; of a shape it is 1, as {kind}_noise_px is its size"
        raise refusal("out-of-range", detail, f"{cure}{np.sqrt(mean):.4g}", at)


def _noise_kind(value: Any) -> str:
    return "<noise>" if isinstance(value, dict | BeadNoise) else "<number>"


NoiseOfBeads = Annotated[
    Annotated[Pixels, Tag("<number>")] | Annotated[BeadNoise, Tag("<noise>")], Discriminator(_noise_kind)
]


@with_sections("view", "sees", "intrinsics_prior", "fiducial_noise_shape", "target_noise_shape")
class _View(Record):
    name: Name = Field(examples=["AP"])
    """What you call this view; unique."""
    fiducial_noise_px: NoiseOfBeads = Field(examples=[0.3])
    """Standard deviation of a fiducial's measured image, per coordinate (not per point), px. Well-segmented 3 mm beads:
    0.05 best, 0.3 typical, 0.5 clinical, 1.0 stress. Or what it follows from."""
    target_noise_px: Pixels = Field(examples=[0.3])
    """Standard deviation of the target's measured image, per coordinate, px. Independent of the fiducials' noise."""
    fiducial_noise_shape: NoiseShape | None = Field(default=None, examples=[[[1.6, 0.3], [0.3, 0.4]]])
    """Covariance of that noise along u and v, [[uu, uv], [uv, vv]], over fiducial_noise_px^2: the mean of uu and vv is
    1. weighted triangulation weighs by it; the other estimators know nothing of it. Default [[1, 0], [0, 1]], alike in
    all directions."""
    target_noise_shape: NoiseShape | None = Field(default=None, examples=[[[0.5, 0.0], [0.0, 1.5]]])
    """The same of the target's image, over target_noise_px^2."""
    sees: Annotated[list[Name], Field(min_length=1)] | None = Field(
        default=None, examples=[["F1", "F2", "F3", "F4", "F5", "F6"]]
    )
    """Labels of the fiducials that this view's estimate uses: the others are hidden, outside the image or not told
    apart. Default: all of them."""
    intrinsics_prior: IntrinsicsPrior | None = None
    """How well focal length and principal point are known beforehand. The estimator pose_with_prior needs it in every
    view. Where intrinsics_error is absent, the assumed intrinsics also err by this much (normal, once per unit). dlt
    and reprojection read neither."""

    @model_validator(mode="after")
    def _noise_has_a_shape(self) -> Self:
        for kind in ("fiducial", "target"):
            if (shape := getattr(self, f"{kind}_noise_shape")) is not None:
                _check_noise_shape(shape, kind)
        return self


class _Aimed(_View):
    """Where the beam goes: an orientation by name, or two directions."""

    model_config, _one_direction = exactly_one("orientation", "beam_direction", needed="orientation: AP")

    orientation: Literal["AP", "LAT"] | None = Field(default=None, examples=["AP"])
    """AP: the beam runs along +y of con. LAT: along -x. In both, u runs right, v down (along -z). Give either this or
    beam_direction."""
    beam_direction: Direction | None = Field(default=None, examples=[[0.0, 1.0, 0.0]])
    """Direction from the source to the detector, in con; any length. Instead of orientation."""
    up_direction: Direction = Field(default=(0.0, 0.0, 1.0), examples=[[0.0, 0.0, 1.0]])
    """Direction in con that is up in the image (v runs the other way). Default z."""
    isocentre_mm: Annotated[Point, TARGET_MM] = Field(default=(0.0, 0.0, 0.0), examples=[[0.0, 0.0, -30.0]])
    """Where the beam's axis passes, in con, mm. Default the origin."""

    @model_validator(mode="after")
    def _directions_differ(self) -> _Aimed:
        beam, up = self.beam, self.up_direction
        if are_parallel(beam, up):
            both = f"beam direction {list(beam)} and up_direction {list(up)}"
            detail = f"{both} must be two different directions, not zero"
            raise refusal("parallel-directions", detail, "choose an up_direction across the beam", "up_direction")
        return self

    @property
    def beam(self) -> tuple[float, float, float]:
        """Direction of the beam in con."""
        return self.beam_direction or ALONG[self.orientation or "AP"]


class PresetView(_Aimed):
    """A published C-arm, aimed.  Any of its numbers can be overridden."""

    preset: str = Field(examples=["siemens-cios-fusion"], json_schema_extra={"enum": list(PRESETS)})
    """Name of a published geometry; `tailstack schema presets` lists them with their sources."""
    source_detector_mm: Annotated[Distance, DETECTOR_MM] | None = Field(default=None, examples=[1020.0])
    """Overrides the preset's. mm."""
    source_isocentre_mm: Annotated[Distance, ISOCENTRE_MM] | None = Field(default=None, examples=[700.0])
    """Overrides the preset's; required where the preset has none. mm."""
    pixel_mm: PixelPitch | None = Field(default=None, examples=[0.194])
    """Overrides the preset's pixel pitch, mm."""
    image_size_px: ImageSize | None = Field(default=None, examples=[[1536, 1536]])
    """Overrides the preset's image size [width, height], px."""
    principal_point_px: Annotated[ImagePoint, FOOT_PX] | None = Field(default=None, examples=[[767.5, 767.5]])
    """Foot of the perpendicular from the source to the detector, px; pixel centres are integers, the first is (0, 0).
    Default the image centre."""


class DistanceView(_Aimed):
    """A C-arm by the numbers of its data sheet, aimed."""

    source_detector_mm: Annotated[Distance, DETECTOR_MM] = Field(examples=[1020.0])
    """Source to detector, mm."""
    source_isocentre_mm: Annotated[Distance, ISOCENTRE_MM] = Field(examples=[700.0])
    """Source to isocentre_mm, mm."""
    pixel_mm: PixelPitch = Field(examples=[0.194])
    """Pixel pitch at the detector (square pixels), mm."""
    image_size_px: ImageSize = Field(examples=[[1536, 1536]])
    """Image [width, height], px."""
    principal_point_px: Annotated[ImagePoint, FOOT_PX] | None = Field(default=None, examples=[[767.5, 767.5]])
    """Foot of the perpendicular from the source to the detector, px; pixel centres are integers, the first is (0, 0).
    Default the image centre."""

    @model_validator(mode="after")
    def _detector_behind_isocentre(self) -> DistanceView:
        if self.source_isocentre_mm >= self.source_detector_mm:
            distances = f"source_isocentre_mm {self.source_isocentre_mm} is not below source_detector_mm"
            detail = f"the isocentre lies between source and detector: {distances} {self.source_detector_mm}"
            raise refusal("distance-order", detail, at="source_isocentre_mm")
        return self


class Intrinsics(Record):
    """Pinhole intrinsics: u = fx x/z + skew y/z + cx, v = fy y/z + cy."""

    focal_px: Annotated[ImagePoint, FOCAL_PX] = Field(examples=[[5258, 5258]])
    """[fx, fy], px: source-detector distance over pixel."""
    principal_point_px: Annotated[ImagePoint, FOOT_PX] = Field(examples=[[767.5, 767.5]])
    """[cx, cy], px."""
    skew_px: Annotated[Entry, SKEW_PX] = Field(default=0.0, examples=[0.0])
    """Skew of the pixel axes, px. Default 0."""

    @model_validator(mode="after")
    def _focal_not_zero(self) -> Intrinsics:
        if min(map(abs, self.focal_px)) < 1:
            detail = f"focal lengths must be at least 1 px; got {list(self.focal_px)}"
            raise refusal("out-of-range", detail, at="focal_px")
        return self


class PinholeView(_View):
    """Calibrated camera: intrinsics and the pose that maps con to the camera frame."""

    intrinsics: Intrinsics
    """Pinhole intrinsics, px."""
    pose: Annotated[Transform, AnySize("source-distance judges where its source lies", "mm")]
    """T_camera_con: maps con coordinates to the camera frame (source at the origin, z towards the detector, x along u,
    y along v). A 4x4 matrix (mm) or a rotation and translation_mm."""
    image_size_px: ImageSize | None = Field(default=None, examples=[[1536, 1536]])
    """Image [width, height], px. Without it the field of view is not checked."""


class MatrixView(_View):
    """A calibrated 3x4 projection."""

    projection: Matrix34 = Field(
        examples=[[[5257.73, 767.5, 0.0, 537250.0], [0.0, 767.5, -5257.73, 537250.0], [0.0, 1.0, 0.0, 700.0]]]
    )
    """P, row by row: maps (X, Y, Z, 1), con mm, to homogeneous px. Scale and sign are free; the sign is chosen so that
    the fiducials lie in front of the source."""
    image_size_px: ImageSize | None = Field(default=None, examples=[[1536, 1536]])
    """Image [width, height], px. Without it the field of view is not checked."""


VIEW_KINDS: dict[str, type[_View]] = {
    "<projection>": MatrixView,
    "<intrinsics>": PinholeView,
    "<preset>": PresetView,
    "<distances>": DistanceView,
}
_TAGS: dict[type, str] = {kind: tag for tag, kind in VIEW_KINDS.items()}
_TELLS = {
    "projection": "<projection>",
    **dict.fromkeys(("intrinsics", "pose"), "<intrinsics>"),
    "preset": "<preset>",
    **dict.fromkeys(("source_detector_mm", "source_isocentre_mm", "pixel_mm"), "<distances>"),
}


def _view_kind(value: Any) -> str | None:
    if isinstance(value, dict):
        return next((tag for field, tag in _TELLS.items() if field in value), None)
    return _TAGS.get(type(value))


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


class PointFile(Record):
    """Points in a file beside the design, of the formats of fiducial files."""

    file: _FileName = Field(examples=["plan/lesions.fcsv"])
    """Its name, a relative path."""
    T_con_file: Transform | None = None
    """Maps its coordinates (LPS, mm) to con, as that of fiducials. Default identity."""
    as_fiducials: bool = Field(default=False, examples=[True])
    """true: its points are in one scene with those of the fiducials' file, and are carried to con by the same motion.
    Default false."""

    @model_validator(mode="after")
    def _one_motion(self) -> Self:
        if self.T_con_file is not None and self.as_fiducials:
            detail = "as_fiducials says where T_con_file comes from; both arrived"
            raise refusal("one-of", detail, KEEP_ONE, "T_con_file")
        return self


class LocatorFile(PointFile):
    """Contacts in a file: its points go two by two, a contact and any point from it along its normal."""

    half_width_mm: Annotated[HalfWidth, SEAT_MM] = Field(examples=[0.01])
    """Half-width of the deviation of each along its normal, mm."""
    distribution: AnyLaw = Field(description=BOUNDED_WORDS, examples=["uniform"])
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[2.0])

    _law = with_law("half_width_mm")


class Locator(Record):
    """One point contact: the seat holds the part at this point along this normal."""

    name: Name = Field(examples=["A1"])
    """Name of the locator, unique in the interface."""
    position_mm: Point = Field(examples=[[40.0, 0.0, -95.0]])
    """Contact point in con, mm."""
    normal: Direction = Field(examples=[[0.0, 0.0, 1.0]])
    """Direction along which the contact constrains the part, in con; any length."""
    half_width_mm: Annotated[HalfWidth, SEAT_MM] = Field(examples=[0.01])
    """Half-width of the contact's deviation along the normal, mm."""
    distribution: AnyLaw = Field(description=BOUNDED_WORDS, examples=["uniform"])
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[2.0])

    _law = with_law("half_width_mm")


class FiducialOrigin(Record):
    """Where inlined points were read from, and what was done to them on the way.

    Written when a fiducial file is read into a design (convert, optimise, report), so that results go on saying it.
    """

    file: _FileName = Field(examples=["fiducials/phantom.mrk.json"])
    """Name of the fiducial file, as the design named it."""
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")] = Field(examples=["0" * 64])
    """SHA-256 of the file's bytes, 64 hexadecimal digits."""
    coordinate_system: Literal["LPS", "RAS"] = Field(examples=["RAS"])
    """What the file held. The points here are LPS: of RAS, x and y changed their sign."""
    coordinate_system_stated: bool = Field(default=True, examples=[True])
    """false: the file did not say, and was read as its format was written then."""
    coordinate_unit: Literal["um", "mm", "cm", "m", "in"] = Field(default="mm", examples=["mm"])
    """Unit of the coordinates in the file. The points here are in mm."""
    left_out: list[Name] = Field(default_factory=list, examples=[["P10"]])
    """Points of the file that are no fiducials here, as their position was not defined: their labels, with their state
    in brackets where it is another than undefined."""
    remarks: list[Annotated[str, Field(min_length=1, max_length=400)]] = Field(
        default_factory=list,
        max_length=20,
        examples=[["1 row was left out, as it begins with # and is a remark: line 12"]],
    )
    """What else is to be known of the file: other rows that were left out, and what was read in another way than it is
    written."""
    changed: bool = Field(default=False, examples=[False])
    """true: the points are no longer those of the file (the optimiser moved or left out some)."""

    def describe_left_out(self) -> str:
        """Which points of the file are no fiducials; empty where there are none."""
        count = len(self.left_out)
        points = "1 point was" if count == 1 else f"{count} points were"
        listed = ", ".join(self.left_out[:20]) + (", ..." if count > 20 else "")
        return f"{self.file}: {points} left out, position not defined: {listed[:400]}" if count else ""

    def list_notes(self) -> Iterator[str]:
        """What was done to the numbers on the way, in words."""
        name, system = self.file, self.coordinate_system
        if left_out := self.describe_left_out():
            yield left_out
        if not self.coordinate_system_stated:
            yield f"{name}: no coordinate system is stated; read as {system}, as Slicer wrote such files"
        if system == "RAS":
            yield f"{name}: coordinates were RAS; converted to LPS (x and y change sign)"
        if self.coordinate_unit != "mm":
            yield f"{name}: coordinates were converted to mm (factor {LENGTHS_MM[self.coordinate_unit]:g})"
        for remark in self.remarks:
            yield f"{name}: {remark}"
        if self.changed:
            yield f"{name}: the fiducials are no longer those of the file: they were moved, or some were left out"


WAYS_OF_HOLDING = ("tolerances", "locators", "locator_files", "features", "drawing")


class SeatDrawing(Record):
    """A STEP file whose tolerances (AP242) state a seat: a flat face and two dowel holes."""

    file: _FileName = Field(examples=["carrier.step"])
    """STEP file beside the design (relative path)."""
    pin_class: Annotated[str, Field(min_length=2, max_length=6)] = Field(examples=["g6"])
    """Class of ISO 286 of the pins that go into its holes."""
    frame: Annotated[str, Field(min_length=1, max_length=200)] | None = Field(default=None, examples=["CONNECTOR"])
    """Coordinate system or part of the file whose frame is con. Default the file's own frame."""


class Interface(Record):
    """A mechanical interface: a known bias and either tolerances, six locators or the features of a drawing."""

    model_config = ConfigDict(json_schema_extra=not_both("tolerances", "locators"))

    label: Annotated[str, Field(max_length=200)] = Field(default="", examples=["two-dowel seat"])
    """What the drawing calls it."""
    pivot_mm: Point = Field(examples=[[0.0, 0.0, -95.0]])
    """Point in con that the displacement is reduced at, mm: rotations turn about it."""
    bias: Bias = Field(default_factory=Bias)
    """Known, fixed displacement. Default none."""
    tolerances: Tolerances | None = None
    """Half-width and law per component. Either this, locators, features or drawing; none means it does not vary."""
    locators: Annotated[list[Locator], Field(min_length=6, max_length=6)] | None = None
    """Six point contacts (3-2-1). Contact i deviates by delta_i along its normal n_i, and the torsor (t, w) at the
    pivot p follows from n_i . (t + w x (p_i - p)) = delta_i."""
    features: Annotated[list[Feature], Field(min_length=1, max_length=12)] | None = None
    """The seat as its drawing states it: pads with flatness, pins with fits, slots, spigots, vees. Together they hold
    six motions, and the torsor follows from what each allows."""
    locator_files: Annotated[list[LocatorFile], Field(min_length=1, max_length=6)] | None = None
    """The six locators, in files beside the design: a contact is called by the label of its point."""
    drawing: SeatDrawing | None = None
    """The features, read from a STEP file beside the design. Absent: as stated here."""
    origin: FiducialOrigin | None = None
    """Only with features that were read from a STEP file: which one, and what of it was read and left. Results note it;
    it changes no number, nor the hash of the design."""
    drawn: HowOften = level_field(Drawn.UNIT, "its tolerances, locators or features")

    _as_before = leave_out_later("drawn", "features", "locator_files", "drawing", "origin")

    _one_way = only_one(*WAYS_OF_HOLDING)

    @model_validator(mode="after")
    def _one_description(self) -> Interface:
        for field in ("locators", "features"):
            refuse_repeated([each.name for each in getattr(self, field) or ()], field, f"{field}/{{}}/name")
        refuse_overheld(self.features or ())
        if self.origin is not None and self.features is None:
            words = "origin belongs to features that were read from a file"
            raise refusal("unused-field", words, "remove origin", "origin")
        return self

    @property
    def contacts(self) -> Iterator[tuple[str, Array, Array]]:
        """Name, place, mm, and normal of each contact that holds it, con."""
        for locator in self.locators or ():
            yield locator.name, np.array(locator.position_mm), np.array(locator.normal, dtype=float)
        for feature in self.features or ():
            for place, normal in feature.contacts:
                yield feature.name, place, normal

    @property
    def is_held(self) -> bool:
        """Whether contacts hold it, so that its pivot only reduces what they do."""
        return self.locators is not None or self.features is not None


class Interfaces(Record):
    """The two interfaces of the chain; one that is absent is perfect."""

    structure_connector: Interface | None = None
    """Seat of the fiducial structure on the connector (T_err1). Absent: perfect."""
    connector_flange: Interface | None = None
    """Connector on the end-effector flange (T_err2). Absent: perfect."""

    @property
    def by_name(self) -> dict[str, Interface]:
        """Those that are there."""
        each = {"structure_connector": self.structure_connector, "connector_flange": self.connector_flange}
        return {name: interface for name, interface in each.items() if interface is not None}


class PosePairs(Record):
    """Where the poses of a hand-eye calibration stand."""

    file: _FileName = Field(examples=["hand_eye.csv"])
    """CSV beside the design: of each pose flange_x_mm, flange_y_mm, flange_z_mm, flange_qw, flange_qx, flange_qy,
    flange_qz (in the robot's base), and the same of tool_ (in the tracker). Not in a request, which has their
    covariance."""


class HandEye(Record):
    """Error of the calibrated transform to the tool, acting in the tcp frame."""

    pivot_mm: Point = Field(default=(0.0, 0.0, 0.0), examples=[[0, 0, 0]])
    """Reduction point in the tcp frame, mm. Default its origin."""
    bias: Annotated[Bias, KNOWN_HAND_EYE_DEG, KNOWN_HAND_EYE_MM] = Field(default_factory=Bias)
    """Known, fixed part. Default none."""
    tolerances: Annotated[Tolerances, HAND_EYE_DEG, HAND_EYE_MM] = Field(default_factory=Tolerances)
    """Half-width and law per component."""
    pose_pairs: PosePairs | None = None
    """The poses that it was calibrated by, which are read into pivot_mm and tolerances."""
    origin: FiducialOrigin | None = None
    """The file of poses that tolerances were read from. Absent: they were written here."""
    drawn: HowOften = level_field(Drawn.UNIT)

    _as_before = leave_out_later("drawn", "pose_pairs")

    @model_validator(mode="after")
    def _stated_once(self) -> HandEye:
        given = [name for name in ("pivot_mm", "tolerances") if name in self.model_fields_set]
        if self.pose_pairs is not None and given:
            raise refusal("one-of", f"pose_pairs state {given[0]}, which arrived beside them", "keep one", given[0])
        return self


class Repeatability(Record):
    """Scatter of the robot's positioning, per axis of the tcp frame."""

    model_config, _one_size = exactly_one("std_mm", "half_width_mm", needed="std_mm: 0.02")

    std_mm: Annotated[HalfWidth | HalfWidths | None, SCATTER_MM] = Field(default=None, examples=[0.02])
    """Standard deviation of a normal law, mm: one number for the three axes, or [x, y, z]. Either this or
    half_width_mm."""
    half_width_mm: Annotated[HalfWidth | HalfWidths | None, SCATTER_MM] = Field(default=None, examples=[0.05])
    """Half-width, mm: one number for the three axes, or [x, y, z]."""
    distribution: RandomLaw | None = Field(
        default=None, description=LAW_WORDS + ". Required with half_width_mm.", examples=["normal"]
    )
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[3.0])

    @model_validator(mode="after")
    def _std_is_of_a_law(self) -> Repeatability:
        for field in ("distribution", "coverage_factor"):
            if self.std_mm is not None and getattr(self, field) is not None:
                raise refusal("unused-field", f"std_mm already means a normal law; {field} says more", at=field)
        return self

    _law = with_law("half_width_mm", "normal")


PASSIVE_ROUNDING = 1e-3  # of the largest entry of a compliance: what three digits in a document leave


def _check_passive(rows: Sequence[Sequence[float]]) -> None:
    """Refuse a compliance (3, 3), mm/N, that is not symmetric or not positive semidefinite within rounding.

    A passive structure has no other: it is symmetric (Maxwell and Betti), and no push moves it against itself.
    """
    matrix = np.array(rows)
    scale = float(np.abs(matrix).max())
    gaps = np.abs(matrix - matrix.T)
    mean = (matrix + matrix.T) / 2
    values, axes = np.linalg.eigh(mean)
    if gaps.max() > PASSIVE_ROUNDING * scale:
        i, j = (int(k) for k in np.unravel_index(gaps.argmax(), gaps.shape))
        halves = [np.triu(matrix), np.tril(matrix)]
        half = next((each for each in halves if np.array_equal(each, matrix)), None)
        whole = mean if half is None else half + half.T - np.diag(np.diag(half))
        what = "the mean of the two is" if half is None else "with both of its halves it is"
        cure = "check the signs and the order of its entries"
        if np.linalg.eigvalsh(whole)[0] >= -PASSIVE_ROUNDING * scale:
            cure = f"{what} matrix_mm_per_n: {write_value(whole.tolist(), 6)}"
        first, second = (f"row {row + 1}, column {column + 1}" for row, column in ((i, j), (j, i)))
        detail = f"a compliance is symmetric; {first} is {matrix[i, j]:g}, {second} {matrix[j, i]:g}"
        raise refusal("not-symmetric", detail, cure, "matrix_mm_per_n")
    if values[0] < -PASSIVE_ROUNDING * scale or np.diag(matrix).min() < 0:
        axis = axes[:, 0] * (1 if axes[np.abs(axes[:, 0]).argmax(), 0] > 0 else -1)
        along = ", ".join(f"{each + 0.0:.3g}" for each in axis.round(3))
        cure = "a deflection goes with the force: check the signs"
        if values[-1] <= PASSIVE_ROUNDING * scale:
            cure = f"a deflection goes with the force: matrix_mm_per_n: {write_value((-mean).tolist(), 6)}"
        elif np.diag(matrix).min() >= 0:
            i, j = max(((i, j) for i in range(3) for j in range(i)), key=lambda pair: _excess(matrix, *pair))
            most = float(np.sqrt(matrix[i, i] * matrix[j, j]))
            cure = f"between {'xyz'[j]} and {'xyz'[i]} it is at most {most:g}, the geometric mean of its two diagonals"
        detail = (
            f"a compliance has no negative eigenvalue; along [{along}] it is {min(values[0], 0):.4g} mm/N: what is "
            "pushed there would move against the force"
        )
        raise refusal("not-passive", detail, cure, "matrix_mm_per_n")


def _excess(matrix: Array, i: int, j: int) -> float:
    return float(abs(matrix[i, j]) - np.sqrt(matrix[i, i] * matrix[j, j]))


class Compliance(Record):
    """Elastic deflection of the tool under a load: d = C f, in the tcp frame."""

    matrix_mm_per_n: Annotated[Rotation3, COMPLIANCE] = Field(examples=[[[0.002, 0, 0], [0, 0.002, 0], [0, 0, 0.0005]]])
    """Compliance C, row by row: deflection in mm per newton, tcp frame. Symmetric, no eigenvalue below zero."""
    load_n: Annotated[Force, LOAD_N] = Field(default=(0.0, 0.0, 0.0), examples=[[0.0, 0.0, -8.0]])
    """Nominal load in newtons, tcp frame. Its deflection is a known bias. Default none."""
    load_half_width_n: Annotated[HalfWidth | HalfWidths | None, LOAD_HALF_WIDTH_N] = Field(default=None, examples=[2.0])
    """Half-width of the load about its nominal value, N: one number or [x, y, z]. Absent: it is constant."""
    distribution: AnyLaw | None = Field(
        default=None, description=BOUNDED_WORDS + " Required with load_half_width_n.", examples=["uniform"]
    )
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[2.0])

    @model_validator(mode="after")
    def _passive(self) -> Compliance:
        _check_passive(self.matrix_mm_per_n)
        return self

    _law = with_law("load_half_width_n")


@with_sections("execution", "drawn")
class Execution(Record):
    """What happens between the navigated position and the tool."""

    repeatability: Repeatability | None = None
    """Positioning scatter. Absent: none."""
    hand_eye: HandEye | None = None
    """Hand-eye calibration error. Absent: none."""
    compliance: Compliance | None = None
    """Deflection under load. Absent: rigid."""
    drawn: HowOften = level_field(Drawn.SHOT, "what repeatability and load add")


SCHEMA_NAME = "tailstack/design/1"
_Side = Annotated[float, Field(ge=0, le=1e5), EXTENT_MM]
_Sides = Annotated[tuple[_Side, _Side, _Side], Field(strict=False), EXTENT_MM]
_Count = Annotated[int, Field(ge=1, le=20), COUNT]
_Counts = Annotated[tuple[_Count, _Count, _Count], Field(strict=False)]
LossProbability = Annotated[float, Field(ge=0, lt=1), SHARE]


class FiducialPoint(Record):
    """One fiducial."""

    label: Name | None = Field(default=None, examples=["F1"])
    """Name; default F1, F2, ... by position in the list."""
    position_mm: Annotated[Point, AnySize("structure-size judges all of them together")] = Field(
        examples=[[-40.0, 30.0, -60.0]]
    )
    """Nominal position in con, mm."""
    loss_probability: LossProbability | None = Field(default=None, examples=[0.02])
    """Of this fiducial, instead of the fiducials' loss_probability."""

    _as_before = leave_out_later("loss_probability")


class Manufacturing(Record):
    """How far each fiducial may sit from its nominal position, per coordinate, independently."""

    half_width_mm: Annotated[HalfWidth | HalfWidths, BEAD_PLACE_MM] = Field(examples=[0.05])
    """Half-width, mm: one number for the three axes, or [x, y, z]."""
    distribution: RandomLaw = Field(description=LAW_WORDS + ".", examples=["uniform"])
    coverage_factor: CoverageFactor | None = Field(default=None, description=COVERAGE_WORDS, examples=[2.0])
    drawn: HowOften = level_field(Drawn.UNIT)

    _as_before = leave_out_later("drawn")
    _law = with_law("half_width_mm")


class NamedPoint(Record):
    """A point of a file, by name, and where it is in con."""

    label: Name = Field(examples=["F1"])
    """Its label in the file."""
    position_mm: Point = Field(examples=[[-40.0, 30.0, -60.0]])
    """Where CAD has it, con, mm."""


@with_sections("fiducials", "loss_probability", "T_con_file", "registered_to")
class Fiducials(Record):
    """The fiducials of the structure, in the document or in a file beside it."""

    model_config, _one_list = exactly_one("points", "file")

    points: Annotated[list[FiducialPoint], Field(min_length=1)] | None = None
    """The fiducials, at least six (four for pose and pose_with_prior). Either this or file."""
    file: _FileName | None = Field(default=None, examples=["fiducials/demo.csv"])
    """Fiducial file beside the design (relative path): .csv with units in the header (label,x_mm,y_mm,z_mm), 3D Slicer
    .mrk.json or .fcsv. RAS coordinates are converted to LPS."""
    T_con_file: Transform | None = None
    """With file: maps its coordinates (LPS, mm) to con. 4x4 matrix (mm) or rotation and translation_mm. Default
    identity."""
    registered_to: Annotated[list[NamedPoint], Field(min_length=3, max_length=1000)] | None = None
    """With file, instead of T_con_file: points of it, by label, and where they are in con, three or more, not on one
    line. All of the file is carried by the motion that brings these nearest; results say what is left between them."""
    origin: FiducialOrigin | None = None
    """Only with points that were read from a fiducial file: which one, and what was done to them. Results note it; it
    changes no number, nor the hash of the design."""
    manufacturing: Manufacturing | None = None
    """Manufacturing tolerance of the fiducials' positions. Absent: perfect."""
    diameter_mm: Length | None = None  # whole in effects/ball_images.py; here for its place among the others
    loss_probability: LossProbability | None = Field(default=None, examples=[0.01])
    """Probability that a fiducial is missed in a shot, in all its views, independently of the others: 0.01 is one shot
    in a hundred. The score adds the quantile over shots with and without losses; simulations draw them. Absent or 0:
    none is missed."""

    @model_validator(mode="after")
    def _origin_of_points(self) -> Fiducials:
        if self.file is not None and self.origin is not None:
            words = "origin belongs to points that were read from a file; here the file itself is named"
            raise refusal("unused-field", words, "remove origin", "origin")
        frames = [name for name in ("T_con_file", "registered_to") if getattr(self, name) is not None]
        if frames and self.file is None:
            words = "points of the document are in con; only those of a file are carried there"
            raise refusal("unused-field", words, f"remove {frames[0]}", frames[0])
        return self

    _one_frame = only_one("T_con_file", "registered_to")


class Transforms(Record):
    """From the connector to the tool; each is rigid and the identity when absent."""

    T_flange_con: Transform | None = None
    """Maps con coordinates to the flange frame. 4x4 matrix (mm) or rotation and translation_mm."""
    T_tcp_flange: Transform | None = None
    """Maps flange coordinates to the tcp frame. 4x4 matrix (mm) or rotation and translation_mm."""


class Box(Record):
    """A grid of targets in an axis-parallel box."""

    centre_mm: Annotated[Point, TARGET_MM] = Field(examples=[[0.0, 0.0, 60.0]])
    """Centre in con, mm."""
    size_mm: _Sides = Field(examples=[[30.0, 20.0, 10.0]])
    """Full edge lengths along x, y, z, mm."""
    points_per_axis: _Count | _Counts = Field(default=2, examples=[2])
    """Grid points along each axis, ends included; 1 is the centre. Default 2: the corners."""


class Sphere(Record):
    """A ball sampled by its centre, its 6 axis points and 8 diagonal points."""

    centre_mm: Annotated[Point, TARGET_MM] = Field(examples=[[0.0, 0.0, 60.0]])
    """Centre in con, mm."""
    radius_mm: Annotated[Length, EXTENT_MM] = Field(examples=[10.0])
    """Radius, mm."""


class Region(Record):
    """A target region, by exactly one shape."""

    model_config, _one_shape = exactly_one("box", "sphere")

    box: Box | None = None
    """Axis-parallel box."""
    sphere: Sphere | None = None
    """Ball."""


class TargetDocument(Record):
    """A target point, or a region that is expanded to points called name[0], name[1], ..."""

    model_config, _one_place = exactly_one("position_mm", "region")

    name: Name = Field(examples=["tip"])
    """Name, unique."""
    position_mm: Annotated[Point | None, TARGET_MM] = Field(default=None, examples=[[0.0, 0.0, 70.0]])
    """Position in con, mm. Either this or region."""
    region: Region | None = None
    """Target region in con."""
    direction: Direction | None = Field(default=None, examples=[[0.0, 0.0, -1.0]])
    """Direction in which an instrument comes to the point, in con; any length. The errors lateral and axial are across
    and along it."""
    entry: Name | None = Field(default=None, examples=["entry"])
    """Name of the target through which an instrument comes to this one, in place of direction: the two are a straight
    trajectory, and the error angle is between it as planned and as executed. Both ends share the resection of the
    views, the seats, repeatability and load; the noise of their images is drawn for each."""
    ends: Literal["one_shot", "two_shots"] = Field(default="one_shot", examples=["one_shot"])
    """With entry. one_shot: both ends are of the same images and of one pose of the tool. two_shots: each has images
    and a pose of its own, and all that is drawn at each shot is drawn for each. Default one_shot."""
    corridor_mm: Annotated[Length, LIMIT_MM] | None = Field(default=None, examples=[1.5])
    """With entry: radius about the planned trajectory within which the axis of the instrument has to stay, that of the
    channel less that of the instrument, mm. It is counted how often an end of the executed axis is beyond it, and by
    more than 2, 4 and 6 mm."""
    corridor_entry_mm: Annotated[Length, LIMIT_MM] | None = Field(default=None, examples=[3.0])
    """Of a cone: the same radius where the instrument enters, mm. Default corridor_mm, a cylinder."""
    corridor_major_mm: Annotated[Length, LIMIT_MM] | None = Field(default=None, examples=[3.0])
    """Of an elliptic channel: its larger half-axis, mm; corridor_mm is the smaller one. Beyond it by so much is outside
    of half-axes that are both longer by that."""
    corridor_major_direction: Direction | None = Field(default=None, examples=[[0.0, 0.0, 1.0]])
    """Required beside corridor_major_mm: in which direction the larger half-axis lies, in con; what of it is along the
    trajectory does not count."""

    @model_validator(mode="after")
    def _trajectory(self) -> TargetDocument:
        for name, unused in (("corridor_mm", None), ("ends", "one_shot")):
            if getattr(self, name) != unused and self.entry is None:
                raise refusal("unused-field", f"{name} is read only beside entry: NAME", at=name)
        for name in ("corridor_entry_mm", "corridor_major_mm", "corridor_major_direction"):
            if getattr(self, name) is not None and self.corridor_mm is None:
                raise refusal("unused-field", f"{name} is read only beside corridor_mm", at=name)
        if (self.corridor_major_mm is None) != (self.corridor_major_direction is None):
            left = "corridor_major_mm" if self.corridor_major_mm is None else "corridor_major_direction"
            raise refusal("missing-field", "corridor_major_mm and corridor_major_direction go together", f"add {left}")
        if self.corridor_major_mm is not None and self.corridor_major_mm < (self.corridor_mm or 0.0):
            detail = f"corridor_major_mm is {self.corridor_major_mm:g}, less than corridor_mm, {self.corridor_mm:g}"
            raise refusal("out-of-range", detail, "the larger half-axis is corridor_major_mm", "corridor_major_mm")
        stated = [name for name in ("direction", "entry") if getattr(self, name) is not None]
        if stated and (self.region is not None or len(stated) > 1):
            detail = "beside position_mm stands direction or entry, beside region neither"
            raise refusal("unused-field", detail, at=stated[0])
        return self

    _as_before = leave_out_later("corridor_entry_mm", "corridor_major_mm", "corridor_major_direction", "ends")


class TargetFile(PointFile):
    """Targets in a file beside the design."""

    line: Name | None = Field(default=None, examples=["L4 left"])
    """The file is a line of that name: its last point is a target called so, its first one the target through which an
    instrument comes there, called NAME entry."""
    pairs: bool = Field(default=False, examples=[True])
    """true: its points go two by two, the one through which an instrument comes and the one where it ends, each a
    target called by its label. Default false: each point is a target by itself."""
    corridor_mm: Annotated[Length, LIMIT_MM] | None = Field(default=None, examples=[1.5])
    """With line or pairs: corridor_mm of its trajectories. Absent: none."""

    @model_validator(mode="after")
    def _trajectories(self) -> TargetFile:
        if self.line is not None and self.pairs:
            raise refusal("one-of", "a file is one line or holds pairs; line and pairs arrived", KEEP_ONE, "pairs")
        if self.corridor_mm is not None and self.line is None and not self.pairs:
            raise refusal("unused-field", "corridor_mm is read only beside line or pairs", at="corridor_mm")
        return self


class RigidBody(Record):
    """A rigid body that is known by targets: an implant or a bone by its markers."""

    name: Name = Field(examples=["implant"])
    """Name, unique among targets and bodies."""
    targets: Annotated[list[Name], Field(min_length=3)] = Field(examples=[["m1", "m2", "m3"]])
    """Names of three targets or more with position_mm, not on one line."""
    against: Name | None = Field(default=None, examples=["bone"])
    """Name of another body: errors are those of the motion against it. Absent: against the frame tcp."""


RequirementId = Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[A-Za-z0-9][A-Za-z0-9._:/#+-]*$")]


class RequirementDocument(Record):
    """What the design promises."""

    model_config = ConfigDict(
        json_schema_extra={"oneOf": [{"required": [name]} for name in dict.fromkeys(m.limit_field for m in STATED)]}
    )
    name: Name = Field(examples=["tip-accuracy"])
    """Name, unique."""
    error: StatedName = Field(
        default="tcp",
        description=" ".join(f"{measure.name}: {measure.meaning}." for measure in STATED),
        examples=["tcp"],
        json_schema_extra={"x-limited-by": {measure.name: measure.limit_field for measure in STATED}},
    )
    side: Literal["above", "below"] | None = Field(default=None, examples=["above"])
    """Of axial, x, y, z and localisation_x, y, z: what counts. above: above zero (of axial, too deep); below: below
    zero; a known part counts with its sign. Default both."""
    statistic: StatisticName = Field(
        default="quantile",
        description="What is limited. " + " ".join(f"{row.name}: {row.meaning}." for row in STATISTICS),
        examples=["quantile"],
    )
    quantile: Annotated[float, Field(ge=0.5, le=0.9999), LEVEL] = Field(default=0.95, examples=[0.95])
    """Quantile of the error's norm that is limited; of cvar, where the tail begins. Default 0.95."""
    limit_mm: Annotated[Length, LIMIT_MM] | None = Field(default=None, examples=[2.0])
    """The statistic must not exceed this, mm; of probability, the error beyond which shots are counted."""
    limit_deg: Annotated[float, Field(ge=1e-6, le=180), LIMIT_DEG] | None = Field(default=None, examples=[2.0])
    """The same of an angle, deg, in place of limit_mm."""
    limit_probability: Annotated[float, Field(ge=0.0001, le=0.5), LEVEL] | None = Field(default=None, examples=[0.01])
    """probability only, required there: probability of an error beyond the limit that is allowed."""
    n: Annotated[int, Field(ge=2, le=5000), AnySize("as many shots as somebody counts")] | None = Field(
        default=None, examples=[20]
    )
    """max_of_n only, required there: number of independent shots."""
    ids: Annotated[list[RequirementId], Field(max_length=20)] = Field(default=[], examples=[["SRS-014"]])
    """What it is called in a system of requirements, each once; every result, report and gate repeats it. Letters,
    digits and . _ : / # + -, without blanks. No number depends on it. Default none."""
    confidence: Annotated[float, Field(ge=0.5, le=0.9999), LEVEL] = Field(default=0.95, examples=[0.95])
    """Confidence of the interval the Monte Carlo verdict is taken from. Default 0.95."""
    targets: Literal["all"] | Annotated[list[Name], Field(min_length=1)] = Field(default="all", examples=["all"])
    """all, or a list of names of targets, regions and bodies. Default all."""
    risk: RiskName = Field(default="pooled", examples=["pooled"])
    """pooled: over installed units and shots together. per_unit: each unit on its own, over its mountings and shots;
    per_mounting: each mounting on its own, over its shots; see min_yield."""
    min_yield: Annotated[float, Field(gt=0, lt=1), YIELD] | None = Field(default=None, examples=[0.95])
    """Required unless the risk is pooled: fraction of installed units, or of mountings, whose own quantile meets the
    limit."""

    @model_validator(mode="after")
    def _yield(self) -> RequirementDocument:
        if self.risk == "pooled" and self.min_yield is not None:
            risks = " or ".join(RISKS[1:])
            raise refusal("unused-field", f"min_yield is read only with risk: {risks}", at="min_yield")
        if self.risk != "pooled" and self.min_yield is None:
            raise refusal("missing-field", f"risk: {self.risk} needs min_yield", "min_yield: 0.95")
        if self.risk != "pooled" and not STATISTIC[self.statistic].by_quantile:
            each = self.risk.removeprefix("per_")
            detail = f"each {each} has a limit on its own quantile; the {self.statistic} is over all {each}s together"
            hint = "statistic: quantile, probability or max_of_n, or risk: pooled"
            raise refusal("unused-field", detail, hint, at="risk")
        return self

    @model_validator(mode="after")
    def _statistic(self) -> RequirementDocument:
        row = STATISTIC[self.statistic]
        for name, example in (("limit_probability", 0.01), ("n", 20)):
            if name in row.needs and getattr(self, name) is None:
                raise refusal("missing-field", f"statistic: {row.name} needs {name}", f"{name}: {example}")
        for name in ("quantile", "limit_probability", "n"):
            if name not in row.needs + row.reads and getattr(self, name) != type(self).model_fields[name].default:
                raise refusal("unused-field", f"statistic: {row.name} does not read {name}", at=name)
        if (level := self.pooled_quantile) > HIGHEST:
            detail = f"P{100 * self.quantile:g} of the largest of {self.n} shots is P{100 * level:.7g} of one"
            raise refusal("out-of-range", detail, f"a quantile of one shot is at most {HIGHEST:g}: lower n", at="n")
        return self

    @model_validator(mode="after")
    def _limit(self) -> RequirementDocument:
        if self.measure not in MEASURE:
            each = ", ".join(name.removesuffix("_above") for name in MEASURE if name.endswith("_above"))
            detail = f"side is read only with error: {each}; the size of {self.error} has no sign"
            raise refusal("unused-field", detail, at="side")
        own = MEASURE[self.error].limit_field
        for name in ("limit_mm", "limit_deg"):
            if name != own and getattr(self, name) is not None:
                raise refusal("unused-field", f"{self.error} is limited by {own}", at=name)
        if getattr(self, own) is None:
            raise refusal("missing-field", f"a requirement on {self.error} needs {own}", f"{own}: 1")
        return self

    @property
    def pooled_quantile(self) -> float:
        """The quantile of one shot's error that is asked for."""
        return pooled_quantile(self.quantile, self.limit_probability, self.n)

    _as_before = leave_out_later("side", "statistic", "limit_probability", "n", "ids")

    @property
    def measure(self) -> str:
        """Name of the measure that is limited."""
        return self.error if self.side is None else f"{self.error}_{self.side}"

    @property
    def limit(self) -> float:
        """In the unit of the measure."""
        value: float = getattr(self, MEASURE[self.error].limit_field)
        return value


class Model(Record):
    """Choices of the model; the defaults are what a real structure does."""

    installation_reading: Annotated[Reading, one_of(Reading)] = Field(default=Reading.PHYSICAL, examples=["physical"])
    """physical: an installation error moves the structure and its images. eq18: it moves the coordinates the estimator
    assumes (Eq 18 of the paper). Default physical."""
    rotation: Annotated[RotationForm, one_of(RotationForm)] = Field(default=RotationForm.FULL, examples=["full"])
    """full: Rx Ry Rz. small_angle: I + [w]x. Default full."""
    estimator: Annotated[Estimator, one_of(Estimator)] = Field(default=DEFAULT_ESTIMATOR, examples=["pose"])
    """What a view is estimated as from its fiducials. dlt: eleven unknowns by linear equations, nothing known
    beforehand. reprojection: the same eleven by least squares of the images. pose: position and orientation, the
    intrinsics taken for exact. pose_with_prior: focal length and principal point too, known as well as intrinsics_prior
    says. Default dlt."""
    triangulation: Annotated[Triangulation, one_of(Triangulation)] = Field(
        default=Triangulation.NORMALISED, examples=["normalised"]
    )
    """normalised: linear, in the fiducials' Hartley frame. published: linear, in plain con mm. weighted: as normalised,
    each view weighted by how well its noise lets it know the target. reprojection: least squares of the target's
    images. Default normalised."""

    _as_before = leave_out_later("estimator")


_Entry = Annotated[str, Field(max_length=80, pattern=r"^[^\x00-\x1f\x7f]*$")]


class DocumentTitle(Record):
    """Under which number the design is kept, and who answers for it; reports show it, and boxes to sign what is empty.

    No number depends on it.
    """

    number: _Entry = Field(default="", examples=["DG-1042"])
    """Number of the document."""
    revision: _Entry = Field(default="", examples=["C"])
    """Its revision."""
    date: Annotated[str, Field(pattern=r"^\d{4}-\d{2}-\d{2}$")] | None = Field(default=None, examples=["2026-11-28"])
    """Day of the revision, YYYY-MM-DD."""
    author: _Entry = Field(default="", examples=["M. Keller"])
    """Who made it."""
    checker: _Entry = Field(default="", examples=["A. Okafor"])
    """Who checked it."""
    approver: _Entry = Field(default="", examples=["L. Brandt"])
    """Who releases it."""

    @model_validator(mode="after")
    def _is_day(self) -> DocumentTitle:
        try:
            date.fromisoformat(self.date or "2000-01-01")
        except ValueError:
            raise refusal("bad-text", f"{self.date} is no day of the calendar", "YYYY-MM-DD", "date") from None
        return self


@with_sections("design", "document", "assumed", "bodies", "target_files", "target_origins", "review")
class _Design(Record):
    """A reference structure on a robot, seen by two or more X-ray views."""

    schema_: Literal["tailstack/design/1"] = Field(alias="schema", examples=["tailstack/design/1"])
    """Version of this document."""
    name: Name = Field(examples=["drill-guide reference, rev C"])
    """Name of the design."""
    description: Annotated[str, Field(max_length=4000)] = Field(
        default="", examples=["12 beads of 3 mm on a PEEK carrier"]
    )
    """Free text."""
    document: DocumentTitle | None = None
    """Title block of the reports: number, revision, date, author, checker, approver. No number depends on it. Absent:
    reports have empty boxes."""
    views: Annotated[list[ViewDocument], Field(min_length=2)]
    """The X-ray views, two or more."""
    fiducials: Fiducials
    """The fiducials the views are resected from."""
    interfaces: Interfaces = Field(default_factory=share(Interfaces.model_construct()))
    """Installation errors. Absent: both interfaces are perfect."""
    transforms: Transforms = Field(default_factory=share(Transforms.model_construct()))
    """From the connector to the tool. Absent: identity."""
    execution: Execution = Field(default_factory=share(Execution.model_construct()))
    """Errors of the robot and the tool. Absent: none."""


class DesignDocument(_Design):
    """A reference structure on a robot, seen by two or more X-ray views."""

    model_config = ConfigDict(
        json_schema_extra={
            "anyOf": [
                {"properties": {"targets": {"minItems": 1, "description": "One or more without target_files."}}},
                {"required": ["target_files"]},
            ]
        }
    )

    targets: list[TargetDocument]
    """Where the tool has to go: named points or regions, in con; one or more with target_files."""
    target_files: Annotated[list[TargetFile], Field(min_length=1, max_length=200)] | None = None
    """More targets, in files beside the design. Absent: none."""
    target_origins: list[FiducialOrigin] | None = None
    """Only with targets or locators that were read from files: which, and what was done to their points. Results note
    it; it changes no number, nor the hash of the design."""
    bodies: list[RigidBody] = Field(default=[])
    """Rigid bodies, each a cluster of targets, of which rotation and translation are told."""
    requirements: list[RequirementDocument] = Field(default=[])
    """What is promised. Default nothing."""
    model: Model = Field(default_factory=share(Model.model_construct()))
    """Choices of the model."""
    optimise: Optimise | None = None
    """Freedom of the optimiser. Absent: it refuses."""
    assumed: Annotated[list[Annotated[str, Field(max_length=400)]], Field(max_length=1000)] = Field(
        default=[], examples=[["/interfaces", "/views/0/fiducial_noise_px"]]
    )
    """What nobody stated: JSON pointers into this document. One to a mapping, or to a list of mappings, covers every
    number below it. A verdict says on how many assumed values it rests; who knows a value takes its pointer off. No
    number depends on it. Default none."""
    review: Review | None = None
    """Earlier versions by name, and comments pinned to fiducials or lines of the budget. Reports list them; they change
    no number, nor the hash of the design. Absent: none."""

    @model_validator(mode="after")
    def _has_a_target(self) -> DesignDocument:
        files = self.point_files
        if files and self.target_origins is not None:
            words = "target_origins belongs to points that were read from files; here the files themselves are named"
            raise refusal("unused-field", words, "remove target_origins", "target_origins")
        if not self.targets and self.target_files is None:
            raise refusal("too-short", "needs at least 1 entry; got an empty list", "name a target", "targets")
        for at, each in files.items() if self.fiducials.file is None else ():
            if each.as_fiducials:
                detail = "the fiducials are in con already, and came from no file"
                raise refusal("unused-field", detail, "state T_con_file here", f"{at[1:]}/as_fiducials")
        return self

    @property
    def point_files(self) -> dict[str, TargetFile | LocatorFile]:
        """By pointer: files of targets, and of the locators of either interface."""
        files = {f"/target_files/{index}": each for index, each in enumerate(self.target_files or ())}
        return files | {
            f"/interfaces/{name}/locator_files/{index}": each
            for name, interface in self.interfaces.by_name.items()
            for index, each in enumerate(interface.locator_files or ())
        }


SCHEMA_ID = "urn:tailstack:schema:design:1"


def design_json_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of ``tailstack/design/1``; every field with description, unit, default and example.

    An optional field is left out rather than null, so the null alternatives that pydantic writes are dropped.
    Rules across fields (unique names, references, coverage factors) are in the descriptions.
    """
    schema = without_null(DesignDocument.model_json_schema(by_alias=True))
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": SCHEMA_ID,
        "title": "tailstack design, version 1",
        "description": "A reference structure on a robot, seen by two or more X-ray views. Lengths in mm, angles in "
        "degrees, images in px: the unit is in every field name. Frames: con (connector: fiducials, targets, "
        "interface pivots, views; LPS), flange, tcp. T_ab maps coordinates in b to coordinates in a. Tolerances are "
        "half-widths. Unknown fields, NaN and infinities are refused.",
    }
    return {**head, **{key: value for key, value in schema.items() if key not in head}}


def without_null(node: Any) -> Any:
    """A schema of pydantic's without the null alternatives: an optional field is left out, not null."""
    if isinstance(node, list):
        return [without_null(item) for item in node]
    if not isinstance(node, dict):
        return node
    node = {key: without_null(value) for key, value in node.items() if not (key == "default" and value is None)}
    options = node.get("anyOf")
    if isinstance(options, list) and {"type": "null"} in options:
        rest = [option for option in options if option != {"type": "null"}]
        del node["anyOf"]
        node = {**(rest[0] if len(rest) == 1 else {"anyOf": rest}), **node}
    return node

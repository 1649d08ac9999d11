"""Views from the headers of C-arm images: DICOM files.

Read are the tags of ``TAGS`` and nothing else: no pixel and nothing of the patient, not even into a message.

Axes of con are taken along the patient's: x to the left, y to the back, z to the head (LPS, PS3.3 C.7.6.2.1.1).
PS3.3 C.8.7.5.1.2 defines the angles like longitude and latitude about the isocentre: zero is before the chest, +90
degrees of PositionerPrimaryAngle (a) is the patient's left (LAO), +90 of PositionerSecondaryAngle (b) is the head
(cranial).  There the detector stands, in the direction ``(sin a cos b, -cos a cos b, sin b)`` from the isocentre, and
the beam runs that way.  Up in the image is where the detector goes as b grows, ``(-sin a sin b, cos a sin b, cos b)``,
turned by FieldOfViewRotation: clockwise, for who looks from the detector towards the source (as in C.8.19.6.13.1.2).
DistanceSourceToPatient ends at the isocentre (C.8.7.5); ImagerPixelSpacing is that at the detector.
A view counts columns for who looks along the beam: in an image that is not flipped (FieldOfViewHorizontalFlip) they run
the other way, ``Columns - 1 - u``.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from io import BytesIO
from math import cos, isfinite, radians, sin
from typing import Any

from ..design.loading import ASSUMED, Design, follow_changes, load_design
from ..design.reading import DEFAULT_LIMITS, DOCUMENTS, Limits
from ..design.write import design_to_data
from ..errors import DesignError, Problem
from ..extras import name_missing_extra
from ..results import Vector3
from .conversion import IMAGES, ConvertedFile, write_data

# Those without which there is no view: tag, numbers, the field of a view that says the same
NEEDED = {
    "DistanceSourceToDetector": (0x00181110, 1, "source_detector_mm"),
    "DistanceSourceToPatient": (0x00181111, 1, "source_isocentre_mm"),
    "PositionerPrimaryAngle": (0x00181510, 1, "beam_direction"),
    "PositionerSecondaryAngle": (0x00181511, 1, "beam_direction"),
    "ImagerPixelSpacing": (0x00181164, 2, "pixel_mm"),
    "Rows": (0x00280010, 1, "image_size_px"),
    "Columns": (0x00280011, 1, "image_size_px"),
}
BESIDE = {
    "SOPClassUID": 0x00080016,
    "TableMotion": 0x00181134,
    "FieldOfViewShape": 0x00181147,
    "FieldOfViewDimensions": 0x00181149,
    "PositionerMotion": 0x00181500,
    "PositionerType": 0x00181508,
    "DetectorPrimaryAngle": 0x00181530,
    "DetectorSecondaryAngle": 0x00181531,
    "FieldOfViewRotation": 0x00187032,
    "FieldOfViewHorizontalFlip": 0x00187034,
}
TAGS = {**{name: tag for name, (tag, _, _) in NEEDED.items()}, **BESIDE}
DEFLATED = b"1.2.840.10008.1.2.1.99"  # the transfer syntax whose header is compressed: small files of any length
ENHANCED = ("1.2.840.10008.5.1.4.1.1.12.1.1", "1.2.840.10008.5.1.4.1.1.12.2.1", "1.2.840.10008.5.1.4.1.1.13.1.1")
START_NOISE_PX = 0.3


@dataclass(frozen=True, slots=True)
class Shot:
    """What the header of one image says of its view."""

    file: str
    primary_deg: float  # of the detector about the patient: towards the left (LAO)
    secondary_deg: float  # towards the head (CRA)
    source_detector_mm: float
    source_isocentre_mm: float
    pixel_mm: float
    image_size_px: tuple[int, int]  # width, height
    image_turn_deg: float  # clockwise, for who looks from the detector
    is_flipped: bool  # columns run as seen from the source
    doubts: tuple[str, ...]  # sentences

    @property
    def seen_mm(self) -> float:
        """How much is seen at the isocentre, across the image where it is narrower."""
        return min(self.image_size_px) * self.pixel_mm * self.source_isocentre_mm / self.source_detector_mm

    @property
    def words(self) -> str:
        """The angles as they are called: LAO 30 CRA 10."""
        across = f"{'RAO' if self.primary_deg < 0 else 'LAO'} {abs(self.primary_deg):g}"
        return f"{across} {'CAU' if self.secondary_deg < 0 else 'CRA'} {abs(self.secondary_deg):g}"

    def aim(self) -> tuple[Vector3, Vector3]:
        """Directions of the beam and of up in the image, con."""
        a, b, turn = map(radians, (self.primary_deg, self.secondary_deg, self.image_turn_deg))
        beam = (sin(a) * cos(b), -cos(a) * cos(b), sin(b))
        upright = (-sin(a) * sin(b), cos(a) * sin(b), cos(b))
        right = (cos(a), sin(a), 0.0)  # in the image, for who looks from the detector
        up = [cos(turn) * one - sin(turn) * other for one, other in zip(upright, right, strict=True)]
        return _tidy(beam), _tidy(up)


def _tidy(direction: Sequence[float]) -> Vector3:
    x, y, z = (round(value, 15) + 0.0 for value in direction)
    return x, y, z


def is_dicom(content: bytes, name: str) -> bool:
    """Whether a file is one, by the ending of its name or, as many have none, by its first bytes."""
    return name.lower().endswith(IMAGES) or content[128:132] == b"DICM"


def read_shot(content: bytes, name: str) -> Shot:
    """The view of one image, from its header, which may be all there is.  Raises DesignError, MissingExtraError."""
    text = _read_tags(content, name)
    if text["SOPClassUID"] in ENHANCED:
        cure = "export it as XA Image (not enhanced), one file for each frame"
        raise _refusal(name, "SOPClassUID is that of an enhanced multi-frame image, with geometry frame by frame", cure)
    missing = [keyword for keyword in NEEDED if not text[keyword]]
    if missing:
        problems: list[Problem] = []
        for keyword in missing:
            cure = f"export with it, or write the view by hand: {NEEDED[keyword][2]}, docs/design.md#geometry-of-a-view"
            problems += _refusal(name, f"{_name_tag(keyword)} is missing", cure).problems
        raise DesignError(problems)
    numbers = {keyword: _read_numbers(text[keyword], keyword, name) for keyword in NEEDED}
    (detector,), (isocentre,) = numbers["DistanceSourceToDetector"], numbers["DistanceSourceToPatient"]
    (primary,), (secondary,) = numbers["PositionerPrimaryAngle"], numbers["PositionerSecondaryAngle"]
    (height,), (width,) = numbers["Rows"], numbers["Columns"]
    between_rows, between_columns = numbers["ImagerPixelSpacing"]
    turn = text["FieldOfViewRotation"] or "0"
    for keyword, holds, rule in (
        ("DistanceSourceToPatient", 0 < isocentre < detector, "is not between 0 and DistanceSourceToDetector"),
        ("PositionerPrimaryAngle", abs(primary) <= 180, "is not within -180 to 180 degrees"),
        ("PositionerSecondaryAngle", abs(secondary) <= 90, "is not within -90 to 90 degrees"),
        ("ImagerPixelSpacing", between_rows > 0 and between_columns > 0, "is not above 0"),
        ("ImagerPixelSpacing", abs(between_rows - between_columns) <= 1e-6 * abs(between_rows),
         "differs along rows and columns: write a view with intrinsics, whose focal_px are two"),
        ("FieldOfViewRotation", turn in ("0", "90", "180", "270"), "is none of 0, 90, 180, 270"),
        ("PositionerType", text["PositionerType"] in ("", "CARM"), "is not CARM, whose angles are those of a view"),
        ("DetectorPrimaryAngle", _is_zero(text["DetectorPrimaryAngle"]), "is not 0: the beam is not normal to it"),
        ("DetectorSecondaryAngle", _is_zero(text["DetectorSecondaryAngle"]), "is not 0: the beam is not normal to it"),
    ):  # fmt: skip
        if not holds:
            raise _refusal(name, f"{_name_tag(keyword)} {rule}", "look at the file, or write the view by hand")
    flipped = text["FieldOfViewHorizontalFlip"] == "YES"
    doubts = tuple(_doubt(text, between_columns * max(width, height)))
    return Shot(
        name, primary, secondary, detector, isocentre, between_columns, (int(width), int(height)), float(turn), flipped,
        doubts,
    )  # fmt: skip


def _read_tags(content: bytes, name: str) -> dict[str, str]:
    """The texts of ``TAGS``, empty where one is missing.  What pydicom says is dropped: it may quote the patient."""
    with name_missing_extra():
        from pydicom import dcmread
        from pydicom.errors import InvalidDicomError
    if DEFLATED in content:
        cure = "write it uncompressed: dcmconv +te IN OUT (DCMTK), or gdcmconv --raw IN OUT"
        raise _refusal(name, "its header is deflated, and could become of any length", cure)
    try:
        with _silence():
            header = dcmread(BytesIO(content), stop_before_pixels=True, specific_tags=list(TAGS.values()))
            items = {keyword: header.get_item(tag) if tag in header else None for keyword, tag in TAGS.items()}
    except InvalidDicomError:
        cure = "give a DICOM file; a bare data set becomes one by dcmconv -f IN OUT (DCMTK)"
        raise _refusal(name, "it does not begin as a DICOM file does: DICM is not at byte 128", cure) from None
    except Exception as error:
        cure = "export it again, or make it whole: dcmconv IN OUT (DCMTK)"
        raise _refusal(name, f"its header is broken ({type(error).__name__})", cure) from None
    return {keyword: _read_text(item, keyword, name) for keyword, item in items.items()}


@contextmanager
def _silence() -> Iterator[None]:
    """Neither warnings nor lines in a log."""
    log = logging.getLogger("pydicom")
    before, log.disabled = log.disabled, True
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        log.disabled = before


def _read_text(item: Any, keyword: str, name: str) -> str:
    """The value of an element as text; empty: it has none."""
    value = getattr(item, "value", None)
    if value is None:
        return ""
    if isinstance(value, bytes) and len(value) <= 400:
        if keyword in ("Rows", "Columns"):
            if len(value) == 2:
                return str(int.from_bytes(value, "little" if item.is_little_endian else "big"))
        elif value.isascii():
            return value.decode("ascii").strip(" \0")
    raise _refusal(name, f"{_name_tag(keyword)} is broken", "export the image again")


def _read_numbers(text: str, keyword: str, name: str) -> list[float]:
    parts, count = text.split("\\"), NEEDED[keyword][1]
    try:
        values = [float(part) for part in parts]
    except ValueError:
        values = []
    if len(values) != count or not all(map(isfinite, values)):
        what = "one number" if count == 1 else "two numbers"
        raise _refusal(name, f"{_name_tag(keyword)} is not {what}", "export the image again")
    return values


def _is_zero(text: str) -> bool:
    try:
        return not text or float(text) == 0
    except ValueError:
        return False


def _doubt(text: dict[str, str], widest_mm: float) -> Iterator[str]:
    """What of a header is to be looked at, in sentences."""
    for keyword, what in (("PositionerMotion", "the C-arm"), ("TableMotion", "the table")):
        if text[keyword] == "DYNAMIC":
            yield f"{what} moved during the run ({keyword} DYNAMIC): the view is that of its first frame"
    try:
        field = max(map(float, text["FieldOfViewDimensions"].split("\\")))
    except ValueError:
        field = widest_mm
    if abs(field - widest_mm) > 2 + 0.02 * widest_mm:
        yield (
            f"FieldOfViewDimensions says {field:g} mm, pixels times ImagerPixelSpacing {widest_mm:.4g} mm: if pixels "
            "were joined or left out after it was written, pixel_mm is wrong"
        )
    if text["FieldOfViewShape"] in ("ROUND", "HEXAGONAL"):
        yield f"FieldOfViewShape is {text['FieldOfViewShape']}: the corners of the image show nothing"


def _name_tag(keyword: str) -> str:
    return f"{keyword} ({TAGS[keyword] >> 16:04X},{TAGS[keyword] & 0xFFFF:04X})"


def _refusal(name: str, detail: str, cure: str) -> DesignError:
    return DesignError(Problem("", "dicom-file", detail, cure, file=name))


def convert_shots(
    files: Sequence[tuple[bytes, str]],
    target_name: str,
    base: Design | Callable[[Sequence[Shot]], Design],
    limits: Limits = DEFAULT_LIMITS,
) -> ConvertedFile:
    """The images (content and name of each) as the views of a design, or of what makes one for them: .yaml or .json.

    Raises DesignError, LimitError, MissingExtraError.
    """
    if not target_name.lower().endswith(DOCUMENTS):
        cure = f"write one of {' '.join(DOCUMENTS)}"
        raise DesignError(Problem("", "unknown-format", "images become a design", cure))
    shots = [read_shot(content, name) for content, name in files]
    if callable(base) and len(shots) < 2:
        raise _refusal(files[0][1], "one image is one view, and a design has two at least", "give the other image, too")
    data, notes = place_shots(base(shots) if callable(base) else base, shots)
    try:
        design = load_design(data, limits=limits)
    except DesignError as error:
        named = {f"/views/{k}": shot.file for k, shot in enumerate(shots)}  # the file that says so
        sources = [named.get("/".join(each.pointer.split("/")[:3])) for each in error.problems]
        placed = [replace(each, file=file) for each, file in zip(error.problems, sources, strict=True)]
        raise DesignError(placed) from None
    return ConvertedFile(write_data(design_to_data(design), design.fiducials, target_name), notes, design.fiducials)


def place_shots(base: Design, shots: Sequence[Shot]) -> tuple[dict[str, Any], tuple[str, ...]]:
    """The design with these as its first views, and sentences: what was read, and what headers do not say.

    What a view says besides its geometry stays; isocentre and noise of one that there was not are a start and assumed.
    """
    old = design_to_data(base)
    views, new, notes = list(old["views"]), [], []
    for k, shot in enumerate(shots):
        before = views[k] if k < len(views) else {}
        start = {"name": f"shot{k + 1}", "isocentre_mm": [0.0, 0.0, 0.0], **dict.fromkeys(NOISE, START_NOISE_PX)}
        kept = {**start, **{field: value for field, value in before.items() if field not in GEOMETRY}}
        new += [f"/views/{k}/{field}" for field in start if field not in before and field != "name"]
        beam, up = shot.aim()
        placed = {
            "name": kept.pop("name"),
            "source_detector_mm": shot.source_detector_mm,
            "source_isocentre_mm": shot.source_isocentre_mm,
            "pixel_mm": shot.pixel_mm,
            "image_size_px": list(shot.image_size_px),
            "beam_direction": list(beam),
            "up_direction": list(up),
        }
        views[k : k + 1] = [placed | kept]
        turned = "" if shot.is_flipped else "; columns of the view run against those of the image"
        notes.append(f"{placed['name']} is {shot.file}: {shot.words}{turned}")
        notes += [f"{shot.file}: {doubt}" for doubt in shot.doubts]
    if len({(shot.pixel_mm, shot.image_size_px) for shot in shots}) > 1:
        notes.append("pixels or sizes of the images differ: are they of one C-arm, and was none of them scaled?")
    if left := [view["name"] for view in views[len(shots) :]]:
        notes.append(f"as in the base: {', '.join(left)}")
    data = follow_changes(old, {**old, "views": views})
    if new:
        data[ASSUMED] = [*data.get(ASSUMED, ()), *new]
    return data, (*notes, *UNKNOWN)


NOISE = ("fiducial_noise_px", "target_noise_px")
GEOMETRY = (  # fields of a view that a header replaces
    "preset", "orientation", "beam_direction", "up_direction", "source_detector_mm", "source_isocentre_mm", "pixel_mm",
    "image_size_px", "principal_point_px", "intrinsics", "pose", "projection",
)  # fmt: skip
UNKNOWN = (
    "con is taken to lie along the patient: x left, y back, z head",
    "headers do not say where the isocentre is in con, nor whether the table moved between shots: correct isocentre_mm",
    "headers do not say where the ray normal to the detector meets it: principal_point_px is the middle of the image",
)

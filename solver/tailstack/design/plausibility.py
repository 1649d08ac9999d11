"""Remarks on values that are allowed and hardly ever meant: a slip of unit, a seat nobody can make, no noise at all.

A design document accepts a wide range, so that no honest design is refused.  Nothing here is refused: each number is
held to the range that stands beside its field (``ranges``), and a few rules look at several numbers together.  Each
says what it met, why it doubts that, and what to do.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, partial
from math import asin, degrees, dist, hypot, pi
from typing import Any, NamedTuple, get_args

import numpy as np
from pydantic import BaseModel

from ..effects import EFFECTS
from ..effects.kind import Doubt, PlausibilityTest
from ..errors import Problem
from ..fields import Pose
from ..geometry.arrays import Array
from ..geometry.camera import camera_centre, image_centre_px
from ..ranges import DETECTOR_MM, ISOCENTRE_MM, NOISE_PX, SLIPS, AnySize, Meant, Range
from ..results import Finding
from ..system import ROTATIONS, System
from ..tables import read_table
from ..tolerances import Bias
from ..units import OTHER_LENGTHS
from .bead_noise import BeadNoise
from .document import DesignDocument, DistanceView, PinholeView, PresetView, Region, TargetDocument
from .frames import find_detector
from .loading import Design
from .meanings import (
    ARMS_MM,
    FARTHEST_MM,
    NEAREST_ISOCENTRE,
    PIVOT_OFF_FLANGE,
    TARGET_OFF_TOOL,
    WrittenPoints,
    doubt_tool,
    find_units_of_points,
    lies_aside,
    read_foot,
    read_isocentre,
    say_meanings,
    state_foot,
    write_numbers,
)
from .presets import PRESETS

BESIDE = "The range beside the field: docs/design.md lists them with their sources."
BEAD_MM = 3.0  # diameter of the beads that localisation noise is quoted for
SMALLEST_STRUCTURE_MM, LARGEST_STRUCTURE_MM = 5 * BEAD_MM, 750.0
WIDEST_CONE, MM_CONE = 0.7, 1.5  # focal length over width of the image; the same of one that is a distance in mm
FARTHEST_ASIDE = 0.45  # of an image, its principal point from its middle
SAME_WIDTH = 0.01  # relative, of two detectors
# A multiple of 30 or 45 degrees, in radians, written with three digits or more: 1.57, 0.785, 3.1416.
TURNS = sorted({k * pi / n for n in (4, 6) for k in range(1, 2 * n + 1)})
SAME_TURN = 6e-4  # relative: 1.57 is nearer to a quarter turn
LAST_SCALAR = 0.99  # of a quaternion: scalar last it is a turn by less than 16 degrees, scalar first nearly half a turn


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """What the rules look at."""

    document: DesignDocument
    fiducials_mm: Array  # (N, 3) con
    system: System | None  # None: its views could not be compiled
    labels: tuple[str, ...]  # of the fiducials


def find_implausible(design: Design, system: System) -> tuple[Finding, ...]:
    """A warning for each value that is doubted, in the order of :data:`PLAUSIBILITY`."""
    doubts = _doubt(Subject(design.document, system.fiducials_mm, system, system.fiducial_labels))
    return tuple(Finding(rule, "warning", met.message, met.pointer, met.value, met.limit) for rule, met in doubts)


def explain_refusal(design: Design, system: System | None = None) -> list[Problem]:
    """Slips of unit, as further problems of a geometry that is refused: they may be why."""
    subject = Subject(design.document, np.array(design.fiducials.positions_mm), system, tuple(design.fiducials.labels))
    return [Problem(met.pointer, rule, met.message) for rule, met in _doubt(subject) if PLAUSIBILITY[rule].slip]


def _doubt(subject: Subject) -> list[tuple[str, Doubt]]:
    """(rule, doubt), in the order of the rules."""
    doubts = [each for number in list_numbers(subject.document) for each in _doubt_range(number)]
    doubts += [(rule.id, met) for rule in _RULES if rule.find for met in rule.find(subject)]
    if (system := subject.system) is not None:
        doubts += [(rule.id, met) for rule in _OF_EFFECTS if rule.find for met in rule.find(system)]
    order = list(PLAUSIBILITY)
    return sorted(doubts, key=lambda each: order.index(each[0]))


# --- the numbers of a document ---------------------------------------------------------------------------


class Number(NamedTuple):
    """A number of a document, or those of a vector or matrix, with its range."""

    pointer: str
    name: str  # as a person calls it: structure_connector rx half_width_deg
    value: Any  # float, or tuples of them
    largest: float  # in size, of all that are judged together with it
    meant: Meant


def find_ranges(annotation: Any, metadata: Any = ()) -> tuple[Range, ...]:
    """The ranges of a type, the nearest to the field last: those that stand outermost in it."""
    notes = [*getattr(annotation, "__metadata__", ()), *metadata]
    own = tuple(note for note in notes if isinstance(note, Meant | AnySize))
    return own or next(filter(None, map(find_ranges, get_args(annotation))), ())


def _holds_records(annotation: Any) -> bool:
    """Whether values of this type are records, or lists of them."""
    own = isinstance(annotation, type) and issubclass(annotation, BaseModel)
    return own or any(map(_holds_records, get_args(annotation)))


@cache
def _list_ranges(record: type[BaseModel]) -> tuple[tuple[str, tuple[Range, ...], bool], ...]:
    """(field, its ranges, whether it holds records) of each field of a record that leads to numbers."""
    fields = [
        (name, find_ranges(field.annotation, field.metadata), _holds_records(field.annotation))
        for name, field in record.model_fields.items()
    ]
    return tuple(each for each in fields if each[1] or each[2])


_UNCALLED = ("interfaces", "transforms", "execution", "tolerances", "rotation_deg", "views", "targets", "points")


def list_numbers(document: DesignDocument) -> list[Number]:
    """Every number of a document that has a plausible range."""
    numbers: list[Number] = []
    _add_numbers(numbers, document, {}, "", "")
    return numbers


def _add_numbers(numbers: list[Number], value: Any, told: Mapping[str, Range], pointer: str, name: str) -> None:
    """Those of a record, or of each of a list.  ``told``: ranges that records above it state, by unit."""
    if isinstance(value, list):
        for index, each in enumerate(value):
            own = getattr(each, "name", None) or getattr(each, "label", None) or str(index + 1)
            _add_numbers(numbers, each, told, f"{pointer}/{index}", f"{name} {own}".strip())
        return
    if not isinstance(value, BaseModel):
        return
    plain: list[tuple[str, Any, Meant]] = []
    for field, found, deep in _list_ranges(type(value)):
        below = getattr(value, field)
        if below is None:
            continue
        if deep and isinstance(below, BaseModel | list):
            inner = {each.unit: each for each in found} | dict(told)
            known = name if field in _UNCALLED else f"{name} {field}".strip()
            _add_numbers(numbers, below, inner, f"{pointer}/{field}", known)
        elif found:
            meant = told.get(found[-1].unit, found[-1]) if found[-1].unit else found[-1]
            if isinstance(meant, Meant):
                plain.append((field, below, meant))
    for field, below, meant in plain:
        at, called = f"{pointer}/{field}", f"{name} {field}".strip()
        if isinstance(below, list) or (isinstance(below, tuple) and not meant.together):
            for index, each in enumerate(below):
                numbers.append(Number(f"{at}/{index}", f"{called} {index + 1}", each, abs(each), meant))
            continue
        alike = [other for _, other, same in plain if same is meant] if meant.together else [below]
        numbers.append(Number(at, called, below, max(map(_largest, alike)), meant))


def _largest(value: Any) -> float:
    """In size; of a transform (4, 4), that of its translation."""
    if not isinstance(value, tuple):
        return abs(float(value))
    if len(value) == 4 and isinstance(value[0], tuple):
        value = tuple(row[3] for row in value[:3])
    return max(_largest(each) for each in value)


# --- one number -----------------------------------------------------------------------------------------


def _doubt_range(number: Number) -> Iterator[tuple[str, Doubt]]:
    """The number, or vector, whose size is outside of its range, and in which unit it would not be."""
    meant, size = number.meant, number.largest
    above, below = size > meant.most, size < meant.least and (size > 0 or meant.zero is None)
    scalar = not isinstance(number.value, tuple)
    if meant.by or not (above or below) or (scalar and abs(number.value) != size):
        return
    limit, why = (meant.most, meant.high) if above else (meant.least, meant.low)
    unit = f", {100 * number.value:g} %" if meant.unit == "of 1" else f" {meant.unit}".rstrip()
    message = f"{number.name} is {write_numbers(_shift(number.value))}{unit}: {why}. {_cure(number)}"
    if meant.zero and below:
        message += f" If {meant.zero}, write 0."
    yield (meant.above if above else meant.below), Doubt(number.pointer, message, size, limit)


def _shift(value: Any) -> Any:
    """The translation of a transform (4, 4), any other value as it is."""
    return tuple(row[3] for row in value[:3]) if isinstance(value, tuple) and len(value) == 4 else value


def _cure(number: Number) -> str:
    """What to write for the units in which the number is within its range, the commonest first."""
    meant, value = number.meant, np.array(_shift(number.value), dtype=float)
    read = {f"if {unit} were meant": value * factor for unit, factor in SLIPS[meant.unit].items()}
    if meant.unit == "mm/N" and number.largest > meant.most and np.linalg.matrix_rank(value) == 3:
        stiff = {"N/mm": 1.0, "N/um": 1e-3, "N/m": 1e3}
        inverse = np.linalg.inv(value)
        read = {f"if it is a stiffness in {unit}, invert the matrix": inverse * stiff[unit] for unit in stiff} | read
    scale = number.largest / float(np.abs(value).max() or 1.0)
    fitting = [
        f"{words}, write {write_numbers(np.vectorize(lambda x: float(f'{x:.4g}'))(each))}"
        for words, each in read.items()
        if meant.least <= scale * float(np.abs(each).max()) <= meant.most
    ]
    if not fitting:
        return f"Check its unit, which is {meant.unit}." if SLIPS[meant.unit] else "Check it."
    words = "; ".join(fitting[:3])
    return f"{words[0].upper()}{words[1:]}."


# --- lengths of the whole ------------------------------------------------------------------------------


def _doubt_structure_size(subject: Subject) -> Iterator[Doubt]:
    points = subject.fiducials_mm - subject.fiducials_mm.mean(axis=0)
    square = (points**2).sum(axis=1)
    width = float(np.sqrt(max(0.0, (square[:, None] + square - 2 * points @ points.T).max())))
    if SMALLEST_STRUCTURE_MM <= width <= LARGEST_STRUCTURE_MM:
        return
    limit, why = LARGEST_STRUCTURE_MM, f"no detector of a C-arm images more than {LARGEST_STRUCTURE_MM:g} mm at once"
    if width < SMALLEST_STRUCTURE_MM:
        limit, why = SMALLEST_STRUCTURE_MM, f"six beads of {BEAD_MM:g} mm need {SMALLEST_STRUCTURE_MM:g} mm"
    message = f"the two fiducials farthest apart are {width:.4g} mm apart; {why}. {_say_units(subject, width)}"
    if subject.document.fiducials.points is None:
        yield Doubt("/fiducials/file", f"{message}, which the file states (x_mm, coordinateUnits)", width, limit)
    else:
        yield Doubt("/fiducials/points", message, width, limit)


def _say_units(subject: Subject, width: float) -> str:
    """In which unit the fiducials and targets would lie in the images of all views."""
    units = find_units_of_points(subject.document, _scene_of(subject), width)
    wide = [f"{unit} ({OTHER_LENGTHS[unit] * width:.4g} mm)" for unit in units]
    if len(units) == 1:
        return f"In {wide[0]} they lie in all images: multiply by {OTHER_LENGTHS[units[0]]:g}, or correct the unit"
    if units:
        return f"In {' and in '.join(wide)} they lie in all images: look up which it is, and correct the unit"
    return f"In none of {', '.join(OTHER_LENGTHS)} would they lie in all images: check the unit of the positions"


def _scene_of(subject: Subject) -> WrittenPoints:
    return WrittenPoints.of(subject.document, subject.labels, subject.fiducials_mm)


def _doubt_source_distances(subject: Subject) -> Iterator[Doubt]:
    middle = subject.fiducials_mm.mean(axis=0)
    for index, view in enumerate(subject.document.views):
        at = f"/views/{index}"
        if isinstance(view, PresetView | DistanceView):
            for field, meant in (("source_detector_mm", DETECTOR_MM), ("source_isocentre_mm", ISOCENTRE_MM)):
                length = getattr(view, field)
                if length is not None:
                    yield from _doubt_distance(subject, view, f"{at}/{field}", field, length, meant)
            yield from _doubt_far_isocentre(view, at)
        elif subject.system is not None:
            field = "pose" if isinstance(view, PinholeView) else "projection"
            length = float(np.linalg.norm(camera_centre(subject.system.views[index].projection) - middle))
            what = "the distance of the source from the middle of the fiducials"
            yield from _doubt_distance(subject, view, f"{at}/{field}", what, length, ISOCENTRE_MM)


def _doubt_far_isocentre(view: PresetView | DistanceView, at: str) -> Iterator[Doubt]:
    for _, far in read_isocentre(view):
        near, detector = view.source_isocentre_mm or 0.0, find_detector(view)
        message = (
            f"view {view.name}: source_isocentre_mm is {near:.4g} mm of {detector:.4g} mm to the detector, which "
            f"magnifies {detector / near:.2g} times; the presets have 530 to 810 mm (1.4 to 1.9 times). If {near:.4g} "
            f"mm are from isocentre to detector, write source_isocentre_mm: {far:.6g}."
        )
        yield Doubt(f"{at}/source_isocentre_mm", message, near, NEAREST_ISOCENTRE * detector)


def _doubt_distance(
    subject: Subject, view: Any, pointer: str, what: str, length: float, meant: Meant
) -> Iterator[Doubt]:
    if meant.least <= length <= meant.most:
        return
    limit, sort, why = (meant.least, "less", meant.low) if length < meant.least else (meant.most, "more", meant.high)
    cure = say_meanings(view, _scene_of(subject))
    cure = cure or f"check its unit, which is mm: none of {', '.join(OTHER_LENGTHS)} fits"
    short = f"view {view.name}: {what} is {length:.4g} mm, {sort} than {limit:g} mm: {why}"
    yield Doubt(pointer, f"{short}. {cure[0].upper()}{cure[1:]}.", length, limit)


def _doubt_feet(subject: Subject) -> Iterator[Doubt]:
    for index, view in enumerate(subject.document.views):
        size, foot, _ = state_foot(view)
        if size is None or foot is None:
            continue
        aside, meant = lies_aside(foot, size), [*read_foot(view)]
        if aside > FARTHEST_ASIDE or meant:
            cure = f"With {meant[0][0]} it is there: write {write_numbers(meant[0][1])}." if meant else "Check it."
            message = (
                f"view {view.name}: principal_point_px {write_numbers(foot)} is {100 * aside:.0f} % of the image away "
                f"from its middle, {write_numbers(image_centre_px(size))}: detectors are not set that far aside. {cure}"
            )
            inner = "/intrinsics" if isinstance(view, PinholeView) else ""
            yield Doubt(f"/views/{index}{inner}/principal_point_px", message, aside, FARTHEST_ASIDE)


def _doubt_cones(subject: Subject) -> Iterator[Doubt]:
    for index, view in enumerate(subject.document.views):
        if isinstance(view, PinholeView) and view.image_size_px is not None:
            focal, width = abs(view.intrinsics.focal_px[0]), view.image_size_px[0]
            if focal < WIDEST_CONE * width or (ARMS_MM[0] <= focal <= ARMS_MM[1] and focal < MM_CONE * width):
                message = (
                    f"view {view.name}: its focal length, {focal:.5g} px, is {focal / width:.2g} times the width of "
                    f"its image, {width} px: no C-arm opens that wide (they have 2.6 to 5). It is the distance "
                    "from source to detector over the pixel: if it is in millimetres, divide it by the pixel."
                )
                yield Doubt(f"/views/{index}/intrinsics/focal_px", message, focal, WIDEST_CONE * width)


def _doubt_detector_widths(subject: Subject) -> Iterator[Doubt]:
    for index, view in enumerate(subject.document.views):
        if not isinstance(view, PresetView):
            continue
        preset = PRESETS[view.preset]
        if preset.pixel_mm is None or preset.image_size_px is None:
            continue
        pixel, size = view.pixel_mm or preset.pixel_mm, view.image_size_px or preset.image_size_px
        sides = zip(size, preset.image_size_px, strict=True)
        ratios = [pixel * own / (preset.pixel_mm * known) for own, known in sides]
        side = max((0, 1), key=lambda each: abs(ratios[each] - 1))
        if abs(ratios[side] - 1) <= SAME_WIDTH:
            continue
        own, known, way = size[side], preset.image_size_px[side], ("wide", "high")[side]
        width, published = pixel * own, preset.pixel_mm * known
        field, whole = "image_size_px", f"pixel_mm: {published / own:.6g}"
        if view.image_size_px is None:
            pixels = ", ".join(f"{each * preset.pixel_mm / pixel:.0f}" for each in size)
            field, whole = "pixel_mm", f"image_size_px: [{pixels}]"
        times = known // own
        binned = f"binned {times} x {times}" if own < known and known % own == 0 else "binned or resampled"
        sentences = []
        if abs(ratios[0] / ratios[1] - 1) <= SAME_WIDTH:  # else no pixel makes both sides those of the preset
            sentences.append(f"An image of the whole detector, {binned}, has {whole}.")
        if max(ratios) <= 1 + SAME_WIDTH:
            sentences.append("Of a crop the numbers are right as they are.")
        message = (
            f"view {view.name}: its detector is {width:.4g} mm {way} ({own} px of {pixel:.4g} mm), that of "
            f"{preset.name} {published:.4g} mm ({known} px of {preset.pixel_mm:.4g} mm). "
            f"{' '.join(sentences) or 'Check image_size_px and pixel_mm.'}"
        )
        yield Doubt(f"/views/{index}/{field}", message, width, published)


_SECTIONS = ("interfaces", "transforms", "execution", "rotation_deg")


def _name(pointer: str) -> str:
    """What an angle belongs to, as a person calls it: structure_connector bias rz_deg, T_flange_con 2."""
    return " ".join(step for step in pointer.split("/") if step and step not in _SECTIONS)


# --- angles ---------------------------------------------------------------------------------------------


def _doubt_angles(subject: Subject) -> Iterator[Doubt]:
    for pointer, angle in _list_angles(subject.document):
        turn = angle and next((each for each in TURNS if abs(abs(angle) - each) <= SAME_TURN * each), None)
        if turn:
            degrees = round(turn * 180 / pi) * (1 if angle > 0 else -1)
            meant = f"{degrees} degrees in radians. Write {degrees} if that is meant."
            yield Doubt(pointer, f"{_name(pointer)}: {angle:g} in a field of degrees is {meant}", angle, degrees)


def _list_poses(document: DesignDocument) -> Iterator[tuple[str, Pose]]:
    """(pointer, pose) of every transform that is written as rotation and translation."""
    poses = [(f"/views/{k}/pose", view.pose) for k, view in enumerate(document.views) if isinstance(view, PinholeView)]
    poses += [(f"/transforms/{name}", getattr(document.transforms, name)) for name in ("T_flange_con", "T_tcp_flange")]
    yield from ((at, pose) for at, pose in poses if isinstance(pose, Pose))


def _list_angles(document: DesignDocument) -> Iterator[tuple[str, float]]:
    """(pointer, degrees) of every rotation that is written as angles."""
    for at, pose in _list_poses(document):
        yield from ((f"{at}/rotation_deg/{axis}", angle) for axis, angle in enumerate(pose.rotation_deg or ()))
    for at, bias in _list_biases(document):
        yield from ((f"{at}/{axis}_deg", getattr(bias, f"{axis}_deg")) for axis in ROTATIONS)
    robot = getattr(document.execution, "robot", None)
    for field in ("joints_imaging_deg", "joints_executing_deg") if robot is not None else ():
        yield from ((f"/execution/robot/{field}/{k}", angle) for k, angle in enumerate(getattr(robot, field)))


def _doubt_quaternions(subject: Subject) -> Iterator[Doubt]:
    for at, pose in _list_poses(subject.document):
        if pose.quaternion_wxyz is not None and abs(pose.quaternion_wxyz[3]) > LAST_SCALAR:
            first = pose.quaternion_wxyz
            off = 2 * degrees(asin(min(1.0, hypot(*first[:3]))))
            near = f", but for {off:.3g} degrees" if off else ""
            message = (
                f"{_name(at)}: quaternion_wxyz {write_numbers(first)} has its scalar first and is half a turn about z"
                f"{near}; with the scalar last it is{' nearly' * bool(near)} none. If none is meant, write "
                f"{write_numbers(np.roll(first, 1))}; half a turn is rotation_deg: [0, 0, 180]."
            )
            yield Doubt(f"{at}/quaternion_wxyz", message, abs(first[3]), LAST_SCALAR)


def _list_biases(document: DesignDocument) -> Iterator[tuple[str, Bias]]:
    for name, interface in document.interfaces.by_name.items():
        yield f"/interfaces/{name}/bias", interface.bias
    if document.execution.hand_eye is not None:
        yield "/execution/hand_eye/bias", document.execution.hand_eye.bias


# --- places and lever arms --------------------------------------------------------------------------------


def _doubt_tool(rule: str, subject: Subject) -> Iterator[Doubt]:
    for found, what, away, readings in doubt_tool(subject.document):
        if found != rule:
            continue
        told = f"at the executed pose {what.format(f'{away:.4g}')}"
        if readings:
            ways = [f"with {each.words}, it lies {each.away_mm:.3g} mm from it: {each.cure}" for each in readings[:2]]
            yield Doubt(readings[0].pointer, f"{told}; {'; '.join(ways)}.", away, readings[0].away_mm)
        else:
            cure = "check T_flange_con, T_tcp_flange and the frame of the targets: score says where each lies in tcp"
            yield Doubt("/transforms", f"{told}, further than a tool is from its work: {cure}.", away, FARTHEST_MM)


def _doubt_lever_arms(subject: Subject) -> Iterator[Doubt]:
    turning = [
        (name, interface)
        for name, interface in subject.document.interfaces.by_name.items()
        if interface.tolerances is not None
        and any((entry := interface.tolerances.components[axis]) and entry.width > 0 for axis in ROTATIONS)
    ]
    for target in subject.document.targets:
        for name, interface in turning:
            lever = _reach(target, interface.pivot_mm)
            if lever < BEAD_MM:
                message = (
                    f"target {target.name} lies within {lever:.2g} mm of the pivot of {name}, nearer than the diameter "
                    f"of a bead ({BEAD_MM:g} mm): rotations of that seat have no lever arm there. The pivot is the "
                    "place of the seat, not of the target: check both."
                )
                yield Doubt(f"/interfaces/{name}/pivot_mm", message, lever, BEAD_MM)


def _reach(target: TargetDocument, pivot: tuple[float, float, float]) -> float:
    """Distance of a target from a pivot, of a region's farthest point, mm."""
    if target.position_mm is not None:
        return dist(target.position_mm, pivot)
    region = target.region
    assert isinstance(region, Region)
    if region.sphere is not None:
        return dist(region.sphere.centre_mm, pivot) + region.sphere.radius_mm
    assert region.box is not None
    offsets = zip(region.box.centre_mm, region.box.size_mm, pivot, strict=True)
    return hypot(*(abs(centre - at) + size / 2 for centre, size, at in offsets))


def _doubt_pivots(subject: Subject) -> Iterator[Doubt]:
    targets = [target.position_mm for target in subject.document.targets if target.position_mm is not None]
    if not targets:
        return
    points, middle = np.vstack([subject.fiducials_mm, *targets]), subject.fiducials_mm.mean(axis=0)
    low, high, away = points.min(axis=0), points.max(axis=0), middle - np.mean(targets, axis=0)

    def among(place: Array) -> bool:
        return bool(((place > low) & (place < high)).all())

    def behind(place: Array) -> bool:
        return bool((place - middle) @ away > 0)

    placed = subject.document.transforms.T_flange_con is not None  # then the flange's own is compared with that
    for name, interface in subject.document.interfaces.by_name.items():
        pivot = np.array(interface.pivot_mm)
        if (placed and name == "connector_flange") or not pivot.any() or not among(pivot):
            continue
        meant = {unit: OTHER_LENGTHS[unit] * pivot for unit in ("centimetres", "inches")}
        fitting = [
            f"in {unit}, write {write_numbers(place.round(4))}"
            for unit, place in meant.items()
            if behind(place) and not among(place)
        ]
        if fitting:
            depth = float(np.minimum(pivot - low, high - pivot).min())
            message = (
                f"the pivot of {name} lies among the fiducials and targets, {depth:.3g} mm inside the box about them. "
                "It is the place of a seat, which lies behind the structure; tolerances turn about it. "
                f"If it is {'; '.join(fitting)}."
            )
            yield Doubt(f"/interfaces/{name}/pivot_mm", message, depth, 0.0)


def _doubt_targets_in_beads(subject: Subject) -> Iterator[Doubt]:
    diameter = subject.document.fiducials.diameter_mm
    radius = (BEAD_MM if diameter is None else diameter) / 2
    for index, target in enumerate(subject.document.targets):
        if target.position_mm is None:
            continue
        away = np.linalg.norm(subject.fiducials_mm - target.position_mm, axis=1)
        if away.min() < radius:
            size = "its radius" if diameter is not None else f"the radius of a bead of {BEAD_MM:g} mm"
            label = f"fiducial {subject.labels[int(away.argmin())]}"
            message = (
                f"target {target.name} lies {away.min():.3g} mm from the centre of {label}, nearer than {size} "
                f"({radius:g} mm): a tool cannot go there while the bead is in place. Check both positions."
            )
            yield Doubt(f"/targets/{index}/position_mm", message, float(away.min()), radius)


def _doubt_noise(subject: Subject) -> Iterator[Doubt]:
    """Noise that follows from physics and is less than anybody measured; a number has its range."""
    for index, view in enumerate(subject.document.views):
        if not isinstance(view.fiducial_noise_px, BeadNoise) or subject.system is None:
            continue
        noise = subject.system.views[index].fiducial_noise_px
        if noise < NOISE_PX.least:
            why, _, _ = NOISE_PX.low.partition(". ")
            met = f"{view.name}: the noise of beads comes to {noise:.2g} px"
            message = f"{met}: {why}. Say in other_px what is missing."
            yield Doubt(f"/views/{index}/fiducial_noise_px", message, noise, NOISE_PX.least)


_FINDERS: dict[str, Callable[[Subject], Iterator[Doubt]]] = {  # of the rules that look at several numbers
    "noise-too-small": _doubt_noise,
    "structure-size": _doubt_structure_size,
    "source-distance": _doubt_source_distances,
    "detector-width": _doubt_detector_widths,
    "principal-point": _doubt_feet,
    "cone-too-wide": _doubt_cones,
    "angle-in-radians": _doubt_angles,
    "quaternion-order": _doubt_quaternions,
    TARGET_OFF_TOOL: partial(_doubt_tool, TARGET_OFF_TOOL),
    PIVOT_OFF_FLANGE: partial(_doubt_tool, PIVOT_OFF_FLANGE),
    "no-lever-arm": _doubt_lever_arms,
    "pivot-among-fiducials": _doubt_pivots,
    "target-in-bead": _doubt_targets_in_beads,
}
_RULES = tuple(
    PlausibilityTest(rule, said["title"], said.get("numbers", BESIDE), _FINDERS.get(rule), said.get("slip", False))
    for rule, said in read_table("doubts").items()
)
_OF_EFFECTS = tuple(rule for kind in EFFECTS for rule in kind.doubts)
_ALL: tuple[PlausibilityTest[Any], ...] = (*_RULES, *_OF_EFFECTS)
PLAUSIBILITY = {rule.id: rule for rule in _ALL}

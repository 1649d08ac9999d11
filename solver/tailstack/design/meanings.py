"""What else the numbers of a view, the points or the tool may mean: each is tried on the design before it is said.

A pose that maps the camera to con, camera axes as computer graphics has them, lengths in metres: obeying what is said
here puts all fiducials and targets in front of the source and into the image, with a source as far away as sources are.
The meaning with the fewest changes is said; where several fit, all are, and none is recommended.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, product
from math import inf
from typing import Any, NamedTuple

import numpy as np

from ..errors import DesignError, IllPosedError, Problem
from ..estimation.checks import sight
from ..field_names import write_value
from ..fields import Pose
from ..geometry.arrays import Array
from ..geometry.camera import camera_centre, image_centre_px
from ..geometry.rotation import rigid_transform, rotation_from_quaternion, rotation_xyz
from ..ranges import DETECTOR_MM, ISOCENTRE_MM
from ..system import View
from ..units import OTHER_LENGTHS as UNITS
from .consistency import expand_target
from .document import DesignDocument, DistanceView, MatrixView, PinholeView, PresetView
from .frames import compile_transform, compile_view, find_detector
from .presets import PRESETS

SHORTEST_MM = {"source_detector_mm": DETECTOR_MM.least, "source_isocentre_mm": ISOCENTRE_MM.least}
ASIDE, IN_THE_MIDDLE = 0.1, 0.05  # of the image: a principal point that is off, and one that another reading mends
LONGEST_CURE = 80  # characters, of one of several
SOURCE_MM = (100.0, 5000.0)  # from the middle of the fiducials: what any source has
USUAL_SOURCE_MM = (300.0, 1500.0)  # from the middle of the fiducials: what a change of unit has to lead to
USUAL_WIDTH_MM = (30.0, 375.0)  # of a structure: likewise
# Published C-arms and a tenth more: from source to detector, and to the isocentre, which lies behind the middle
ARMS_MM, ISOCENTRES_MM, NEAREST_ISOCENTRE = (900.0, 1400.0), (500.0, 900.0), 0.485
TURNED = np.diag([1.0, -1.0, -1.0, 1.0])  # from the camera axes of OpenGL, y up and z away from the detector
_PLACED = ("behind-source", "outside-view", "behind-detector")  # refusals that another meaning may be the cure of


@dataclass(frozen=True, slots=True, eq=False)
class WrittenPoints:
    """The points that all views should show."""

    labels: tuple[str, ...]
    fiducials_mm: Array  # (N, 3) con
    targets_mm: Array  # (T, 3) con

    @classmethod
    def of(cls, document: DesignDocument, labels: Sequence[str], fiducials_mm: Array) -> WrittenPoints:
        """That of a document with these fiducials."""
        targets = chain.from_iterable(map(expand_target, document.targets))
        return cls(tuple(labels), fiducials_mm, np.array([target.position_mm for target in targets]).reshape(-1, 3))

    def shows(self, view: View, detector_mm: float = inf, away_mm: tuple[float, float] = SOURCE_MM) -> bool:
        """Whether a view has everything between source and detector and in its image, its source this far away."""
        seen = [view.sees is None or label in view.sees for label in self.labels]
        each = sight(view, np.concatenate([self.fiducials_mm[seen], self.targets_mm]))
        away = float(np.linalg.norm(camera_centre(view.projection) - self.fiducials_mm.mean(axis=0)))
        return each.clear and float(each.depth.max()) <= detector_mm and away_mm[0] <= away <= away_mm[1]


class Meaning(NamedTuple):
    """A way to read the numbers of a view."""

    changes: int  # things that are otherwise than written
    words: str  # what is read otherwise
    cure: str  # what to write then
    view: Any  # of the document, with that
    rescaled: bool  # some length has another unit


def _read_otherwise(
    view: Any, words: str, changes: int = 1, rescaled: bool = False, cure: str = "", **fields: Any
) -> Meaning:
    """The view with other values in some of its fields; cure: where it is told shorter than by all of them."""
    told = cure or ", ".join(f"{name}: {write_numbers(value)}" for name, value in fields.items())
    return Meaning(changes, words, told, view.model_copy(update=fields), rescaled)


def find_meanings(view: Any, scene: WrittenPoints, beside: Sequence[Any] = ()) -> list[Meaning]:
    """Ways to read a view of the document, as it is not written, that show everything; those with fewest changes.

    beside: views that are refused with it; who writes one camera in another way writes all of them so, and a way that
    fits all goes before one that fits this view alone."""
    fitting = _list_fitting(view, scene)
    others = [{each.words for each in _list_fitting(other, scene)} for other in beside]
    fitting = [each for each in fitting if all(each.words in words for words in others)] or fitting
    return [each for each in fitting if each.changes == fitting[0].changes]


def _list_fitting(view: Any, scene: WrittenPoints) -> list[Meaning]:
    try:
        meanings = list(_list_meanings(view, scene))
    except (DesignError, IllPosedError):  # it has no projection: that is what is refused
        return []
    fitting = [each for each in meanings if _shows(each.view, scene, USUAL_SOURCE_MM if each.rescaled else SOURCE_MM)]
    return sorted(fitting, key=lambda meaning: meaning.changes)


def _list_meanings(view: Any, scene: WrittenPoints) -> Iterator[Meaning]:
    feet = list(read_foot(view))
    for words, foot in feet:
        yield _with_foot(view, words, foot)
    if isinstance(view, PinholeView):
        yield from _read_pose(view, scene, len(feet))
    elif isinstance(view, MatrixView):
        yield from _read_matrix(view, scene)
    else:
        yield from _read_distances(view, len(feet))


def _with_foot(view: Any, words: str, foot: tuple[float, float]) -> Meaning:
    if not isinstance(view, PinholeView):
        return _read_otherwise(view, words, principal_point_px=foot)
    intrinsics = view.intrinsics.model_copy(update={"principal_point_px": foot})
    return _read_otherwise(view, words, cure=f"principal_point_px: {write_numbers(foot)}", intrinsics=intrinsics)


def _read_pose(view: PinholeView, scene: WrittenPoints, already: int) -> Iterator[Meaning]:
    """``already``: other things that are otherwise than written."""
    written, given = compile_transform(view.pose, "", []), view.intrinsics
    middle = np.append(scene.fiducials_mm.mean(axis=0), 1.0)
    for (form, base), turned in product(read_transform(view.pose, written, "the camera to con"), (False, True)):
        focal_px = (-given.focal_px[0], given.focal_px[1]) if turned and min(given.focal_px) < 0 else given.focal_px
        as_read = TURNED @ base if turned else base
        usual = SOURCE_MM[0] <= float(np.linalg.norm(as_read[:3] @ middle)) <= SOURCE_MM[1]
        for unit, factor in [("", 1.0)] if usual else [("", 1.0), *UNITS.items()]:
            parts = [f"its translation in {unit}"] * bool(unit)
            parts += [f"its pose read as {form}"] * bool(form)
            parts += ["the camera axes turned, as computer graphics has z away from the detector"] * turned
            if not parts:
                continue
            pose = scale_translation(as_read, factor)
            cure = f"pose: {write_numbers(pose)}"
            if not turned and form in ("", ELSEWHERE):
                numbers = write_numbers(pose[:3, 3])
                whole = not isinstance(view.pose, Pose)
                cure = f"{numbers} as the fourth column of pose" if whole else f"translation_mm: {numbers}"
            if focal_px != given.focal_px:
                cure += (
                    f" and focal_px: {write_numbers(focal_px)}; or give the product of the intrinsics and the first "
                    "three rows of the pose as projection, whose sign is free"
                )
            fields = {"pose": pose, "intrinsics": given.model_copy(update={"focal_px": focal_px})}
            yield _read_otherwise(view, " and ".join(parts), len(parts) + already, bool(unit), cure, **fields)


def scale_translation(transform: Array, factor: float) -> Array:
    """The transform (4, 4) with its translation multiplied."""
    return np.asarray(np.block([[transform[:3, :3], factor * transform[:3, 3:]], [transform[3:]]]))


ELSEWHERE = "its rotation beside the place of the other origin"


def read_transform(written: Any, matrix: Array, way: str) -> Iterator[tuple[str, Array]]:
    """A transform (4, 4) as it is written, and as what else its numbers may be: the inverse (``way``: what that maps),
    whole or in one of its two parts, a quaternion with the scalar last, or angles of another order or unit."""
    rotation, shift = matrix[:3, :3], matrix[:3, 3]
    yield "", matrix
    yield f"its inverse, which maps {way}", rigid_transform(rotation.T, -rotation.T @ shift)
    yield ELSEWHERE, rigid_transform(rotation, -rotation @ shift)
    yield "its translation beside the inverse rotation", rigid_transform(rotation.T, shift)
    if isinstance(written, Pose) and written.quaternion_wxyz is not None:
        last = np.roll(written.quaternion_wxyz, 1)
        yield "its quaternion with the scalar last", rigid_transform(rotation_from_quaternion(last), shift)
    if isinstance(written, Pose) and written.rotation_deg is not None and any(written.rotation_deg):
        angles = np.deg2rad(written.rotation_deg)
        about_x, about_y, about_z = (rotation_xyz(angles * axis) for axis in np.eye(3))
        yield "roll, pitch and yaw, Z-Y-X", rigid_transform(about_z @ about_y @ about_x, shift)
        about_c, about_b, about_a = (rotation_xyz(angles[::-1] * axis) for axis in np.eye(3))
        yield "the angles A, B, C of KUKA, Z-Y-X", rigid_transform(about_a @ about_b @ about_c, shift)
        half = float(np.linalg.norm(angles)) / 2
        vector = rotation_from_quaternion(np.append(np.cos(half), np.sin(half) * angles / (2 * half)))
        yield "a rotation vector", rigid_transform(vector, shift)
        yield "its angles in radians", rigid_transform(rotation_xyz(np.array(written.rotation_deg)), shift)


def read_isocentre(view: PresetView | DistanceView) -> Iterator[tuple[str, float]]:
    """The distance to the isocentre as that from isocentre to detector, where it would then be that of a C-arm."""
    near, detector = view.source_isocentre_mm, find_detector(view)
    if near is not None and near < NEAREST_ISOCENTRE * detector and ARMS_MM[0] <= detector <= ARMS_MM[1]:
        far = detector - near
        if ISOCENTRES_MM[0] <= far <= ISOCENTRES_MM[1]:
            yield "source_isocentre_mm from isocentre to detector", far


def read_foot(view: Any) -> Iterator[tuple[str, tuple[float, float]]]:
    """What else the principal point of a view may be that is far from the middle of the image, where that is near."""
    size, foot, pixel = state_foot(view)
    if size is None or foot is None or lies_aside(foot, size) <= ASIDE:
        return
    middle = image_centre_px(size)
    pixel = pixel or max(map(abs, foot)) / max(middle) or 1.0  # without one, that with which it would be in the middle
    read = {
        "in millimetres": (foot[0] / pixel, foot[1] / pixel),
        "from the middle of the image": (middle[0] + foot[0], middle[1] + foot[1]),
        "from the middle of the image, in millimetres": (middle[0] + foot[0] / pixel, middle[1] + foot[1] / pixel),
        "with the other sign": (abs(foot[0]), abs(foot[1])),
        "with v before u": (foot[1], foot[0]),
    }
    near = [each for each in read.items() if lies_aside(each[1], size) <= IN_THE_MIDDLE]
    yield from ((f"its principal point {words}", place) for words, place in near[:1])


def state_foot(view: Any) -> tuple[tuple[int, int] | None, tuple[float, float] | None, float | None]:
    """Size of the image, px, principal point, px, and pixel, mm, as a view or its preset states them."""
    preset = PRESETS.get(getattr(view, "preset", ""))
    size: tuple[int, int] | None = view.image_size_px or getattr(preset, "image_size_px", None)
    if isinstance(view, MatrixView):
        return size, None, None
    if isinstance(view, PinholeView):
        return size, view.intrinsics.principal_point_px, None
    return size, view.principal_point_px, view.pixel_mm or getattr(preset, "pixel_mm", None)


def lies_aside(foot: tuple[float, float], size: tuple[int, int]) -> float:
    """How far a principal point is from the middle of the image, as a part of its width or height, the larger."""
    return max(abs(own - middle) / whole for own, middle, whole in zip(foot, image_centre_px(size), size, strict=True))


def _read_matrix(view: MatrixView, scene: WrittenPoints) -> Iterator[Meaning]:
    if scene.shows(replace(compile_view(view, "", scene.fiducials_mm, []), image_size_px=None)):
        return  # its unit is right
    for unit, factor in UNITS.items():
        words = f"the fourth column of its projection for lengths in {unit}"
        scaled = np.array(view.projection) * [1.0, 1.0, 1.0, factor]
        yield _read_otherwise(view, words, rescaled=True, projection=scaled)


def _read_distances(view: PresetView | DistanceView, already: int) -> Iterator[Meaning]:
    """``already``: other things that are otherwise than written."""
    short = [field for field, least in SHORTEST_MM.items() if (own := getattr(view, field)) is not None and own < least]
    fields = [[short], [["isocentre_mm"]], [short, ["isocentre_mm"]]] if short else [[["isocentre_mm"]]]
    for words, far in read_isocentre(view):
        yield _read_otherwise(view, words, rescaled=True, source_isocentre_mm=far)
    for groups, (unit, factor) in product(fields, UNITS.items()):
        names = [name for group in groups for name in group]
        if "isocentre_mm" not in names or any(view.isocentre_mm):
            scaled: dict[str, Any] = {name: factor * np.array(getattr(view, name)) for name in names}
            words = f"{' and '.join(names)} in {unit}"
            yield _read_otherwise(view, words, len(groups) + already, bool(short), **scaled)


def write_numbers(values: Any) -> str:
    """Numbers and rows of them, as a design has them."""
    return write_value(np.asarray(values).tolist(), 9)


# --- what is said -----------------------------------------------------------------------------------------


def say_meanings(view: Any, scene: WrittenPoints, beside: Sequence[Any] = ()) -> str:
    """What to write in a view so that it shows everything, without a point at its end; empty: nothing was found."""
    meanings = find_meanings(view, scene, beside)
    sized = not isinstance(view, PinholeView | MatrixView) or view.image_size_px is not None
    where = "in front of the source" + (" and inside the image" if sized else "")
    if len(meanings) == 1:
        return f"with {meanings[0].words}, all fiducials and targets lie {where}: write {meanings[0].cure}"
    if meanings:
        ways = [each.words + (f" ({each.cure})" if len(each.cure) <= LONGEST_CURE else "") for each in meanings]
        every = "; with ".join(ways)
        return f"all fiducials and targets lie {where} in {len(meanings)} ways: with {every}. Look up which is meant"
    return ""


def _say_targets(document: DesignDocument, scene: WrittenPoints) -> str:
    """In which unit the targets would be shown by every view, where the fiducials are; empty: in none, or several.

    Any point is shown where it is moved to the origin: a unit is made smaller only of what lies beyond all sources.
    """
    beyond = bool(np.any(np.abs(scene.targets_mm) > USUAL_SOURCE_MM[1]))
    read = {unit: replace(scene, targets_mm=factor * scene.targets_mm) for unit, factor in UNITS.items()}
    tried = [unit for unit, factor in UNITS.items() if factor > 1 or beyond]
    fitting = [unit for unit in tried if all(_shows(view, read[unit], SOURCE_MM) for view in document.views)]
    if len(fitting) != 1 or not len(scene.targets_mm):
        return ""
    return f"with the targets in {fitting[0]}, every view shows everything: multiply by {UNITS[fitting[0]]:g}"


def explain_places(document: DesignDocument, scene: WrittenPoints, problems: Sequence[Problem]) -> Iterator[Problem]:
    """Problems of what a view shows, with what to do in a view of that kind."""
    hints: dict[str, str] = {}
    refused = {int(each.pointer.split("/")[2]) for each in problems if each.code in _PLACED}
    for problem in problems:
        if problem.code in _PLACED:
            index = int(problem.pointer.split("/")[2])
            view = document.views[index]
            beside = [document.views[k] for k in sorted(refused - {index}) if type(document.views[k]) is type(view)]
            if first := problem.pointer not in hints:
                hints[problem.pointer] = say_meanings(view, scene, beside) or _say_targets(document, scene)
            meant = hints[problem.pointer]
            problem = replace(problem, hint=meant * first if meant else _say_nothing_fits(view, problem.code))
        yield problem


def _say_nothing_fits(view: Any, code: str) -> str:
    size, foot, _ = state_foot(view)
    if size is not None and foot is not None and lies_aside(foot, size) > ASIDE:
        return (
            f"check principal_point_px first: {write_numbers(foot)} is far from the middle of the image, "
            f"{write_numbers(image_centre_px(size))}"
        )
    if code == "outside-view":
        if isinstance(view, PresetView | DistanceView):
            return "move it, isocentre_mm or the source; a longer source_isocentre_mm widens the field"
        return "move it, or check image_size_px and the frame of the coordinates"
    if isinstance(view, PinholeView):
        return (
            "pose maps con to the camera frame, z from the source towards the detector. Its inverse, the camera axes "
            "of OpenGL and other units of the translation do not show everything either: check the frame of the "
            "coordinates"
        )
    if isinstance(view, MatrixView):
        return "projection maps con millimetres to pixels: check the frame and the unit of the coordinates"
    return "check the direction of the beam, isocentre_mm and the frame of the coordinates"


# --- the unit of the points -------------------------------------------------------------------------------


def find_units_of_points(document: DesignDocument, scene: WrittenPoints, width_mm: float) -> list[str]:
    """The units in which a structure of this width would be as wide as structures are, and shown by every view."""
    return [
        unit
        for unit, factor in UNITS.items()
        if USUAL_WIDTH_MM[0] <= width_mm * factor <= USUAL_WIDTH_MM[1] and _shown(document, scene, factor)
    ]


def _shown(document: DesignDocument, scene: WrittenPoints, factor: float) -> bool:
    """Whether every view shows the points, multiplied: the fiducials with the targets, alone, or with the views."""
    beads = replace(scene, fiducials_mm=factor * scene.fiducials_mm)
    every = replace(beads, targets_mm=factor * scene.targets_mm)
    usual = (USUAL_SOURCE_MM[0] / factor, USUAL_SOURCE_MM[1] / factor)
    return any(
        all(_shows(view, each, bounds) for view in document.views)
        for each, bounds in ((every, SOURCE_MM), (beads, SOURCE_MM), (scene, usual))
    )


def _shows(view: Any, scene: WrittenPoints, away_mm: tuple[float, float]) -> bool:
    try:
        compiled = compile_view(view, "", scene.fiducials_mm, [])
    except (DesignError, IllPosedError):
        return False
    return scene.shows(compiled, find_detector(view), away_mm)


# --- the tool, the flange and the seat ------------------------------------------------------------------
# At the executed pose a target is at the tool, a standoff away, and the pivot of the flange at its origin.  Where one
# is far from the other as written, and near it by another reading of a number, that reading is told.

TARGET_OFF_TOOL, PIVOT_OFF_FLANGE = "target-off-tool", "pivot-off-flange"  # the rules that tell them
STANDOFF_MM = 20.0  # nearer than this, nothing is doubted
NEARER = 0.2  # of the distance as it is written: a reading that is told
FARTHEST_MM = 300.0
# By a smaller one anything meets the origin
LARGER_UNITS = {unit: factor for unit, factor in UNITS.items() if factor > 1}


class ToolReading(NamedTuple):
    """Another reading of a transform, the targets or the seat's pivot."""

    pointer: str
    words: str
    cure: str
    away_mm: float  # between what should be near


class ToolDoubt(NamedTuple):
    """Two places that should be near one another, and the readings that bring them there, the nearest first."""

    rule: str
    what: str
    away_mm: float
    readings: list[ToolReading]


Transforms = dict[str, Array]
Gap = Callable[[Transforms, Array, Array], float]  # of transforms, targets (T, 3) and the pivot (3,) of the flange, con


def doubt_tool(document: DesignDocument) -> Iterator[ToolDoubt]:
    """What is far apart, and near by another reading; a target that is far from the tool by any."""
    stated = {name: getattr(document.transforms, name) for name in ("T_flange_con", "T_tcp_flange")}
    seat = document.interfaces.connector_flange
    if not any(value is not None for value in stated.values()):
        return
    written = {name: compile_transform(value, "", []) for name, value in stated.items()}
    pivot = np.zeros(3) if seat is None else np.array(seat.pivot_mm)
    targets = np.array([_middle(target) for target in document.targets])
    away, apart = _miss_tool(written, targets, pivot), _miss_seat(written, targets, pivot)
    if max(away, apart) <= STANDOFF_MM:
        return
    readings = [*_read_transforms(stated, written), *_read_places()]
    if away > STANDOFF_MM:
        found = _find(readings, _miss_tool, away, stated, written, targets, pivot)
        if found or away > FARTHEST_MM:
            yield ToolDoubt(TARGET_OFF_TOOL, "the nearest target lies {} mm from the tool's origin (tcp)", away, found)
            return
    if stated["T_flange_con"] is not None and pivot.any() and apart > STANDOFF_MM:
        # where the target is at the tool, the transforms are right: then it is the pivot
        readings = [each for each in readings if away > STANDOFF_MM or each[0].startswith("/interfaces")]
        if found := _find(readings, _miss_seat, apart, stated, written, targets, pivot):
            what = "the pivot of connector_flange lies {} mm from the flange's origin"
            yield ToolDoubt(PIVOT_OFF_FLANGE, what, apart, found)


def _middle(target: Any) -> Any:
    shape = target.region and (target.region.box or target.region.sphere)
    return shape.centre_mm if shape else target.position_mm


def _miss_tool(transforms: Transforms, targets: Array, pivot: Array) -> float:
    whole = transforms["T_tcp_flange"] @ transforms["T_flange_con"]
    return float(np.linalg.norm(targets @ whole[:3, :3].T + whole[:3, 3], axis=1).min())


def _miss_seat(transforms: Transforms, targets: Array, pivot: Array) -> float:
    at = transforms["T_flange_con"]
    return float(np.linalg.norm(at[:3, :3] @ pivot + at[:3, 3]))


# Pointer, words, cure (empty: to write the transforms so), transforms, scales of targets and pivot
ToolMeaning = tuple[str, str, str, Transforms, float, float]


def _find(
    readings: list[ToolMeaning],
    gap: Gap,
    away: float,
    stated: dict[str, Any],
    written: Transforms,
    targets: Array,
    pivot: Array,
) -> list[ToolReading]:
    found: dict[str, ToolReading] = {}
    for pointer, words, cure, read, targets_by, pivot_by in readings:
        left = gap(written | read, targets_by * targets, pivot_by * pivot)
        if left <= max(NEARER * away, STANDOFF_MM / 2):
            anew = (_write_transform(name, stated[name], written[name], matrix) for name, matrix in read.items())
            cure = cure or " and ".join(anew)
            found.setdefault(cure, ToolReading(pointer, words, cure, left))  # an inverse may be a sign: once
    return sorted(found.values(), key=lambda reading: reading.away_mm)


def _read_transforms(stated: dict[str, Any], written: Transforms) -> Iterator[ToolMeaning]:
    inverses: Transforms = {}
    for name, value in stated.items():
        if value is None:
            continue
        _, to, of = name.split("_")
        for form, matrix in read_transform(value, written[name], f"{to} to {of}"):
            for unit, factor in {"": 1.0, **(LARGER_UNITS if not form else {})}.items():
                if not form and not unit:
                    continue
                read = scale_translation(matrix, factor)
                if form.startswith("its inverse"):
                    inverses[name] = read
                words = f"{name} in {unit}" if unit else f"{name} read as {form}"
                yield f"/transforms/{name}", words, "", {name: read}, 1.0, 1.0
    if len(inverses) == 2:
        yield "/transforms", "both transforms read as their inverses", "", inverses, 1.0, 1.0


def _write_transform(name: str, value: Any, written: Array, read: Array) -> str:
    """The cure: the translation alone where the rotation stays."""
    if isinstance(value, Pose) and np.array_equal(read[:3, :3], written[:3, :3]):
        return f"write {name}: translation_mm: {write_numbers(read[:3, 3])}"
    return f"write {name}: {write_numbers(read)}"


def _read_places() -> Iterator[ToolMeaning]:
    for unit, factor in LARGER_UNITS.items():
        yield "/targets", f"the targets in {unit}", f"multiply the targets by {factor:g}", {}, factor, 1.0
        at = "/interfaces/connector_flange/pivot_mm"
        yield at, f"the pivot in {unit}", f"multiply pivot_mm by {factor:g}", {}, 1.0, factor

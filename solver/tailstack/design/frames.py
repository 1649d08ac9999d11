"""Transforms and views of the document -> matrices, degrees to radians; and points and surfaces of files -> con.

Points are carried by a transform that the document states, or by the one that brings some of them, by name, nearest to
where CAD has them: the least squares of Kabsch (1976), by a singular value decomposition.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from ..errors import DesignError, IllPosedError, Problem
from ..fields import Pose
from ..geometry.arrays import Array, frozen
from ..geometry.camera import (
    image_centre_px,
    intrinsic_matrix,
    projection_from_distances,
    projection_from_pose,
    scale_to_unit_depth,
)
from ..geometry.mesh import Mesh
from ..geometry.rotation import (
    rigid_transform,
    rigidity_defect,
    rotation_from_quaternion,
    rotation_xyz,
    transform_points,
)
from ..system import View
from ..units import LENGTHS_MM
from .bead_noise import BeadNoise, bead_noise, describe_noise
from .consistency import check_entries, find_duplicates
from .document import (
    DistanceView,
    Fiducials,
    Locator,
    LocatorFile,
    MatrixView,
    NamedPoint,
    PinholeView,
    PointFile,
    PresetView,
    TargetDocument,
    TargetFile,
)
from .fiducial_files import FiducialList
from .optimise_document import SearchSurface
from .presets import PRESETS
from .surface_files import Surface, read_packed

RIGID = 1e-4  # largest entry of R'R - I that rounding in a document may leave; beyond it, it is not a rotation
FRAME_FIELDS = ("T_con_file", "registered_to")  # of what is read from a file
DECIMALS = 6  # of positions in mm: the last digits of a decomposition are those of a library
ON_A_LINE = 1e-3  # of the spread of points: what they have across a line, below which a turn about it is not known
_Named = tuple[str, tuple[float, float, float]]  # label and position
LEAST_NOISE = 1e-6  # of a direction without noise, as a part of what there is: gains per px are asked of every one
FLAT = "; a file with an axis reversed would fit as well: name a point off the plane of these"
STRETCHED = 0.1  # by which two sets of points may differ in size before they are not the same


class FileMotion(NamedTuple):
    """How the points of a file are carried to con."""

    matrix: Array  # (4, 4) T_con_file
    remarks: tuple[str, ...]  # what is to be known of it


def motion_of(section: Fiducials | PointFile, pointer: str, read: FiducialList) -> FileMotion | None:
    """That of a file with these points, which the section at a pointer states; None: they are in con.

    Raises DesignError."""
    remarks: list[str] = []
    if isinstance(section, Fiducials) and section.registered_to is not None:
        matrix = _register(section.registered_to, read, remarks)
    elif section.T_con_file is not None:
        matrix = compile_transform(section.T_con_file, f"{pointer}/T_con_file", remarks)
        remarks.append("its points were carried to con by T_con_file")
    else:
        return None
    return FileMotion(matrix, tuple(remarks))


def carry(read: FiducialList, motion: FileMotion | None) -> FiducialList:
    """The points of a file in con, with remarks that say how they came there."""
    if motion is None:
        return read
    matrix, remarks = motion
    moved = np.round(transform_points(matrix, np.array(read.positions_mm)), DECIMALS) + 0.0  # no negative zeros
    if (origin := read.origin) is not None:
        origin = origin.model_copy(update={"remarks": [*origin.remarks, *remarks][-20:]})
    return replace(read, positions_mm=tuple(map(tuple, moved.tolist())), origin=origin)


def _register(wanted: Sequence[NamedPoint], read: FiducialList, remarks: list[str]) -> Array:
    """T_con_file (4, 4) by points of a file that are somewhere in con; how well they go there is remarked."""
    pointer = "/fiducials/registered_to"
    if problems := check_entries(pointer, "point of the file", [each.label for each in wanted], read.labels):
        raise DesignError(problems)
    at = dict(zip(read.labels, read.positions_mm, strict=True))
    file = np.array([at[each.label] for each in wanted])
    con = np.array([each.position_mm for each in wanted])
    spreads = [np.linalg.svd(points - points.mean(axis=0), compute_uv=False) for points in (file, con)]
    if any(spread[1] <= ON_A_LINE * spread[0] for spread in spreads):
        cure = "name a point beside that line"
        raise DesignError(Problem(pointer, "free-motion", "the points lie on one line: a turn about it is free", cure))
    size = float(np.linalg.norm(spreads[0]) / np.linalg.norm(spreads[1]))
    if abs(size - 1) > STRETCHED:
        detail = f"in the file the points are {size:.4g} times as far from one another as in con: no motion does that"
        raise DesignError(Problem(pointer, "not-rigid", detail, "check the units of both, and the labels"))
    matrix, left = fit_motion(file, con)
    _, mirrored = fit_motion(file * [1, 1, -1], con)
    if np.linalg.norm(mirrored) < 0.1 * np.linalg.norm(left) - 1e-6:
        detail = f"a mirror image of the points fits to {_rms(mirrored):.3g} mm, the points themselves to"
        cure = "one of both is left-handed: check the signs of its axes, and whether the file is RAS or LPS"
        raise DesignError(Problem(pointer, "not-rigid", f"{detail} {_rms(left):.3g} mm", cure))
    worst = int(np.linalg.norm(left, axis=1).argmax())
    fits_mirrored = np.linalg.norm(mirrored) < 2 * np.linalg.norm(left) + 1e-6
    remarks.append(
        f"its points were carried to con by registration to {len(wanted)} of them: {_rms(left):.3g} mm are left, root "
        f"mean square, most at {wanted[worst].label}, {float(np.linalg.norm(left[worst])):.3g} mm"
        f"{FLAT if fits_mirrored else ''}"
    )
    return matrix


def targets_of(section: TargetFile, pointer: str, read: FiducialList) -> list[TargetDocument]:
    """The targets that points of a file in con stand for.  Raises DesignError."""
    if section.pairs:
        ends = _pairs_of(section, f"{pointer}/pairs", read)
    elif section.line is not None:
        both = f"{section.line[:74]} entry", section.line
        named = FiducialList(both, (read.positions_mm[0], read.positions_mm[-1]))
        ends = _pairs_of(section, f"{pointer}/line", named)
    else:
        points = zip(read.labels, read.positions_mm, strict=True)
        return [TargetDocument(name=label, position_mm=position) for label, position in points]
    found = []
    channel = {} if section.corridor_mm is None else {"corridor_mm": section.corridor_mm}
    for (entry, first), (name, last) in ends:
        end = {"name": name, "position_mm": last, "entry": entry, **channel}
        found += [TargetDocument.model_validate(end), TargetDocument(name=entry, position_mm=first)]
    return found


def _pairs_of(section: PointFile, pointer: str, read: FiducialList) -> list[tuple[_Named, _Named]]:
    """Points two by two, none of them in one place.  Raises DesignError."""
    points = list(zip(read.labels, read.positions_mm, strict=True))
    if len(points) % 2:
        detail = f"points go two by two; {section.file} holds {len(points)}"
        raise DesignError(Problem(pointer, "missing-point", detail, "add the other end of the last, or take it out"))
    for (first, there), (last, here) in (pairs := list(zip(points[::2], points[1::2], strict=True))):
        if there == here:
            detail = f"{section.file}: a line has two ends; {first} and {last} are in one place"
            raise DesignError(Problem(pointer, "zero-direction", detail, "move one of both"))
    return pairs


def locators_of(files: Sequence[tuple[LocatorFile, FiducialList]], pointer: str) -> list[Locator]:
    """The six contacts that points of files in con, those of one interface, stand for.  Raises DesignError."""
    found = []
    for index, (section, read) in enumerate(files):
        law = {name: getattr(section, name) for name in section.model_fields_set - PointFile.model_fields.keys()}
        for (name, place), (_, beyond) in _pairs_of(section, f"{pointer}/{index}/file", read):
            normal = tuple(np.round(np.subtract(beyond, place), DECIMALS).tolist())
            found.append(Locator(name=name, position_mm=place, normal=normal, **law))
    if len(found) != 6:
        detail = f"six contacts hold a seat; its files hold {len(found)}"
        raise DesignError(Problem(pointer, "wrong-length", detail, "two points a contact: its place, and one along it"))
    if problems := find_duplicates([each.name for each in found], lambda _: pointer, "contacts"):
        raise DesignError(problems)
    return found


def read_surface_of(surface: SearchSurface) -> Surface:
    """What its file holds, as that stands there.  Raises DesignError, LimitError."""
    return read_packed(surface.content or "", surface.file or "the surface")


@lru_cache(maxsize=4)
def mesh_of(surface: SearchSurface) -> Mesh:
    """The triangles of a surface that was read, con, mm."""
    read = read_surface_of(surface).mesh
    in_mm = read.corners_mm * LENGTHS_MM[surface.unit]
    return replace(read, corners_mm=frozen(transform_points(compile_transform(surface.T_con_file, "", []), in_mm)))


def fit_motion(points: Array, onto: Array) -> tuple[Array, Array]:
    """T (4, 4) that brings points (n, 3) nearest to others (n, 3), in the sum of squares; and what is left (n, 3)."""
    centres = points.mean(axis=0), onto.mean(axis=0)
    left, _, right = np.linalg.svd((onto - centres[1]).T @ (points - centres[0]))
    rotation = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
    matrix = rigid_transform(rotation, centres[1] - rotation @ centres[0])
    return matrix, onto - transform_points(matrix, points)


def _rms(rows: Array) -> float:
    return float(np.sqrt((rows**2).sum(axis=1).mean()))


def compile_transform(value: Pose | Any | None, pointer: str, notes: list[str]) -> Array:
    """4x4 of a pose or a matrix; rounding in the document is taken out, anything more is refused."""
    if value is None:
        return frozen(np.eye(4))
    if isinstance(value, Pose):
        translation = np.array(value.translation_mm)
        if value.rotation_deg is not None:
            return frozen(rigid_transform(rotation_xyz(np.deg2rad(value.rotation_deg)), translation))
        if value.quaternion_wxyz is not None:
            norm = float(np.linalg.norm(value.quaternion_wxyz))
            if abs(norm - 1) > 1e-3:
                raise _refuse_not_rigid(f"{pointer}/quaternion_wxyz", f"the quaternion's norm is {norm:.6g}, not 1")
            rotation = rotation_from_quaternion(np.array(value.quaternion_wxyz))
            return frozen(rigid_transform(rotation, translation))
        rotation = np.eye(3) if value.rotation is None else np.array(value.rotation)
        pointer += "/rotation"
    else:
        matrix = np.array(value)
        if np.abs(matrix[3] - [0.0, 0.0, 0.0, 1.0]).max() > 0:
            turned = np.array_equal(matrix[:, 3], [0.0, 0.0, 0.0, 1.0])
            rows = ", ".join(str(row) for row in matrix.T.tolist())
            hint = f"it is written for rows (x, y, z, 1) on its left; transposed it is [{rows}]" if turned else ""
            raise _refuse_not_rigid(f"{pointer}/3", f"the last row is {matrix[3].tolist()}, not [0, 0, 0, 1]", hint)
        if np.abs(matrix[:3, 3]).max() > 1e5:
            raise DesignError(Problem(pointer, "out-of-range", "the translation is longer than 100 m"))
        rotation, translation = matrix[:3, :3], matrix[:3, 3]
    size = float(np.abs(rotation).max())
    defect = rigidity_defect(rotation) if size < 10 else float("inf")
    if not defect <= RIGID and size < 10 and rigidity_defect(-rotation) <= RIGID:
        hint = "one axis of one of the two frames, a row or a column, points the other way there: reverse its numbers"
        raise _refuse_not_rigid(pointer, "its rotation is a reflection: the determinant is -1", hint)
    if not defect <= RIGID:
        what = "it is far from a rotation" if defect == float("inf") else f"R'R - I reaches {defect:.2g}"
        raise _refuse_not_rigid(pointer, f"its rotation is not a rotation: {what}")
    if defect > 1e-12:
        left, _, right = np.linalg.svd(rotation)
        rotation = left @ right
    if defect > 1e-9:
        notes.append(f"{pointer}: replaced by the nearest rotation (R'R - I reached {defect:.1g})")
    return frozen(rigid_transform(rotation, translation))


def _refuse_not_rigid(pointer: str, detail: str, hint: str = "") -> DesignError:
    rule, cure = f"a transform is rigid; {detail} (accepted: {RIGID:g})", "give more digits, or use rotation_deg"
    return DesignError(Problem(pointer, "not-rigid", rule, hint or cure))


# --- views -> projections, con mm to px -------------------------------------------------------------------


def compile_view(view: Any, pointer: str, fiducials: Array, notes: list[str]) -> View:
    """A view of the document with its projection, con mm to px; ``notes`` is added to."""
    projection, size = _projection(view, pointer, fiducials, notes)
    noise = view.fiducial_noise_px
    if isinstance(noise, BeadNoise):
        place = f"{pointer}/fiducial_noise_px"
        noise, words = describe_noise(view.name, bead_noise(noise, projection, fiducials, find_detector(view), place))
        notes += [words] if words else []
    sees = None if view.sees is None else tuple(view.sees)
    prior = view.intrinsics_prior
    known = None if prior is None else (prior.focal_rel_sd, prior.principal_point_px_sd)
    return View(view.name, frozen(projection), noise, view.target_noise_px, size, sees, known, _noise_factors(view))


def _noise_factors(view: Any) -> Array | None:
    """Lower triangles (2, 2, 2) whose squares are the covariances of noise along u and v, of a mean variance of 1."""
    shapes = view.fiducial_noise_shape, view.target_noise_shape
    if shapes == (None, None):
        return None
    factors = []
    for shape in shapes:
        matrix = np.eye(2) if shape is None else np.array(shape)
        matrix = matrix / (matrix.trace() / 2)
        u = max(sqrt(matrix[0, 0]), LEAST_NOISE)
        mixed = (matrix[0, 1] + matrix[1, 0]) / 2 / u
        factors.append([[u, 0.0], [mixed, max(sqrt(max(matrix[1, 1] - mixed**2, 0.0)), LEAST_NOISE)]])
    return frozen(factors)


def _projection(view: Any, pointer: str, fiducials: Array, notes: list[str]) -> tuple[Array, tuple[int, int] | None]:
    """Con mm to px, and the size of the image where it is stated."""
    if isinstance(view, PresetView | DistanceView):
        return aim_view(view)
    if isinstance(view, PinholeView):
        k = intrinsic_matrix(view.intrinsics.focal_px, view.intrinsics.principal_point_px, view.intrinsics.skew_px)
        return projection_from_pose(k, compile_transform(view.pose, f"{pointer}/pose", notes)), view.image_size_px
    assert isinstance(view, MatrixView)
    return _read_matrix(view, pointer, fiducials), view.image_size_px


def aim_view(view: PresetView | DistanceView) -> tuple[Array, tuple[int, int]]:
    """A preset fills in what the view leaves open; loading has made sure that nothing stays open."""
    preset = PRESETS[view.preset] if isinstance(view, PresetView) else None

    def number(name: str) -> Any:
        own = getattr(view, name)
        return own if own is not None else getattr(preset, name)

    size: tuple[int, int] = number("image_size_px")
    pixel, foot = float(number("pixel_mm")), view.principal_point_px or image_centre_px(size)
    detector_mm, isocentre_mm = number("source_detector_mm"), number("source_isocentre_mm")
    place, beam, up = (np.array(each) for each in (view.isocentre_mm, view.beam, view.up_direction))
    return projection_from_distances(detector_mm, isocentre_mm, (pixel, pixel), foot, place, beam, up), size


def find_detector(view: Any) -> float:
    """mm from the source of a view of the document to its detector; infinite where it does not say."""
    if isinstance(view, PresetView | DistanceView):
        return view.source_detector_mm or PRESETS[getattr(view, "preset", "")].source_detector_mm
    return float("inf")


def _read_matrix(view: MatrixView, pointer: str, fiducials: Array) -> Array:
    matrix = np.array(view.projection)
    left = matrix[:, :3] / max(float(np.abs(matrix[:, :3]).max()), 1e-300)
    # rows of a projection differ by the focal length in px; scaling each makes the rank a matter of directions
    rows = np.linalg.norm(left, axis=1)
    if rows.min() == 0 or np.linalg.svd(left / rows[:, None], compute_uv=False)[-1] < 1e-9:
        detail = "the left 3x3 block of the projection is singular: it has no finite X-ray source"
        cure = "give a perspective projection that maps con millimetres to pixels"
        raise IllPosedError(Problem(f"{pointer}/projection", "no-source", detail, cure))
    if np.abs(matrix).max() > 1e12 * np.linalg.norm(matrix[2, :3]):
        detail = "the rows of the projection differ by more than a factor of 1e12: no camera has such a focal length"
        raise IllPosedError(Problem(f"{pointer}/projection", "no-source", detail, "it maps con millimetres to pixels"))
    return scale_to_unit_depth(matrix, fiducials)

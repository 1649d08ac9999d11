"""Views and transforms of the document into matrices: presets filled in, poses read, rounding taken out."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import DesignError, IllPosedError, Problem
from ..geometry.camera import (
    depths,
    image_centre_px,
    intrinsic_matrix,
    projection_from_distances,
    projection_from_pose,
    scale_to_unit_depth,
)
from ..geometry.rotation import rigid_transform, rigidity_defect, rotation_from_quaternion, rotation_xyz
from ..system import Array, Target, View
from .loading import Design
from .presets import PRESETS
from .remembering import kept
from .view_document import DistanceView, MatrixView, PinholeView, Pose, PresetView

RIGID = 1e-4  # largest entry of R'R - I that rounding in a document may leave; beyond it, it is not a rotation


def frozen(values: Any) -> Array:
    """A read-only float array."""
    array = np.array(values, dtype=float, order="C")  # one layout: another would have kernels compiled again
    array.setflags(write=False)
    return array


def compile_view(view: Any, pointer: str, fiducials: Array, notes: list[str]) -> View:
    """A view of the document with its projection, con mm to px; ``notes`` is added to."""
    size: tuple[int, int] | None
    if isinstance(view, PresetView | DistanceView):
        return _aimed(view)
    if isinstance(view, PinholeView):
        k = intrinsic_matrix(view.intrinsics.focal_px, view.intrinsics.principal_point_px, view.intrinsics.skew_px)
        projection = projection_from_pose(k, compile_transform(view.pose, f"{pointer}/pose", notes))
        size = view.image_size_px
    else:
        assert isinstance(view, MatrixView)
        projection, size = _given(view, pointer, fiducials), view.image_size_px
    return View(view.name, frozen(projection), view.fiducial_noise_px, view.target_noise_px, size)


@kept
def _aimed(view: PresetView | DistanceView) -> View:
    """A preset fills in what the view leaves open; loading has made sure that nothing stays open."""
    preset = PRESETS[view.preset] if isinstance(view, PresetView) else None

    def number(name: str) -> Any:
        own = getattr(view, name)
        return own if own is not None else getattr(preset, name)

    size: tuple[int, int] = number("image_size_px")
    pixel = float(number("pixel_mm"))
    projection = projection_from_distances(
        number("source_detector_mm"),
        number("source_isocentre_mm"),
        (pixel, pixel),
        view.principal_point_px or image_centre_px(size),
        np.array(view.isocentre_mm),
        np.array(view.beam),
        np.array(view.up_direction),
    )
    return View(view.name, frozen(projection), view.fiducial_noise_px, view.target_noise_px, size)


def refuse_behind_detector(
    design: Design, views: tuple[View, ...], fiducials: Array, targets: tuple[Target, ...]
) -> None:
    """A distance to the detector is known for aimed views only; the System no longer holds it."""
    points = np.concatenate([fiducials, [target.position_mm for target in targets]])
    labels = design.fiducials.labels
    for index, (view, compiled) in enumerate(zip(design.document.views, views, strict=True)):
        if not isinstance(view, PresetView | DistanceView):
            continue
        detector = view.source_detector_mm or PRESETS[getattr(view, "preset", "")].source_detector_mm
        depth = depths(compiled.projection, points)
        worst = depth.argmax()
        if depth[worst] > detector:
            count = len(fiducials)
            name = f"target {targets[worst - count].name}" if worst >= count else f"fiducial {labels[worst]}"
            raise IllPosedError(
                Problem(
                    f"/views/{index}",
                    "behind-detector",
                    f"{name} lies {depth[worst]:.4g} mm from the source of view {view.name}, behind its detector at "
                    f"{detector:g} mm",
                    "check the isocentre, the direction of the beam and the frame of the coordinates",
                )
            )


def _given(view: MatrixView, pointer: str, fiducials: Array) -> Array:
    matrix = np.array(view.projection)
    left = matrix[:, :3] / max(float(np.abs(matrix[:, :3]).max()), 1e-300)
    # rows of a projection differ by the focal length in px; scaling each makes the rank a matter of directions
    rows = np.linalg.norm(left, axis=1)
    if rows.min() == 0 or np.linalg.svd(left / rows[:, None], compute_uv=False)[-1] < 1e-9:
        raise IllPosedError(
            Problem(
                f"{pointer}/projection",
                "no-source",
                "the left 3x3 block of the projection is singular: it has no finite X-ray source",
                "give a perspective projection that maps con millimetres to pixels",
            )
        )
    if np.abs(matrix).max() > 1e12 * np.linalg.norm(matrix[2, :3]):
        detail = "the rows of the projection differ by more than a factor of 1e12: no camera has such a focal length"
        raise IllPosedError(Problem(f"{pointer}/projection", "no-source", detail, "it maps con millimetres to pixels"))
    return scale_to_unit_depth(matrix, fiducials)


def compile_transform(value: Pose | Any | None, pointer: str, notes: list[str]) -> Array:
    """4x4 of a pose or a matrix; rounding in the document is taken out, anything more is refused."""
    matrix, remarks = _transform(value, pointer)
    notes += remarks
    return matrix


@kept
def _transform(value: Pose | Any | None, pointer: str) -> tuple[Array, tuple[str, ...]]:
    if value is None:
        return frozen(np.eye(4)), ()
    if isinstance(value, Pose):
        translation = np.array(value.translation_mm)
        if value.rotation_deg is not None:
            return frozen(rigid_transform(rotation_xyz(np.deg2rad(value.rotation_deg)), translation)), ()
        if value.quaternion_wxyz is not None:
            norm = float(np.linalg.norm(value.quaternion_wxyz))
            if abs(norm - 1) > 1e-3:
                raise _not_rigid(f"{pointer}/quaternion_wxyz", f"the quaternion's norm is {norm:.6g}, not 1")
            rotation = rotation_from_quaternion(np.array(value.quaternion_wxyz))
            return frozen(rigid_transform(rotation, translation)), ()
        rotation = np.eye(3) if value.rotation is None else np.array(value.rotation)
        pointer += "/rotation"
    else:
        matrix = np.array(value)
        if np.abs(matrix[3] - [0.0, 0.0, 0.0, 1.0]).max() > 0:
            raise _not_rigid(f"{pointer}/3", f"the last row is {matrix[3].tolist()}, not [0, 0, 0, 1]")
        if np.abs(matrix[:3, 3]).max() > 1e5:
            raise DesignError(Problem(pointer, "out-of-range", "the translation is longer than 100 m"))
        rotation, translation = matrix[:3, :3], matrix[:3, 3]
    size = float(np.abs(rotation).max())
    defect = rigidity_defect(rotation) if size < 10 else float("inf")
    if not defect <= RIGID:
        what = (
            "it is a reflection, or far from a rotation" if defect == float("inf") else f"R'R - I reaches {defect:.2g}"
        )
        raise _not_rigid(pointer, f"its rotation is not a rotation: {what}")
    if defect > 1e-12:
        left, _, right = np.linalg.svd(rotation)
        rotation = left @ right
    rounded = f"{pointer}: replaced by the nearest rotation (R'R - I reached {defect:.1g})"
    return frozen(rigid_transform(rotation, translation)), (rounded,) if defect > 1e-9 else ()


def _not_rigid(pointer: str, detail: str) -> DesignError:
    return DesignError(
        Problem(
            pointer,
            "not-rigid",
            f"a transform is rigid; {detail} (accepted: {RIGID:g})",
            "give more digits, or use rotation_deg",
        )
    )

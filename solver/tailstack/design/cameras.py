"""Views of the document -> projections, con mm to px."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np

from ..errors import IllPosedError, Problem
from ..geometry.arrays import Array, frozen
from ..geometry.camera import (
    image_centre_px,
    intrinsic_matrix,
    projection_from_distances,
    projection_from_pose,
    scale_to_unit_depth,
)
from ..system import View
from .bead_noise import BeadNoise, bead_noise, describe_noise
from .document import DistanceView, MatrixView, PinholeView, PresetView
from .frames import compile_transform
from .loading import Design
from .presets import PRESETS

LEAST_NOISE = 1e-6  # of a direction without noise, as a part of what there is: gains per px are asked of every one


def seen_by(view: Any) -> tuple[str, ...] | None:
    """The labels of the fiducials that a view of the document lists; None: all of them."""
    return None if view.sees is None else tuple(view.sees)


def compile_view(view: Any, pointer: str, fiducials: Array, notes: list[str]) -> View:
    """A view of the document with its projection, con mm to px; ``notes`` is added to."""
    projection, size = _projection(view, pointer, fiducials, notes)
    noise = view.fiducial_noise_px
    if isinstance(noise, BeadNoise):
        place = f"{pointer}/fiducial_noise_px"
        noise, words = describe_noise(view.name, bead_noise(noise, projection, fiducials, find_detector(view), place))
        notes += [words] if words else []
    prior = view.intrinsics_prior
    return View(
        view.name,
        frozen(projection),
        noise,
        view.target_noise_px,
        size,
        seen_by(view),
        None if prior is None else (prior.focal_rel_sd, prior.principal_point_px_sd),
        _noise_factors(view),
    )


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
    return projection, size


def detector_distances(design: Design) -> Array:
    """(V,) mm from the source of each view to its detector; infinite where the document does not say."""
    return np.array([find_detector(view) for view in design.document.views])


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

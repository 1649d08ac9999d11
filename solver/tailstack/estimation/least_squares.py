"""The estimators that make the images' residuals least: pose, pose with prior, all eleven unknowns, and the target.

``P = K [R | t]`` of a view is split into its intrinsics and its pose.  With ``x = R (X - c) + d`` about the fiducials'
centroid c, a bead is imaged at ``u = (1 + phi) (f_u x + s y) / z + c_u + a``, ``v = (1 + phi) f_v y / z + c_v + b``:
phi, relative, scales the focal lengths and the skew alike, (a, b) px shifts the principal point; the ratio of the
focal lengths and the skew are those of the nominal view and are held.

- *pose*: R and d (six unknowns) for which the sum of squared residuals is least, the intrinsics as they are assumed.
- *pose and intrinsics*: also phi, a and b, or the first of these, with the square of what they deviate from the
  assumed ones, over the variance of the prior, added (images over their variance): the most probable of normal laws.
  Where nothing is known beforehand, nothing is added.
- *reprojection*: all eleven ratios of P, from DLT onwards.

Each is by Gauss-Newton steps, solved by QR, until no image moves any more; leading dimensions are a batch.  A pose that
they do not bring to rest is sought by damped steps (Levenberg-Marquardt, from SciPy): where the images of a small
structure hardly tell its principal point, they bend as much as they slope, and whole steps turn about the answer.  What
does not converge is NaN.  Written for the tests and for single trials, and without a formula of ``propagation``.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ..geometry.arrays import Array, frozen
from ..geometry.rotation import left_jacobian, skew, torsor_transform, transform_points, turn_by
from ..system import Reading, System, Target, View, Weighing
from .resection import hartley_similarity, homogeneous, project, resect, scale_to_depth
from .triangulation import triangulate

STEPS = 60
DAMPED_STEPS = 1000  # three poses of two million trials under a prior took more than 300: up to 671
AT_REST_PX = 1e-9  # the largest move of an image by the last step
RESTLESS_PX = 1e-6  # a larger one is no rest; between the two it is rounding that moves a badly determined estimate
NONE_SOUGHT = np.zeros(0)  # precisions where no intrinsic is


class SplitProjection(NamedTuple):
    """A projection split: ``P = K [R | t]`` with K upper triangular, its last entry 1."""

    intrinsics: Array  # (3, 3)
    rotation: Array  # (3, 3), orthogonal; its determinant is -1 where the image is a mirrored one
    source_mm: Array  # (3,) translation t


def split(projection: Array) -> SplitProjection:
    """K, R and t of a projection (3, 4) with positive depths; its scale does not matter."""
    scaled = projection / np.linalg.norm(projection[2, :3])
    rows = np.empty((3, 3))
    rows[2] = scaled[2, :3]
    v = float(scaled[1, :3] @ rows[2])
    down = scaled[1, :3] - v * rows[2]
    rows[1] = down / np.linalg.norm(down)
    u, shear = float(scaled[0, :3] @ rows[2]), float(scaled[0, :3] @ rows[1])
    right = scaled[0, :3] - shear * rows[1] - u * rows[2]
    rows[0] = right / np.linalg.norm(right)
    intrinsics = np.array([[np.linalg.norm(right), shear, u], [0.0, np.linalg.norm(down), v], [0.0, 0.0, 1.0]])
    return SplitProjection(intrinsics, rows, np.linalg.solve(intrinsics, scaled[:, 3]))


def _solve(rows: Array, right: Array) -> Array:
    """Least squares of stacked systems (..., m, n) x = (..., m), by QR; NaN where a column depends on others."""
    q, r = np.linalg.qr(rows)
    diagonal = np.abs(np.diagonal(r, axis1=-2, axis2=-1))
    singular = ~(diagonal.min(axis=-1) > 1e-13 * diagonal.max(axis=-1))
    r = np.where(singular[..., None, None], np.eye(r.shape[-1]), r)
    solution = np.linalg.solve(r, np.swapaxes(q, -1, -2) @ right[..., None])[..., 0]
    return np.where(singular[..., None], np.nan, solution)


def resect_pose(
    points: Array, images: Array, view: View, *, error: Array | None = None, precision: Array = NONE_SOUGHT
) -> Array:
    """Estimate a view's pose, and as many of its intrinsics as there are precisions; leading dimensions are a batch.

    points (..., N, 3) mm, as the estimator assumes them; images (..., N, 2) px; view: its projection gives intrinsics,
    and with which orientation and distance the search starts; error (..., 3): of the assumed intrinsics, in the order
    of ``INTRINSICS``; precision (f,) px^2: variance of an image coordinate over that of each of the first f intrinsics,
    0 where nothing is known of it; the others are taken for exact.  Returns (..., 3, 4), ``|P[2, :3]| = 1``.
    """
    batch = np.broadcast_shapes(points.shape[:-2], images.shape[:-2], () if error is None else error.shape[:-1])
    camera = split(view.projection)
    assumed = np.broadcast_to(np.zeros(3) if error is None else error, (*batch, 3))
    centre = points.mean(axis=-2, keepdims=True)
    offset = np.broadcast_to(points - centre, (*batch, *points.shape[-2:]))
    images = np.broadcast_to(images, (*batch, *images.shape[-2:]))
    # the search starts before the middle of the images, where the assumed camera images the structure as large
    depth = (centre[..., 0, :] @ camera.rotation[2] + camera.source_mm[2]) * (1 + assumed[..., 0])
    middle = homogeneous(images.mean(axis=-2))
    place = depth[..., None] * np.linalg.solve(_calibration(camera.intrinsics, assumed), middle[..., None])[..., 0]
    pose = _Pose(np.broadcast_to(camera.rotation, (*batch, 3, 3)).copy(), place.copy(), assumed.copy())
    moved = np.full(batch, np.inf)
    for _ in range(STEPS):
        restless = moved > AT_REST_PX  # what is at rest stays as it is
        if not restless.any():
            break
        equations = _equations_of(
            camera.intrinsics, offset[restless], images[restless], assumed[restless], pose.at(restless), precision
        )
        step = _solve(equations.rows, equations.left)
        pose.put(restless, _move_pose(pose.at(restless), step))
        moved[restless] = _largest_move(equations, step, precision)
    for k in map(tuple, np.argwhere(~(moved <= RESTLESS_PX))):
        alone = _Pose(camera.rotation, place[k], assumed[k])
        settled, moved[k] = _settle(camera.intrinsics, offset[k], images[k], assumed[k], alone, precision)
        pose.put(k, settled)
    in_front = (offset @ pose.rotation[..., 2, :, None] + pose.place_mm[..., None, 2:] > 0).all(axis=(-1, -2))
    shift = pose.place_mm - (pose.rotation @ centre[..., 0, :, None])[..., 0]
    placed = np.concatenate([pose.rotation, shift[..., None]], axis=-1)
    estimate = _calibration(camera.intrinsics, pose.intrinsics) @ placed
    return np.where(((moved <= RESTLESS_PX) & in_front)[..., None, None], estimate, np.nan)


class _Pose(NamedTuple):
    """Unknowns of a view; leading dimensions are a batch."""

    rotation: Array  # (..., 3, 3)
    place_mm: Array  # (..., 3) of the fiducials' centroid, camera frame
    intrinsics: Array  # (..., 3) what they deviate from the nominal ones

    def at(self, chosen: Any) -> _Pose:
        return _Pose(*(each[chosen] for each in self))

    def put(self, chosen: Any, other: _Pose) -> None:
        for each, values in zip(self, other, strict=True):
            each[chosen] = values


class _Equations(NamedTuple):
    """What is to be made least, linearised at a pose: one row for each image coordinate, then one for each prior."""

    rows: Array  # (..., m, 6 + f)
    left: Array  # (..., m) residuals


def _equations_of(
    nominal: Array, offset: Array, images: Array, assumed: Array, pose: _Pose, precision: Array
) -> _Equations:
    predicted, slopes = images_of(nominal, offset, *pose)
    batch, sought = assumed.shape[:-1], len(precision)
    free = 6 + sought
    rows, left = slopes[..., :free].reshape(*batch, -1, free), (images - predicted).reshape(*batch, -1)
    weight = np.sqrt(precision)
    known = np.zeros((*batch, sought, free))
    known[..., range(sought), range(6, free)] = weight
    rows = np.concatenate([rows, known], axis=-2)
    left = np.concatenate([left, weight * (assumed - pose.intrinsics)[..., :sought]], axis=-1)
    return _Equations(rows, left)


def _move_pose(pose: _Pose, step: Array) -> _Pose:
    """The pose after a step (..., 6 + f): a turn, a shift, and a change of the first f intrinsics."""
    intrinsics = pose.intrinsics.copy()
    intrinsics[..., : step.shape[-1] - 6] += step[..., 6:]
    return _Pose(turn_by(step[..., :3]) @ pose.rotation, pose.place_mm + step[..., 3:6], intrinsics)


def _largest_move(equations: _Equations, step: Array, precision: Array) -> Array:
    """(...,) px: by how much a step moves the image that it moves most."""
    moves = np.abs(equations.rows @ step[..., None])[..., 0]
    return np.asarray(moves[..., : moves.shape[-1] - len(precision)].max(axis=-1))


def _settle(
    nominal: Array, offset: Array, images: Array, assumed: Array, start: _Pose, precision: Array
) -> tuple[_Pose, Array]:
    """One pose by damped steps, and how far a whole step would still move an image, px."""
    from scipy.optimize import least_squares

    def pose_at(unknowns: Array) -> _Pose:
        return _move_pose(start, unknowns)

    def residuals(unknowns: Array) -> Array:
        return -_equations_of(nominal, offset, images, assumed, pose_at(unknowns), precision).left

    def slopes(unknowns: Array) -> Array:
        """The rows are by a turn after the one of the unknowns; this is by the vector of the one turn that is both."""
        rows = _equations_of(nominal, offset, images, assumed, pose_at(unknowns), precision).rows.copy()
        rows[:, :3] @= left_jacobian(unknowns[:3])
        return rows

    solution = least_squares(
        residuals, np.zeros(6 + len(precision)), slopes, method="lm", x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15,
        max_nfev=DAMPED_STEPS,
    )  # fmt: skip
    pose = pose_at(solution.x)
    equations = _equations_of(nominal, offset, images, assumed, pose, precision)
    return pose, _largest_move(equations, _solve(equations.rows, equations.left), precision)


def _calibration(nominal: Array, change: Array) -> Array:
    """K (..., 3, 3) of the intrinsics that deviate by this change (..., 3) from the nominal ones."""
    matrix = np.broadcast_to(nominal, (*change.shape[:-1], 3, 3)).copy()
    matrix[..., :2, :2] *= (1 + change[..., 0])[..., None, None]
    matrix[..., :2, 2] += change[..., 1:]
    return matrix


class Imaged(NamedTuple):
    """Points as a view images them."""

    images: Array  # (..., N, 2) px
    slopes: Array  # (..., N, 2, 9): by a turn of the structure, its shift (camera frame), and the intrinsics


def images_of(nominal: Array, offset: Array, rotation: Array, place: Array, intrinsics: Array) -> Imaged:
    """Images of points at ``rotation @ offset + place``, by the intrinsics that deviate by so much from nominal."""
    turned = offset @ np.swapaxes(rotation, -1, -2)
    seen = turned + place[..., None, :]
    matrix = _calibration(nominal, intrinsics)
    rays = seen @ np.swapaxes(matrix, -1, -2)
    images = rays[..., :2] / rays[..., 2:]
    by_place = (matrix[..., None, :2, :] - images[..., None] * matrix[..., None, 2:, :]) / rays[..., 2, None, None]
    by_turn = -by_place @ skew(turned)
    by_intrinsics = np.zeros((*images.shape, 3))
    centre = matrix[..., None, :2, 2]
    by_intrinsics[..., 0] = (images - centre) / (1 + intrinsics[..., None, None, 0])
    by_intrinsics[..., 0, 1] = by_intrinsics[..., 1, 2] = 1.0
    return Imaged(images, np.concatenate([by_turn, by_place, by_intrinsics], axis=-1))


def resect_reprojection(points: Array, images: Array) -> Array:
    """Estimate all eleven ratios of a projection by least squares of the images, from DLT; see ``resect``."""
    object_frame, image_frame = hartley_similarity(points), hartley_similarity(images)
    local = homogeneous(points) @ np.swapaxes(object_frame, -1, -2)
    estimate = image_frame @ resect(points, images) @ np.linalg.inv(object_frame)
    seen = (homogeneous(images) @ np.swapaxes(image_frame, -1, -2))[..., :2]
    scale = image_frame[..., 0, 0]
    moved = np.full(images.shape[:-2], np.inf)
    for _ in range(STEPS):
        estimate = estimate / estimate[..., 2:, 3:]  # the depth of the centroid is held
        rays = local @ np.swapaxes(estimate, -1, -2)
        predicted = rays[..., :2] / rays[..., 2:]
        rows = np.zeros((*predicted.shape, 11))
        rows[..., 0, 0:4] = rows[..., 1, 4:8] = local / rays[..., 2:]
        rows[..., 8:] = -predicted[..., None] * (local[..., None, :3] / rays[..., 2, None, None])
        step = _solve(rows.reshape(*rows.shape[:-3], -1, 11), (seen - predicted).reshape(*predicted.shape[:-2], -1))
        change = np.concatenate([step, np.zeros((*step.shape[:-1], 1))], axis=-1)
        estimate = estimate + change.reshape(*step.shape[:-1], 3, 4)
        moved = np.abs(rows @ step[..., None, :, None])[..., 0].max(axis=(-1, -2))
        if not (moved > AT_REST_PX * scale).any():
            break
    projection = np.asarray(np.linalg.solve(image_frame, estimate @ object_frame), dtype=np.float64)
    return np.where((moved <= RESTLESS_PX * scale)[..., None, None], scale_to_depth(projection, points), np.nan)


def estimate_views(system: System, assumed: Array, images: Array, errors: Array | None = None) -> Array:
    """The projections that the system's estimator makes of its fiducials' images; leading dimensions are a batch.

    assumed (..., N, 3) mm; images (..., V, N, 2) px; errors (..., V, 3) of the assumed intrinsics, None:
    they are exact.  Returns (..., V, 3, 4), ``|P[2, :3]| = 1``.
    """
    traits = system.estimator.traits
    known = system.prior_precisions[:, : traits.free_intrinsics]
    projections = []
    for v, (view, weights) in enumerate(zip(system.views, system.sees, strict=True)):
        points, seen = assumed[..., weights > 0, :], images[..., v, :, :][..., weights > 0, :]
        if traits.seeks_pose:
            error = None if errors is None else errors[..., v, :]
            projections.append(resect_pose(points, seen, view, error=error, precision=known[v]))
        else:
            projections.append((resect_reprojection if traits.unknowns else resect)(points, seen))
    return np.stack(projections, axis=-3)


def row_weights(system: System, projections: Array, assumed: Array, point: Array) -> Array:
    """(V, 2, 2) weights of the weighted triangulation: inverse covariance of each view's rows at a point (3,) mm.

    projections (V, 3, 4) with ``|P[2, :3]| = 1`` and assumed (N, 3) mm as the estimator meets them without noise.  The
    covariance is that of the image noise alone, of the target's and of the fiducials' through the resection; the
    estimator knows both.  Only ratios between the weights matter, and they are the same at every noise in proportion.
    """
    traits = system.estimator.traits
    free = traits.free_intrinsics
    known, out = system.prior_precisions[:, :free], np.empty((len(system.views), 2, 2))
    for v, (view, projection, seen) in enumerate(zip(system.views, projections, system.sees, strict=True)):
        used = assumed[seen > 0]
        camera = split(projection)
        centre = used.mean(axis=0)
        place = camera.rotation @ centre + camera.source_mm
        both = np.vstack([used, point])
        if traits.seeks_pose:
            every = images_of(camera.intrinsics, both - centre, camera.rotation, place, np.zeros(3)).slopes
        else:
            every = _eleven(projection, both, used)
        slopes, aim = every[:-1], every[-1]
        rows = slopes.reshape(2 * len(used), -1)
        weight = np.ones(len(used))
        if not traits.unknowns:  # its rows are the images' residuals times the depths
            weight = homogeneous(used) @ projection[2]
        rows = rows * np.repeat(weight, 2)[:, None]
        if traits.seeks_pose:
            rows, aim = rows[:, : traits.unknowns], aim[:, : traits.unknowns]
        prior = np.zeros((free, rows.shape[1]))
        prior[range(free), range(6, 6 + free)] = np.sqrt(known[v])
        gain = np.linalg.pinv(np.vstack([rows, prior]))[:, : len(rows)]
        gain = aim @ gain * np.repeat(weight, 2)
        own = np.eye(2)
        if view.noise_factors is not None:
            gain = (gain.reshape(2, -1, 2) @ view.noise_factors[0]).reshape(2, -1)
            own = view.noise_factors[1] @ view.noise_factors[1].T
        covariance = view.fiducial_noise_px**2 * gain @ gain.T + view.target_noise_px**2 * own
        depth = float(projection[2] @ np.append(point, 1.0))
        out[v] = np.linalg.inv(covariance) / depth**2
    return out


@lru_cache(maxsize=2048)  # of all patterns of missed fiducials
def weights_at_rest(system: System, target: Target) -> Array:
    """(V, 2, 2) of the rows of the weighted triangulation at a target: of the structure at its bias, without noise.

    Rounded to eight digits: the last ones are those of a library that sums otherwise on another processor, and the
    digits of a trial are not to depend on it.
    """
    mount = system.structure_connector
    at_bias = torsor_transform(mount.known[None], mount.pivot_mm, system.rotation_form)
    moved = transform_points(at_bias, system.fiducials_mm[None])[0]
    eq18 = system.reading is Reading.EQ18
    assumed, truly = (moved, system.fiducials_mm) if eq18 else (system.fiducials_mm, moved)
    estimates = estimate_views(system, assumed, np.stack([project(view.projection, truly) for view in system.views]))
    aims = np.stack([project(view.projection, target.position_mm[None])[0] for view in system.views])
    weights = row_weights(system, estimates, assumed, triangulate(estimates, aims, assumed))
    return frozen([[[float(f"{entry:.7e}") for entry in row] for row in view] for view in weights.tolist()])


def _eleven(projection: Array, points: Array, assumed: Array) -> Array:
    """(n, 2, 11) slopes of the images of points (n, 3) by the ratios of a projection, in the fiducials' frame."""
    frame = hartley_similarity(assumed)
    local = homogeneous(points) @ frame.T
    rays = homogeneous(points) @ projection.T
    rows = np.zeros((len(points), 2, 11))
    rows[:, 0, 0:4] = rows[:, 1, 4:8] = local / rays[:, 2:]
    rows[..., 8:] = -(rays[:, :2] / rays[:, 2:])[..., None] * (local[:, None, :3] / rays[:, 2, None, None])
    return rows


def locate(system: System, projections: Array, images: Array, assumed: Array, weights: Array | None = None) -> Array:
    """The target by the system's triangulation; leading dimensions are a batch.

    projections (..., V, 3, 4), images (..., V, 2) px, assumed (..., N, 3) mm, weights (V, 2, 2) of the weighted form
    (``row_weights``).  Returns (..., 3) mm, NaN where a projection is.
    """
    known = np.asarray(np.isfinite(projections).all(axis=(-1, -2, -3)))[..., None]
    met = np.where(known[..., None, None], projections, system.projections)
    return np.where(known, _locate(system, met, images, assumed, weights), np.nan)


def _locate(system: System, projections: Array, images: Array, assumed: Array, weights: Array | None) -> Array:
    weighing, factors = system.triangulation.traits.weighing, None
    if weighing is Weighing.BY_NOISE:
        assert weights is not None
        factors = np.asarray(np.linalg.cholesky(weights), dtype=np.float64)
    point = triangulate(projections, images, assumed, system.triangulation, factors)
    if weighing is not Weighing.BY_IMAGES:
        return point
    for _ in range(STEPS):
        rays = (projections @ homogeneous(point)[..., None, :, None])[..., 0]
        predicted = rays[..., :2] / rays[..., 2:]
        rows = (projections[..., :2, :3] - predicted[..., None] * projections[..., 2:, :3]) / rays[..., 2, None, None]
        step = _solve(rows.reshape(*rows.shape[:-3], -1, 3), (images - predicted).reshape(*predicted.shape[:-2], -1))
        point = point + step
        if not (np.abs(step).max(axis=-1) > 1e-10).any():
            break
    return np.where((np.abs(step).max(axis=-1) <= 1e-9)[..., None], point, np.nan)

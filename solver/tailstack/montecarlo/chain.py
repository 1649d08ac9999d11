"""Trials by index or by given deviates: the kernel, with every flagged trial redone by SVD.

The same chain by full singular value decompositions is for flagged trials, and where no reduction is exact: plain
NumPy on the estimator of ``tailstack.estimation``, batched over trials: about a hundred times
slower than the kernel, without its conditions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import OutOfRangeError, Problem
from ..estimation.resection import project, resect
from ..estimation.triangulation import reprojection_rms, triangulate
from ..geometry.rotation import torsor_transform, transform_points
from ..system import Reading
from .kernel import Draws, Results, run_trials, scratch_size
from .plan import ChainPlan
from .streams import draw_columns, stream_key

SVD_BATCH = 1024  # trials per batched SVD: about 5 MB of design matrices at 12 fiducials
EVALUATE_BATCH = 8192
_NOT_GIVEN = np.empty((0, 0))
_NO_KEYS = np.zeros(2, dtype=np.uint64)


class Outcome(NamedTuple):
    """Results of one run of trials, in the order of their indices."""

    errors: Array  # (T, 2, 3, n): TCP error in tcp, localisation error in con; mm
    redone: int  # trials that went through SVD because the structured solution was not proven
    reprojection: Array | None  # (n,) px


def _allocate_scratch(size: int) -> Array:
    """Scratch that starts on a 64-byte line: eight lanes never straddle two."""
    raw = np.empty(size + 8)
    shift = (-raw.ctypes.data // 8) % 8
    return raw[shift : shift + size]


def _keys(seed: int) -> NDArray[np.uint64]:
    if seed < 0:
        raise OutOfRangeError(Problem("", "seed", f"a seed is a non-negative integer, got {seed}"))
    return np.array([stream_key(seed, 0), stream_key(seed, 1)])


def _pad(indices: NDArray[np.int64]) -> NDArray[np.int64]:
    """To a multiple of eight, by repeating the last index."""
    return np.concatenate([indices, np.repeat(indices[-1:], -len(indices) % 8)])


def draw(plan: ChainPlan, seed: int, indices: NDArray[np.int64]) -> Array:
    """Standardised deviates z (n, d) of the trials with these indices (columns: see ``plan``)."""
    trials = _pad(np.asarray(indices, dtype=np.int64))
    out = np.empty((plan.dimension, len(trials)))
    scratch = _allocate_scratch(8 * plan.dimension)
    draw_columns(plan.tables.segments, _keys(seed), trials // plan.shots_per_unit, trials, scratch, out)
    return np.ascontiguousarray(out[:, : len(indices)].T)


def standard_normals(seed: int, stream: int, count: int, dimension: int) -> Array:
    """(count, dimension) N(0, 1) from a stream of its own (2 or more; 0 and 1 are the trials')."""
    indices = _pad(np.arange(count, dtype=np.int64))
    out = np.empty((dimension, len(indices)))
    keys = np.array([stream_key(seed, stream), stream_key(seed, stream)])
    segments = np.array([[0, dimension, 0, 0]], dtype=np.int64)
    draw_columns(segments, keys, indices, indices, _allocate_scratch(8 * dimension), out)
    return out[:, :count].T


def _run(
    plan: ChainPlan, keys: NDArray[np.uint64], trials: NDArray[np.int64], given: Array, reprojection: bool
) -> Results:
    n = len(trials)
    results = Results(np.empty(6 * len(plan.system.targets) * n), np.empty(n), np.empty(n if reprojection else 0))
    draws = Draws(keys, trials // plan.shots_per_unit, trials, given)
    run_trials(plan.tables, draws, results, _allocate_scratch(int(scratch_size(plan.tables.counts))))
    return results


def _redo(plan: ChainPlan, z: Array, columns: NDArray[np.int64], errors: Array, rms: Array | None) -> None:
    """Overwrite these columns of ``errors`` (T, 2, 3, n) by the full SVD chain of their deviates."""
    for start in range(0, len(columns), SVD_BATCH):
        part = columns[start : start + SVD_BATCH]
        exact, reprojection = errors_by_svd(plan, z[start : start + SVD_BATCH])
        errors[..., part] = np.moveaxis(exact, 0, -1)
        if rms is not None:
            rms[part] = reprojection


def run_indices(plan: ChainPlan, seed: int, first: int, count: int, *, reprojection: bool = False) -> Outcome:
    """Trials first ... first + count - 1 of this seed."""
    indices = np.arange(first, first + count, dtype=np.int64)
    shape = (len(plan.system.targets), 2, 3)
    errors, flags, rms = _run(plan, _keys(seed), _pad(indices), _NOT_GIVEN, reprojection)
    errors, rms = errors.reshape(*shape, -1)[..., :count], rms[:count]
    columns = np.flatnonzero(flags[:count])
    if len(columns):
        _redo(plan, draw(plan, seed, indices[columns]), columns, errors, rms if reprojection else None)
    return Outcome(errors, len(columns), rms if reprojection else None)


def evaluate(plan: ChainPlan, z: Array) -> Array:
    """Errors (n, T, 2, 3), mm, of standardised deviates z (n, d); axis 2: TCP (tcp), localisation (con).

    Raises OutOfRangeError when z has not ``plan.dimension`` columns.
    """
    z = np.asarray(z, dtype=np.float64)
    if z.ndim != 2 or z.shape[1] != plan.dimension:
        detail = f"z must be (n, {plan.dimension}), one column per random input; got {z.shape}"
        raise OutOfRangeError(Problem("", "deviates-shape", detail))
    out = np.empty((len(z), len(plan.system.targets), 2, 3))
    for start in range(0, len(z), EVALUATE_BATCH):
        part = z[start : start + EVALUATE_BATCH]
        trials = np.arange(len(part) + (-len(part)) % 8)
        given = np.zeros((max(plan.dimension, 1), len(trials)))
        given[: plan.dimension, : len(part)] = part.T
        errors, flags, _ = _run(plan, _NO_KEYS, trials, given, False)
        errors = errors.reshape(len(plan.system.targets), 2, 3, -1)[..., : len(part)]
        columns = np.flatnonzero(flags[: len(part)])
        if len(columns):
            _redo(plan, part[columns], columns, errors, None)
        out[start : start + len(part)] = np.moveaxis(errors, -1, 0)
    return out


def errors_by_svd(plan: ChainPlan, z: Array) -> tuple[Array, Array]:
    """Errors (n, T, 2, 3) mm and reprojection RMS (n,) px of standardised deviates z (n, d).

    Axis 2: TCP error (tcp), localisation error (con).
    """
    system, tables = plan.system, plan.tables
    count, views, targets = len(system.fiducials_mm), len(system.views), len(system.targets)
    trials = len(z)
    eq18 = system.reading is Reading.EQ18
    points = np.broadcast_to(system.fiducials_mm, (trials, count, 3))
    true = points
    if tables.counts[3]:
        start = tables.starts[0]
        true = points + tables.spread * z[:, start : start + 3 * count].reshape(trials, count, 3)

    transforms = []
    for k, mount in enumerate((*system.interfaces, system.hand_eye)):
        offset, sources = tables.gain_starts[k]
        gain = tables.gains[offset : offset + 6 * sources].reshape(6, sources)
        start = tables.starts[1 + k]
        torsor = tables.torsors[k] + z[:, start : start + sources] @ gain.T
        transforms.append(torsor_transform(torsor, mount.pivot_mm, system.rotation_form))
    told = transform_points(transforms[0], points) if eq18 else points
    true = true if eq18 else transform_points(transforms[0], true)

    noise = z[:, : 2 * views * (count + targets)].reshape(trials, views, count + targets, 2)
    sigma = tables.noise[:, None, :]  # (V, 1, kind)
    exact = np.stack([project(view.projection, true) for view in system.views], axis=1)
    images = exact + sigma[:, :, :1] * noise[:, :, :count]
    weights = system.sees
    each = [resect(told[:, used > 0], images[:, v, used > 0]) for v, used in enumerate(weights)]
    estimates = np.stack(each, axis=1)
    reprojection = reprojection_rms(estimates, told, images, weights)

    offset, sources = tables.gain_starts[3]
    gain = tables.gains[offset : offset + 3 * sources].reshape(3, sources)
    executed = z[:, tables.starts[4] : tables.starts[4] + sources] @ gain.T + tables.execution_bias
    errors = np.empty((trials, targets, 2, 3))
    tcp_con = system.T_tcp_con
    for t, target in enumerate(system.targets):
        seen = np.stack([project(view.projection, target.position_mm[None])[0] for view in system.views])
        noisy = seen + sigma[:, 0, 1:] * noise[:, :, count + t]
        found = triangulate(estimates, noisy, told, system.triangulation)
        errors[:, t, 1] = found - target.position_mm
        tool = transform_points(transforms[1], found[:, None])
        tool = transform_points(transforms[2], transform_points(tcp_con, tool[:, 0])[:, None])[:, 0]
        errors[:, t, 0] = tool + executed - transform_points(tcp_con, target.position_mm)
    return errors, reprojection

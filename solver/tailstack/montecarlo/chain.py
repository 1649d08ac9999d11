"""Trials by index or by given deviates: the kernel, with every flagged trial redone by SVD."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import OutOfRangeError, Problem
from ..system import Array
from .full_svd import errors_by_svd
from .kernel import run_trials, scratch_size
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


def _aligned(size: int) -> Array:
    """Scratch that starts on a 64-byte line: eight lanes never straddle two."""
    raw = np.empty(size + 8)
    shift = (-raw.ctypes.data // 8) % 8
    return raw[shift : shift + size]


def _keys(seed: int) -> NDArray[np.uint64]:
    if seed < 0:
        raise OutOfRangeError(Problem("", "seed", f"a seed is a non-negative integer, got {seed}"))
    return np.array([stream_key(seed, 0), stream_key(seed, 1)])


def _padded(indices: NDArray[np.int64]) -> NDArray[np.int64]:
    """To a multiple of eight, by repeating the last index."""
    return np.concatenate([indices, np.repeat(indices[-1:], -len(indices) % 8)])


def draw(plan: ChainPlan, seed: int, indices: NDArray[np.int64]) -> Array:
    """Standardised deviates z (n, d) of the trials with these indices (columns: see ``plan``)."""
    trials = _padded(np.asarray(indices, dtype=np.int64))
    out = np.empty((plan.dimension, len(trials)))
    scratch = _aligned(8 * plan.dimension)
    draw_columns(plan.tables.segments, _keys(seed), trials // plan.shots_per_unit, trials, scratch, out)
    return np.ascontiguousarray(out[:, : len(indices)].T)


def standard_normals(seed: int, stream: int, count: int, dimension: int) -> Array:
    """(count, dimension) N(0, 1) from a stream of its own (2 or more; 0 and 1 are the trials')."""
    indices = _padded(np.arange(count, dtype=np.int64))
    out = np.empty((dimension, len(indices)))
    keys = np.array([stream_key(seed, stream), stream_key(seed, stream)])
    segments = np.array([[0, dimension, 0, 0]], dtype=np.int64)
    draw_columns(segments, keys, indices, indices, _aligned(8 * dimension), out)
    return out[:, :count].T


def _run(
    plan: ChainPlan, keys: NDArray[np.uint64], trials: NDArray[np.int64], given: Array, reprojection: bool
) -> tuple[Array, Array, Array]:
    n = len(trials)
    errors, flags = np.empty(6 * len(plan.system.targets) * n), np.empty(n)
    rms = np.empty(n if reprojection else 0)
    scratch = _aligned(int(scratch_size(plan.tables.counts)))
    units = trials // plan.shots_per_unit
    run_trials(plan.tables, keys, units, trials, given, errors, flags, rms, reprojection, scratch)
    return errors, flags, rms


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
    errors, flags, rms = _run(plan, _keys(seed), _padded(indices), _NOT_GIVEN, reprojection)
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

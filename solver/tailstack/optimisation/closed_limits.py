"""The limits of a fixed layout as functions of the half-widths: Pearson's closed form, through what was read last.

With the layout fixed a half-width multiplies a column of the law, so that its moments are polynomials in the
half-widths.  A closed form is some per cent wrong, and more for a mean of the tail or a quantile over units; times
``exp(level + tilt . log h)`` it has the value that was read of the exact law, and the slopes where these were read, and
bends as the law does.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.special import ndtri

from ..contributors import WorstCase, columns_of
from ..geometry.arrays import Array
from ..laws import Drawn
from ..propagation.linear import ErrorModel
from ..system import Law
from ..tail.approximation import columns_in_cumulants
from .exact_law import LEAST_LEVEL
from .least_cost import LEAST, ClosedLimits
from .problem import QuantileConstraint

Place = tuple[int, int]  # of a half-width: its block in the linear model, and its source in that


def close_limits(
    demands: Sequence[QuantileConstraint],
    models: Sequence[ErrorModel],
    places: Sequence[Sequence[Place]],
    ends: Sequence[WorstCase],
    half_width: Array,
) -> ClosedLimits:
    """Of limits (T), their linear models, where in each the half-widths are, and the worst ends at half-widths (K,)."""
    parts, known = [], dict[tuple[object, ...], tuple[Array, Array]]()
    for demand, model, own, worst in zip(demands, models, places, ends, strict=True):
        row = demand.requirement
        key = id(model), row.error, row.level, worst.mean_mm.tobytes()
        if key not in known:
            known[key] = _moments(model, row.error, row.level, own, worst, half_width)
        fixed, added = known[key]
        every = (LEAST * row.limit) ** 2 * np.eye(3)
        least = _pack(np.zeros(3), every, np.zeros((3, 3)), every, np.zeros(()), np.zeros(()))
        level = demand.fraction if demand.is_nested else sum(level * weight for level, weight in row.mixture)
        normal = ndtri(max(level, LEAST_LEVEL)), ndtri(row.quantile)
        parts.append(
            (fixed + least, added, *normal, demand.is_nested, float(row.limit), 0.0, np.zeros(len(half_width)))
        )
    stacked: list[Any] = [np.array(each) for each in zip(*parts, strict=True)]
    return ClosedLimits(*stacked)


def _moments(
    model: ErrorModel, error: str, level: Drawn | None, places: Sequence[Place], worst: WorstCase, half_width: Array
) -> tuple[Array, Array]:
    """(32,) and (K, 32), as ``ClosedLimits`` has them, of a law."""
    columns, first = columns_of(model, error), np.cumsum([0, *(len(block.laws) for block in model.blocks)])
    held = columns.constant_in(level) if level else np.full(len(columns.kinds), True)
    own, fixed = np.array([first[b] + j for b, j in places]), np.full(len(columns.kinds), True)
    fixed[own] = False
    scaled = columns.gain * columns.std
    rows = max((slice(k, k + 3) for k in range(0, len(scaled), 3)), key=lambda k: float((scaled[k] ** 2).sum()))
    gain, kinds, stays = columns.gain[rows][:, own].T, columns.kinds[own], held[own]
    signs = np.zeros(len(places))
    for k, (b, j) in enumerate(places):
        if model.blocks[b].laws[j] is Law.BOUNDED:
            signs[k] = worst.signs.get((model.blocks[b].contributor, j), 1.0)
    still, shot, wide = scaled[rows][:, fixed & held], scaled[rows][:, fixed & ~held], fixed & held & columns.wide
    c2, c3, shape = columns_in_cumulants((columns.gain * columns.half_width)[rows][:, wide], columns.kinds[wide])
    each = gain * np.array([model.blocks[b].effect.sources.std_per_half_width[j] for b, j in places])[:, None]
    ends, once, again = signs[:, None], (stays & (signs == 0))[:, None], ~stays[:, None]
    by_c2, by_c3, by_shape = columns_in_cumulants(
        (gain * (once & (kinds >= 0)[:, None]))[:, :, None], np.maximum(kinds, 0)[:, None]
    )
    moments = worst.mean_mm[rows] - half_width @ (gain * ends), still @ still.T, shape, shot @ shot.T, c2, c3
    return _pack(*moments), _pack(gain * ends, _square(each * once), by_shape, _square(each * again), by_c2, by_c3)


def _square(columns: Array) -> Array:
    """(K, 3, 3) of columns (K, 3)."""
    return columns[:, :, None] * columns[:, None, :]


def _pack(*moments: Array) -> Array:
    """(..., 32) moments (..., 3), (..., 3, 3) thrice, (...) twice, one after the other as ``DEGREES`` has them."""
    mean, *matrices, c2, c3 = moments
    flat = (each.reshape(*each.shape[:-2], 9) for each in matrices)
    return np.concatenate([mean, *flat, c2[..., None], c3[..., None]], axis=-1)

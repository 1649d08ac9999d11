"""The limits of a fixed layout as functions of the half-widths: Pearson's closed form, through what was read last.

With the layout fixed a half-width multiplies a column of the law, so that the cumulants are polynomials in the
half-widths, and values and slopes of all limits cost what some ten products of small matrices do.  A closed form is
some per cent wrong, and more for a mean of the tail or a quantile over units; times ``exp(level + tilt . log h)`` it
has the value that was read of the exact law, and the slopes where these were read, and bends as the law does.

Of units, or mountings, the offset d has E[dd'] = D where |d| is at its quantile (``tail/approximation.py``, Q = I), and
R^2 is Pearson's form of the shots at D; how the shape of D moves with the half-widths is left to the tilt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from ..contributors import WorstCase, columns_of
from ..geometry.arrays import Array
from ..laws import Drawn
from ..propagation.linear import ErrorModel
from ..system import Law
from ..tail.approximation import KAPPA4, KAPPA6, columns_in_cumulants, pearson_square
from .exact_law import LEAST_LEVEL
from .problem import QuantileConstraint

Place = tuple[int, int]  # of a half-width: its block in the linear model, and its source in that
LEAST = 1e-6  # of a limit: a standard deviation that every law has, as the form has no value without any
_TINY = 1e-20  # of a complex step


@dataclass(frozen=True, slots=True, eq=False)
class ClosedLimits:
    """T limits by K half-widths, mm or the unit of each measure; of two vectors the one that varies more.

    Pooled, everything is held; of units or mountings, what is drawn again is the shot.
    """

    mean: Array  # (T, 3) with no half-width
    covariance: Array  # (T, 3, 3) of what is fixed and held
    in_c2: Array  # (T,) of columns that are: ``columns_in_cumulants``
    in_c3: Array  # (T,)
    shape: Array  # (T, 3, 3)
    pushes: Array  # (T, 3, K) of the mean, per half-width: bounded ones at their ends
    gains: Array  # (T, 3, K) per half-width, of what is held and not bounded
    std: Array  # (T, K) standard deviations per half-width
    kappa4: Array  # (T, K) cumulants of one half-width
    kappa6: Array  # (T, K)
    normal: Array  # (T,) quantiles of the standard normal law, of what is held
    shot: Array  # (T, 3, 3) of what is fixed and drawn again
    shot_gains: Array  # (T, 3, K) standard deviations, mm, per half-width
    normal_of_shots: Array  # (T,)
    nested: NDArray[np.bool_]  # (T,)
    limit: Array  # (T,)
    level: Array  # (T,) of the logarithm of the square, as read
    tilt: Array  # (T, K)

    def log_squares(self, half_width: Array) -> tuple[Array, Array]:
        """Logarithms (T,) of the squares of all values over their limits at half-widths (K,), and their slopes (T, K)
        by the logarithms of the half-widths."""
        g, p = self.gains * half_width, self.pushes * half_width
        s, m = g * self.std[:, None], self.mean + p.sum(axis=2)
        covariance = self.covariance + s @ np.swapaxes(s, 1, 2)
        gg, at = (g * g).sum(axis=1), m[:, :, None]
        shape = self.shape + (g * (1.5 * self.kappa4 * gg)[:, None]) @ np.swapaxes(g, 1, 2)
        second, square = covariance + at * m[:, None, :], covariance @ covariance
        c_m, c_s, m_s, m_p = covariance @ at, covariance @ s, (at * s).sum(axis=1), (at * p).sum(axis=1)
        c1 = np.trace(second, axis1=1, axis2=2)
        c2 = np.trace(square, axis1=1, axis2=2) + 2 * (at * c_m).sum(axis=(1, 2)) + self.in_c2
        c2 += (self.kappa4 / 2 * gg**2).sum(axis=1)
        c3 = (square * covariance).sum(axis=(1, 2)) + 3 * (c_m * c_m).sum(axis=(1, 2)) + self.in_c3
        c3 += (shape * second).sum(axis=(1, 2)) + (self.kappa6 / 8 * gg**3).sum(axis=1)
        by_c1 = 2 * (s * s).sum(axis=1) + 2 * m_p
        by_c2 = 4 * (s * c_s + c_m * p).sum(axis=1) + 4 * m_s**2 + 2 * self.kappa4 * gg**2
        by_c3 = (6 * (c_s * c_s + (square @ at) * p) + 2 * (s * (shape @ s) + p * (shape @ at))).sum(axis=1)
        by_c3 += 12 * m_s * (c_m * s).sum(axis=1)
        by_c3 += 6 * self.kappa4 * gg * (g * (second @ g)).sum(axis=1) + 0.75 * self.kappa6 * gg**3
        cumulants, slopes = (c1, c2, c3), (by_c1, by_c2, by_c3)
        found = _pearson(cumulants, slopes, self.normal)
        if (own := self.nested).any():
            none, each = np.zeros((len(c1), 1)), np.full((len(c1), 1), 1 / _TINY)
            by_c2 = _pearson(cumulants, (none, each, none), self.normal).imag
            by_c3 = _pearson(cumulants, (none, none, each), self.normal).imag
            cross = c_m * m[:, None, :]
            offset = second + 2 * by_c2[..., None] * (square + cross + np.swapaxes(cross, 1, 2) + shape / 3)
            offset += 3 * by_c3[..., None] * square @ covariance
            found[own] = self._of_shots(own, half_width, offset[own], found[own])
        logs = np.log(found)
        value = logs.real[:, 0] - 2 * np.log(self.limit) + self.level + self.tilt @ np.log(half_width)
        return value, logs.imag / _TINY + self.tilt

    def _of_shots(self, own: NDArray[np.bool_], half_width: Array, offset: Array, square: Array) -> Array:
        """(n, K) squared values of these limits, with their slopes in the imaginary part, where the squared offsets
        (n, K) are at their quantile; offset (n, 3, 3): in proportion to D."""
        s = self.shot_gains[own] * half_width
        covariance = self.shot[own] + s @ np.swapaxes(s, 1, 2)
        offset = offset / np.trace(offset, axis1=1, axis2=2)[:, None, None]
        twice, c_s = covariance @ covariance, covariance @ s
        d_2, d_3 = ((each * offset).sum(axis=(1, 2)) for each in (covariance, twice))
        length, d = square.real[:, :1], square.imag / _TINY
        c1 = np.trace(covariance, axis1=1, axis2=2) + length[:, 0]
        c2 = np.trace(twice, axis1=1, axis2=2) + 2 * length[:, 0] * d_2
        c3 = (twice * covariance).sum(axis=(1, 2)) + 3 * length[:, 0] * d_3
        by_c2 = 4 * (s * c_s).sum(axis=1) + 4 * length * (s * (offset @ s)).sum(axis=1) + 2 * d * d_2[:, None]
        by_c3 = 6 * (c_s * c_s).sum(axis=1) + 12 * length * (s * (offset @ c_s)).sum(axis=1) + 3 * d * d_3[:, None]
        return _pearson((c1, c2, c3), (2 * (s * s).sum(axis=1) + d, by_c2, by_c3), self.normal_of_shots[own])

    def anchor(self, logs: Array, ratios: Array) -> None:
        """Lead each through its value over its limit (T,) as read where the squares had these logarithms (T,); NaN: it
        was not read."""
        self.level[:] += np.where(np.isnan(ratios), 0.0, 2 * np.log(np.maximum(ratios, LEAST)) - logs)

    def turn(self, t: int, half_width: Array, slopes: Array) -> None:
        """Give one, at half-widths (K,), the slopes (K,) that were read there of the logarithm of its value."""
        moved = 2 * slopes - self.log_squares(half_width)[1][t]
        self.tilt[t] += moved
        self.level[t] -= float(moved @ np.log(half_width))


def _pearson(cumulants: Sequence[Array], slopes: Sequence[Array], normal: Array) -> Array:
    """Pearson's form (T, K) at cumulants (T,), what it gains by their slopes (T, K) times ``_TINY`` imaginary."""
    moved = [each[:, None] + 1j * _TINY * by for each, by in zip(cumulants, slopes, strict=True)]
    z: Any = normal[:, None]
    return np.asarray(pearson_square(moved[0], moved[1], moved[2], z))


def close_limits(
    demands: Sequence[QuantileConstraint],
    models: Sequence[ErrorModel],
    places: Sequence[Sequence[Place]],
    ends: Sequence[WorstCase],
    half_width: Array,
) -> ClosedLimits:
    """Of limits (T), their linear models, where in each the half-widths are, and the worst ends at half-widths (K,)."""
    parts, known = [], dict[tuple[object, ...], tuple[Array, ...]]()
    for demand, model, own, worst in zip(demands, models, places, ends, strict=True):
        row = demand.requirement
        key = id(model), row.error, row.level, worst.mean_mm.tobytes()
        if key not in known:
            known[key] = _moments(model, row.error, row.level, own, worst, half_width)
        least = (LEAST * row.limit) ** 2 * np.eye(3)
        mean, covariance, *others, shot, shot_gains = known[key]
        level = demand.fraction if demand.nested else sum(level * weight for level, weight in row.mixture)
        normal = ndtri(max(level, LEAST_LEVEL)), ndtri(row.quantile)
        law = mean, covariance + least, *others, normal[0], shot + least, shot_gains, normal[1]
        parts.append((*law, demand.nested, row.limit, 0.0, np.zeros(len(half_width))))
    stacked: list[Any] = [np.array(each) for each in zip(*parts, strict=True)]
    return ClosedLimits(*stacked)


def _moments(
    model: ErrorModel, error: str, level: Drawn | None, places: Sequence[Place], worst: WorstCase, half_width: Array
) -> tuple[Array, ...]:
    """The fields of a limit on an error that are of its law, in their order."""
    columns, first = columns_of(model, error), np.cumsum([0, *(len(block.laws) for block in model.blocks)])
    held = columns.constant_in(level) if level else np.full(len(columns.kinds), True)
    own, fixed = np.array([first[b] + j for b, j in places]), np.full(len(columns.kinds), True)
    fixed[own] = False
    scaled = columns.gain * columns.std
    rows = max((slice(k, k + 3) for k in range(0, len(scaled), 3)), key=lambda k: float((scaled[k] ** 2).sum()))
    gain, kinds, stays = columns.gain[rows][:, own], columns.kinds[own], held[own]
    signs = np.zeros(len(places))
    for k, (b, j) in enumerate(places):
        if model.blocks[b].laws[j] is Law.BOUNDED:
            signs[k] = worst.signs.get((model.blocks[b].contributor, j), 1.0)
    still, shot, wide = scaled[rows][:, fixed & held], scaled[rows][:, fixed & ~held], fixed & held & columns.wide
    std = np.array([model.blocks[b].effect.sources.std_per_half_width[j] for b, j in places])
    return (
        worst.mean_mm[rows] - (gain * signs) @ half_width,
        still @ still.T,
        *columns_in_cumulants((columns.gain * columns.half_width)[rows][:, wide], columns.kinds[wide]),
        gain * signs,
        np.where(stays & (signs == 0), gain, 0.0),
        std,
        np.where(kinds >= 0, np.array(KAPPA4)[kinds], 0.0),
        np.where(kinds >= 0, np.array(KAPPA6)[kinds], 0.0),
        shot @ shot.T,
        np.where(stays, 0.0, gain * std),
    )

"""Two vectors that go together: where one is within a radius and the other is not, by rays.

x = m + N(0, S) + sum_j h_j u_j holds both, three components each.  Bounded sources u are sampled by scrambled Sobol
points (16 scramblings, for a standard error), the Gaussian part along rays: rho A n with A A' = S of rank k, n uniform
on the sphere in k dimensions and rho a chi variable of k degrees of freedom (directional sampling; Bjerager 1988).
Along a ray each vector is within r for an interval of rho, whose probability is known exactly.

A is the symmetric root of S on a basis of its range that no spread turns, so that everything read from the same rays is
smooth in m, S and h: where the ends of an interval go is all that derivatives need.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import erf, exp, gamma, inf, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from ..kernels.store import kernel
from ..laws import shape_deviates
from ..measures.corridor import radius_within
from .sampling import sobol_points

LOG2_POINTS, LOG2_RARE = 10, 14  # of each scrambling; the second for probabilities that few rays meet
_SAME = 1e-12  # relative: a variance that small beside the largest is rounding
_LEANS = 0.3  # sine of the angle at which a vector is a direction of its own beside others
SMALLEST_MM = 1e-9  # radius below which none is told apart
ABOUT, STEPS, SOLVED = 0.01, 60, 1e-7  # of a radius at which a probability is looked for; the others relative
FARTHEST = 1e3  # of a chi variable


class PairGradient(NamedTuple):
    """Derivatives of a probability."""

    by_mean: Array  # (6,) 1/mm
    by_covariance: Array  # (6, 6) 1/mm^2, symmetric
    by_columns: Array  # (6, K) 1/mm


@dataclass(frozen=True, eq=False)
class PairSample:
    """n rays of the law of two vectors about its mean, ``start + rho gain``."""

    degrees: int  # of freedom of rho
    u: Array  # (n, K) deviates of the columns
    direction: Array  # (n, k) on the sphere
    root: Array  # (6, k) mm
    start: Array  # (2, 3, n) mm
    gain: Array  # (2, 3, n) mm

    def inside(self, mean: Array, r: float, room: Array) -> Array:
        """(2, 2, n) between which rho each vector of the law at a mean (6,) mm is within r; 0 and 0 where it never is.
        room (6,) mm: by how much what each component may come to is more than r."""
        return np.asarray(between(mean, r, room, self.start, self.gain))

    def outside(self, mean: Array, r: float, room: Array, first: int) -> Array:
        """(n,) P(|x_first| <= r < |x_other|) on each ray."""
        (low, high), k = self.inside(mean, r, room), self.degrees
        both = np.maximum(chi_below(high.min(axis=0), k) - chi_below(low.max(axis=0), k), 0.0)
        return np.asarray(np.maximum(chi_below(high[first], k) - chi_below(low[first], k) - both, 0.0))

    def shares(self, mean: Array, r: float, room: Array) -> Array:
        """(n,) P(both <= r) on each ray."""
        low, high = self.inside(mean, r, room)
        below = chi_below(high.min(axis=0), self.degrees) - chi_below(low.max(axis=0), self.degrees)
        return np.asarray(np.maximum(below, 0.0))

    def quantiles(self, means: Array, p: float, room: Array, guess: Array) -> Array:
        """(m,) mm, the r with P(both <= r) = p of laws at means (m, 6) mm; guess (m,) mm: where it is looked for."""
        return np.asarray(solve_rays(means, p, room, guess, self.start, self.gain, self.degrees))

    def slopes(self, mean: Array, r: float, room: Array, first: int) -> PairGradient:
        """Derivatives of P(|x_first| <= r < |x_other|)."""
        (low, high), count, other = self.inside(mean, r, room), self.start.shape[2], 1 - first
        together = high.min(axis=0) > low.max(axis=0)
        by_start, by_gain = np.zeros((2, 2, 3, count))
        for sign, ends, nearer in ((1.0, high, np.less), (-1.0, low, np.greater)):
            beyond = nearer(ends[other], ends[first])  # where the other one ends first
            takes = {first: np.where(together & ~beyond, 0.0, sign), other: np.where(together & beyond, -sign, 0.0)}
            for k, times in takes.items():
                rho = np.where(np.isfinite(ends[k]) & (ends[k] > 0.0), ends[k], 0.0)
                wide = np.maximum(r, SMALLEST_MM) + room.reshape(2, 3)[k][:, None]
                normal = (mean.reshape(2, 3)[k][:, None] + self.start[k] + rho * self.gain[k]) / wide**2
                slope = (normal * self.gain[k]).sum(axis=0)
                density = np.where((rho > 0.0) & (slope != 0.0), times * self._density(rho), 0.0)
                by_start[k] -= normal * density / np.where(slope != 0.0, slope, 1.0)
                by_gain[k] -= normal * rho * density / np.where(slope != 0.0, slope, 1.0)
        by_start, by_gain = by_start.reshape(6, -1), by_gain.reshape(6, -1)
        by_root = by_gain @ self.direction[:, : self.root.shape[1]] / count
        return PairGradient(by_start.mean(axis=1), self._by_covariance(by_root), by_start @ self.u / count)

    def _by_covariance(self, by_root: Array) -> Array:
        """(6, 6) of derivatives by the root (6, k): with S = X X, X symmetric, ``dS = dX X + X dX``."""
        if not self.root.size:
            return np.zeros((6, 6))
        axes, sizes, basis = np.linalg.svd(self.root, full_matrices=False)
        by_symmetric = by_root @ (axes @ basis).T  # root = X B with the basis B = axes @ basis
        along = axes.T @ (by_symmetric + by_symmetric.T) @ axes / 2
        return np.asarray(axes @ (along / (sizes[:, None] + sizes)) @ axes.T)

    def _density(self, rho: Array) -> Array:
        """Of the chi variable."""
        k = self.degrees
        return np.asarray(2 ** (1 - k / 2) / gamma(k / 2) * rho ** (k - 1) * np.exp(-(rho**2) / 2))


def sample_pair(
    covariance: Array, columns: Array, kinds: NDArray[np.int64], log2_points: int = LOG2_POINTS
) -> PairSample:
    """Rays of the law of two vectors about its mean: covariance (6, 6) mm^2, columns (6, K) mm of sources of these
    laws (K,), places in SUMS."""
    variances, axes = np.linalg.eigh(covariance)
    kept = variances > _SAME * max(variances[-1], 0.0)
    axes = axes[:, kept]
    root = (axes * np.sqrt(variances[kept])) @ axes.T @ span_of(axes)
    felt = columns.any(axis=0)
    z, some = sobol_points(max(int(kept.sum()), 1), int(felt.sum()), log2_points)
    u = np.zeros((len(z), len(kinds)))
    u[:, felt] = shape_deviates(some, kinds[felt])
    direction = z / np.linalg.norm(z, axis=1, keepdims=True)
    start, gain = columns @ u.T, root @ direction[:, : root.shape[1]].T
    return PairSample(z.shape[1], u, direction, root, start.reshape(2, 3, -1), gain.reshape(2, 3, -1))


def span_of(axes: Array) -> Array:
    """(6, k) an orthonormal basis of what axes (6, k) span, which is the same whichever axes span it."""
    projector, picked = axes @ axes.T, np.zeros_like(axes[:, :0])
    for column in projector.T:
        rest = column - picked @ (picked.T @ column)
        if picked.shape[1] < axes.shape[1] and (size := np.linalg.norm(rest)) > _LEANS:
            picked = np.column_stack([picked, rest / size])
    return picked if picked.shape == axes.shape else axes


def lengths_of(pairs: Array, room: Array | None) -> Array:
    """(n,) mm of pairs of vectors (n, 6): that of the longer; with room (6,) the smallest r at which both are within
    half-axes r + room."""
    if room is None:
        return np.asarray(np.sqrt((pairs.reshape(-1, 2, 3) ** 2).sum(axis=2)).max(axis=1))
    each = [radius_within(pairs[:, k].T, room[k]) for k in (slice(0, 3), slice(3, 6))]
    return np.maximum(*each)


@kernel()
def between(mean: Array, r: float, room: Array, start: Array, gain: Array) -> Array:
    """:meth:`PairSample.inside`; start, gain (2, 3, n)."""
    found = np.empty((2, 2, start.shape[2]))
    for k in range(2):
        for n in range(start.shape[2]):
            within, along, square = -1.0, 0.0, 0.0
            for a in range(3):
                wide = max(r, SMALLEST_MM) + room[3 * k + a]
                x, step = (mean[3 * k + a] + start[k, a, n]) / wide, gain[k, a, n] / wide
                within += x * x
                along += x * step
                square += step * step
            low, high = 0.0, 0.0
            if square == 0.0:
                high = inf if within <= 0.0 else 0.0
            elif along * along >= square * within:
                root = sqrt(along * along - square * within)
                low, high = max((-along - root) / square, 0.0), max((-along + root) / square, 0.0)
            found[0, k, n] = low
            found[1, k, n] = high
    return found


@kernel()
def chi_below(rho: Array, degrees: int) -> Array:
    """(n,) P(chi <= rho), by recursion over the degrees of freedom."""
    found = np.empty(rho.size)
    for n in range(rho.size):
        half = 0.5 * min(rho[n], FARTHEST) ** 2
        falls = exp(-half)
        if degrees % 2 == 1:
            total, term, first = erf(sqrt(half)), 2.0 * sqrt(half / pi) * falls, 3
        else:
            total, term, first = 1.0 - falls, half * falls, 4
        for k in range(first, degrees + 1, 2):
            total -= term
            term *= 2.0 * half / k
        found[n] = total
    return found


@kernel()
def share_within(mean: Array, r: float, room: Array, start: Array, gain: Array, degrees: int) -> float:
    """P(both <= r), the mean over rays."""
    inside = between(mean, r, room, start, gain)
    low, high = np.maximum(inside[0, 0], inside[0, 1]), np.minimum(inside[1, 0], inside[1, 1])
    return float(np.maximum(chi_below(high, degrees) - chi_below(low, degrees), 0.0).mean())


@kernel(nogil=True)
def solve_rays(means: Array, p: float, room: Array, guess: Array, start: Array, gain: Array, degrees: int) -> Array:
    """:meth:`PairSample.quantiles`, by the Illinois method from a bracket that grows until it holds the radius; 0 where
    even that holds more than p."""
    found = np.empty(guess.size)
    for m in range(guess.size):
        mean = means[m]
        low = high = max(guess[m], SMALLEST_MM)
        f_low = f_high = share_within(mean, low, room, start, gain, degrees) - p
        factor = 1.0
        while f_high < 0.0:
            low, f_low = high, f_high
            factor *= 2.0
            high *= 1.0 + ABOUT * factor
            f_high = share_within(mean, high, room, start, gain, degrees) - p
        while f_low > 0.0 and low > 0.0:
            high, f_high = low, f_low
            factor *= 2.0
            low *= max(1.0 - ABOUT * factor, 0.0)
            f_low = share_within(mean, low, room, start, gain, degrees) - p
        if f_low > 0.0:
            found[m] = 0.0
            continue
        r = high
        for _ in range(STEPS):
            if not (high - low > SOLVED * high and f_high > f_low):
                break
            before = r
            r = high - f_high * (high - low) / (f_high - f_low)
            f = share_within(mean, r, room, start, gain, degrees) - p
            if f < 0.0:
                low, f_low, f_high = r, f, 0.5 * f_high
            else:
                high, f_high, f_low = r, f, 0.5 * f_low
            if abs(r - before) <= SOLVED * r:
                break
        found[m] = r
    return found

"""Two vectors that go together: where one is within a radius and the other is not, by rays.

x = m + N(0, S) + sum_j h_j u_j holds both, three components each.  Bounded sources u are sampled by scrambled Sobol
points (16 scramblings, for a standard error), the Gaussian part along rays: rho A n with A A' = S of rank k, n uniform
on the sphere in k dimensions and rho a chi variable of k degrees of freedom (directional sampling; Bjerager 1988).
Along a ray each vector is within r for an interval of rho, whose probability is known exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import gamma, inf, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from ..geometry.arrays import Array
from ..laws import shape_deviates
from .sampling import RANDOMISATIONS, sobol_points

LOG2_POINTS, LOG2_RARE = 10, 14  # of each scrambling; the second for probabilities that few rays meet
_SAME = 1e-12  # relative: a variance that small beside the largest is rounding


@dataclass(frozen=True, slots=True, eq=False)
class PairSample:
    """n rays, ``start + rho gain`` of either vector, by what lengths need of them."""

    degrees: int  # of freedom of rho
    start: Array  # (2, n) squared length at the start of the ray, mm^2
    along: Array  # (2, n) start . gain
    gain: Array  # (2, n) squared length of the gain

    def outside(self, r: float, first: int) -> Array:
        """(n,) P(|x_first| <= r < |x_other|) on each ray; r in mm."""
        within = self.start - r * r
        root = np.sqrt(np.maximum(self.along**2 - self.gain * within, 0.0))
        still = self.gain == 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            low = np.where(still, 0.0, (-self.along - root) / self.gain)
            high = np.where(still, np.where(within <= 0.0, inf, 0.0), (-self.along + root) / self.gain)
        missed = (self.along**2 < self.gain * within) | (still & (within > 0.0))
        low, high = np.maximum(low, 0.0), np.where(missed, 0.0, np.maximum(high, 0.0))
        low = np.where(missed, 0.0, low)
        both = np.maximum(self._below(high.min(axis=0)) - self._below(low.max(axis=0)), 0.0)
        return np.asarray(np.maximum(self._below(high[first]) - self._below(low[first]) - both, 0.0))

    def _below(self, rho: Array) -> Array:
        """P(chi <= rho), by recursion over the degrees of freedom."""
        half = np.minimum(rho, 1e3) ** 2 / 2
        total, start = (erf(np.sqrt(half)), 1) if self.degrees % 2 else (-np.expm1(-half), 2)
        for degrees in range(start + 2, self.degrees + 1, 2):
            total = total - half ** (degrees / 2 - 1) * np.exp(-half) / gamma(degrees / 2)
        return np.asarray(total)


def sample_pair(
    mean: Array, covariance: Array, columns: Array, kinds: NDArray[np.int64], log2_points: int = LOG2_POINTS
) -> PairSample:
    """Rays of the law of two vectors: mean (6,) mm, covariance (6, 6) mm^2, columns (6, K) mm of sources of these
    laws (K,), places in SUMS."""
    variances, axes = np.linalg.eigh(covariance)
    kept = variances > _SAME * max(variances[-1], 0.0)
    root = axes[:, kept] * np.sqrt(variances[kept])
    z, u = sobol_points(max(int(kept.sum()), 1), len(kinds), log2_points)
    u = shape_deviates(u, kinds)
    direction = z / np.linalg.norm(z, axis=1, keepdims=True)
    start = (mean + u @ columns.T).reshape(-1, 2, 3)
    gain = (direction[:, : root.shape[1]] @ root.T).reshape(-1, 2, 3)
    products = ((start * start), (start * gain), (gain * gain))
    return PairSample(z.shape[1], *(np.ascontiguousarray(each.sum(axis=2).T) for each in products))


def mean_and_error(values: Array) -> tuple[float, float]:
    """The mean over rays (n,), and its standard error from the means of the scramblings."""
    blocks = values.reshape(RANDOMISATIONS, -1).mean(axis=1)
    return float(blocks.mean()), float(blocks.std(ddof=1)) / sqrt(RANDOMISATIONS)

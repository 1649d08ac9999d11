"""Statistics of a bench, of many simulated ones at a time: mean, spread, spread between installations, tail.

Every statistic is a fixed function of the measurements, so its distribution under the predicted law is found by
simulating the bench under that law; no asymptotic table is used.  A p-value is (1 + how many of the simulated benches
are at least as extreme) / (1 + their number): its size is exact for any number of them (Barnard 1963, Dwass 1957).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import Literal

import numpy as np

from ...geometry.arrays import Array

TestName = Literal["mean", "spread", "between installations", "tail"]
LEAST_FREEDOM = 4  # degrees of freedom from which three variances and their correlations are tested together
LEAST_FOR_TAIL = 10
TAIL_SHARE = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Expected:
    """Mean and covariances that the statistics are measured in; (3,) mm, (3, 3) mm^2."""

    mean: Array
    unit: Array  # of what is drawn once for the whole bench: manufacturing, hand-eye
    installation: Array  # of what is drawn at each installation: both interfaces
    shot: Array  # of what is drawn at each trial

    def of_mean(self, sizes: Sequence[int]) -> Array:
        """(3, 3) covariance of the mean of a bench."""
        return np.asarray(self.unit + self.between(sizes) / len(sizes))

    def between(self, sizes: Sequence[int]) -> Array:
        """(3, 3) expected sample covariance of the means of installations."""
        return np.asarray(self.installation + self.shot * float((1 / np.array(sizes)).mean()))


@dataclass(frozen=True, slots=True, eq=False)
class BenchMoments:
    """What the statistics of vectors are made of, of R benches."""

    mean: Array  # (R, 3)
    within: Array | None  # (R, 3, 3) pooled covariance within installations; None without a degree of freedom
    between: Array | None  # (R, 3, 3) sample covariance of the means of installations


def moments_of(errors: Array, sizes: Sequence[int]) -> BenchMoments:
    """Moments of errors (R, n, 3), trials ordered by installation."""
    means = installation_means(errors, sizes)
    residual = errors - np.repeat(means, sizes, axis=1)
    freedom, several = sum(sizes) - len(sizes), len(sizes) - 1
    apart = means - means.mean(axis=1, keepdims=True)
    return BenchMoments(
        means.mean(axis=1),
        np.matmul(residual.swapaxes(1, 2), residual) / freedom if freedom else None,
        np.matmul(apart.swapaxes(1, 2), apart) / several if several else None,
    )


def installation_means(values: Array, sizes: Sequence[int]) -> Array:
    """(R, k, ...) means of values (R, n, ...) over each installation's trials."""
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    shape = (1, len(sizes)) + (1,) * (values.ndim - 2)
    return np.asarray(np.add.reduceat(values, starts, axis=1) / np.reshape(sizes, shape))


def bench_mean(values: Array, sizes: Sequence[int]) -> Array:
    """(R, ...) mean of a bench: every installation counts alike, however many trials it has.  values (R, n, ...)."""
    return np.asarray(installation_means(values, sizes).mean(axis=1))


def distance(vectors: Array, covariance: Array) -> Array:
    """(R,) squared Mahalanobis length of vectors (R, 3)."""
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), vectors.T)
    return np.asarray((whitened**2).sum(axis=0))


def departure(covariances: Array, expected: Array, freedom: int) -> Array:
    """(R,) how far covariances (R, 3, 3) with so many degrees of freedom are from an expected one.

    The likelihood-ratio statistic of ``Sigma = Sigma_0`` (Anderson 2003, section 10.8), large for any difference;
    with few degrees of freedom the ratio of traces in the expected metric, which is small or large.
    """
    factor = np.linalg.cholesky(expected)
    half = np.linalg.solve(factor, covariances)
    whitened = np.linalg.solve(factor, half.swapaxes(1, 2))
    trace = np.trace(whitened, axis1=1, axis2=2)
    if freedom < LEAST_FREEDOM:
        return np.asarray(trace / 3)
    _, logarithm = np.linalg.slogdet(whitened)
    return np.asarray(freedom * (trace - logarithm - 3))


def tail_mean(norms: Array) -> Array:
    """(R,) mean of the largest tenth of norms (R, n)."""
    count = ceil(TAIL_SHARE * norms.shape[1])
    return np.asarray(np.partition(norms, norms.shape[1] - count, axis=1)[:, -count:].mean(axis=1))


def pooled_sd(norms: Array, sizes: Sequence[int]) -> Array:
    """(R,) standard deviation of norms (R, n) within installations."""
    residual = norms - np.repeat(installation_means(norms, sizes), sizes, axis=1)
    return np.asarray(np.sqrt((residual**2).sum(axis=1) / (sum(sizes) - len(sizes))))


def norm_statistics(norms: Array, sizes: Sequence[int]) -> dict[TestName, Array]:
    """(R,) mean of norms (R, n), and their deviation within installations and between these, where there is one."""
    statistics: dict[TestName, Array] = {"mean": bench_mean(norms, sizes)}
    if sum(sizes) > len(sizes):
        statistics["spread"] = pooled_sd(norms, sizes)
    if len(sizes) > 1:
        statistics["between installations"] = np.asarray(installation_means(norms, sizes).std(axis=1, ddof=1))
    return statistics


def p_value(observed: float, simulated: Array, *, both_sides: bool) -> float:
    """Of one bench among simulated ones (R,)."""
    count = len(simulated)
    above = (1 + int((simulated >= observed).sum())) / (count + 1)
    if not both_sides:
        return above
    below = (1 + int((simulated <= observed).sum())) / (count + 1)
    return min(1.0, 2 * min(above, below))


def holm(p_values: Sequence[float]) -> list[float]:
    """Adjusted for their number (Holm 1979): valid however the tests depend on each other."""
    order = sorted(range(len(p_values)), key=lambda k: p_values[k])
    adjusted, largest = [0.0] * len(p_values), 0.0
    for rank, k in enumerate(order):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[k]))
        adjusted[k] = largest
    return adjusted

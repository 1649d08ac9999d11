"""Worst case over bounded components: the largest quantile of |e| when b_1 ... b_q may each sit anywhere in +-1.

    e = m + sum_j s_j b_j + xi,   |s_j| <= 1 fixed but unknown, xi random

*The maximum is at a vertex of the box.*  Let xi have a log-concave density (normal, uniform, triangular ones, and
their sums: log-concavity survives convolution and linear images, Prekopa 1973).  Then ``P(|c + xi| <= r)`` is the
convolution of that density with the indicator of a ball, itself log-concave, hence log-concave in c.  So the set of c
where it is at least p is convex for each r: the quantile is quasi-convex in c, and so it is in s, in which c is
affine.  A quasi-convex function on a box attains its maximum at a vertex.  (For laws with singular S take limits.)

There are 2^q vertices; with m = 0 opposite ones agree and half suffice.  Gaussian quantiles rank them; then the
declared law has the word: at the best quantile r* so far every vertex must have P(|e| <= r*) >= p, and one that has not
is solved for and replaces it, until none is left.

A mean of |e|, over all or over its tail, is convex in c, whatever the law of xi: its maximum is at a vertex as well, if
not always at the same one.  There the Gaussian ones leave the vertices that come near, of which the law has the word.

*Which vertices first order cannot tell apart.*  With m = 0 opposite vertices agree exactly to first order, and only
there: the full chain turns by finite angles, and one of the two is worse by some tenths of a per cent.  What is sampled
with the full chain is therefore sampled at every vertex of :func:`indistinguishable`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..errors import LimitError, Problem
from ..geometry.arrays import Array
from .declared import SAMPLED_METHOD, LawQuantile, LinearLaw, lattice_columns, law_cdf, law_quantile
from .gaussian import norm_quantiles, probability_iv
from .sampling import sample

MOST_BOUNDED = 12
CLOSE = 0.1  # of the largest Gaussian value: vertices further below have been the worst of no law
NEAR = 0.01  # of the quantile: what first order, at its best, claims to know
MOST_TOGETHER = 4  # vertices that are told apart by sampling
# Where a sampled law has more vertices than a few they are asked from one sample, good to the slack; the probability of
# a lattice is good to the other slack where it is not asked for as exactly as can be.
_FEW, _LOG2_POINTS, _SAMPLED_SLACK, _COARSE_SLACK = 4, 9, 2e-4, 2e-3


@dataclass(frozen=True, slots=True, eq=False)
class WorstVertex:
    """The vertex with the largest quantile; signs (q,) of +-1, law the linear law moved there."""

    signs: tuple[int, ...]
    law: LinearLaw
    quantile: LawQuantile
    vertices: int  # how many were compared


def _vertices(q: int, count: int) -> Array:
    """(count, q) signs of the first vertices of a box: vertex v has -1 where bit j of v is set."""
    return np.asarray(1.0 - 2.0 * (np.arange(count)[:, None] >> np.arange(q) & 1), dtype=np.float64)


def worst_case(
    law: LinearLaw, bounded: Array, p: float, value: Callable[[LinearLaw], float] | None = None
) -> WorstVertex:
    """Largest p-quantile of |e|, or value, over ``law.mean + bounded @ s``, s in the box [-1, 1]^q; value: convex.

    bounded: (3, q) mm, of two vectors (6, q), columns already multiplied by their half-widths, in the frame of the law;
    columns of zeros keep the sign +1.  Raises ValueError for a bad shape or p, LimitError for more than 12 columns that
    are not zero.
    """
    p = probability_iv(p)
    bounded = np.asarray(bounded, dtype=np.float64)
    if bounded.ndim != 2 or bounded.shape[0] != len(law.mean) or not np.isfinite(bounded).all():
        raise ValueError(f"bounded must be finite and have shape ({len(law.mean)}, q), got shape {bounded.shape}")
    active = np.flatnonzero((bounded != 0).any(axis=0))
    if active.size > MOST_BOUNDED:
        detail = f"{active.size} bounded components act on the error; {MOST_BOUNDED} can be searched exactly"
        hint = "declare a law (normal, uniform, triangular) for the smaller ones"
        raise LimitError(Problem("", "too-many-bounded", detail, hint))
    q = int(active.size)
    # The last sign stays +1 when opposite vertices are mirror images.
    signs = _vertices(q, 1 << (q - 1 if q and not (law.mean.any() or law.is_one_sided) else q))
    means = law.mean + signs @ bounded[:, active].T
    ranking = _rank(law, means, p, value) if len(means) > 1 else np.zeros(1)
    best = int(np.nanargmax(ranking))
    if value is not None and law.columns.any() and not law.is_one_sided:
        close = np.flatnonzero(ranking >= (1 - CLOSE) * ranking[best])
        best = int(close[np.argmax([value(replace(law, mean=means[v])) for v in close])]) if len(close) > 1 else best
    quantile = law_quantile(replace(law, mean=means[best]), p)
    if law.columns.any() and value is None and not law.is_one_sided:
        solved = {best}
        while len(means) > 1:
            probability, slack = _probabilities(law, means, quantile, p)
            probability[list(solved)] = np.inf
            worst = int(np.argmin(probability))
            if probability[worst] >= p - slack:
                break
            solved.add(worst)
            candidate = law_quantile(replace(law, mean=means[worst]), p)
            if candidate.quantile_mm > quantile.quantile_mm:
                best, quantile = worst, candidate
    full = np.ones(bounded.shape[1], dtype=int)
    full[active] = signs[best]
    return WorstVertex(tuple(full.tolist()), replace(law, mean=means[best]), quantile, len(means))


def indistinguishable(
    law: LinearLaw, bounded: Array, p: float, worst: tuple[int, ...], value: Callable[[LinearLaw], float] | None = None
) -> tuple[tuple[int, ...], ...]:
    """The worst vertex and the others that first order cannot tell from it: signs (q,) of each, the worst first.

    Those are the vertices whose p-quantile or value (of the Gaussian law of equal covariance) is within 1 % of the
    worst one's and whose mean is farther than 1 % of it from the means of those already taken: farthest first, at most
    four in all.
    Signs of columns of zeros stay as they are in ``worst``.  Arguments as of :func:`worst_case`, which found ``worst``.
    """
    active = np.flatnonzero((bounded != 0).any(axis=0))
    signs = _vertices(int(active.size), 1 << int(active.size))
    means = law.mean + signs @ bounded[:, active].T
    ranking = _rank(law, means, p, value)
    first = int(np.flatnonzero((signs == np.array(worst)[active]).all(axis=1))[0])
    near = np.flatnonzero(ranking >= (1 - NEAR) * ranking[first])
    taken = [first]
    distance = np.linalg.norm(means[near] - means[first], axis=1)
    while len(taken) < MOST_TOGETHER and distance.max(initial=0.0) > NEAR * ranking[first]:
        # Equally far but for rounding: the lowest number, so that every machine takes the same.
        farthest = int(near[np.flatnonzero(distance >= (1 - 1e-9) * distance.max())[0]])
        taken.append(farthest)
        distance = np.minimum(distance, np.linalg.norm(means[near] - means[farthest], axis=1))
    full = np.tile(np.array(worst, dtype=int), (len(taken), 1))
    full[:, active] = signs[taken]
    return tuple(tuple(row) for row in full.tolist())


def _rank(law: LinearLaw, means: Array, p: float, value: Callable[[LinearLaw], float] | None) -> Array:
    """(n,) p-quantiles, or values, at means (n, 3) of the Gaussian law of equal covariance; of two vectors those of the
    longer.  Of one number that counts on one side: means, from a place below all of them."""
    if law.is_one_sided:  # everything that is asked of it rises with its mean
        return np.asarray(means[:, 0] + 2 * np.abs(means).max() + np.sqrt(law.total_covariance[0, 0]))
    if value is not None:
        nothing = np.zeros((len(law.mean), 0)), np.zeros(0, dtype=np.int64)
        return np.array([value(LinearLaw(mean, law.total_covariance, *nothing, law.room)) for mean in means])
    if law.room is not None:  # as they are near the quantile of the first
        r = law_quantile(replace(law, mean=means[0]), p).quantile_mm
        law, means = law.without_room(r), means * law.scale_at(r)
    ends = zip(law.ends, np.split(means, len(law.ends), axis=1), strict=True)
    each = [norm_quantiles(p, np.ascontiguousarray(own), end.total_covariance) for end, own in ends]
    return np.asarray(np.max(each, axis=0))


def _probabilities(law: LinearLaw, means: Array, worst: LawQuantile, p: float) -> tuple[Array, float]:
    """(P(|e| <= the worst quantile so far) at each of the means (n, 3), (n,), 1 where it is at least p for sure; how
    far they may be off)."""
    r, out = worst.quantile_mm, np.ones(len(means))
    # |m + xi| <= |m| + |xi|: a vertex nearer to 0 than r by the p-quantile of |xi| keeps p
    own = law_quantile(replace(law, mean=np.zeros_like(law.mean)), p, fine=False)
    open_vertices = np.flatnonzero(np.linalg.norm(means, axis=1) + own.quantile_mm + 4 * own.error_mm > r)
    if worst.method == SAMPLED_METHOD and open_vertices.size > _FEW:
        points = sample(law.mean, law.covariance, lattice_columns(law)[0], _LOG2_POINTS)
        out[open_vertices] = [points.shift(mean - law.mean).probability(r) for mean in means[open_vertices]]
        return out, _SAMPLED_SLACK
    out[open_vertices] = [law_cdf(replace(law, mean=mean), r, fine=False) for mean in means[open_vertices]]
    near = np.flatnonzero(out < p + _COARSE_SLACK)
    out[near] = [law_cdf(replace(law, mean=mean), r) for mean in means[near]]
    return out, 0.0

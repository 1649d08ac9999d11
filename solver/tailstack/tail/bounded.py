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

*Which vertices first order cannot tell apart.*  With m = 0 opposite vertices agree exactly to first order, and only
there: the full chain turns by finite angles, and one of the two is worse by some tenths of a per cent.  What is sampled
with the full chain is therefore sampled at every vertex of :func:`indistinguishable`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..errors import LimitError, Problem
from ..kernels import kernel
from .declared import (
    LawQuantile,
    LinearLaw,
    build,
    lattice_columns,
    law_cdf,
    law_quantile,
    law_quantile_coarse,
    on_principal_axes,
)
from .gaussian import norm_quantile_jit, probability_iv
from .lattice import balls
from .sampling import sample

MOST_BOUNDED = 12
NEAR = 0.01  # of the quantile: what first order, at its best, claims to know
MOST_TOGETHER = 4  # vertices that are told apart by sampling
_THRESHOLD, _ALIASING, _LARGEST_BOX = 1e-7, 1e-8, 2e5
# So many vertices are asked one by one; of more than many those that cannot be the worst are left out first; without a
# lattice for all of them they are asked from one sample, good to the slack.
_FEW, _MANY, _LOG2_POINTS, _SLACK = 4, 64, 9, 2e-4


@dataclass(frozen=True, slots=True, eq=False)
class WorstCase:
    """The vertex with the largest quantile; signs (q,) of +-1, law the linear law moved there."""

    signs: tuple[int, ...]
    law: LinearLaw
    quantile: LawQuantile
    vertices: int  # how many were compared


def _at_vertex(law: LinearLaw, bounded: Array, vertex: int) -> tuple[tuple[int, ...], LinearLaw]:
    signs = tuple(-1 if vertex >> j & 1 else 1 for j in range(bounded.shape[1]))
    mean = law.mean + bounded @ np.array(signs, dtype=np.float64) if signs else law.mean
    return signs, LinearLaw(mean, law.covariance, law.columns, law.kinds)


def worst_case(law: LinearLaw, bounded: Array, p: float) -> WorstCase:
    """Largest p-quantile of |e| over ``law.mean + bounded @ s``, s in the box [-1, 1]^q.

    bounded: (3, q) mm, columns already multiplied by their half-widths, in the frame of the law; columns of zeros
    keep the sign +1.  Raises ValueError for a bad shape or p, LimitError for more than 12 columns that are not zero.
    """
    p = probability_iv(p)
    bounded = np.asarray(bounded, dtype=np.float64)
    if bounded.ndim != 2 or bounded.shape[0] != 3 or not np.isfinite(bounded).all():
        raise ValueError(f"bounded must be finite and have shape (3, q), got shape {bounded.shape}")
    active = np.flatnonzero((bounded != 0).any(axis=0))
    if active.size > MOST_BOUNDED:
        raise LimitError(
            Problem(
                "",
                "too-many-bounded",
                f"{active.size} bounded components act on the error; {MOST_BOUNDED} can be searched exactly",
                "declare a law (normal, uniform, triangular) for the smaller ones",
            )
        )
    columns = np.ascontiguousarray(bounded[:, active])
    q = int(active.size)
    # The last sign stays +1 when opposite vertices are mirror images.
    count = 1 << (q - 1 if q and not law.mean.any() else q)
    ranking = gaussian_vertices(p, law.mean, law.total_covariance, columns, count)
    best = int(np.nanargmax(ranking)) if count > 1 else 0
    signs, at = _at_vertex(law, columns, best)
    quantile = law_quantile(at, p)
    if law.columns.any():
        solved = {best}
        while count > 1:
            probability, slack = _probabilities(law, columns, count, quantile.quantile_mm, p)
            probability[list(solved)] = np.inf
            worst = int(np.argmin(probability))
            if probability[worst] >= p - slack:
                break
            solved.add(worst)
            other_signs, other = _at_vertex(law, columns, worst)
            candidate = law_quantile(other, p)
            if candidate.quantile_mm > quantile.quantile_mm:
                signs, at, quantile = other_signs, other, candidate
    full = np.ones(bounded.shape[1], dtype=int)
    full[active] = signs
    return WorstCase(tuple(int(s) for s in full), at, quantile, count)


def indistinguishable(law: LinearLaw, bounded: Array, p: float, worst: tuple[int, ...]) -> tuple[tuple[int, ...], ...]:
    """The worst vertex and the others that first order cannot tell from it: signs (q,) of each, the worst first.

    Those are the vertices whose p-quantile (of the Gaussian law of equal covariance) is within 1 % of the worst one's
    and whose mean is farther than 1 % of it from the means of those already taken: farthest first, at most four in all.
    Signs of columns of zeros stay as they are in ``worst``.  Arguments as of :func:`worst_case`, which found ``worst``.
    """
    active = np.flatnonzero((bounded != 0).any(axis=0))
    columns = np.ascontiguousarray(bounded[:, active])
    count = 1 << int(active.size)
    ranking = gaussian_vertices(p, law.mean, law.total_covariance, columns, count)
    signs = 1 - 2 * (np.arange(count)[:, None] >> np.arange(active.size) & 1)
    first = int(np.flatnonzero((signs == np.array(worst, dtype=int)[active]).all(axis=1))[0])
    near = np.flatnonzero(ranking >= (1 - NEAR) * ranking[first])
    means = law.mean + signs[near] @ columns.T
    taken = [first]
    distance = np.linalg.norm(means - (law.mean + columns @ signs[first]), axis=1)
    while len(taken) < MOST_TOGETHER and distance.max(initial=0.0) > NEAR * ranking[first]:
        # Equally far but for rounding: the lowest number, so that every machine takes the same.
        farthest = int(np.flatnonzero(distance >= (1 - 1e-9) * distance.max())[0])
        taken.append(int(near[farthest]))
        distance = np.minimum(distance, np.linalg.norm(means - means[farthest], axis=1))
    full = np.tile(np.array(worst, dtype=int), (len(taken), 1))
    full[:, active] = signs[taken]
    return tuple(tuple(int(s) for s in row) for row in full)


def _probabilities(law: LinearLaw, bounded: Array, count: int, r: float, p: float) -> tuple[Array, float]:
    """(count,) P(|e| <= r) at each vertex, 1 where it is at least p for sure, and how far they may be off."""
    out = np.ones(count)
    asked = np.arange(count)
    if count > _MANY:
        # |m + xi| <= |m| + |xi|: a vertex nearer to 0 than r by the p-quantile of |xi| keeps p
        own = law_quantile_coarse(LinearLaw(np.zeros(3), law.covariance, law.columns, law.kinds), p)
        signs = 1 - 2 * (asked[:, None] >> np.arange(bounded.shape[1]) & 1)
        sizes = np.linalg.norm(law.mean + signs @ bounded.T, axis=1)
        asked = np.flatnonzero(sizes + own.quantile_mm + 4 * own.error_mm > r)
    if asked.size > _FEW or count <= _MANY:
        h, _ = lattice_columns(law)
        found, value = vertex_probabilities(
            r, law.mean, law.covariance, h, bounded, count, _THRESHOLD, _ALIASING, _LARGEST_BOX
        )
        if found:
            return np.asarray(value), 0.0
    moved = [_at_vertex(law, bounded, int(vertex))[1] for vertex in asked]
    if asked.size <= _FEW:
        out[asked] = [law_cdf(at, r) for at in moved]
        return out, 0.0
    points = sample(law.mean, law.covariance, h, _LOG2_POINTS)
    out[asked] = [points.probability_moved(r, at.mean - law.mean) for at in moved]
    return out, _SLACK


def vertex_probabilities(
    r: float,
    mean: Array,
    covariance: Array,
    h: Array,
    bounded: Array,
    count: int,
    threshold: float,
    aliasing: float,
    largest_box: float,
) -> tuple[bool, Array]:
    """(found, P(|e + B s| <= r) for the first `count` sign vectors s (count,)); bounded: (3, q).

    Vertex v has s_j = -1 where bit j of v is set.  Only cos(k'(m + B s)) differs between vertices.  They are visited
    in Gray code order, so that the next phase is the last one turned by +-2 k'b_j: no cosine, four multiplications.
    found is False when the lattice is too large or the law lies in a plane or on a line.
    """
    sigma, m, S, turned, axes, dimension, _ = on_principal_axes(mean, covariance, h)
    if dimension < 3:
        return False, np.zeros(count)
    b = np.ascontiguousarray(axes.T @ bounded)
    away = np.abs(m) + np.abs(b).sum(axis=1)
    t, w, k, volume, _ = build(r, sigma, np.zeros(3), away, S, turned, threshold, aliasing, largest_box, True)
    if volume == 0.0:
        return False, np.zeros(count)
    return True, _gray_walk(r, m, b, count, t, w, k)


@kernel()
def _gray_walk(r: float, m: Array, b: Array, count: int, t: Array, w: Array, k: Array) -> Array:
    """(count,) probabilities at the vertices from one lattice: t (n,), w (n,) of the law without mean, k (n, 3)."""
    q = b.shape[1]
    out = np.zeros(count)
    n = t.size
    re = np.empty(n)
    im = np.empty(n)
    turn_c = np.empty((q, n))
    turn_s = np.empty((q, n))
    ball = balls(r, t)
    for i in range(n):
        phase = k[i, 0] * m[0] + k[i, 1] * m[1] + k[i, 2] * m[2]
        for j in range(q):
            along = k[i, 0] * b[0, j] + k[i, 1] * b[1, j] + k[i, 2] * b[2, j]
            phase += along
            turn_c[j, i] = np.cos(2.0 * along)
            turn_s[j, i] = np.sin(2.0 * along)
        re[i] = w[i] * ball[i] * np.cos(phase)
        im[i] = w[i] * ball[i] * np.sin(phase)
    code = 0
    for step in range(1 << q):
        if code < count:
            total = 0.0
            for i in range(n):
                total += re[i]
            out[code] = total
        if step + 1 == 1 << q:
            break
        j = 0
        while ((step + 1) >> j) & 1 == 0:
            j += 1
        sign = -1.0 if (code >> j) & 1 == 0 else 1.0  # from +1 to -1 turns the phase back
        code ^= 1 << j
        line_c = turn_c[j]
        line_s = turn_s[j]
        for i in range(n):
            x = re[i]
            y = im[i]
            c = line_c[i]
            s = sign * line_s[i]
            re[i] = x * c - y * s
            im[i] = x * s + y * c
    return out


@kernel()
def gaussian_vertices(p: float, mean: Array, covariance: Array, bounded: Array, count: int) -> Array:
    """(count,) p-quantiles of |N(m + B s, S)|, vertices numbered as above; NaN where one did not converge."""
    out = np.empty(count)
    at = np.empty(3)
    for v in range(count):
        for a in range(3):
            at[a] = mean[a]
            for j in range(bounded.shape[1]):
                at[a] += -bounded[a, j] if (v >> j) & 1 else bounded[a, j]
        out[v] = norm_quantile_jit(at, covariance, p)
    return out

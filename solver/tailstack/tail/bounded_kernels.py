"""Compiled steps of the worst case: the probability, or the Gaussian quantile, at every vertex of the box."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..kernels import kernel
from .ball import balls
from .declared_kernels import build, on_principal_axes
from .quantile import norm_quantile_jit


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

"""A smooth closed form for the quantile of |e|: Pearson's shifted chi-square on three cumulants.

With ``kappa_n(|e|^2) = 2^(n-1) (n-1)! c_n``, a Gaussian e ~ N(m, S) has

    c1 = tr S + m'm,   c2 = tr S^2 + 2 m'S m,   c3 = tr S^3 + 3 m'S^2 m

and each independent source ``g u`` of S that is not normal (kappa4, kappa6 its cumulants along g, odd ones zero) adds

    c2 += kappa4 |g|^4 / 2,   c3 += (12 kappa4 |g|^2 (g'S g + (g'm)^2) + kappa6 |g|^6) / 8

(joint cumulants by the diagram formula: one block of four legs and one of two, or of four with two legs on the
mean; the term in m vanishes without bias).  Pearson (1959, Biometrika 46, 364) matches

    r^2 = c1 + sqrt(c2/h) (chi2_h - h),   h = c2^3 / c3^2

For a Gaussian law the 95 % point is then right to -0.6 ... +1.2 %, with Wilson and Hilferty's cube for the
chi-square to -1.3 ... +0.9 %.  Good to drive an optimiser; the number that is promised comes from the exact law.

The first two functions use + - * / and the ``sqrt`` they are given, nothing else: floats and CasADi SX alike.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import sqrt as float_sqrt
from typing import Any

from scipy.special import chdtri, ndtri

# Cumulants of one unit of half-width.
KAPPA4_UNIFORM, KAPPA6_UNIFORM = -2 / 15, 16 / 63
KAPPA4_TRIANGULAR, KAPPA6_TRIANGULAR = -1 / 60, 1 / 126  # the sum of two uniforms of half the width

Vector = Sequence[Any]


def square_cumulants(
    mean: Vector, covariance: Sequence[Vector], uniform: Sequence[Vector] = (), triangular: Sequence[Vector] = ()
) -> tuple[Any, Any, Any]:
    """(c1, c2, c3) of |e|^2.  mean: 3 scalars, mm; covariance: 3 rows of 3, mm^2.

    The covariance is the total one, sources included.  uniform, triangular: columns of 3 scalars, each the
    displacement at one end of the source's half-width, mm.
    """
    axes = range(3)
    s_m = [sum(covariance[i][j] * mean[j] for j in axes) for i in axes]
    s_2 = [[sum(covariance[i][k] * covariance[k][j] for k in axes) for j in axes] for i in axes]
    c1 = sum(covariance[i][i] + mean[i] * mean[i] for i in axes)
    c2 = sum(s_2[i][i] + 2 * mean[i] * s_m[i] for i in axes)
    c3 = sum(sum(s_2[i][j] * covariance[j][i] for j in axes) + 3 * s_m[i] * s_m[i] for i in axes)
    for columns, kappa4, kappa6 in (
        (uniform, KAPPA4_UNIFORM, KAPPA6_UNIFORM),
        (triangular, KAPPA4_TRIANGULAR, KAPPA6_TRIANGULAR),
    ):
        for g in columns:
            gg = sum(g[i] * g[i] for i in axes)
            gm = sum(g[i] * mean[i] for i in axes)
            gsg = sum(g[i] * sum(covariance[i][j] * g[j] for j in axes) for i in axes)
            c2 = c2 + kappa4 / 2 * gg * gg
            c3 = c3 + (12 * kappa4 * gg * (gsg + gm * gm) + kappa6 * gg * gg * gg) / 8
    return c1, c2, c3


def pearson_wh_quantile_squared(p: float, cumulants: tuple[Any, Any, Any], sqrt: Callable[[Any], Any]) -> Any:
    """Square of the approximate p-quantile, mm^2, with Wilson and Hilferty's (1931) chi-square quantile.

    Written in gamma = c3 / c2^(3/2) = 1/sqrt(h): smooth through gamma = 0, where h has a pole.
    """
    c1, c2, c3 = cumulants
    root = sqrt(c2)
    gamma = c3 / (c2 * root)
    b = float_sqrt(2) / 3 * float(ndtri(p)) - gamma * (2 / 9)
    w = gamma * b
    return c1 + root * b * (3 + 3 * w + w * w)


def pearson_wh_quantile(
    p: float,
    mean: Vector,
    covariance: Sequence[Vector],
    uniform: Sequence[Vector] = (),
    triangular: Sequence[Vector] = (),
    sqrt: Callable[[Any], Any] = float_sqrt,
) -> Any:
    """The approximate p-quantile of |e|, mm; arguments as in :func:`square_cumulants`.

    In an optimiser constrain :func:`pearson_wh_quantile_squared` instead: the outer root is not smooth at zero.
    """
    return sqrt(pearson_wh_quantile_squared(p, square_cumulants(mean, covariance, uniform, triangular), sqrt))


def pearson_chi2_quantile(
    p: float,
    mean: Vector,
    covariance: Sequence[Vector],
    uniform: Sequence[Vector] = (),
    triangular: Sequence[Vector] = (),
) -> float:
    """The same with the exact chi-square quantile; floats only.

    Raises ValueError where the third cumulant of |e|^2 is not positive.
    """
    c1, c2, c3 = square_cumulants(mean, covariance, uniform, triangular)
    if not c3 > 0:
        raise ValueError(f"Pearson's chi-square needs a positive third cumulant of |e|^2, got {c3}")
    h = c2**3 / c3**2
    return float_sqrt(max(c1 + float_sqrt(c2 / h) * (float(chdtri(h, 1 - p)) - h), 0.0))

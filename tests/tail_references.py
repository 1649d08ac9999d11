"""References that the tests of the declared laws share; no lattice in them."""

from __future__ import annotations

import numpy as np

from tailstack.tail.declared import UNIFORM


def average(law, function):
    """Mean of function(mean shifted by the columns) over two sources, by Gauss-Legendre: no lattice in it."""
    x, w = np.polynomial.legendre.leggauss(24)
    rules = []
    for kind in law.kinds:
        if kind == UNIFORM:
            rules.append(list(zip(x, w / 2, strict=True)))
        else:
            half, weight = (x + 1) / 2, w / 2 * (1 - (x + 1) / 2)
            rules.append([*zip(-half, weight, strict=True), *zip(half, weight, strict=True)])
    first, second = rules
    return sum(a * b * function(law.mean + law.columns @ np.array([u, v])) for u, a in first for v, b in second)

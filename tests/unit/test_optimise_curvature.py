"""Second derivatives by a list of operations against those that CasADi writes in symbols."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import casadi as ca
import numpy as np
import pytest

from tailstack.optimisation.curvature import LANES, Curvature


def rows(x: Any, p: Any) -> Any:
    """Every operation there is, with operands that move and that do not, on either side."""
    squares = ca.sum1(ca.exp(x * ca.sin(np.arange(x.numel()))) ** 2 / (1 + x**2))
    return ca.vertcat(
        ca.exp(x[0] * p[0]) / x[1] + ca.sqrt(x[2] + x[3] ** 2) * 2 - ca.log(x[1]) * x[0] + squares,
        3 / x[1] - x[2] * p[1] / x[3] - (-x[0]) ** 2 + x[0] / p[0] - 1 / x[2] + 2 * x[1] + p[0] / x[1] - p[1],
        p[0] * p[1] - x[3] * ca.fabs(x[0] - x[1]),
        -(x[0] - x[1]) * (p[1] - x[2]) / (x[3] - p[0] * 9) + (x[0] + x[1]) * x[2] ** 3 + 7,
    )


@pytest.mark.parametrize("count", [4, LANES, 2 * LANES + 5])  # fewer, as many and more than go side by side
def test_equals_the_hessian_in_symbols(count: int) -> None:
    x, p, weights = ca.SX.sym("x", count), ca.SX.sym("p", 2), ca.SX.sym("w", 4)
    expected = ca.Function("h", [x, p, weights], [ca.hessian(ca.dot(weights, rows(x, p)), x)[0]])
    curvature = Curvature(ca.vertcat(x, p), rows(x, p), count)
    rng = np.random.default_rng(count)
    draws = [(rng.uniform(0.5, 2, count), rng.uniform(0.5, 2, 2), rng.normal(size=4)) for _ in range(8)]
    with ThreadPoolExecutor(2) as pool:  # each thread has room of its own
        found = list(pool.map(lambda d: curvature(np.concatenate(d[:2]), d[2]).full(), draws))
    for hessian, draw in zip(found, draws, strict=True):
        reference = expected(*draw).full()
        np.testing.assert_allclose(hessian, reference, rtol=1e-12, atol=1e-12 * np.abs(reference).max())

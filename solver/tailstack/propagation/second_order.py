"""Mean and covariance to second order: the bias of the estimator, which first order does not see.

With standardised independent inputs z and the chain's error ``e(z)``, Hessians ``H_k`` of its components::

    E e      = e(0) + 1/2 tr(H_k)
    Cov e    = J J' + 1/2 tr(H_k H_l)       (exact to this order for normal z)

``nu`` is here that of what first order divides by (``Nonlinearity.divisor``). The mean shift is as a rule good to
some 10 % at nu = 0.02; at 0.05, the limit, it may be several times too large, as it is for a small cluster far from
its target. A quantile from the corrected covariance is as a rule no nearer to Monte Carlo than first order's:
products of first and third derivatives are left out, as large as what is kept and often of the other sign
(docs/method.md, section 4, has figures).

Uniform and triangular inputs enter with their variances, as if normal.  Hessians are central differences
of the *estimator itself*, which shares nothing with the analytic first-order model.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np

from ..errors import OutOfRangeError, Problem
from ..geometry.arrays import Array
from .validity import SECOND_ORDER_LIMIT

LARGEST_DIMENSION = 400
PAIRS_PER_BATCH = 20_000


def refuse_outside_range(divisor: float, dimension: int) -> None:
    """Raise OutOfRangeError where the correction is known to be worse than none, or too large to form."""
    if divisor > SECOND_ORDER_LIMIT:
        detail = (
            f"nu = {divisor:.2g} (of depths and crossing) exceeds {SECOND_ORDER_LIMIT:g}: the expansion diverges "
            "here (at nu = 0.10 it errs by up to 41 % where first order errs by 4 %)"
        )
        raise OutOfRangeError(Problem("", "second-order-out-of-range", detail, "use Monte Carlo: `tailstack verify`"))
    if dimension > LARGEST_DIMENSION:
        detail = f"{dimension} random inputs exceed the limit of {LARGEST_DIMENSION} for a full Hessian"
        raise OutOfRangeError(Problem("", "second-order-too-large", detail, "use Monte Carlo: `tailstack verify`"))


def second_order_moments(
    evaluate: Callable[[Array], Array], scale: Array, jacobian: Array, step: float = 0.25
) -> tuple[Array, Array]:
    """Mean shift (3,) and covariance (3, 3) to second order.

    evaluate: standardised deviates (n, d) -> errors (n, 3), mm; scale (d,): standard deviation of each
    input on its standard scale (1 for normal); jacobian (3, d): first-order gain per standard deviation;
    step: difference step in standard deviations (truncation ~ step^2, rounding ~ 1e-12 / step^2).
    """
    dimension = len(scale)
    at_zero = evaluate(np.zeros((1, dimension)))[0]
    kicks = step * np.diag(scale)
    ahead, behind = evaluate(kicks), evaluate(-kicks)
    hessian_diagonal = (ahead + behind - 2 * at_zero) / step**2  # (d, 3)
    product = np.einsum("ik,il->kl", hessian_diagonal, hessian_diagonal)
    pairs = np.array(list(combinations(range(dimension), 2)))
    for start in range(0, len(pairs), PAIRS_PER_BATCH):
        i, j = pairs[start : start + PAIRS_PER_BATCH].T
        both = kicks[i] + kicks[j]
        mixed = evaluate(both) + evaluate(-both) - ahead[i] - behind[i] - ahead[j] - behind[j] + 2 * at_zero
        mixed /= 2 * step**2
        product += 2 * np.einsum("ik,il->kl", mixed, mixed)
    return hessian_diagonal.sum(axis=0) / 2, jacobian @ jacobian.T + product / 2

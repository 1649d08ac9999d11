"""How far first order can be trusted: the validity number nu and what it was calibrated to mean.

nu is the standard deviation of the relative perspective error at the target
(:func:`~tailstack.propagation.linear.validity_number`).  First order divides by a depth whose relative
error it takes to be small; nu measures exactly that.  The thresholds were calibrated by Monte Carlo on
families of layouts (``docs/method.md``): they bound the error of the first-order P95, and the sign of
that error is optimistic where it grows.
"""

from __future__ import annotations

from ..results import Validity

# (nu up to, status, error of P95 in per cent)
LEVELS = ((0.02, "good to 1 %", 1.0), (0.08, "good to 5 %", 5.0), (0.15, "good to 20 %", 20.0))
SECOND_ORDER_LIMIT = 0.05  # second order helps below; at nu = 0.10 it errs by +26 % and -41 %


def validity(nu: float) -> Validity:
    """Statement about the linearisation at the worst target."""
    for limit, status, percent in LEVELS:
        if nu <= limit:
            return Validity(
                nu=nu,
                status=status,  # type: ignore[arg-type]
                expected_error_percent=percent,
                statement=f"nu = {nu:.2g}: first-order P95 agrees with the full chain within {percent:g} %"
                + ("" if percent <= 1 else "; where it errs it is optimistic: verify by Monte Carlo"),
            )
    return Validity(
        nu=nu,
        status="not valid",
        expected_error_percent=None,
        statement=f"nu = {nu:.2g} > {LEVELS[-1][0]:g}: first order is optimistic here and its P95 must not be used; "
        "only Monte Carlo (`tailstack verify`) speaks, and if nu > 0.2 not even the standard deviation exists",
    )

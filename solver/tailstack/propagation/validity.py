"""How far first order can be trusted: the validity number nu and what it was calibrated to mean.

nu (``images._validity_number``) is the standard deviation of what first order divides by, relative to itself: of the
depth in each image, and of the firmness with which the rays cross.  First order takes it to be small.  The thresholds
were calibrated by Monte Carlo on families of layouts, with views far apart and close together (``docs/method.md``,
``benchmarks/validity_calibration.py``): they hold the error of the first-order P95 on 95 % of them.  Higher quantiles
err more, and towards optimism.  Six fiducials leave one redundant equation, and near-critical layouts then err by up
to 25 % at nu = 0.02, mostly towards pessimism: nu counts five times there.
"""

from __future__ import annotations

from math import degrees
from typing import Literal

from ..results import Validity

Level = Literal["good to 1 %", "good to 5 %", "good to 20 %"]

# (nu up to, status, error of P95 in per cent)
LEVELS: tuple[tuple[float, Level, float], ...] = (
    (0.02, "good to 1 %", 1.0),
    (0.08, "good to 5 %", 5.0),
    (0.15, "good to 20 %", 20.0),
)
ROTATION_LIMITS_RAD = (0.1, 0.22, 0.45)  # 0.7 times their squares: 0.7, 3.4 and 14 %
FEWEST_FIDUCIALS = 6
SIX_FIDUCIALS_FACTOR = 5.0
SECOND_ORDER_LIMIT = 0.05  # second order is offered below; at nu = 0.10 it errs by +26 % and -41 %


def validity(nu: float, fiducials: int, rotation_rad: float = 0.0) -> Validity:
    """Statement about the linearisation: nu at the worst target, and the largest random rotation.

    rotation_rad: largest standard deviation (half-width if bounded) of a random rotation.  Its second order is
    some 0.7 of its square: 0.08, 0.20 and 0.54 % were measured at 1, 2 and 5 degrees.
    """
    few = fiducials <= FEWEST_FIDUCIALS
    effective = nu * SIX_FIDUCIALS_FACTOR if few else nu
    counted = f"nu = {nu:.2g}" + (f" (counted {SIX_FIDUCIALS_FACTOR:g} times: {fiducials} fiducials)" if few else "")
    if rotation_rad > ROTATION_LIMITS_RAD[0]:
        counted += f", random rotations of {degrees(rotation_rad):.3g} deg"
    for (limit, status, percent), turn in zip(LEVELS, ROTATION_LIMITS_RAD, strict=True):
        if effective <= limit and rotation_rad <= turn:
            return Validity(
                nu=nu,
                status=status,
                expected_error_percent=percent,
                statement=f"{counted}: first-order P95 agrees with the full chain within {percent:g} %"
                + ("" if percent <= 1 else "; where it errs it is mostly optimistic: verify by Monte Carlo"),
            )
    return Validity(
        nu=nu,
        status="not valid",
        expected_error_percent=None,
        statement=f"{counted}, beyond {LEVELS[-1][0]:g} or {degrees(ROTATION_LIMITS_RAD[-1]):.0f} deg: first order is "
        "optimistic here and its P95 must not be used; only Monte Carlo (`tailstack verify`) speaks, and beyond "
        "nu = 0.2 not even the standard deviation exists",
    )

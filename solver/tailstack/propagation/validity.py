"""How far first order can be trusted: the validity number nu and what it was calibrated to mean; and second order.

nu is the largest of the five numbers of ``nonlinearity.py``: standard deviations of relative errors that first order
takes for small.  The thresholds were calibrated by Monte Carlo on thousands of random layouts of each class of
``CALIBRATED`` (``benchmarks/validity_calibration.py``; the tables are in ``docs/method.md``, section 4).  What is
outside these classes is not judged by first order at all.

Few fiducials leave few redundant equations (six leave one), and near-critical layouts then err while nu is small,
mostly towards pessimism: nu counts more there.  Higher quantiles err more, and towards optimism: the error that is
expected at P95 is multiplied.

**Second order** has mean and covariance: the bias of the estimator, which first order does not see.  With standardised
independent inputs z and the chain's error ``e(z)``, Hessians ``H_k`` of its components::

    E e      = e(0) + 1/2 tr(H_k)
    Cov e    = J J' + 1/2 tr(H_k H_l)       (exact to this order for normal z)

``nu`` is here that of what first order divides by (``Nonlinearity.divisor``). The mean shift is as a rule good to
some 10 % at nu = 0.02; at 0.05, the limit, it may be several times too large, as it is for a small cluster far from
its target. A quantile from the corrected covariance is as a rule no nearer to Monte Carlo than first order's:
products of first and third derivatives are left out, as large as what is kept and often of the other sign
(docs/method.md, section 4, has figures).

Uniform and triangular inputs enter with their variances, as if normal.  Hessians are central differences of the
*estimator itself*, which shares nothing with the analytic first-order model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations
from math import ceil, inf, sqrt
from typing import Literal

import numpy as np

from ..effects import EFFECTS
from ..effects.kind import Excess, Limit, Proportional
from ..errors import OutOfRangeError, Problem
from ..geometry.arrays import Array
from ..geometry.rotation import RotationForm
from ..results import Validity
from ..results.digits import number
from ..system import DEFAULT_ESTIMATOR, System
from .nonlinearity import NO_TURNS, Nonlinearity, Turns, motion_of_images

Level = Literal["good to 1 %", "good to 5 %", "good to 20 %"]

# (nu up to, status, error of P95 in per cent)
LEVELS: tuple[tuple[float, Level, float], ...] = (
    (0.02, "good to 1 %", 1.0),
    (0.08, "good to 5 %", 5.0),
    (0.15, "good to 20 %", 20.0),
)
# of the designs that a level is said of, so many of 100 are within its error of P95: 95 % bound (Clopper and Pearson)
# of every class in the table of ``docs/method.md``, its levels together
PROMISED_PERCENT = 95
# what nu does not see, and up to what size each level holds
TURN_LIMITS = (0.1, 0.22, 0.45)  # of ``Turns.size``; 0.7 times their squares: 0.7, 3.4 and 14 %
# what errs in its first power: ``Turns.along_bias`` and ``images_beside_bias``, ``Nonlinearity.known``, and what
# effects say of themselves
BIAS_LIMITS = (0.005, 0.03, 0.12)
COUNTED = {4: 5.0, 5: 5.0, 6: 5.0, 7: 2.0, 8: 2.0}  # how often nu counts with so many fiducials
# (quantile up to, how many times the error of P95 its error may be)
QUANTILES = ((0.95, 1.0), (0.99, 2.5), (0.999, 6.0))
CALIBRATED_VIEWS = (2, 8)
# (focal length, principal point in px) up to which intrinsics may be in doubt under pose_with_prior: nu does not see
# them, and of 40 layouts beyond, two left their band (by -8 % at "good to 5 %" and by +3.5 % at "good to 1 %")
CALIBRATED_PRIOR = (0.03, 30.0)
# standard deviation of manufacturing errors in the images over that of noise, up to which pose_with_prior is believed:
# it takes them for noise, which sets the intrinsics free. From 2 to 30, 9 of 25 layouts left their band, optimistic by
# up to 86 %; a random design with 11 was passed although its P95 was 15 % beyond first order
CALIBRATED_MANUFACTURE = 2.0
SECOND_ORDER_LIMIT = 0.05  # second order is offered below; at nu = 0.10 it errs by +26 % and -41 %
LARGEST_DIMENSION = 400
PAIRS_PER_BATCH = 20_000

PARTS = {
    "depth": "how well the depths are known",
    "crossing": "how firmly the rays cross",
    "disagreement": "by how much the views disagree",
    "gap": "how well triangulation tells its solution from others",
    "range": "how far the point may lie along its rays",
}


def level_of(counted: float, turns: float, linear: float) -> tuple[Level, float] | None:
    """What is stated of nu as it is counted, ``Turns.size`` and what errs in its first power: the status and the error
    of P95 in per cent; None: not valid."""
    for (limit, status, percent), of_turns, of_bias in zip(LEVELS, TURN_LIMITS, BIAS_LIMITS, strict=True):
        if counted <= limit and turns <= of_turns and linear <= of_bias:
            return status, percent
    return None


def error_percent(trust: Validity, quantile: float) -> float:
    """Up to how many per cent a first-order quantile may be off; inf where nothing is known."""
    if trust.expected_error_percent is None:
        return inf
    return next((trust.expected_error_percent * times for limit, times in QUANTILES if quantile <= limit), inf)


def _fewest_seen(system: System) -> int:
    """Number of fiducials of the view that sees the fewest."""
    return int(system.sees.sum(axis=1).min())


def _manufacture_over_noise(system: System) -> float:
    """Manufacturing errors in the images over the noise there, standard deviations; of the view where it is most."""
    std, centre = float(system.manufacturing_std_mm.max()), system.fiducials_mm.mean(axis=0)
    if std == 0.0:
        return 0.0
    slopes = [motion_of_images(view.projection, centre[None]) for view in system.views]  # px per mm
    moved = [std * float(np.linalg.norm(slope)) / sqrt(2.0) for slope in slopes]
    noises = [view.fiducial_noise_px for view in system.views]
    return max(px / noise if noise else inf for px, noise in zip(moved, noises, strict=True))


def _class_of(system: System, limits: Sequence[Limit]) -> tuple[str, str]:
    """(the class of a system in words, why it was not calibrated or "")."""
    views, fiducials = len(system.views), _fewest_seen(system)
    words = f"{views} views, {fiducials} fiducials, {system.triangulation} triangulation"
    if system.estimator is not DEFAULT_ESTIMATOR:
        words += f", estimator {system.estimator}"
    if system.triangulation not in system.estimator.traits.trusted_forms:
        return words, f"{system.triangulation} triangulation with the estimator {system.estimator}"
    if not CALIBRATED_VIEWS[0] <= views <= CALIBRATED_VIEWS[1]:
        return words, f"{views} views (calibrated: {CALIBRATED_VIEWS[0]} to {CALIBRATED_VIEWS[1]})"
    low, high = system.estimator.traits.trusted_fiducials
    if not low <= fiducials <= high:
        return words, f"{fiducials} fiducials (calibrated: {low} to {high})"
    if system.estimator.traits.takes_prior:
        priors = [view.intrinsics_prior or (inf, inf) for view in system.views]
        focal, centre = (max(prior[k] for prior in priors) for k in (0, 1))
        if focal > CALIBRATED_PRIOR[0] or centre > CALIBRATED_PRIOR[1]:
            return words, (
                f"intrinsics that are known to {100 * focal:.3g} % and {centre:.3g} px "
                f"(calibrated: to {100 * CALIBRATED_PRIOR[0]:g} % and {CALIBRATED_PRIOR[1]:g} px)"
            )
        ratio = _manufacture_over_noise(system)
        if ratio > CALIBRATED_MANUFACTURE:
            return words, (
                f"manufacturing errors that are {ratio:.2g} times the noise in the images "
                f"(calibrated: to {CALIBRATED_MANUFACTURE:g} times)"
            )
    for limit in limits:
        if isinstance(limit, Excess):
            return words, limit.words
    if system.rotation_form is not RotationForm.FULL:
        return words, "rotations in their small-angle form"
    return words, ""


def widen_validity(trust: Validity, percent: float) -> Validity:
    """The statement of a P95 over shots that miss fiducials, which first order may be off by so many per cent; trust:
    of the structure with all of them."""
    level = next((status for _, status, least in LEVELS if percent <= least), None)
    if level is None:
        statement = (
            f"{trust.statement}. Of shots that miss fiducials, as the design says that some do, first order is not "
            "known to tell enough, and only Monte Carlo (`tailstack verify`) decides"
        )
        return replace(trust, status="not valid", expected_error_percent=None, statement=statement)
    rounded = max(ceil(100 * percent) / 100, trust.expected_error_percent or 0.0)
    statement = (
        f"{trust.statement}. Over all shots, those that miss fiducials among them and the structures that are left "
        f"judged like this one, P95 agrees within {rounded:g} %"
    )
    return replace(trust, status=level, expected_error_percent=rounded, statement=statement)


def worst_validity(by_target: Sequence[tuple[Nonlinearity, Turns]], system: System) -> Validity:
    """The statement of a system from the numbers of its targets: of each the largest."""
    numbers = max((each for each, _ in by_target), key=lambda each: each.nu)
    turns = NO_TURNS
    for each, own in by_target:
        numbers, turns = numbers._replace(known=max(numbers.known, each.known)), turns.larger(own)
    return validity(numbers, system, turns)


def validity(numbers: Nonlinearity, system: System, turns: Turns = NO_TURNS) -> Validity:
    """Statement about the linearisation of a system.

    numbers, turns: at the worst target.
    """
    fiducials = _fewest_seen(system)
    limits = [limit for kind in EFFECTS if kind.limits for limit in kind.limits(system)]
    words, uncalibrated = _class_of(system, limits)
    times = COUNTED.get(fiducials, 1.0)
    part = max(PARTS, key=numbers._asdict().__getitem__)
    more = f"; counted {times:g} times: {fiducials} fiducials" if times > 1 else ""
    counted = f"nu = {numbers.nu:.2g} ({PARTS[part]}{more})"
    if turns.size > TURN_LIMITS[0]:
        counted += f", mounts that turn so far that {number(100 * turns.size, 2)} % of the error is of second order"
    in_proportion = {
        "mounts that turn about a lever with a known error along it, which changes P95 by {} %": turns.along_bias,
        "a known error beside errors by the images that grow with it, which may change P95 by {} %": (
            turns.images_beside_bias
        ),
        "known shifts of images of {} % of what they are seen by": numbers.known,
    } | {limit.words: limit.size for limit in limits if isinstance(limit, Proportional)}
    for template, size in in_proportion.items():
        if size > BIAS_LIMITS[0]:
            counted += ", " + template.format(number(100 * size, 2))
    linear = max(in_proportion.values())

    def state(status: Level | Literal["not valid"], percent: float | None, statement: str) -> Validity:
        return Validity(
            nu=numbers.nu,
            status=status,
            expected_error_percent=percent,
            statement=statement,
            nu_depth=numbers.depth,
            nu_crossing=numbers.crossing,
            nu_disagreement=numbers.disagreement,
            nu_gap=numbers.gap,
            layout_class=words,
            calibrated=not uncalibrated,
            nu_turns=turns.size,
            nu_bias=linear,
            nu_range=numbers.range,
        )

    if uncalibrated:
        return state(
            "not valid",
            None,
            f"{counted}; first order was not calibrated for {uncalibrated}: what its P95 is worth is not known, and "
            "only Monte Carlo (`tailstack verify`) decides",
        )
    if (level := level_of(times * numbers.nu, turns.size, linear)) is not None:
        return state(
            *level,
            f"{counted}: first-order P95 agrees with the full chain within {level[1]:g} %, in at least "
            f"{PROMISED_PERCENT:g} of 100 designs that it is said of"
            + ("" if level[1] <= 1 else "; it may be optimistic: verify by Monte Carlo"),
        )
    return state(
        "not valid",
        None,
        f"{counted}, beyond nu = {LEVELS[-1][0]:g}, or too much that turns or is known: first order may be optimistic "
        "here by a factor and its P95 must not be used; only Monte Carlo (`tailstack verify`) speaks"
        + (", and beyond nu = 0.2 not even the standard deviation exists" if numbers.divisor > LEVELS[-1][0] else ""),
    )


# --- second order -----------------------------------------------------------------------------------------


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

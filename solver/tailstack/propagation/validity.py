"""How far first order can be trusted: the validity number nu and what it was calibrated to mean.

nu is the largest of the four numbers of ``nonlinearity.py``: standard deviations of relative errors that first order
takes for small.  The thresholds were calibrated by Monte Carlo on thousands of random layouts of each class of
``CALIBRATED`` (``benchmarks/validity_calibration.py``; the tables are in ``docs/method.md``, section 4).  What is
outside these classes is not judged by first order at all.

Few fiducials leave few redundant equations (six leave one), and near-critical layouts then err while nu is small,
mostly towards pessimism: nu counts more there.  Higher quantiles err more, and towards optimism: the error that is
expected at P95 is multiplied.
"""

from __future__ import annotations

from math import degrees, inf, pi, sqrt
from typing import Literal

import numpy as np

from ..estimation.checks import LINEAR
from ..results import Validity
from ..system import Estimator, Law, RotationForm, System, Triangulation
from .nonlinearity import Nonlinearity, motion_of_images

Level = Literal["good to 1 %", "good to 5 %", "good to 20 %"]

# (nu up to, status, error of P95 in per cent)
LEVELS: tuple[tuple[float, Level, float], ...] = (
    (0.02, "good to 1 %", 1.0),
    (0.08, "good to 5 %", 5.0),
    (0.15, "good to 20 %", 20.0),
)
# what nu does not see, and up to what size each level holds
ROTATION_LIMITS_RAD = (0.1, 0.22, 0.45)  # 0.7 times their squares: 0.7, 3.4 and 14 %
GROWTH_LIMITS = (0.005, 0.03, 0.12)  # of the structure by temperature, relative; it errs by as much
KNOWN_INTRINSICS_LIMITS = (0.005, 0.03, 0.12)  # a known error that is believed, relative; it errs by up to 1.3 times it
COUNTED = {4: 5.0, 5: 5.0, 6: 5.0, 7: 2.0, 8: 2.0}  # how often nu counts with so many fiducials
# (quantile up to, how many times the error of P95 its error may be)
QUANTILES = ((0.95, 1.0), (0.99, 2.5), (0.999, 6.0))
CALIBRATED_VIEWS = (2, 8)
CALIBRATED_FIDUCIALS = (6, 40)
CALIBRATED_OF_POSE = (4, 40)  # of the estimators that know the intrinsics
# (focal length, principal point in px) up to which intrinsics may be in doubt under pose_with_prior: nu does not see
# them, and of 40 layouts beyond, two left their band (by -8 % at "good to 5 %" and by +3.5 % at "good to 1 %")
CALIBRATED_PRIOR = (0.03, 30.0)
# standard deviation of manufacturing errors in the images over that of noise, up to which pose_with_prior is believed:
# it takes them for noise, which sets the intrinsics free. From 2 to 30, 9 of 25 layouts left their band, optimistic by
# up to 86 %; a random design with 11 was passed although its P95 was 15 % beyond first order
CALIBRATED_MANUFACTURE = 2.0
# (mm, rad) standard deviation of a motion between the shots, which nu does not see either: with half-widths up to 0.3
# mm and deg none of 200 layouts left its band, up to 0.5 four of 250 did, and at 9 mm P95 was 2.7 times first order's
CALIBRATED_MOTION = (0.15, 0.15 * pi / 180)
# the forms of triangulation that were sampled with each estimator
CALIBRATED_FORMS: dict[Estimator, tuple[Triangulation, ...]] = {
    Estimator.DLT: (*LINEAR, Triangulation.WEIGHTED),
    Estimator.POSE: (*LINEAR, Triangulation.WEIGHTED),
    Estimator.POSE_WITH_PRIOR: (Triangulation.NORMALISED, Triangulation.WEIGHTED),
    Estimator.REPROJECTION: (Triangulation.NORMALISED,),
}
SECOND_ORDER_LIMIT = 0.05  # second order is offered below; at nu = 0.10 it errs by +26 % and -41 %

PARTS = {
    "depth": "how well the depths are known",
    "crossing": "how firmly the rays cross",
    "disagreement": "by how much the views disagree",
    "gap": "how well triangulation tells its solution from others",
}


def error_percent(trust: Validity, quantile: float) -> float:
    """Up to how many per cent a first-order quantile may be off; inf where nothing is known."""
    if trust.expected_error_percent is None:
        return inf
    return next((trust.expected_error_percent * times for limit, times in QUANTILES if quantile <= limit), inf)


def _fewest_seen(system: System) -> int:
    """Number of fiducials of the view that sees the fewest."""
    return int(system.sees.sum(axis=1).min())


def _largest_motion(system: System) -> tuple[float, float]:
    """(mm, rad) of the motions between the shots: the largest standard deviation, half-width where it is bounded."""
    largest = {"mm": 0.0, "rad": 0.0}
    for view in system.views:
        if view.motion is not None:
            sources = view.motion.sources
            for unit, law, std, half_width in zip(
                sources.units, sources.laws, sources.std.tolist(), sources.half_width.tolist(), strict=True
            ):
                largest[unit] = max(largest[unit], half_width if law is Law.BOUNDED else std)
    return largest["mm"], largest["rad"]


def _manufacture_over_noise(system: System) -> float:
    """Manufacturing errors in the images over the noise there, standard deviations; of the view where it is most."""
    std, centre = float(system.manufacturing_std_mm.max()), system.fiducials_mm.mean(axis=0)
    if std == 0.0:
        return 0.0
    slopes = [motion_of_images(view.projection, centre[None]) for view in system.views]  # px per mm
    moved = [std * float(np.linalg.norm(slope)) / sqrt(2.0) for slope in slopes]
    noises = [view.fiducial_noise_px for view in system.views]
    return max(px / noise if noise else inf for px, noise in zip(moved, noises, strict=True))


def _largest_growth(system: System) -> float:
    """How much the structure grows or shrinks at most, relative."""
    heat = system.temperature
    return 0.0 if heat is None else abs(heat.structure_per_k) * (abs(heat.difference_k) + heat.sources.half_width.sum())


def _known_intrinsics(system: System) -> float:
    """The largest known error of intrinsics that are believed, relative; 1000 px of the principal point count as 1."""
    errors = [view.intrinsics_error for view in system.views if view.intrinsics_error is not None]
    if not system.estimator.believes_intrinsics or not errors:
        return 0.0
    return max(float(abs(error.bias / (1.0, 1000.0, 1000.0)).max()) for error in errors)


def _class_of(system: System) -> tuple[str, str]:
    """(the class of a system in words, why it was not calibrated or "")."""
    views, fiducials = len(system.views), _fewest_seen(system)
    words = f"{views} views, {fiducials} fiducials, {system.triangulation} triangulation"
    if system.estimator is not Estimator.DLT:
        words += f", estimator {system.estimator}"
    if system.triangulation not in CALIBRATED_FORMS[system.estimator]:
        return words, f"{system.triangulation} triangulation with the estimator {system.estimator}"
    if not CALIBRATED_VIEWS[0] <= views <= CALIBRATED_VIEWS[1]:
        return words, f"{views} views (calibrated: {CALIBRATED_VIEWS[0]} to {CALIBRATED_VIEWS[1]})"
    low, high = CALIBRATED_OF_POSE if system.estimator.believes_intrinsics else CALIBRATED_FIDUCIALS
    if not low <= fiducials <= high:
        return words, f"{fiducials} fiducials (calibrated: {low} to {high})"
    if system.estimator is Estimator.POSE_WITH_PRIOR:
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
    shift, turn = _largest_motion(system)
    if shift > CALIBRATED_MOTION[0] or turn > CALIBRATED_MOTION[1]:
        return words, (
            f"a motion between the shots of {shift:.3g} mm and {degrees(turn):.3g} deg, standard deviation "
            f"(calibrated: to {CALIBRATED_MOTION[0]:g} mm and {degrees(CALIBRATED_MOTION[1]):g} deg)"
        )
    if system.rotation_form is not RotationForm.FULL:
        return words, "rotations in their small-angle form"
    return words, ""


def validity(numbers: Nonlinearity, system: System, rotation_rad: float = 0.0) -> Validity:
    """Statement about the linearisation of a system.

    numbers: at the worst target.  rotation_rad: largest standard deviation (half-width if bounded) of a random
    rotation.  Its second order is some 0.7 of its square: 0.08, 0.20 and 0.54 % were measured at 1, 2 and 5 degrees.
    """
    fiducials = _fewest_seen(system)
    words, uncalibrated = _class_of(system)
    times = COUNTED.get(fiducials, 1.0)
    part = max(numbers._asdict(), key=numbers._asdict().__getitem__)
    counted = f"nu = {numbers.nu:.2g} ({PARTS[part]}" + (
        f"; counted {times:g} times: {fiducials} fiducials)" if times > 1 else ")"
    )
    if rotation_rad > ROTATION_LIMITS_RAD[0]:
        counted += f", random rotations of {degrees(rotation_rad):.3g} deg"
    growth, known = _largest_growth(system), _known_intrinsics(system)
    if growth > GROWTH_LIMITS[0]:
        counted += f", growth by temperature of {100 * growth:.2g} %"
    if known > KNOWN_INTRINSICS_LIMITS[0]:
        counted += f", intrinsics that are known to be {100 * known:.2g} % wrong"
    unseen = zip(ROTATION_LIMITS_RAD, GROWTH_LIMITS, KNOWN_INTRINSICS_LIMITS, strict=True)

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
        )

    if uncalibrated:
        return state(
            "not valid",
            None,
            f"{counted}; first order was not calibrated for {uncalibrated}: what its P95 is worth is not known, and "
            "only Monte Carlo (`tailstack verify`) decides",
        )
    for (limit, status, percent), (turn, grown, wrong) in zip(LEVELS, unseen, strict=True):
        if times * numbers.nu <= limit and rotation_rad <= turn and growth <= grown and known <= wrong:
            return state(
                status,
                percent,
                f"{counted}: first-order P95 agrees with the full chain within {percent:g} %"
                + ("" if percent <= 1 else "; where it errs it is mostly optimistic: verify by Monte Carlo"),
            )
    return state(
        "not valid",
        None,
        f"{counted}, beyond nu = {LEVELS[-1][0]:g}, {degrees(ROTATION_LIMITS_RAD[-1]):.0f} deg or "
        f"{100 * GROWTH_LIMITS[-1]:g} %: first order may be optimistic here by a factor and its P95 must not be used; "
        "only Monte Carlo (`tailstack verify`) speaks"
        + (", and beyond nu = 0.2 not even the standard deviation exists" if numbers.divisor > LEVELS[-1][0] else ""),
    )

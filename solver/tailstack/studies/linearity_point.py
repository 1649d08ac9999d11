"""One point of the grid: the design changed, first and second order of it, and Monte Carlo on the same deviates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import exp, log, radians, sqrt
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from ..contributors import error_law
from ..errors import OutOfRangeError, Problem, TailstackError
from ..montecarlo import ChainPlan, compile_plan, draw, evaluate, gains_in_plan_order
from ..propagation.linear import LinearModel, largest_rotation_rad, linearise
from ..propagation.second_order import refuse_outside_range, second_order_moments
from ..propagation.validity import validity
from ..results import Interval
from ..scoring import FRAMES, P95, checked_system
from ..system import Array, Law, Mount, Sources, System
from ..tail.declared import law_quantile
from ..tail.gaussian import norm_quantile
from .linearity_records import LEVELS, SECTIONS, LinearityPoint, Within
from .settings import with_noise

CONFIDENCE = 0.95
GLANCE = 8  # one trial in so many is looked at first
FEWEST_FIDUCIALS = 6
Error = Literal["tcp", "localisation"]


@dataclass(frozen=True, slots=True)
class Place:
    """A point of the grid."""

    noise_px: float
    rotation_deg: float
    spread: float
    fiducials: int


def far_apart(points: Array) -> NDArray[np.int64]:
    """An order of points (N, 3) in which every beginning is spread out: the farthest from the centroid, then always the
    one farthest from those before it."""
    from_centre = np.linalg.norm(points - points.mean(axis=0), axis=1)
    order = [int(from_centre.argmax())]
    nearest = np.linalg.norm(points - points[order[0]], axis=1)
    while len(order) < len(points):
        order.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, np.linalg.norm(points - points[order[-1]], axis=1))
    return np.array(order)


def _turning(mount: Mount, rotation_deg: float) -> Mount:
    """The mount with its translations as they are and three independent normal rotations of this standard deviation.

    A source that both turns and shifts, as a locator does, keeps its shift at the pivot.
    """
    old = mount.sources
    kept = [j for j in range(old.count) if old.direction[3:, j].any()]
    shifts = old.direction[:, kept]
    shifts[:3] = 0.0
    turns = 3 if rotation_deg > 0 else 0
    sources = Sources(
        names=("rx", "ry", "rz")[:turns] + tuple(old.names[j] for j in kept),
        laws=(Law.NORMAL,) * turns + tuple(old.laws[j] for j in kept),
        half_width=np.concatenate([np.full(turns, radians(rotation_deg)), old.half_width[kept]]),
        coverage_factor=np.concatenate([np.ones(turns), old.coverage_factor[kept]]),
        units=("rad",) * turns + tuple(old.units[j] for j in kept),
        direction=np.hstack([np.eye(6)[:, :turns], shifts]),
    )
    return replace(mount, sources=sources)


def changed(system: System, place: Place) -> System:
    """The system at a point of the grid, one target left in it."""
    kept = np.sort(far_apart(system.fiducials_mm)[: place.fiducials])
    centre = system.fiducials_mm.mean(axis=0)
    spread = centre + place.spread * (system.fiducials_mm[kept] - centre)
    layout = replace(
        system,
        fiducials_mm=spread,
        fiducial_labels=tuple(system.fiducial_labels[k] for k in kept),
        manufacturing_half_width_mm=system.manufacturing_half_width_mm[kept],
        interface_1=_turning(system.interface_1, place.rotation_deg),
        requirements=(),
    )
    return with_noise(layout, place.noise_px)


@dataclass(frozen=True, slots=True)
class Compared:
    """A P95 by Monte Carlo, and the linear model's over it."""

    p95_mm: float
    ratio: float
    interval: Interval
    trials: int


def compared(
    plan: ChainPlan, gains: Array, mean: Array, first_order_mm: float, error: Error, trials: int, seed: int
) -> Compared:
    """First order over Monte Carlo at P95, the linear model run on the same deviates.

    gains (3, d) per standardised deviate, mean (3,) mm.  The ratio is that of the two sampled quantiles, which share
    nearly all of their scatter; Monte Carlo's P95 is the exact first-order one over it.  The interval is Student's, of
    the logarithms of the ratios of ``SECTIONS`` equal sections.  Where an eighth of the trials shows that first order
    is beyond all levels, it is left at them: most of those trials need a full SVD each.
    """
    for count in (trials // GLANCE, trials):
        full, linear = _norms(plan, gains, mean, error, count // SECTIONS, seed)
        ratio = float(np.quantile(linear, P95) / np.quantile(full, P95))
        logs = np.log(np.quantile(linear, P95, axis=1) / np.quantile(full, P95, axis=1))
        half = float(student.ppf(0.5 + CONFIDENCE / 2, SECTIONS - 1) * logs.std(ddof=1)) / sqrt(SECTIONS)
        interval = (exp(log(ratio) - half), exp(log(ratio) + half))
        if count == trials or classified(ratio, interval) == ("beyond", True):
            break
    return Compared(first_order_mm / ratio, ratio, interval, full.size)


def _norms(plan: ChainPlan, gains: Array, mean: Array, error: Error, each: int, seed: int) -> tuple[Array, Array]:
    """(SECTIONS, each) norms, mm, of the chain and of the linear model."""
    full, linear = np.empty((SECTIONS, each)), np.empty((SECTIONS, each))
    for section in range(SECTIONS):
        z = draw(plan, seed, np.arange(section * each, (section + 1) * each))
        full[section] = np.linalg.norm(evaluate(plan, z)[:, 0, list(FRAMES).index(error)], axis=1)
        # Not a matrix product: its last digits depend on how many threads the BLAS takes.
        linear[section] = np.linalg.norm(mean + np.einsum("nd,kd->nk", z, gains), axis=1)
    return full, linear


def classified(ratio: float, interval: Interval) -> tuple[Within, bool]:
    """How far first order is from Monte Carlo, and whether the whole interval says so."""
    low, high = interval
    ends = (abs(low - 1), abs(high - 1))
    nearest, farthest = 0.0 if low <= 1 <= high else min(ends), max(ends)
    inner = 0.0
    for name, limit in LEVELS:
        if abs(ratio - 1) <= limit:
            return name, inner <= nearest and farthest <= limit
        inner = limit
    return "beyond", nearest > inner


def examined(system: System, target: int, error: Error, place: Place, trials: int, seed: int) -> LinearityPoint:
    """A point of the grid; one whose geometry does not determine the target is refused with the reason."""
    try:
        return _examined(system, target, error, place, trials, seed)
    except TailstackError as refusal:
        first = refusal.problems[0]
        nothing: dict[str, Any] = dict.fromkeys(
            name
            for name in LinearityPoint.__dataclass_fields__
            if name not in (*Place.__dataclass_fields__, "status", "reason")
        )
        return LinearityPoint(
            noise_px=place.noise_px, rotation_deg=place.rotation_deg, spread=place.spread, fiducials=place.fiducials,
            status="refused", reason=first.detail, **nothing,
        )  # fmt: skip


def _examined(system: System, target: int, error: Error, place: Place, trials: int, seed: int) -> LinearityPoint:
    if place.fiducials < FEWEST_FIDUCIALS:
        raise OutOfRangeError(Problem("", "too-few", f"{place.fiducials} fiducials do not determine a view; 6 may"))
    here = replace(changed(system, place), targets=(system.targets[target],))
    checked_system(here)
    model = linearise(here, here.targets[0])
    law = error_law(model, error, P95)
    first = law_quantile(law.law, P95).quantile_mm
    if not first > 0:
        raise OutOfRangeError(Problem("", "no-spread", "nothing moves the error here: there is no P95 to compare"))
    plan = compile_plan(here, vertex=law.worst.vertex(model))
    gains = gains_in_plan_order(plan, model.blocks, 0, error)
    found = compared(plan, gains, law.law.mean, first, error, trials, seed)
    second, why = _second_order(plan, model, error, law.law.mean, law.total_covariance, first)
    trust = validity(model.nonlinearity, here, largest_rotation_rad(model))
    within, sure = classified(found.ratio, found.interval)
    low, high = found.interval
    return LinearityPoint(
        noise_px=place.noise_px,
        rotation_deg=place.rotation_deg,
        spread=place.spread,
        fiducials=place.fiducials,
        status="ok",
        reason=None,
        nu=model.nu,
        promise=trust.status,
        promised_percent=trust.expected_error_percent,
        first_order_p95_mm=first,
        second_order_p95_mm=second,
        second_order_reason=why,
        monte_carlo_p95_mm=found.p95_mm,
        ratio=found.ratio,
        ratio_interval=found.interval,
        second_order_ratio=None if second is None else second / found.p95_mm,
        within=within,
        sure=sure,
        trials=found.trials,
        errs="optimistic" if high < 1 else "pessimistic" if low > 1 else "none seen",
    )


def _second_order(
    plan: ChainPlan, model: LinearModel, error: Error, mean: Array, covariance: Array, first_mm: float
) -> tuple[float | None, str | None]:
    """The first-order P95 times what mean and covariance to second order do to the Gaussian one, or why there is
    none."""
    try:
        refuse_outside_range(model.nonlinearity.divisor, plan.inputs)
    except OutOfRangeError as refusal:
        return None, refusal.problems[0].detail
    scaled = np.hstack([model.gain(block, error) * block.std for block in model.blocks])
    kept = np.concatenate([[law is not Law.BOUNDED for law in block.laws] for block in model.blocks]).astype(bool)
    metric = list(FRAMES).index(error)
    shift, corrected = second_order_moments(
        lambda z: evaluate(plan, z)[:, 0, metric], plan.standard_std, scaled[:, kept]
    )
    ratio = norm_quantile(P95, mean + shift, corrected) / norm_quantile(P95, mean, covariance)
    return first_mm * ratio, None


def places(
    noises_px: Sequence[float], rotations_deg: Sequence[float], spreads: Sequence[float], counts: Sequence[int]
) -> tuple[Place, ...]:
    """The grid: count, spread, noise, rotation; the last runs fastest."""
    return tuple(
        Place(noise, rotation, spread, count)
        for count in counts
        for spread in spreads
        for noise in noises_px
        for rotation in rotations_deg
    )

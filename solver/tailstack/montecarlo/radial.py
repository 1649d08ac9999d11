"""Radial conditional sampling: a quantile of |e| from a few hundred evaluations instead of many thousands.

Gaussian deviates are split as ``z = Q w + v``, w three-dimensional in the row space of the chain's Jacobian, v in
its complement.  In polar form ``w = rho n`` the radius is a chi variable with 3 degrees of freedom, and
along a ray |e| grows from inside the ball of radius r to outside: with the crossing at rho*,

    P(|e| > r) = E[ P(chi_3 > rho*(n, v)) ]

leaves nothing random in the direction that matters (directional sampling; Bjerager 1988).  The same number for
the *linear* model on the same rays has an exact expectation, and differs only by curvature: as control
variate with coefficient 1 it removes nearly all that is left.  Uniform and triangular inputs enter through their
isoprobabilistic transform ``u = F^-1(Phi(x))`` and then take part like the others (linear model included).

Directions are a Fibonacci lattice on the sphere, turned at random: each of its points is uniform, together they
cover the sphere evenly.  Independent randomisations give a Student interval.  One crossing per ray is
checked, not assumed; where it does not hold the method refuses and plain sampling has to speak.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import pi, sqrt
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc, ndtr, stdtrit

from ..errors import OutOfRangeError, Problem
from ..geometry.arrays import Array
from ..laws import SUMS, find_size
from ..results import Interval
from ..system import Effect, Law
from .chain import evaluate, measure_errors, standard_normals
from .estimators import QuantileEstimate
from .plan import ChainPlan

FARTHEST = 12.0  # P(chi_3 > 12) = 5e-31: beyond it a ray contributes nothing
RAY_STEPS = 50  # two or three are the rule; bisection of a difficult ray needs at most this many
RAY_TOLERANCE = 1e-6  # mm per mm of r: far below the sampling error, reached by the secant in two or three steps
RADIUS_STEPS = 6
RANDOMISATIONS = 16
RAYS = 4  # of each randomisation: enough for ±0.2 % on well-behaved designs


class LinearBlock(Protocol):
    """What is read of a contributor of the linear model."""

    @property
    def contributor(self) -> str: ...
    @property
    def effect(self) -> Effect: ...
    @property
    def laws(self) -> tuple[Law, ...]: ...
    def columns_mm(self, error: str) -> Array: ...


@dataclass(frozen=True, slots=True, eq=False)
class LinearChain:
    """First order of one metric in the deviates of a plan, with its exact law."""

    mean: Array  # (3,) mm, at the plan's vertex
    gain: Array  # (3, d) mm per standardised deviate, columns in the order of the plan
    exceedance: Callable[[float], float]  # r (mm) -> exact P(|e| > r) of the linear model with its declared laws
    quantile_mm: float  # start: the linear model's quantile
    density_per_mm: float  # of |e| there, > 0


class RadialEstimate(NamedTuple):
    value_mm: float
    interval_mm: Interval
    standard_error_mm: float
    evaluations: int  # of the full chain

    @property
    def quantile(self) -> QuantileEstimate:
        """The quantile with its interval."""
        return QuantileEstimate(self.value_mm, self.interval_mm)


def gains_in_plan_order(plan: ChainPlan, blocks: Sequence[LinearBlock], targets: Sequence[int], error: str) -> Array:
    """(3, d): gains of standardised deviates, in the unit of the error, from a linear model's blocks.

    targets: which of the system's the model is of; of its blocks for the noise of a target, one is of each.  Sources
    that are BOUNDED have no column; noise of other targets has zero gain.
    """
    gain = np.zeros((3, plan.dimension))
    starts = {place.name: place.start for place in plan.blocks}
    met: Counter[str] = Counter()
    standard = plan.standard_std
    for block in blocks:
        values = block.columns_mm(error)[:, [k for k, law in enumerate(block.laws) if law is not Law.BOUNDED]]
        if block.contributor not in starts:
            continue
        start = starts[block.contributor]
        if block.effect.of_target:
            start += 2 * targets[met[block.contributor]]
            met[block.contributor] += 1
        stop = start + values.shape[1]
        gain[:, start:stop] = values / standard[start:stop]
    return gain


def _chi3_tail(rho: Array) -> Array:
    return np.asarray(erfc(rho / sqrt(2)) + sqrt(2 / pi) * rho * np.exp(-0.5 * rho * rho))


def _sphere(count: int) -> Array:
    """(count, 3) Fibonacci lattice on the unit sphere."""
    k = np.arange(count) + 0.5
    height = 1 - 2 * k / count
    angle = pi * (1 + sqrt(5)) * k
    ring = np.sqrt(1 - height**2)
    return np.column_stack([ring * np.cos(angle), ring * np.sin(angle), height])


def _rotations(quaternions: Array) -> Array:
    """(m, 4) normal deviates -> (m, 3, 3) rotations, uniform over the group."""
    q = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
    w, x, y, z = q.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


@dataclass(frozen=True, slots=True, eq=False)
class _Rays:
    """Everything along the rays: ``x = rho n + v`` in Gaussian deviates, the two models of |e|."""

    plan: ChainPlan
    metric: int  # which of the system's
    linear: LinearChain
    direction: Array  # (n, d)
    offset: Array  # (n, d)
    sums: Mapping[Law, NDArray[np.int64]]  # the columns of each law in SUMS that has some

    def standardise(self, rho: Array, rays: NDArray[np.int64]) -> Array:
        x: Array = self.offset[rays] + rho[:, None] * self.direction[rays]
        for law, columns in self.sums.items():
            p = ndtr(x[:, columns])
            size = find_size(law, 2 * np.where(p < 0.5, p, 1 - p))  # half-widths, by the inverse of the distribution
            x[:, columns] = np.where(p < 0.5, -size, size)
        return x

    def chain(self, rho: Array, rays: NDArray[np.int64]) -> Array:
        errors = np.moveaxis(evaluate(self.plan, self.standardise(rho, rays)), 0, -1)
        return np.asarray(np.sqrt((measure_errors(self.plan.system, errors)[self.metric] ** 2).sum(axis=0)))

    def linear_crossing(self, r: float, start: Array) -> tuple[Array, Array]:
        """Crossings of the linear model and d|e| / d rho there: in closed form when every input is Gaussian."""
        everyone = np.arange(len(start), dtype=np.int64)
        if self.sums:
            rho, _ = _crossings(self.first_order, r, start)
            slope = (r - self.first_order(0.999 * rho, everyone)) / (0.001 * rho)
            return rho, np.where(slope > 0, slope, r / rho)
        # |m + rho g|^2 = r^2, a quadratic in rho with its one positive root when |m| < r
        m = self.linear.mean + self.offset @ self.linear.gain.T
        g = self.direction @ self.linear.gain.T
        a, b, c = (g * g).sum(axis=1), (m * g).sum(axis=1), r * r - (m * m).sum(axis=1)
        if not (c > 0).all():
            raise _refuse("radial-starts-outside", f"{int((c <= 0).sum())} of {len(c)} rays start outside {r:.6g} mm")
        root = np.sqrt(b * b + a * c)
        with np.errstate(divide="ignore"):
            rho = np.where(b > 0, c / np.maximum(b + root, 1e-300), (root - b) / np.maximum(a, 1e-300))
        return np.clip(rho, 1e-6, FARTHEST), np.maximum(root / r, 1e-12)

    def first_order(self, rho: Array, rays: NDArray[np.int64]) -> Array:
        errors = self.linear.mean + self.standardise(rho, rays) @ self.linear.gain.T
        return np.asarray(np.sqrt((errors**2).sum(axis=1)))


Norm = Callable[[Array, NDArray[np.int64]], Array]


def _refuse(code: str, detail: str) -> OutOfRangeError:
    return OutOfRangeError(Problem("", code, detail, "use plain sampling for this design"))


def _crossings(norm: Norm, r: float, start: Array, slope_guess: Array | None = None) -> tuple[Array, int]:
    """Radius at which |e| = r on each ray, by secant steps kept inside a bracket; FARTHEST if it lies beyond.

    slope_guess: d|e|/d rho for the first step (that of a ray through the centre if not given).

    Returns the radii and the number of evaluations.  Raises OutOfRangeError when a ray starts outside the ball
    or does not settle.
    """
    count = len(start)
    low, high = np.zeros(count), np.full(count, FARTHEST)
    rho = np.clip(start, 1e-6, FARTHEST)
    everyone = np.arange(count, dtype=np.int64)
    gap = norm(rho, everyone) - r
    evaluations = count
    previous, previous_gap = np.zeros(count), np.full(count, np.nan)
    active = everyone[np.abs(gap) > RAY_TOLERANCE * r]
    for _ in range(RAY_STEPS):
        if not len(active):
            return rho, evaluations
        inside = gap[active] < 0
        low[active] = np.where(inside, rho[active], low[active])
        high[active] = np.where(inside, high[active], np.minimum(rho[active], np.nextafter(FARTHEST, 0)))
        slope = (gap[active] - previous_gap[active]) / (rho[active] - previous[active])
        guess = r / np.maximum(rho[active], 0.1) if slope_guess is None else slope_guess[active]
        slope = np.where(np.isfinite(slope) & (slope > 0), slope, guess)
        proposal = rho[active] - gap[active] / slope
        middle = 0.5 * (low[active] + high[active])
        too_far = np.where(high[active] == FARTHEST, FARTHEST, middle)  # the far end is tried before it is believed
        proposal = np.where(proposal >= high[active], too_far, np.where(proposal <= low[active], middle, proposal))
        beyond = inside & (rho[active] >= FARTHEST)
        active, proposal = active[~beyond], proposal[~beyond]
        if not len(active):
            return rho, evaluations
        previous[active], previous_gap[active] = rho[active], gap[active]
        rho[active] = proposal
        gap[active] = norm(proposal, active) - r
        evaluations += len(active)
        active = active[(np.abs(gap[active]) > RAY_TOLERANCE * r) & (high[active] - low[active] > 1e-12)]
    if len(active):
        raise _refuse("radial-no-crossing", f"{len(active)} of {count} rays did not settle on a crossing of {r:.6g} mm")
    return rho, evaluations


def _single_crossing(norm: Norm, r: float, rho: Array) -> int:
    """Refuse unless every ray starts inside, is inside half-way to its crossing and outside half as far again."""
    count = len(rho)
    everyone = np.tile(np.arange(count, dtype=np.int64), 3)
    met = rho < FARTHEST
    further = np.where(met, np.minimum(1.5 * rho + 0.5, FARTHEST), rho)
    sizes = norm(np.concatenate([np.zeros(count), 0.5 * rho, further]), everyone).reshape(3, count)
    if not (sizes[0] < r).all():
        outside = int((~(sizes[0] < r)).sum())
        raise _refuse("radial-starts-outside", f"{outside} of {count} rays start outside {r:.6g} mm")
    if not (sizes[1] < r * (1 + 1e-9)).all() or not (sizes[2][met] > r * (1 - 1e-9)).all():
        raise _refuse("radial-not-monotone", f"the error does not grow along every ray through {r:.6g} mm")
    return 3 * count


def radial(
    plan: ChainPlan,
    linear: LinearChain,
    *,
    metric: int = 0,
    quantile: float = 0.95,
    seed: int,
    confidence: float = 0.95,
    randomisations: int = RANDOMISATIONS,
    rays: int = RAYS,
) -> RadialEstimate:
    """Quantile of one of the system's metrics by radial conditional sampling.

    linear: its first order in the plan's deviates, with its exact law (control variate).  rays: of each randomisation;
    more of them narrow the interval.  Raises OutOfRangeError when rays do not cross the quantile's sphere exactly
    once, or fewer than 16 randomisations are asked for.
    """
    if randomisations < 16:
        detail = f"an interval needs at least 16 randomisations, got {randomisations}"
        raise OutOfRangeError(Problem("", "randomisations", detail))
    if plan.system.loss_probability:
        raise _refuse("radial-losses", "the design says how often fiducials are missed, which no ray shows")
    laws = plan.laws
    sums = {each: np.array([k for k, law in enumerate(laws) if law is each]) for each in SUMS if each in laws}
    if plan.dimension < 3:
        raise _refuse("radial-too-few-inputs", f"three random inputs are needed, the design has {plan.dimension}")
    basis = np.linalg.svd(linear.gain * plan.standard_std, full_matrices=False)[2].T  # (d, 3), orthonormal

    count = randomisations * rays
    normal = standard_normals(seed, 2, count, plan.dimension)
    turns = _rotations(standard_normals(seed, 3, randomisations, 4))
    direction = (_sphere(rays) @ np.swapaxes(turns, 1, 2)).reshape(count, 3) @ basis.T
    offset = normal - (normal @ basis) @ basis.T
    lines = _Rays(plan, metric, linear, direction, offset, sums)

    r = linear.quantile_mm
    at_linear, slope = lines.linear_crossing(r, np.full(count, 2.8))
    crossing = at_linear
    evaluations, checked = 0, 0
    previous: tuple[float, float] | None = None
    for _ in range(RADIUS_STEPS):
        crossing, used = _crossings(lines.chain, r, crossing, slope)
        evaluations += used
        if not checked:
            checked = _single_crossing(lines.chain, r, crossing)
        by_linear = _chi3_tail(at_linear).reshape(randomisations, rays).mean(axis=1)
        exact = linear.exceedance(r)
        if abs(by_linear.mean() - exact) > 8 * by_linear.std(ddof=1) / sqrt(randomisations) + 1e-6 * exact:
            detail = f"linear model at {r:.6g} mm: the law given has P = {exact:.6g}, its rays {by_linear.mean():.6g}"
            raise _refuse("radial-control-variate", detail)
        differences = (_chi3_tail(crossing) - _chi3_tail(at_linear)).reshape(randomisations, rays).mean(axis=1)
        excess = exact + float(differences.mean()) - (1 - quantile)
        density = linear.density_per_mm
        if previous is not None and r != previous[0]:
            secant = (previous[1] - excess) / (r - previous[0])
            density = secant if secant > 0 else density
        previous = (r, excess)
        spread = float(differences.std(ddof=1)) / sqrt(randomisations) / density
        step = excess / density
        r += step
        # What is left after a Newton step: 5 % of it if the slope is that far off, and the curvature of the tail
        # (r f'/f is 3 to 6 at these quantiles).  A tenth of the sampling error is little enough.
        if 0.05 * abs(step) + 5 * step * step / r <= 0.1 * spread or abs(step) <= 1e-7 * r:
            break
        crossing = np.clip(crossing + step / slope, 1e-6, FARTHEST)
        at_linear, slope = lines.linear_crossing(r, np.clip(at_linear + step / slope, 1e-6, FARTHEST))
    else:
        raise _refuse("radial-no-quantile", f"the quantile did not settle near {r:.6g} mm")
    half = float(stdtrit(randomisations - 1, 0.5 + confidence / 2)) * spread
    return RadialEstimate(r, (r - half, r + half), spread, evaluations + checked)

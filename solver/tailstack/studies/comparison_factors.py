"""How many times as large one contributor alone would have to be for the measurements to be plausible.

By inversion of the tests: a factor is plausible when none of the tests, corrected for their number, refuses the law
that has it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, log

import numpy as np

from ..system import Array
from .comparison_linear import VANISHING_MM2, Contribution, Scene, scaled_expected
from .comparison_records import Explanation
from .comparison_search import last, least
from .comparison_statistics import (
    NormsAlong,
    departure,
    distance,
    installation_means,
    moments_of,
    norm_statistics,
    p_value,
    simulated_norm_statistics,
    two_sided,
)

FACTORS = np.concatenate([[0.0], np.geomspace(0.05, 30.0, 40)])
NARROWEST = 1e-4  # relative: how exactly the most plausible factor is found, so that no interval is stepped over
SKETCH = 199  # benches from which the smooth cost of norms is taken: it says where to look, p-values say what is found


def factor_of(scenes: Sequence[Scene], name: str, alpha: float) -> Explanation:
    pairs = [(scene, part) for scene in scenes for part in scene.law.contributions if part.name == name]
    made = [(_vector_tests if scene.errors is not None else _norm_tests)(scene, part) for scene, part in pairs]
    tests, costs = [test for test, _ in made], [cost for _, cost in made]
    count = sum(len(test(1.0)) for test in tests)
    level = alpha / count

    def plausible(factor: float) -> float:
        return min(min(test(factor)) for test in tests)

    def cost(factor: float) -> float:
        return sum(each(factor) for each in costs)

    most, low_step, high_step = _cheapest(cost)
    # The cost weighs the tests otherwise than the worst p-value does, so that its minimum may be refused where a
    # factor beside it is not.
    near = [most, *np.linspace(low_step, high_step, 17), *FACTORS]
    seed = next((float(factor) for factor in near if plausible(factor) >= level), None)
    intervals: tuple[tuple[float, float], ...] = ()
    if seed is not None:
        low, high = _reach(plausible, seed, FACTORS[::-1], level), _reach(plausible, seed, FACTORS, level)
        intervals = ((low, high),)
        most = min(max(most, low), high)
    return Explanation(
        kind="factor",
        target=scenes[0].target,
        contributor=name,
        component="all",
        unit="",
        declared=1.0,
        most_plausible=most if intervals else None,
        intervals=intervals,
        search_end=float(FACTORS[-1]),
        explains=f"{count} tests: mean and spread" if count > 1 else "the mean",
    )


def _cheapest(cost: Callable[[float], float]) -> tuple[float, float, float]:
    """The factor of least cost, and the grid's factors on either side of it."""
    k = int(np.argmin([cost(float(factor)) for factor in FACTORS]))
    low, high = float(FACTORS[max(k - 1, 0)]), float(FACTORS[min(k + 1, len(FACTORS) - 1)])
    return least(cost, low, high, NARROWEST * max(float(FACTORS[k]), float(FACTORS[1]))), low, high


def _reach(plausible: Callable[[float], float], seed: float, steps: Array, level: float) -> float:
    """How far from a plausible place the plausible ones go, along steps that run one way."""
    inside = seed
    for step in steps[steps > seed] if steps[-1] > steps[0] else steps[steps < seed]:
        if plausible(float(step)) < level:
            return last(plausible, inside, float(step), level)
        inside = float(step)
    return inside


Scaled = tuple[Callable[[float], list[float]], Callable[[float], float]]


def _vector_tests(scene: Scene, part: Contribution) -> Scaled:
    """p-values of a scene's tests when one contributor is scaled, and minus twice the Gaussian log-likelihood."""
    law, sizes, base = scene.law, scene.sizes, scene.expected
    assert scene.errors is not None
    found = moments_of(scene.errors[None], sizes)
    freedom, several = sum(sizes) - len(sizes), len(sizes) - 1
    whole = _Pieces.of(law.total - law.bias_mm, sizes)
    own = _Pieces.of(part.errors, sizes)
    mean, own_mean = whole.mean, own.mean
    within, between_them = (
        _Square.of(whole.residual, own.residual, freedom),
        _Square.of(whole.apart, own.apart, several),
    )

    def tests(factor: float) -> list[float]:
        expected = scaled_expected(base, part, factor)
        more = factor - 1
        if np.linalg.eigvalsh(expected.shot)[0] <= VANISHING_MM2:
            return [0.0]
        about = expected.of_mean(sizes)
        at = distance(found.mean - law.bias_mm, about)[0]
        p_values = [p_value(at, distance(mean + more * own_mean, about), both_sides=False)]
        if found.within is not None:
            at = departure(found.within, expected.shot, freedom)[0]
            simulated = departure(within.at(more), expected.shot, freedom)
            p_values.append(p_value(at, simulated, both_sides=two_sided(freedom, True)))
        if found.between is not None:
            between = expected.between(sizes)
            at = departure(found.between, between, several)[0]
            simulated = departure(between_them.at(more), between, several)
            p_values.append(p_value(at, simulated, both_sides=two_sided(several, True)))
        return p_values

    def cost(factor: float) -> float:
        expected = scaled_expected(base, part, factor)
        if np.linalg.eigvalsh(expected.shot)[0] <= VANISHING_MM2:
            return inf
        about = expected.of_mean(sizes)
        value = float(distance(found.mean - law.bias_mm, about)[0] + np.linalg.slogdet(about)[1])
        for covariance, predicted, degrees in (
            (found.within, expected.shot, freedom), (found.between, expected.between(sizes), several),
        ):  # fmt: skip
            if covariance is not None:
                value += degrees * float(np.trace(np.linalg.solve(predicted, covariance[0])))
                value += degrees * float(np.linalg.slogdet(predicted)[1])
        return value

    return tests, cost


@dataclass(frozen=True, slots=True, eq=False)
class _Pieces:
    """What the moments of scaled benches are put together from."""

    mean: Array  # (B, 3)
    residual: Array  # (B, n, 3) about the means of installations
    apart: Array  # (B, k, 3) those about their own mean

    @classmethod
    def of(cls, errors: Array, sizes: Sequence[int]) -> _Pieces:
        means = installation_means(errors, sizes)
        mean = means.mean(axis=1)
        return cls(mean, errors - np.repeat(means, sizes, axis=1), means - mean[:, None])


@dataclass(frozen=True, slots=True, eq=False)
class _Square:
    """Covariances (B, 3, 3) of ``whole + more * own`` for any ``more``, without the trials they are made of."""

    fixed: Array
    linear: Array
    square: Array

    @classmethod
    def of(cls, whole: Array, own: Array, freedom: int) -> _Square:
        degrees = max(freedom, 1)  # without a degree of freedom there is a covariance of nothing, which nobody asks for
        cross = np.matmul(whole.swapaxes(1, 2), own) / degrees
        return cls(
            np.matmul(whole.swapaxes(1, 2), whole) / degrees,
            cross + cross.swapaxes(1, 2),
            np.matmul(own.swapaxes(1, 2), own) / degrees,
        )

    def at(self, more: float) -> Array:
        return np.asarray(self.fixed + more * self.linear + more**2 * self.square)


def _norm_tests(scene: Scene, part: Contribution) -> Scaled:
    """The same for norms; the cost is Gaussian in each statistic, with the mean and spread of a few benches."""
    law, sizes = scene.law, scene.sizes
    observed = norm_statistics(scene.norms, scene.summary, scene.sizes)

    along = NormsAlong.of(law.total, part.errors)
    sketch = along.first(SKETCH)

    def tests(factor: float) -> list[float]:
        found = simulated_norm_statistics(along.at(factor - 1), sizes)
        return [p_value(at, sample, both_sides=True) for at, sample in zip(observed, found, strict=False)]

    def cost(factor: float) -> float:
        found = simulated_norm_statistics(sketch.at(factor - 1), sizes)
        return sum(_deviance(at, sample) for at, sample in zip(observed, found, strict=False))

    return tests, cost


def _deviance(at: float, sample: Array) -> float:
    """Minus twice the logarithm of a normal density with the mean and spread of a sample (B,), but for a constant."""
    spread = max(float(sample.std()), 1e-9)
    return ((at - float(sample.mean())) / spread) ** 2 + 2 * log(spread)

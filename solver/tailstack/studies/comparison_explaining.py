"""Which contributor would have to be how large to explain what was measured, one at a time.

By inversion of the tests: a factor (or a value) is plausible when none of the tests, corrected for their number,
refuses the law that has it.  The plausible ones are a 95 % confidence set of it, if nothing else differs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from math import sqrt

import numpy as np

from ..contributors import unit_for_people
from ..cores import usable_cores
from ..system import Array
from .comparison_linear import (
    Contribution,
    Displacement,
    Law1,
    covariance_without,
    mean_without,
    scaled_expected,
)
from .comparison_records import Explanation
from .comparison_statistics import (
    Expected,
    bench_mean,
    departure,
    distance,
    installation_means,
    lengths,
    moments_of,
    norm_statistics,
    p_value,
    simulated_norm_statistics,
    two_sided,
)

FACTORS = np.concatenate([[0.0], np.geomspace(0.05, 30.0, 40)])
REFINEMENTS = 8  # bisections of an end: 2^-8 of a step of the grid
BEST_TRIED = 33
VALUES = 61  # of a component, tried for norms
LARGEST = {"rad": float(np.deg2rad(20.0)), "mm": 100.0}  # values beyond are no explanation
Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """One level at one target: what was measured and the first-order law it is held against."""

    target: str
    sizes: tuple[int, ...]
    errors: Array | None  # (n, 3) mm, bias of bounded components taken off
    norms: Array | None  # (n,) mm
    summary: tuple[float, ...] | None  # mean and, if stated, standard deviation of the norm, mm
    expected: Expected
    law: Law1


def explanations(
    scenes: Sequence[Scene], alpha: float, threads: int | None = None, progress: Progress | None = None
) -> tuple[Explanation, ...]:
    """A factor for every contributor and a value for every component of a mount; scenes are of one target."""
    parts = {part.name: part for scene in scenes for part in scene.law.contributions}
    names = list(parts)
    moved = {(d.contributor, d.component) for scene in scenes for d in scene.law.displacements}
    asked: list[Callable[[], Explanation]] = [partial(_factor, scenes, name, alpha) for name in names]
    asked += [partial(_value, scenes, key, alpha) for key in sorted(moved)]
    found: list[Explanation] = []
    with ThreadPoolExecutor(usable_cores() if threads is None else threads) as pool:
        for one in pool.map(lambda ask: ask(), asked):
            found.append(one)
            if progress is not None:
                progress(len(found) / len(asked))
    return tuple(found)


# --- a factor -------------------------------------------------------------------------------------


def _factor(scenes: Sequence[Scene], name: str, alpha: float) -> Explanation:
    pairs = [(scene, part) for scene in scenes for part in scene.law.contributions if part.name == name]
    made = [(_vector_tests if scene.errors is not None else _norm_tests)(scene, part) for scene, part in pairs]
    tests, costs = [test for test, _ in made], [cost for _, cost in made]
    count = sum(len(test(1.0)) for test in tests)
    most = 1.0

    def plausible(factor: float) -> float:
        return min(min(test(factor)) for test in tests)

    level = alpha / count
    values = np.array([plausible(factor) for factor in FACTORS])
    best = int(values.argmax())
    intervals: tuple[tuple[float, float], ...] = ()
    if values[best] >= level:
        low = high = best
        while low > 0 and values[low - 1] >= level:
            low -= 1
        while high < len(values) - 1 and values[high + 1] >= level:
            high += 1
        ends = (
            FACTORS[0] if low == 0 else _end(plausible, FACTORS[low], FACTORS[low - 1], level),
            FACTORS[-1] if high == len(values) - 1 else _end(plausible, FACTORS[high], FACTORS[high + 1], level),
        )
        intervals = ((float(ends[0]), float(ends[1])),)
        tried = np.linspace(*intervals[0], BEST_TRIED)
        most = float(min(tried, key=lambda factor: sum(cost(factor) for cost in costs)))
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


def _end(plausible: Callable[[float], float], inside: float, outside: float, level: float) -> float:
    for _ in range(REFINEMENTS):
        middle = (inside + outside) / 2
        if plausible(middle) >= level:
            inside = middle
        else:
            outside = middle
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

    def tests(factor: float) -> list[float]:
        expected = scaled_expected(base, part, factor)
        more = factor - 1
        if np.linalg.eigvalsh(expected.shot)[0] <= 1e-12:
            return [0.0]
        about = expected.of_mean(sizes)
        at = distance(found.mean - law.bias_mm, about)[0]
        p_values = [p_value(at, distance(whole.mean + more * own.mean, about), both_sides=False)]
        if found.within is not None:
            simulated = _covariance(whole.residual, own.residual, more, freedom)
            at = departure(found.within, expected.shot, freedom)[0]
            simulated = departure(simulated, expected.shot, freedom)
            p_values.append(p_value(at, simulated, both_sides=two_sided(freedom, True)))
        if found.between is not None:
            simulated = _covariance(whole.apart, own.apart, more, several)
            between = expected.between(sizes)
            at = departure(found.between, between, several)[0]
            p_values.append(p_value(at, departure(simulated, between, several), both_sides=two_sided(several, True)))
        return p_values

    def cost(factor: float) -> float:
        expected = scaled_expected(base, part, factor)
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


def _covariance(whole: Array, own: Array, more: float, freedom: int) -> Array:
    """(B, 3, 3) of ``whole + more * own``."""
    deviations = whole + more * own
    return np.asarray(np.matmul(deviations.swapaxes(1, 2), deviations) / freedom)


def _norm_tests(scene: Scene, part: Contribution) -> Scaled:
    """The same for norms; the cost is the worst p-value, and the nearer factor of two that are alike."""
    law, sizes = scene.law, scene.sizes
    observed = norm_statistics(scene.norms, scene.summary, scene.sizes)

    def tests(factor: float) -> list[float]:
        norms = lengths(law.total + (factor - 1) * part.errors)
        simulated = simulated_norm_statistics(norms, sizes)
        return [p_value(at, sample, both_sides=True) for at, sample in zip(observed, simulated, strict=False)]

    def cost(factor: float) -> float:
        return -min(tests(factor)) + 1e-6 * abs(factor - 1)

    return tests, cost


# --- a value --------------------------------------------------------------------------------------


def _value(scenes: Sequence[Scene], key: tuple[str, str], alpha: float) -> Explanation:
    pairs = [
        (scene, moved)
        for scene in scenes
        for moved in scene.law.displacements
        if (moved.contributor, moved.component) == key
    ]
    level = alpha / len(pairs)
    regions = []
    weights: list[tuple[float, float]] = []
    for scene, moved in pairs:
        region, best, weight = (_vector_value if scene.errors is not None else _norm_value)(scene, moved, level)
        regions.append(region)
        weights.append((best, weight))
    both = regions[0]
    for region in regions[1:]:
        both = _intersection(both, region)
    largest = LARGEST[pairs[0][1].unit]
    both = _intersection(both, ((-largest, largest),))
    unit, factor = unit_for_people(pairs[0][1].unit)
    half = pairs[0][1].half_width
    middle = sum(best * weight for best, weight in weights) / sum(weight for _, weight in weights)
    if both and not any(low <= middle <= high for low, high in both):
        nearest = min(both, key=lambda ends: abs(sum(ends) / 2 - middle))
        middle = sum(nearest) / 2
    return Explanation(
        kind="value",
        target=pairs[0][0].target,
        contributor=key[0],
        component=key[1],
        unit=unit,
        declared=None if half is None else half * factor,
        most_plausible=middle * factor if both else None,
        intervals=tuple((low * factor, high * factor) for low, high in both),
        search_end=largest * factor,
        explains="the mean alone",
    )


Region = tuple[tuple[float, float], ...]


def _vector_value(scene: Scene, moved: Displacement, level: float) -> tuple[Region, float, float]:
    """(values that are plausible, the best one, its weight): distance is a quadratic in the value."""
    assert scene.errors is not None
    about = covariance_without(scene.expected, moved, scene.sizes)
    reference = distance(mean_without(scene.law, moved), about)
    threshold = float(np.quantile(reference, 1 - level, method="higher"))
    factor = np.linalg.cholesky(about)
    gain = np.linalg.solve(factor, moved.gain)
    gap = np.linalg.solve(factor, bench_mean(scene.errors[None], scene.sizes)[0] - scene.law.bias_mm)
    weight = float(gain @ gain)
    best = float(gain @ gap) / weight
    room = threshold - float(((gap - best * gain) ** 2).sum())
    if room < 0:
        return (), best, weight
    half = sqrt(room / weight)
    return ((best - half, best + half),), best, weight


def _norm_value(scene: Scene, moved: Displacement, level: float) -> tuple[Region, float, float]:
    """The same for norms, by trying values: plausible ones may lie on both sides of zero."""
    law = scene.law
    still = law.total if moved.errors is None else law.total - moved.errors
    at = norm_statistics(scene.norms, scene.summary, scene.sizes)[0]
    length = float(np.linalg.norm(moved.gain))
    reach = min(3 * (at + float(lengths(still).mean())) / length, LARGEST[moved.unit])
    tried = np.linspace(-reach, reach, VALUES)

    def plausible(value: float) -> float:
        norms = lengths(still + value * moved.gain)
        return p_value(at, bench_mean(norms, scene.sizes), both_sides=True)

    p_values = np.array([plausible(value) for value in tried])
    inside = p_values >= level
    region, k = [], 0
    while k < VALUES:
        if not inside[k]:
            k += 1
            continue
        first = k
        while k + 1 < VALUES and inside[k + 1]:
            k += 1
        low = tried[first] if first == 0 else _end(plausible, tried[first], tried[first - 1], level)
        high = tried[k] if k == VALUES - 1 else _end(plausible, tried[k], tried[k + 1], level)
        region.append((float(low), float(high)))
        k += 1
    best = float(tried[_nearest_to_zero(p_values, tried)])
    return tuple(region), best, length**2


def _nearest_to_zero(p_values: Array, tried: Array) -> int:
    """Of the values that are most plausible, the smallest."""
    largest = np.flatnonzero(p_values >= 0.9 * p_values.max())
    return int(largest[np.argmin(np.abs(tried[largest]))])


def _intersection(a: Region, b: Region) -> Region:
    return tuple(
        (max(low, other_low), min(high, other_high))
        for low, high in a
        for other_low, other_high in b
        if max(low, other_low) <= min(high, other_high)
    )

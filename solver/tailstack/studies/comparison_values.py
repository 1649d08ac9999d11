"""Which fixed value of one component alone would explain the mean: how far it would have to be off."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import sqrt

import numpy as np

from ..contributors import unit_for_people
from .comparison_linear import Displacement, Scene, covariance_without, mean_without
from .comparison_records import Explanation
from .comparison_search import least, reach
from .comparison_statistics import NormsAlong, bench_mean, distance, norm_statistics, p_value

LARGEST = {"rad": float(np.deg2rad(20.0)), "mm": 100.0}  # values beyond are no explanation
NEAR = 1e-6  # of the largest value: how exactly the one of the least mean norm is found
SKETCH = 199  # benches from which the mean norm is taken to look along; p-values are taken from all of them


def value_of(scenes: Sequence[Scene], key: tuple[str, str], alpha: float) -> Explanation:
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
    """The same for norms: plausible values may lie on both sides of where the mean norm is least."""
    law, largest = scene.law, LARGEST[moved.unit]
    still = law.total if moved.errors is None else law.total - moved.errors
    at = norm_statistics(scene.norms, scene.summary, scene.sizes)[0]
    along = NormsAlong.of(still, moved.gain)
    sketch = along.first(SKETCH)

    def mean_norm(value: float) -> float:
        return float(bench_mean(sketch.at(value), scene.sizes).mean())

    def plausible(value: float) -> float:
        return p_value(at, bench_mean(along.at(value), scene.sizes), both_sides=True)

    lowest = least(mean_norm, -largest, largest, NEAR * largest)  # a mean of norms is convex in the value
    seeds = [_crossing(mean_norm, lowest, end, at) for end in (-largest, largest)]
    inner = plausible(lowest) >= level
    spread = float(bench_mean(sketch.at(seeds[0]), scene.sizes).std())
    step = max(spread / float(np.linalg.norm(moved.gain)), NEAR * largest)
    region: list[tuple[float, float]] = []
    for seed, end in zip(seeds, (-largest, largest), strict=True):
        if plausible(seed) < level:
            outer = inward = lowest
            if not inner:
                continue
        else:
            outer = reach(plausible, seed, end, step, level)
            inward = lowest if inner else reach(plausible, seed, lowest, step, level)
        region.append((min(outer, inward), max(outer, inward)))
    if inner:
        region = [(min(low for low, _ in region), max(high for _, high in region))]
    best = min(seeds, key=abs)
    return tuple(region), best, float(moved.gain @ moved.gain)


def _crossing(mean_norm: Callable[[float], float], lowest: float, end: float, at: float) -> float:
    """Where the mean norm is the measured one between its least and an end of the search, or what is nearest to it."""
    if mean_norm(lowest) >= at:
        return lowest
    if mean_norm(end) <= at:
        return end
    inside, outside = lowest, end
    while abs(outside - inside) > 1e-9 * abs(end):
        middle = (inside + outside) / 2
        if mean_norm(middle) < at:
            inside = middle
        else:
            outside = middle
    return (inside + outside) / 2


def _intersection(a: Region, b: Region) -> Region:
    return tuple(
        (max(low, other_low), min(high, other_high))
        for low, high in a
        for other_low, other_high in b
        if max(low, other_low) <= min(high, other_high)
    )

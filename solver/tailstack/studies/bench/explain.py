"""Which contributor would have to be how large to explain what was measured, one at a time.

By inversion of the tests: a factor (or a value) is plausible when none of the tests, corrected for their number,
refuses the law that has it.  The plausible ones are a 95 % confidence set of it, if nothing else differs.

A contributor alone is scaled by a factor, or one of its components displaced by a fixed value that would explain the
mean, in benches of the first-order law.  What the nonlinear chain adds is left out: the question is which contributor
would have to be how large, and the answer is an interval that is much wider."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from math import inf, log, sqrt
from typing import Literal

import numpy as np

from ...contributors import KIND, unit_for_people
from ...geometry.arrays import Array
from ...kernels.process import usable_cores
from ...propagation.linear import Block, LinearModel, linearise
from ...results import Interval
from ...system import TORSOR_COMPONENTS, DirectEffect, Law, Place, Sources, System, put_links
from ...tail.declared import UNIFORM
from .levels import BenchDraws, Progress, draw_time
from .statistics import (
    Expected,
    NormsAlong,
    bench_mean,
    departure,
    distance,
    installation_means,
    moments_of,
    norm_statistics,
    p_value,
    simulated_norm_statistics,
    two_sided,
)


def explain(
    scenes: Sequence[TargetLevel], alpha: float, threads: int | None = None, progress: Progress | None = None
) -> tuple[Explanation, ...]:
    """A factor for every contributor and a value for every component of a mount; scenes are of one target."""
    parts = {part.name: part for scene in scenes for part in scene.law.contributions}
    names = list(parts)
    moved = {(d.contributor, d.component) for scene in scenes for d in scene.law.displacements}
    asked: list[Callable[[], Explanation]] = [partial(find_factor, scenes, name, alpha) for name in names]
    asked += [partial(find_value, scenes, key, alpha) for key in sorted(moved)]
    explanations: list[Explanation] = []
    with ThreadPoolExecutor(usable_cores() if threads is None else threads) as pool:
        for explanation in pool.map(lambda ask: ask(), asked):
            explanations.append(explanation)
            if progress is not None:
                progress(len(explanations) / len(asked))
    return tuple(explanations)


FACTORS = np.concatenate([[0.0], np.geomspace(0.05, 30.0, 40)])
NARROWEST = 1e-4  # relative: how exactly the most plausible factor is found, so that no interval is stepped over
SKETCH = 199  # benches from which the smooth cost of norms is taken: it says where to look, p-values say what is found


def find_factor(scenes: Sequence[TargetLevel], name: str, alpha: float) -> Explanation:
    pairs = [(scene, part) for scene in scenes for part in scene.law.contributions if part.name == name]
    made = [(_test_vectors if scene.errors is not None else _test_norms)(scene, part) for scene, part in pairs]
    tests, costs = [test for test, _ in made], [cost for _, cost in made]
    count = sum(len(test(1.0)) for test in tests)
    level = alpha / count

    def plausible(factor: float) -> float:
        return min(min(test(factor)) for test in tests)

    def cost(factor: float) -> float:
        return sum(each(factor) for each in costs)

    most, low_step, high_step = _find_cheapest(cost)
    # The cost weighs the tests otherwise than the worst p-value does, so that its minimum may be refused where a
    # factor beside it is not.
    near = [most, *np.linspace(low_step, high_step, 17), *FACTORS]
    seed = next((float(factor) for factor in near if plausible(factor) >= level), None)
    intervals: tuple[tuple[float, float], ...] = ()
    if seed is not None:
        low, high = _step_to_end(plausible, seed, FACTORS[::-1], level), _step_to_end(plausible, seed, FACTORS, level)
        intervals = ((low, high),)
        most = min(max(most, low), high)
    return Explanation(
        kind="factor",
        target=scenes[0].target,
        contributor=name,
        label=pairs[0][1].label,
        component="all",
        unit="",
        declared=1.0,
        most_plausible=most if intervals else None,
        intervals=intervals,
        search_end=float(FACTORS[-1]),
        explains=f"{count} tests: mean and spread" if count > 1 else "the mean",
    )


def _find_cheapest(cost: Callable[[float], float]) -> tuple[float, float, float]:
    """The factor of least cost, and the grid's factors on either side of it."""
    k = int(np.argmin([cost(float(factor)) for factor in FACTORS]))
    low, high = float(FACTORS[max(k - 1, 0)]), float(FACTORS[min(k + 1, len(FACTORS) - 1)])
    return find_least(cost, low, high, NARROWEST * max(float(FACTORS[k]), float(FACTORS[1]))), low, high


def _step_to_end(plausible: Callable[[float], float], seed: float, steps: Array, level: float) -> float:
    """How far from a plausible place the plausible ones go, along steps that run one way."""
    inside = seed
    for step in steps[steps > seed] if steps[-1] > steps[0] else steps[steps < seed]:
        if plausible(float(step)) < level:
            return find_last(plausible, inside, float(step), level)
        inside = float(step)
    return inside


Scaled = tuple[Callable[[float], list[float]], Callable[[float], float]]


def _test_vectors(scene: TargetLevel, part: Contribution) -> Scaled:
    """p-values of a scene's tests when one contributor is scaled, and minus twice the Gaussian log-likelihood."""
    law, sizes, base = scene.law, scene.sizes, scene.expected
    assert scene.errors is not None
    moments = moments_of(scene.errors[None], sizes)
    freedom, several = sum(sizes) - len(sizes), len(sizes) - 1
    whole = _Pieces.of(law.total - law.bias_mm, sizes)
    own = _Pieces.of(part.errors, sizes)
    mean, own_mean = whole.mean, own.mean
    within, between_them = (
        _Square.of(whole.residual, own.residual, freedom),
        _Square.of(whole.apart, own.apart, several),
    )

    def tests(factor: float) -> list[float]:
        expected = scale_expected(base, part, factor)
        more = factor - 1
        if np.linalg.eigvalsh(expected.shot)[0] <= VANISHING_MM2:
            return [0.0]
        about = expected.of_mean(sizes)
        at = distance(moments.mean - law.bias_mm, about)[0]
        p_values = [p_value(at, distance(mean + more * own_mean, about), both_sides=False)]
        if moments.within is not None:
            at = departure(moments.within, expected.shot, freedom)[0]
            simulated = departure(within.at(more), expected.shot, freedom)
            p_values.append(p_value(at, simulated, both_sides=two_sided(freedom, True)))
        if moments.between is not None:
            between = expected.between(sizes)
            at = departure(moments.between, between, several)[0]
            simulated = departure(between_them.at(more), between, several)
            p_values.append(p_value(at, simulated, both_sides=two_sided(several, True)))
        return p_values

    def cost(factor: float) -> float:
        expected = scale_expected(base, part, factor)
        if np.linalg.eigvalsh(expected.shot)[0] <= VANISHING_MM2:
            return inf
        about = expected.of_mean(sizes)
        value = float(distance(moments.mean - law.bias_mm, about)[0] + np.linalg.slogdet(about)[1])
        for covariance, predicted, degrees in (
            (moments.within, expected.shot, freedom),
            (moments.between, expected.between(sizes), several),
        ):
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


def _test_norms(scene: TargetLevel, part: Contribution) -> Scaled:
    """The same for norms; the cost is Gaussian in each statistic, with the mean and spread of a few benches."""
    law, sizes = scene.law, scene.sizes
    observed = norm_statistics(scene.norms, scene.summary, scene.sizes)

    along = NormsAlong.of(law.total, part.errors)
    sketch = along.first(SKETCH)

    def tests(factor: float) -> list[float]:
        simulated = simulated_norm_statistics(along.at(factor - 1), sizes)
        return [p_value(at, sample, both_sides=True) for at, sample in zip(observed, simulated, strict=False)]

    def cost(factor: float) -> float:
        simulated = simulated_norm_statistics(sketch.at(factor - 1), sizes)
        return sum(_deviance(at, sample) for at, sample in zip(observed, simulated, strict=False))

    return tests, cost


def _deviance(at: float, sample: Array) -> float:
    """Minus twice the logarithm of a normal density with the mean and spread of a sample (B,), but for a constant."""
    spread = max(float(sample.std()), 1e-9)
    return ((at - float(sample.mean())) / spread) ** 2 + 2 * log(spread)


LARGEST = {"rad": float(np.deg2rad(20.0)), "mm": 100.0}  # values beyond are no explanation
NEAR = 1e-6  # of the largest value: how exactly the one of the least mean norm is found
MEAN_SKETCH = 199  # benches from which the mean norm is taken to look along; p-values are taken from all of them


def find_value(scenes: Sequence[TargetLevel], key: tuple[str, str], alpha: float) -> Explanation:
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
        region, best, weight = (_find_vector_value if scene.errors is not None else _find_norm_value)(
            scene, moved, level
        )
        regions.append(region)
        weights.append((best, weight))
    both = regions[0]
    for region in regions[1:]:
        both = _intersect(both, region)
    largest = LARGEST[pairs[0][1].unit]
    both = _intersect(both, ((-largest, largest),))
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
        label=pairs[0][1].label,
        component=key[1],
        unit=unit,
        declared=None if half is None else half * factor,
        most_plausible=middle * factor if both else None,
        intervals=tuple((low * factor, high * factor) for low, high in both),
        search_end=largest * factor,
        explains="the mean alone",
    )


Region = tuple[tuple[float, float], ...]


def _find_vector_value(scene: TargetLevel, moved: MountComponent, level: float) -> tuple[Region, float, float]:
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


def _find_norm_value(scene: TargetLevel, moved: MountComponent, level: float) -> tuple[Region, float, float]:
    """The same for norms: plausible values may lie on both sides of where the mean norm is least."""
    law, largest = scene.law, LARGEST[moved.unit]
    still = law.total if moved.errors is None else law.total - moved.errors
    at = norm_statistics(scene.norms, scene.summary, scene.sizes)[0]
    along = NormsAlong.of(still, moved.gain)
    sketch = along.first(MEAN_SKETCH)

    def mean_norm(value: float) -> float:
        return float(bench_mean(sketch.at(value), scene.sizes).mean())

    def plausible(value: float) -> float:
        return p_value(at, bench_mean(along.at(value), scene.sizes), both_sides=True)

    lowest = find_least(mean_norm, -largest, largest, NEAR * largest)  # a mean of norms is convex in the value
    seeds = [_find_crossing(mean_norm, lowest, end, at) for end in (-largest, largest)]
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
            outer = find_end(plausible, seed, end, step, level)
            inward = lowest if inner else find_end(plausible, seed, lowest, step, level)
        region.append((min(outer, inward), max(outer, inward)))
    if inner:
        region = [(min(low for low, _ in region), max(high for _, high in region))]
    best = min(seeds, key=abs)
    return tuple(region), best, float(moved.gain @ moved.gain)


def _find_crossing(mean_norm: Callable[[float], float], lowest: float, end: float, at: float) -> float:
    """Where the mean norm is the measured one between its least and an end of the search, or what is nearest to it."""
    if mean_norm(lowest) >= at:
        return lowest
    if mean_norm(end) <= at:
        return end
    from scipy.optimize import brentq

    return float(brentq(lambda value: mean_norm(value) - at, lowest, end, xtol=1e-9 * abs(end)))


def _intersect(a: Region, b: Region) -> Region:
    return tuple(
        (max(low, other_low), min(high, other_high))
        for low, high in a
        for other_low, other_high in b
        if max(low, other_low) <= min(high, other_high)
    )


REFINEMENTS = 10  # bisections of an end


def find_least(cost: Callable[[float], float], low: float, high: float, near: float) -> float:
    """Where a function is least between two places, to within ``near``; ends included."""
    from scipy.optimize import minimize_scalar  # a third of a second that no other command should wait for

    inner = minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": near})
    return min((float(inner.x), low, high), key=cost)


def find_last(plausible: Callable[[float], float], inside: float, outside: float, level: float) -> float:
    """The last plausible place between one that is and one that is not."""
    for _ in range(REFINEMENTS):
        middle = (inside + outside) / 2
        if plausible(middle) >= level:
            inside = middle
        else:
            outside = middle
    return inside


def find_end(plausible: Callable[[float], float], seed: float, end: float, step: float, level: float) -> float:
    """How far from a plausible place the plausible ones go towards ``end``, by steps that double."""
    inside, direction = seed, 1.0 if end > seed else -1.0
    while inside != end:
        further = min(seed + step, end) if direction > 0 else max(seed - step, end)
        if plausible(further) < level:
            return find_last(plausible, inside, further, level)
        inside, step = further, 2 * step
    return inside


VANISHING_MM2 = 1e-12  # of a contributor to this error: nothing to be scaled
LEVER = 0.01  # rad
IMAGE_NOISE = "image_noise"  # of fiducials and targets in all views, as one contributor


@dataclass(frozen=True, slots=True, eq=False)
class Contribution:
    """One contributor of B benches."""

    name: str
    label: str  # what people call it
    when: str  # unit, installation, shot
    errors: Array  # (B, n, 3) mm; its own part
    covariance: Array  # (3, 3) mm^2 of one draw


@dataclass(frozen=True, slots=True, eq=False)
class MountComponent:
    """One component of a mount: what a fixed value of it does, and its own random part."""

    contributor: str
    label: str  # what people call the contributor
    component: str
    unit: str  # rad or mm
    gain: Array  # (3,) mm per unit
    half_width: float | None  # as declared; None where the design has it in place
    errors: Array | None  # (B, n, 3) mm; None where it is not random
    covariance: Array  # (3, 3) mm^2
    when: str


@dataclass(frozen=True, slots=True, eq=False)
class SampledLaw:
    """The first-order law of a group's bench, sampled."""

    sizes: tuple[int, ...]
    bias_mm: Array  # (3,)
    total: Array  # (B, n, 3) mm, bias included
    contributions: tuple[Contribution, ...]
    displacements: tuple[MountComponent, ...]


@dataclass(frozen=True, slots=True, eq=False)
class TargetLevel:
    """One level at one target: what was measured and the first-order law it is held against."""

    target: str
    sizes: tuple[int, ...]
    errors: Array | None  # (n, 3) mm, bias of bounded components taken off
    norms: Array | None  # (n,) mm
    summary: tuple[float, ...] | None  # mean and, if stated, standard deviation of the norm, mm
    expected: Expected
    law: SampledLaw


def sample_law(system: System, target: int, error: str, sizes: Sequence[int], draws: BenchDraws) -> SampledLaw:
    """Benches of the first-order law at one target, with every contributor's own part."""
    model = linearise(system, system.targets[target])
    count = draws.count
    rng = np.random.default_rng([draws.seed, 0x434F4D50])
    contributions, parts = [], {}
    total = np.broadcast_to(model.bias_mm(error), (count, sum(sizes), 3)).copy()
    for block in model.blocks:
        columns = _draw_components(block, block.gain(error), rng, count, sizes)
        whole = sum(columns.values(), np.zeros((count, 1, 3)))
        total += whole
        covariance = block.covariance(error)
        if np.trace(covariance) > VANISHING_MM2:
            contributions.append(
                Contribution(
                    block.contributor,
                    block.label,
                    draw_time(block),
                    np.broadcast_to(whole, total.shape),
                    covariance,
                )
            )
        parts.update({(block.contributor, name): (block, j, errors) for (j, name), errors in columns.items()})
    noises = {block.contributor for block in model.blocks if block.grouped and block.effect.acts_at(Place.IMAGES)}
    seen = [part for part in contributions if part.name in noises]
    if len(seen) > 1:
        together = np.sum([part.errors for part in seen], axis=0)
        covariance = np.sum([part.covariance for part in seen], axis=0)
        contributions.insert(0, Contribution(IMAGE_NOISE, "image noise", "shot", together, covariance))
    if draws.instrument_sd_mm:
        noise = rng.normal(0.0, draws.instrument_sd_mm, total.shape)
        total += noise
        contributions.append(
            Contribution("instrument", "instrument", "shot", noise, draws.instrument_sd_mm**2 * np.eye(3))
        )
    moved = tuple(_list_displacements(system, target, error, model, parts, total.shape))
    return SampledLaw(tuple(sizes), model.bias_mm(error), total, tuple(contributions), moved)


def _draw_components(
    block: Block, gain: Array, rng: np.random.Generator, count: int, sizes: Sequence[int]
) -> dict[tuple[int, str], Array]:
    """Errors (B, n or 1, 3) of each component of a block; a grouped block counts as one."""
    trials = sum(sizes)
    draws = {"unit": 1, "installation": len(sizes), "shot": trials}[draw_time(block)]
    if block.grouped and all(law is Law.NORMAL for law in block.laws):
        scaled = gain * block.std
        values, vectors = np.linalg.eigh(scaled @ scaled.T)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        drawn = {(0, "all"): rng.standard_normal((count, draws, 3)) @ root.T}
    elif block.grouped:
        xi = np.stack([_draw_scalars(block, j, rng, (count, draws)) for j in range(len(block.laws))], axis=-1)
        drawn = {(0, "all"): xi @ gain.T}
    else:
        drawn = {
            (j, name): _draw_scalars(block, j, rng, (count, draws))[..., None] * gain[:, j]
            for j, name in enumerate(block.components)
        }
    if draw_time(block) == "installation":
        return {key: np.repeat(errors, sizes, axis=1) for key, errors in drawn.items()}
    return drawn


def _draw_scalars(block: Block, j: int, rng: np.random.Generator, shape: tuple[int, int]) -> Array:
    law, half = block.laws[j], float(block.half_width[j])
    if law is Law.NORMAL:
        return rng.normal(0.0, float(block.std[j]), shape)
    if law is Law.BOUNDED:
        return np.zeros(shape)
    if KIND[law] == UNIFORM:
        return rng.uniform(-half, half, shape)
    return half * (rng.random(shape) - rng.random(shape))


def _list_displacements(
    system: System,
    target: int,
    error: str,
    model: LinearModel,
    parts: dict[tuple[str, str], tuple[Block, int, Array]],
    shape: tuple[int, ...],
) -> list[MountComponent]:
    """All six components of every mount, whether the design gives them a tolerance or not."""
    probed = put_links(system, map(_free_six, system.mounts))
    full = linearise(probed, system.targets[target])
    displacements = []
    for block in full.blocks:
        if block.grouped or block.effect.acts_at(Place.TOOL):
            continue
        for j, component in enumerate(block.components):
            gain = block.gain(error)[:, j]
            if not np.linalg.norm(gain) * (LEVER if block.units[j] == "rad" else 1.0) > 1e-3:
                continue  # turns about the target itself move nothing
            own = parts.get((block.contributor, component))
            covariance, errors, half = np.zeros((3, 3)), None, None
            if own is not None:
                declared, k, drawn = own
                scaled = declared.gain(error)[:, k] * declared.std[k]
                covariance, half = np.outer(scaled, scaled), float(declared.half_width[k])
                errors = np.broadcast_to(drawn, shape)
            displacements.append(
                MountComponent(
                    contributor=block.contributor,
                    label=block.label,
                    component=component,
                    unit=block.units[j],
                    gain=gain,
                    half_width=half,
                    errors=errors,
                    covariance=covariance,
                    when=draw_time(block),
                )
            )
    return displacements


def _free_six(mount: DirectEffect) -> DirectEffect:
    """The mount with a source for each torsor component, to read their gains off the linear model."""
    sources = Sources(
        TORSOR_COMPONENTS, (Law.NORMAL,) * 6, np.ones(6), np.ones(6), ("rad",) * 3 + ("mm",) * 3, np.eye(6)
    )
    return replace(mount, sources=sources)


def scale_expected(base: Expected, part: Contribution, factor: float) -> Expected:
    """Expected moments with one contributor's tolerance times a factor."""
    more = (factor**2 - 1) * part.covariance
    return replace(base, **{part.when: getattr(base, part.when) + more})


def mean_without(law: SampledLaw, moved: MountComponent) -> Array:
    """(B, 3) mean error of each bench about the bias, with one component standing still."""
    errors = law.total if moved.errors is None else law.total - moved.errors
    return bench_mean(errors, law.sizes) - law.bias_mm


def covariance_without(base: Expected, moved: MountComponent, sizes: Sequence[int]) -> Array:
    """(3, 3) covariance of the mean of a bench, with one component standing still."""
    return replace(base, **{moved.when: getattr(base, moved.when) - moved.covariance}).of_mean(sizes)


@dataclass(frozen=True, slots=True)
class Explanation:
    """How large one contributor alone would have to be for the measurements to be plausible."""

    kind: Literal["factor", "value"]
    """factor: on the declared tolerance or noise of a contributor; value: fixed, of one component."""
    target: str
    """Name of the target."""
    contributor: str
    """Source of error."""
    component: str
    """Its component."""
    unit: str
    """Unit of the values: deg or mm; empty for a factor."""
    declared: float | None
    """Declared half-width, in `unit`; 1 for a factor; null where none is declared."""
    most_plausible: float | None
    """The most plausible factor or value, in `unit`; null: none explains the difference."""
    intervals: tuple[Interval, ...]
    """95 % intervals of it, in `unit`; empty when none does. The last end may be the end of the search."""
    search_end: float
    """Largest factor or value that was tried, in `unit`."""
    explains: str
    """Which tests it is held against."""
    label: str = ""
    """What people call the source: the label that the design gives an interface, otherwise its name or words for it."""

"""Which contributor would have to be how large to explain what was measured, one at a time.

By inversion of the tests: a factor (or a value) is plausible when none of the tests, corrected for their number,
refuses the law that has it.  The plausible ones are a 95 % confidence set of it, if nothing else differs.

A contributor alone is scaled by a factor, or one of its components displaced by a fixed value that would explain the
mean.  The law is the Gaussian one with the first-order moments: the verdict is of simulated benches, but here the
question is which contributor would have to be how large, and the answer is an interval that is much wider than what
that leaves out.  Error vectors are needed: a norm does not say which way to look.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf, log, sqrt
from typing import Literal

import numpy as np
from scipy.special import chdtr, chdtrc, chdtri, psi

from ...contributors import unit_for_people
from ...geometry.arrays import Array
from ...propagation.linear import Block, LinearModel, linearise
from ...results import Interval
from ...system import TORSOR_COMPONENTS, DirectEffect, Law, Place, Sources, put_links
from .levels import Bench, choose_offset, draw_time
from .statistics import LEAST_FREEDOM, BenchMoments, Expected, departure, moments_of

FACTORS = np.concatenate([[0.0], np.geomspace(0.05, 30.0, 4000)])  # by a sixth of a per cent
TIMES = ("unit", "installation", "shot")
LARGEST = {"rad": float(np.deg2rad(20.0)), "mm": 100.0}  # values beyond are no explanation
VANISHING_MM2 = 1e-12  # of a contributor to this error: nothing to be scaled
LEAST_GAIN = {"rad": 0.1, "mm": 1e-3}  # mm per unit; a turn about the target itself moves nothing


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
    """95 % interval of it, in `unit`; empty when none does. The last end may be the end of the search."""
    search_end: float
    """Largest factor or value that was tried, in `unit`."""
    explains: str
    """Which tests it is held against."""
    label: str = ""
    """What people call the source: the label that the design gives an interface, otherwise its name or words for it."""


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredBench:
    """One level at one target: the moments of what was measured, about the predicted mean."""

    bench: Bench
    moments: BenchMoments  # of this bench alone; bounded components are where they serve the prediction best

    @classmethod
    def of(cls, bench: Bench) -> MeasuredBench:
        """Of a bench with error vectors."""
        assert bench.vectors is not None
        return cls(bench, moments_of((bench.vectors - choose_offset(bench) - bench.expected.mean)[None], bench.sizes))


def explain(benches: Sequence[Bench], instrument_sd_mm: float, error: str, alpha: float) -> tuple[Explanation, ...]:
    """A factor for every contributor and a value for every component of a mount; benches of one target."""
    shares: dict[str, list[tuple[MeasuredBench, Contribution]]] = {}
    moved: dict[tuple[str, str], list[tuple[MeasuredBench, MountComponent]]] = {}
    for each in [MeasuredBench.of(bench) for bench in benches if bench.vectors is not None]:
        for share in _list_shares(each.bench.model, error, instrument_sd_mm):
            shares.setdefault(share.name, []).append((each, share))
        for part in _list_displacements(each.bench, error):
            moved.setdefault((part.contributor, part.component), []).append((each, part))
    factors = [_find_factor(pairs, alpha) for pairs in shares.values()]
    return (*factors, *(_find_value(moved[key], alpha) for key in sorted(moved)))


# --- factors ----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Contribution:
    """One contributor of a bench."""

    name: str
    label: str  # what people call it
    when: str  # unit, installation, shot
    covariance: Array  # (3, 3) mm^2 of one draw


def _list_shares(model: LinearModel, error: str, instrument_sd_mm: float) -> list[Contribution]:
    """Every contributor; the noise of all images counts as one beside that of each."""
    shares = [Contribution(b.contributor, b.label, draw_time(b.effect), b.covariance(error)) for b in model.blocks]
    noises = {block.contributor for block in model.blocks if block.is_grouped and block.effect.acts_at(Place.IMAGES)}
    seen = [share.covariance for share in shares if share.name in noises]
    if len(seen) > 1:
        shares.insert(0, Contribution("image_noise", "image noise", "shot", np.sum(seen, axis=0)))
    shares.append(Contribution("instrument", "instrument", "shot", instrument_sd_mm**2 * np.eye(3)))
    return [share for share in shares if np.trace(share.covariance) > VANISHING_MM2]


def _find_factor(pairs: Sequence[tuple[MeasuredBench, Contribution]], alpha: float) -> Explanation:
    """The factors that no test refuses, of all that are tried, and the likeliest of them."""
    weighed = [each for measured, share in pairs for each in _weigh_factors(measured, share)]
    plausible = np.min([p for p, _ in weighed], axis=0) >= alpha / len(weighed)
    deviance = np.where(plausible, np.sum([each for _, each in weighed], axis=0), inf)
    ends, found = FACTORS[plausible], bool(plausible.any())
    return Explanation(
        kind="factor",
        target=pairs[0][0].bench.group.target,
        contributor=pairs[0][1].name,
        label=pairs[0][1].label,
        component="all",
        unit="",
        declared=1.0,
        most_plausible=float(FACTORS[deviance.argmin()]) if found else None,
        intervals=((float(ends[0]), float(ends[-1])),) if found else (),
        search_end=float(FACTORS[-1]),
        explains=f"{len(weighed)} tests: mean and spread" if len(weighed) > 1 else "the mean",
    )


def _weigh_factors(measured: MeasuredBench, share: Contribution) -> Iterator[tuple[Array, Array]]:
    """Of each test of a level, at every factor on a contributor: p-value and minus twice the log-likelihood, (F,) each.

    Where nothing would vary any more, these are 0 and infinite.
    """
    moments, sizes = measured.moments, measured.bench.sizes
    scaled = _scale(measured.bench.expected, share, FACTORS)
    varies = np.linalg.eigvalsh(scaled.shot)[:, 0] > VANISHING_MM2
    law = Expected(scaled.mean, scaled.unit[varies], scaled.installation[varies], scaled.shot[varies])

    tests: list[tuple[Array | None, int, Array]] = [
        (np.einsum("ri,rj->rij", moments.mean, moments.mean), 1, law.of_mean(sizes)),
        (moments.within, sum(sizes) - len(sizes), law.shot),
        (moments.between, len(sizes) - 1, law.between(sizes)),
    ]
    for number, (observed, freedom, expected) in enumerate(tests):
        if observed is not None:
            p, deviance = np.zeros(len(FACTORS)), np.full(len(FACTORS), inf)
            trace = np.trace(np.linalg.solve(expected, observed), axis1=1, axis2=2)
            apart = None if number == 0 else departure(observed, expected, freedom)
            p[varies] = chdtrc(3, trace) if apart is None else departure_p_value(apart, freedom)
            deviance[varies] = freedom * (trace + np.linalg.slogdet(expected)[1])
            yield p, deviance


def _scale(law: Expected, share: Contribution, factors: Array) -> Expected:
    """Expected moments, covariances (F, 3, 3), with one contributor's tolerance times each factor."""
    more = np.multiply.outer(factors**2 - 1, share.covariance)
    parts = {name: getattr(law, name) + (more if name == share.when else 0 * more) for name in TIMES}
    return replace(law, **parts)


def departure_p_value(statistic: Array, freedom: int) -> Array:
    """(R,) of :func:`departure` (R,) among Gaussian benches, both sides of a ratio of traces.

    The ratio of traces is chi-squared; the likelihood ratio is too, nearly, with 6 degrees of freedom once its mean is
    (by the mean of a Wishart matrix' log determinant: Anderson 2003, sections 7.5 and 10.8).
    """
    if freedom < LEAST_FREEDOM:
        degrees = 3 * freedom
        sides = chdtr(degrees, degrees * statistic), chdtrc(degrees, degrees * statistic)
        return np.asarray(2 * np.minimum(*sides))
    mean = -freedom * (psi((freedom - np.arange(3)) / 2).sum() + 3 * log(2 / freedom))
    return np.asarray(chdtrc(6, 6 / mean * statistic))


# --- values -----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class MountComponent:
    """One component of a mount: what a fixed value of it does, and its own random part."""

    contributor: str
    label: str  # what people call the contributor
    component: str
    unit: str  # rad or mm
    gain: Array  # (3,) mm per unit
    half_width: float | None  # as declared; None where the design has it in place
    covariance: Array  # (3, 3) mm^2
    when: str


def _list_displacements(bench: Bench, error: str) -> Iterator[MountComponent]:
    """All six components of every mount, whether the design gives them a tolerance or not."""
    declared = {(b.contributor, name): (b, j) for b in bench.model.blocks for j, name in enumerate(b.components)}
    probed = put_links(bench.system, map(_free_six, bench.system.mounts))
    for block in linearise(probed, bench.model.target).blocks:
        if block.is_grouped or block.effect.acts_at(Place.TOOL):
            continue
        for j, component in enumerate(block.components):
            gain, unit = block.gain(error)[:, j], block.units[j]
            if not np.linalg.norm(gain) > LEAST_GAIN[unit]:
                continue
            own: Block | None
            own, k = declared.get((block.contributor, component), (None, 0))
            scaled = np.zeros(3) if own is None else own.gain(error)[:, k] * own.std[k]
            half = None if own is None else float(own.half_width[k])
            drawn_with = draw_time(block.effect)
            yield MountComponent(
                block.contributor, block.label, component, unit, gain, half, np.outer(scaled, scaled), drawn_with
            )


def _free_six(mount: DirectEffect) -> DirectEffect:
    """The mount with a source for each torsor component, to read their gains off the linear model."""
    sources = Sources(
        TORSOR_COMPONENTS, (Law.NORMAL,) * 6, np.ones(6), np.ones(6), ("rad",) * 3 + ("mm",) * 3, np.eye(6)
    )
    return replace(mount, sources=sources)


def _find_value(pairs: Sequence[tuple[MeasuredBench, MountComponent]], alpha: float) -> Explanation:
    """The values that the mean of no level refuses, were the component fixed there."""
    first, largest = pairs[0][1], LARGEST[pairs[0][1].unit]
    threshold = float(chdtri(3, alpha / len(pairs)))
    low, high, total, weights = -largest, largest, 0.0, 0.0
    for each, part in pairs:
        law = each.bench.expected
        still = replace(law, **{part.when: getattr(law, part.when) - part.covariance})
        root = np.linalg.cholesky(still.of_mean(each.bench.sizes))
        gain, gap = np.linalg.solve(root, part.gain), np.linalg.solve(root, each.moments.mean[0])
        weight = float(gain @ gain)
        best = float(gain @ gap) / weight
        room = threshold - float(((gap - best * gain) ** 2).sum())  # distance is a quadratic in the value
        half = sqrt(room / weight) if room >= 0 else -2 * largest
        low, high = max(low, best - half), min(high, best + half)
        total, weights = total + best * weight, weights + weight
    unit, factor = unit_for_people(first.unit)
    found = low <= high
    return Explanation(
        kind="value",
        target=pairs[0][0].bench.group.target,
        contributor=first.contributor,
        label=first.label,
        component=first.component,
        unit=unit,
        declared=None if first.half_width is None else first.half_width * factor,
        most_plausible=min(max(total / weights, low), high) * factor if found else None,
        intervals=((low * factor, high * factor),) if found else (),
        search_end=largest * factor,
        explains="the mean alone",
    )

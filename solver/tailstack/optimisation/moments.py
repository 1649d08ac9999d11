"""Moments of one limited error at a choice, and the smooth closed form of its quantile: floats and symbols alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt as float_sqrt
from typing import Any

import numpy as np

from ..system import Array, Law
from ..tail.approximation import pearson_wh_quantile_squared, square_cumulants, unit_quantile_squared
from .problem import Demand
from .symbols import Duck, plain, times
from .terms import DemandTerms, Mechanics


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """Mean (3,), covariances (3, 3) of what is drawn once per unit and at each shot, and the displacement (3,) at one
    end of each source that is not normal; mm."""

    mean: Duck
    unit: Duck
    shot: Duck
    unit_uniform: tuple[Duck, ...]
    unit_triangular: tuple[Duck, ...]
    shot_uniform: tuple[Duck, ...]
    shot_triangular: tuple[Duck, ...]


def moments(
    terms: DemandTerms, noise: Duck, made: Duck, half_width: Duck, mechanics: Mechanics, signs: Duck
) -> Moments:
    """Moments at one target.

    noise, made (3, 3): covariances of image noise and of manufacturing; half_width (K,) native units; signs (B,):
    the end at which each of ``terms.bounded`` is held.  All but the terms may be symbols.
    """
    bias = terms.bias.at(mechanics)
    mean = plain(bias) if bias.dtype != object else bias
    gains = terms.gains.at(mechanics)
    covariance = {True: made, False: noise}
    columns: dict[tuple[bool, Law], list[Duck]] = {
        (per_unit, law): [] for per_unit in (True, False) for law in (Law.UNIFORM, Law.TRIANGULAR)
    }
    fixed = {True: np.zeros((3, 3)), False: np.zeros((3, 3))}
    ends = {index: signs[b] for b, index in enumerate(terms.bounded)}
    for index, source in enumerate(terms.sources):
        gain = plain(gains[index]) if gains.dtype != object else gains[index]
        if source.free is None and source.half_width == 0:
            continue
        size = source.half_width if source.free is None else half_width[source.free]
        if index in ends:
            mean = mean + times(gain, ends[index] * size)
            continue
        if source.free is None and gains.dtype != object:  # numbers: add them up as such
            scaled = gains[index] * (source.std_per_half_width * source.half_width)
            fixed[source.per_unit] += np.outer(scaled, scaled)
        else:
            variance = (source.std_per_half_width * size) ** 2
            covariance[source.per_unit] = covariance[source.per_unit] + times(np.outer(gain, gain), variance)
        if source.law in (Law.UNIFORM, Law.TRIANGULAR):
            columns[source.per_unit, source.law].append(times(gain, size))
    return Moments(
        mean,
        covariance[True] + plain(fixed[True]),
        covariance[False] + plain(fixed[False]),
        tuple(columns[True, Law.UNIFORM]),
        tuple(columns[True, Law.TRIANGULAR]),
        tuple(columns[False, Law.UNIFORM]),
        tuple(columns[False, Law.TRIANGULAR]),
    )


def squared_quantile(demand: Demand, law: Moments, sqrt: Callable[[Any], Any]) -> Duck:
    """The smooth closed form of the limited quantile, squared, mm^2.

    Pooled: of everything together.  Per unit: of each unit's own shots, that of the required fraction of units.
    """
    p = demand.requirement.quantile
    if demand.per_unit:
        return unit_quantile_squared(
            p, demand.fraction, law.mean, law.unit, law.shot, law.unit_uniform, law.unit_triangular, sqrt
        )
    cumulants = square_cumulants(
        law.mean, law.unit + law.shot, law.unit_uniform + law.shot_uniform, law.unit_triangular + law.shot_triangular
    )
    return pearson_wh_quantile_squared(p, cumulants, sqrt)


def closed_form_mm(
    terms: DemandTerms, noise: Array, made: Array, half_width: Array, mechanics: Mechanics, signs: Array
) -> float:
    """The same in floats, mm."""
    law = moments(terms, plain(noise), plain(made), half_width, mechanics, signs)
    return float_sqrt(float(squared_quantile(terms.demand, law, float_sqrt)))

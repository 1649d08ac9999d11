"""The quantile that is limited: the exact law at a choice, and the correction that carries it into the programme.

Where a mean of quantiles is limited (a mean, a CVaR), read that for the quantile: its value is the law's own, its
slopes are the mean of theirs.

The programme's constraint is smooth closed form + correction.  The correction is affine in what the quantile sees
(what comes through the images, logarithms of half-widths, pivots) and is chosen at an iterate so that value
*and* gradient are those of the exact law there.  Solved again until the iterate stands still, the programme's
first-order conditions are those of the exact law (first-order model management: Alexandrov and Lewis 2001).

The moments of a limited error and the smooth closed form of its quantile are written once, for floats and symbols.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import log, sqrt

import numpy as np
from scipy.special import ndtri

from ..contributors import WorstCase, columns_of, declared_law, law_of, read_value, value_of, worst_case
from ..geometry.arrays import Array
from ..laws import SUMS
from ..losses import search_losses, without_fiducials
from ..propagation.linear import ErrorModel, chain_of
from ..results.verdicts import P95
from ..system import ArrayLike, Effect, Law, Place, Requirement, System, Way
from ..tail.approximation import pearson_square, square_cumulants, unit_quantile_squared
from ..tail.declared import (
    LawGradient,
    LawQuantile,
    LawReading,
    LinearLaw,
    law_quantiles,
    mixture_column_gradient,
    mixture_gradient,
)
from ..tail.per_unit import SignedReading, UnitReading, read_units
from .problem import Choice, PlacementProblem, QuantileConstraint, apply_choice
from .symbols import plain, side_by_side, times
from .terms import DemandTerms, ImageParts, at_ends, linearise_demand, pivot_shift_of

LOG2_UNITS = 7  # 2048 units for a per-unit quantile: as the score draws them
LOG2_QUICK_UNITS, QUICKLY_CORRECTED = 4, 3  # and how many of them are solved with the declared law of their shots
QUICK_ERROR, QUICK_ERROR_OF_UNITS = 1e-3, 2e-2  # relative, of what is read quickly
STEP = 1e-5  # relative step of central differences of the closed form
PIVOT_STEP_MM = 0.05  # of the exact quantile
LEAST_PART = 1e-3  # of its limit, that what counts on one side is taken for where it is less: it may be 0
LEAST_LEVEL = 0.1  # of a quantile in the closed form, which knows nothing of a law's lower end


Reading = LawQuantile | UnitReading | SignedReading  # what a value was read from; its slopes are read from the same


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """One quantile at one choice, in the unit of its measure."""

    exact_mm: float
    limit: float  # of its requirement
    density: float  # of the error's norm at the quantile, 1/mm
    relative_error: float  # numerical error of exact_mm, relative
    mean_mm: Array  # (3,) at the worst vertex
    signs: Array  # (B,) ends of the bounded sources, in the order of ``DemandTerms.at_ends``
    images: ImageParts
    model: ErrorModel
    read: Reading


@dataclass(frozen=True, slots=True, eq=False)
class Correction:
    """``offset + slopes . seen``, added to log r^2.

    seen (15 + 3 C + K + 3P,): what comes through the images (``ImageParts.numbers``), logarithms of the half-widths,
    deviations of the pivots, mm.
    """

    offset: float
    slopes: Array


def is_noise(effect: Effect) -> bool:
    """Of the effects that act through single images: whether it is noise of them."""
    return effect.acts_at(Place.IMAGES)


def image_parts(model: ErrorModel, error: str) -> ImageParts:
    """What comes through the images by the linear model."""
    noise, made, gains = np.zeros((3, 3)), np.zeros((3, 3)), [np.zeros((0, 3))]
    for block in model.blocks:
        if block.effect.way is Way.IMAGES:
            (noise if is_noise(block.effect) else made)[...] += block.covariance(error)
        elif block.effect.way is Way.SHARED:
            gains.append(block.gain(error).T)
    return ImageParts(noise, made, model.imaged_bias_mm(error), np.concatenate(gains))


def evaluate_demand(problem: PlacementProblem, terms: DemandTerms, choice: Choice) -> Evaluation:
    """Exact quantile of the declared law for one demand, at the worst vertex of the bounded sources: the number the
    score reports.  Raises IllPosedError or NotConvergedError."""
    requirement = terms.demand.requirement
    system = without_fiducials(apply_choice(problem, choice), terms.demand.lost)
    model = at_ends(linearise_demand(chain_of(system), terms.demand)[0], terms.demand.ends)
    exact = exact_quantile(model, terms.demand)
    sources = (*terms.sources, *terms.common)
    keys = [(sources[b].contributor, sources[b].index) for b in terms.at_ends]
    return Evaluation(
        exact_mm=exact.value_mm,
        limit=requirement.limit,
        density=exact.density,
        relative_error=exact.relative_error,
        mean_mm=exact.worst.mean_mm,
        signs=np.array([exact.worst.signs.get(key, 1.0) for key in keys]),
        images=image_parts(model, requirement.error),
        model=model,
        read=exact.read,
    )


@dataclass(frozen=True, slots=True, eq=False)
class ExactQuantile:
    """The quantile that a requirement limits, of a linear model at its worst vertex."""

    value_mm: float
    density: float  # 1/mm
    relative_error: float
    worst: WorstCase
    read: Reading


def exact_quantile(model: ErrorModel, demand: QuantileConstraint, *, fine: bool = True) -> ExactQuantile:
    """Quantile of the declared law; nested, the required fraction of units' or mountings' own quantile (sampled).

    Not fine: several times faster, to ``QUICK_ERROR``, or nested to ``QUICK_ERROR_OF_UNITS``.
    """
    requirement = demand.requirement
    worst = worst_case(model, requirement.error, requirement.quantile, value=value_of(requirement))
    if not demand.is_nested:
        law = declared_law(model, requirement.error, worst.mean_mm)
        of_law = LawReading(law, requirement.quantile, requirement.limit, fine=fine)
        quantile, found = of_law.quantile, read_value(requirement, of_law)
        error = quantile.error_mm / max(quantile.quantile_mm, 1e-300) if fine else QUICK_ERROR
        return ExactQuantile(_keep_positive(found, demand), quantile.density, error, worst, quantile)
    columns = columns_of(model, requirement.error)
    once = columns.constant_in(demand.level)  # throughout a unit, or a mounting; the rest is drawn again
    laws = law_of(worst.mean_mm, columns.only(once)), law_of(np.zeros_like(worst.mean_mm), columns.only(~once))
    how = (LOG2_UNITS,) if fine else (LOG2_QUICK_UNITS, QUICKLY_CORRECTED)
    read = read_units(*laws, requirement.quantile, demand.fraction, *how)
    own = read.quantile
    value_mm = _keep_positive(own.value_mm, demand)
    error = own.standard_error_mm / max(value_mm, 1e-300) if fine else QUICK_ERROR_OF_UNITS
    return ExactQuantile(value_mm, own.density, error, worst, read)


def _keep_positive(value: float, demand: QuantileConstraint) -> float:
    """For logarithms; what is raised is far within its limit, and has no slope."""
    return max(value, LEAST_PART * demand.requirement.limit) if demand.measure.side else value


def error_of_trial(exact: Evaluation, demand: QuantileConstraint) -> float:
    """The standard error, mm, that one trial would leave in the mean of quantiles that is limited: of n trials, those
    at p and q have the covariance ``(min(p, q) - p q) / (n f_p f_q)``; 0: nothing varies."""
    requirement = demand.requirement
    law = declared_law(exact.model, requirement.error, exact.mean_mm)
    levels, weights = np.array(requirement.mixture).T
    density = np.array([each.density for each in law_quantiles(law, levels, requirement.quantile)])
    if not density.all():
        return 0.0
    scaled = weights / density
    return sqrt(float(scaled @ (np.minimum.outer(levels, levels) - np.outer(levels, levels)) @ scaled))


def closed_form_at(problem: PlacementProblem, terms: DemandTerms, evaluation: Evaluation, choice: Choice) -> float:
    """The closed form, mm, at the choice of a constraint and with its ends."""
    shift = pivot_shift_of(problem, choice)
    return closed_form_mm(terms, evaluation.images, choice.half_width, shift, evaluation.signs)


def count_seen(problem: PlacementProblem, terms: DemandTerms) -> int:
    """How many numbers a correction is affine in."""
    return 15 + 3 * len(terms.common) + len(problem.half_widths) + 3 * len(problem.pivots)


def no_correction(problem: PlacementProblem, terms: DemandTerms) -> Correction:
    return Correction(0.0, np.zeros(count_seen(problem, terms)))


def correction_at(
    problem: PlacementProblem, terms: DemandTerms, choice: Choice, evaluation: Evaluation, same_ends: Array | None
) -> Correction:
    """The correction that makes value and gradient exact at a choice.  ``same_ends`` (B,) keeps the bounded sources
    where they are in the programme, when the worst vertex flips between iterates."""
    at_ends = evaluation if same_ends is None else replace(evaluation, signs=same_ends)
    difference = 2 * log(evaluation.exact_mm) - 2 * log(closed_form_at(problem, terms, at_ends, choice))
    slopes = _exact_gradient(problem, terms, choice, evaluation) - _closed_gradient(problem, terms, choice, at_ends)
    seen = evaluation.images.numbers, np.log(choice.half_width), pivot_shift_of(problem, choice)
    return Correction(difference - float(slopes @ np.concatenate(seen)), slopes)


@dataclass(frozen=True, slots=True, eq=False)
class LawSlopes:
    """Derivatives of the value that a requirement limits by its law, bounded sources at their ends."""

    law: LinearLaw  # pooled of everything; nested of what a unit (or mounting) holds
    mixture: list[tuple[LawQuantile, float]]  # see ``quantiles_of``; nested: empty
    by: LawGradient  # by the law
    by_shot: Array  # (3, 3) 1/mm, by the covariance of what is drawn again
    where: Mapping[tuple[str, int], int]  # the column in the law of a source (contributor, index) that has one

    def by_covariance(self, held: bool) -> Array:
        """(3, 3) 1/mm, by that of what a unit (or mounting) holds, or of what it draws again."""
        return self.by.by_covariance if held else self.by_shot

    def by_log_width(self, source: tuple[str, int], held: bool, scaled: Array) -> float:
        """By the logarithm of the half-width of a source that is not bounded; scaled (3,) mm: its gain times its
        standard deviation."""
        if source in self.where:
            return float(self.by.by_log_column[self.where[source]])
        return 2 * float(scaled @ self.by_covariance(held) @ scaled)


def law_slopes(
    model: ErrorModel, demand: QuantileConstraint, mean_mm: Array, read: Reading, *, fine: bool = True
) -> LawSlopes:
    """At a mean (3,) mm, where the value was read; fine: as exact as that is, otherwise to 1e-4 and several times
    faster.  Nested, columns of what is drawn again are taken as normal."""
    requirement, columns = demand.requirement, columns_of(model, demand.requirement.error)
    held = columns.constant_in(demand.level) if demand.is_nested else np.full(len(columns.kinds), True)
    keys = [(block.contributor, j) for block in model.blocks for j in range(len(block.laws))]
    where = {keys[k]: column for column, k in enumerate(np.flatnonzero(held & columns.wide).tolist())}
    if not isinstance(read, LawQuantile):
        by, by_shot = read.gradient()
        return LawSlopes(read.installation, [], by, by_shot, where)
    law = law_of(mean_mm, columns)
    mixture = [(read, 1.0)] if requirement.row.by_quantile else quantiles_of(law, requirement, fine=fine)
    by = mixture_gradient(law, mixture, requirement.quantile, fine=fine)
    return LawSlopes(law, mixture, by, by.by_covariance, where)


def _exact_gradient(problem: PlacementProblem, terms: DemandTerms, choice: Choice, evaluation: Evaluation) -> Array:
    """Gradient of log r^2 under the declared law; by differences along pivots, analytic otherwise."""
    slopes = law_slopes(evaluation.model, terms.demand, evaluation.mean_mm, evaluation.read)
    columns = [slopes.where.get((source.contributor, source.index)) for source in terms.common]
    by_column = None
    if slopes.mixture and columns != [None] * len(columns):
        by_column = mixture_column_gradient(slopes.law, slopes.mixture, terms.demand.requirement.quantile)
    gains = terms.gains.at(pivot_shift_of(problem, choice))
    ends = {index: evaluation.signs[b] for b, index in enumerate(terms.at_ends)}
    widths = np.zeros(len(problem.half_widths))
    for index, source in enumerate(terms.sources):
        if source.free is None:
            continue
        moved = gains[index] * source.size(choice.half_width)
        if index in ends:
            widths[source.free] += float(slopes.by.by_mean @ moved) * ends[index]
        else:
            key, scaled = (source.contributor, source.index), moved * source.std_per_half_width
            widths[source.free] += slopes.by_log_width(key, source.held, scaled)

    # By the gains of the common sources through the covariance: for uniform and triangular ones it is that of a normal
    # law as wide; bounded ones have none (``QuantileConstraint.ends``).
    common = np.zeros((len(terms.common), 3))
    for c, (source, gain, column) in enumerate(zip(terms.common, evaluation.images.gains, columns, strict=True)):
        size = source.std_per_half_width * source.half_width
        common[c] = 2 * size**2 * slopes.by_covariance(source.held) @ gain
        if by_column is not None and column is not None:
            common[c] = source.half_width * by_column[:, column]
    images = ImageParts(slopes.by_covariance(False), slopes.by_covariance(True), slopes.by.by_mean, common)
    return _gradient(problem, terms, choice, 2 / evaluation.exact_mm, images, widths)


def quantiles_of(law: LinearLaw, requirement: Requirement, *, fine: bool = True) -> list[tuple[LawQuantile, float]]:
    """Those of a law that a requirement limits the sum of, each with its weight."""
    levels, weights = zip(*requirement.mixture, strict=True)
    return list(zip(law_quantiles(law, levels, requirement.quantile, fine=fine), weights, strict=True))


def width_slopes(problem: PlacementProblem, terms: DemandTerms, choice: Choice, evaluation: Evaluation) -> Array:
    """(K,) of the logarithm of a pooled quantile, squared, by the logarithm of each half-width."""
    first = 15 + 3 * len(terms.common)
    return _exact_gradient(problem, terms, choice, evaluation)[first : first + len(choice.half_width)]


def _gradient(
    problem: PlacementProblem, terms: DemandTerms, choice: Choice, per: float, images: ImageParts, widths: Array
) -> Array:
    """``per`` times the gradient by what comes through the images (covariances: symmetric matrices) and by logarithms
    of half-widths, followed by that by pivots."""
    twice = 2.0 - np.eye(3)  # an entry of the upper triangle stands for two
    by_images = per * images._replace(noise=images.noise * twice, made=images.made * twice).numbers
    by_pivots = []
    for p in range(choice.pivots_mm.size):
        step = np.zeros(choice.pivots_mm.shape)
        step.flat[p] = PIVOT_STEP_MM
        sides = (replace(choice, pivots_mm=choice.pivots_mm + way) for way in (-step, step))
        below, above = (evaluate_demand(problem, terms, side) for side in sides)
        through = float(by_images @ (above.images.numbers - below.images.numbers))
        by_pivots.append((2 * log(above.exact_mm / below.exact_mm) - through) / (2 * PIVOT_STEP_MM))
    return np.concatenate([by_images, per * widths, by_pivots])


def _closed_gradient(problem: PlacementProblem, terms: DemandTerms, choice: Choice, evaluation: Evaluation) -> Array:
    """Gradient of the closed form's log r^2, by central differences, all of them side by side."""
    images, widths, shift = evaluation.images, np.log(choice.half_width), pivot_shift_of(problem, choice)
    scale = float(np.trace(images.noise + images.made)) or float(evaluation.exact_mm**2)
    by_gain = [evaluation.exact_mm / source.half_width if source.half_width else 1.0 for source in terms.common]
    sizes = np.repeat([scale, evaluation.exact_mm, *by_gain, 1.0], [12, 3, *[3] * len(by_gain), len(widths)])
    steps = np.concatenate([STEP * sizes, np.full(len(shift), PIVOT_STEP_MM)])
    sides = np.concatenate([images.numbers, widths, shift])[:, None] + np.hstack([np.diag(steps), -np.diag(steps)])
    first, last = len(images.numbers), len(steps) - len(shift)
    sides[first:last] = np.exp(sides[first:last])
    numbers, half_width, moved = np.split(side_by_side(sides), [first, last])
    law = error_moments(terms, ImageParts.of(numbers), half_width, moved, evaluation.signs)
    above, below = np.split(np.log(squared_quantile(terms.demand, law)), 2)
    return np.asarray((above - below) / (2 * steps))


def exact_ratios(problem: PlacementProblem, terms: tuple[DemandTerms, ...], choice: Choice) -> Array:
    """(T,) exact quantile over its limit of every demand at a choice."""
    evaluations = [evaluate_demand(problem, term, choice) for term in terms]
    return np.array([item.exact_mm / item.limit for item in evaluations])


def p95_of(system: System, demands: Sequence[QuantileConstraint]) -> list[float]:
    """P95 of each error to first order, pooled, whatever its requirement limits; of all shots, those that miss
    fiducials among them, where that is known.  Raises IllPosedError."""
    search, chain, values = search_losses(system), chain_of(system), []
    for demand in demands:
        wanted = replace(demand.requirement, quantile=P95, risk="pooled", min_yield=None, statistic="quantile")
        if search is not None and demand.is_point:
            values.append(search.shots(demand.site.name, wanted.error, P95).value(P95))
        else:
            model, _ = linearise_demand(chain, demand)
            values.append(exact_quantile(model, replace(demand, requirement=wanted)).value_mm)
    return values


def leading_demands(
    problem: PlacementProblem, terms: tuple[DemandTerms, ...], choices: list[Choice], share: float
) -> set[int]:
    """Indices of the demands whose quantile over its limit is at least ``share`` of the largest at any of some
    choices: those that are likely to bind."""
    each = (exact_ratios(problem, terms, choice) for choice in choices)
    return {int(k) for values in each for k in np.flatnonzero(values >= share * values.max())}


@dataclass(frozen=True, slots=True, eq=False)
class ErrorMoments:
    """Mean (3,), covariances (3, 3) of what a unit (or mounting) holds and of what it draws again, and the displacement
    (3,) at one end of each source that is not normal, by whether it is held and by its law; mm."""

    mean: ArrayLike
    unit: ArrayLike
    shot: ArrayLike
    columns: Mapping[tuple[bool, Law], Sequence[ArrayLike]]


def error_moments(
    terms: DemandTerms, images: ImageParts, half_width: ArrayLike, pivot_shift: ArrayLike, signs: ArrayLike
) -> ErrorMoments:
    """Moments at one target.

    half_width (K,) native units; pivot_shift (3P,) mm; signs (B,): the end at which each of ``terms.at_ends`` stands.
    All but the terms may be symbols.
    """
    bias = terms.bias.at(pivot_shift)
    mean = (plain(bias) if bias.dtype != object else bias) + images.shift
    gains = (*terms.gains.at(pivot_shift), *images.gains)
    covariance = {True: images.made, False: images.noise}
    columns: dict[tuple[bool, Law], list[ArrayLike]] = {(held, law): [] for held in (True, False) for law in SUMS}
    fixed = {True: np.zeros((3, 3)), False: np.zeros((3, 3))}
    ends = {index: signs[b] for b, index in enumerate(terms.at_ends)}
    for index, source in enumerate((*terms.sources, *terms.common)):
        gain = plain(gains[index]) if gains[index].dtype != object else gains[index]
        if (source.half_width if source.free is None else source.ratio) == 0:
            continue
        size = source.size(half_width)
        if index in ends:
            mean = mean + times(gain, ends[index] * size)
            continue
        if source.free is None and gains[index].dtype != object:  # numbers: add them up as such
            scaled = gains[index] * (source.std_per_half_width * source.half_width)
            fixed[source.held] += np.outer(scaled, scaled)
        else:
            variance = (source.std_per_half_width * size) ** 2
            covariance[source.held] = covariance[source.held] + times(np.outer(gain, gain), variance)
        if source.law in SUMS:
            columns[source.held, source.law].append(times(gain, size))
    return ErrorMoments(mean, covariance[True] + plain(fixed[True]), covariance[False] + plain(fixed[False]), columns)


def squared_quantile(demand: QuantileConstraint, law: ErrorMoments) -> ArrayLike:
    """The smooth closed form of the limited quantile, squared, mm^2.

    Pooled: of everything together.  Nested: of each unit's or mounting's own shots, that of
    the required fraction of them.
    """
    p = demand.requirement.quantile
    if demand.is_nested:
        once = (tuple(law.columns[True, each]) for each in SUMS)
        return unit_quantile_squared(p, demand.fraction, law.mean, law.unit, law.shot, *once)
    every = ((*law.columns[True, each], *law.columns[False, each]) for each in SUMS)
    cumulants = square_cumulants(law.mean, law.unit + law.shot, *every)
    if demand.requirement.row.by_quantile:
        return pearson_square(*cumulants, float(ndtri(p)))
    each = ((weight, float(ndtri(max(level, LEAST_LEVEL)))) for level, weight in demand.requirement.mixture)
    return sum(weight * pearson_square(*cumulants, normal) ** 0.5 for weight, normal in each) ** 2


def closed_form_mm(
    terms: DemandTerms, images: ImageParts, half_width: Array, pivot_shift: Array, signs: Array
) -> float:
    """The same in floats, mm."""
    plainly = images._replace(noise=plain(images.noise), made=plain(images.made))
    law = error_moments(terms, plainly, half_width, pivot_shift, signs)
    return sqrt(float(squared_quantile(terms.demand, law)))

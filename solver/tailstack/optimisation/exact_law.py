"""The quantile that is limited: the exact law at a choice, and the correction that carries it into the programme.

The programme's constraint is smooth closed form + correction.  The correction is affine in what the quantile sees
(image covariances, logarithms of half-widths, pivots, spacings) and is chosen at an iterate so that value *and*
gradient are those of the exact law there.  Solved again until the iterate stands still, the programme's
first-order conditions are those of the exact law (first-order model management: Alexandrov and Lewis 2001).

The moments of a limited error and the smooth closed form of its quantile are written once, for floats and symbols.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import log, sqrt

import numpy as np
from scipy.special import ndtri

from ..arrays import Array
from ..contributors import Part, WorstCase, declared_law, law_of, part_of, worst_case
from ..losses import without_fiducials
from ..propagation.linear import LinearModel, linearise
from ..system import Law
from ..tail.approximation import pearson_square, square_cumulants, unit_quantile_squared
from ..tail.declared import law_gradient, law_quantile
from ..tail.per_unit import UnitQuantile, unit_quantile
from .problem import Choice, Demand, PlacementProblem, apply_choice
from .symbols import Duck, plain, times
from .terms import DemandTerms, Mechanics, mechanics_of

LOG2_UNITS = 7  # 2048 units for a per-unit quantile: as the score draws them
STEP = 1e-5  # relative step of central differences of the closed form
UNIT_STEP = 1e-2  # likewise of a per-unit quantile: its slope jumps a little, which the step evens out
PIVOT_STEP_MM, SPACING_STEP = 0.05, 1e-3  # of the exact quantile


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """One quantile at one choice."""

    exact_mm: float
    limit_mm: float  # of its requirement
    density: float  # of the error's norm there, 1/mm
    relative_error: float  # numerical error of exact_mm, relative
    mean_mm: Array  # (3,) at the worst vertex
    signs: Array  # (B,) ends of the bounded sources, in the order of ``DemandTerms.bounded``
    noise: Array  # (3, 3) mm^2 of image noise, in the frame of the limited error
    made: Array  # (3, 3) mm^2 of manufacturing errors and of assumed intrinsics, drawn once per unit
    model: LinearModel


@dataclass(frozen=True, slots=True, eq=False)
class Correction:
    """``offset + <noise, N> + <made, M> + widths . log h + pivots . w + spacings . log s``, added to log r^2."""

    offset: float
    noise: Array  # (3, 3) symmetric, per mm^2
    made: Array  # (3, 3)
    widths: Array  # (K,)
    pivots: Array  # (3P,) per mm of deviation
    spacings: Array  # (L,) per log of the factor


def image_parts(model: LinearModel, error: str) -> tuple[Array, Array]:
    """Covariances (3, 3) mm^2 of image noise, and of manufacturing errors and assumed intrinsics."""
    noise, made = np.zeros((3, 3)), np.zeros((3, 3))
    for block in model.blocks:
        if block.imaged:
            scaled = model.gain(block, error) * block.std
            (made if block.per_unit else noise)[...] += scaled @ scaled.T
    return noise, made


def evaluate_demand(problem: PlacementProblem, terms: DemandTerms, choice: Choice) -> Evaluation:
    """Exact quantile of the declared law for one demand, at the worst vertex of the bounded sources: the number the
    score reports.  Raises IllPosedError or NotConvergedError."""
    requirement = terms.demand.requirement
    system = without_fiducials(apply_choice(problem, choice), terms.demand.lost)
    model = linearise(system, terms.demand.target)
    exact = exact_quantile(model, terms.demand)
    noise, made = image_parts(model, requirement.error)
    keys = [(terms.sources[b].contributor, terms.sources[b].index) for b in terms.bounded]
    return Evaluation(
        exact_mm=exact.value_mm,
        limit_mm=requirement.limit_mm,
        density=exact.density,
        relative_error=exact.relative_error,
        mean_mm=exact.worst.mean_mm,
        signs=np.array([exact.worst.signs.get(key, 1.0) for key in keys]),
        noise=noise,
        made=made,
        model=model,
    )


@dataclass(frozen=True, slots=True, eq=False)
class ExactQuantile:
    """The quantile that a requirement limits, of a linear model at its worst vertex."""

    value_mm: float
    density: float  # 1/mm
    relative_error: float
    worst: WorstCase


def exact_quantile(model: LinearModel, demand: Demand) -> ExactQuantile:
    """Quantile of the declared law; per unit, the required fraction of units' own quantile (sampled)."""
    requirement = demand.requirement
    worst = worst_case(model, requirement.error, requirement.quantile)
    if not demand.per_unit:
        law, _ = declared_law(model, requirement.error, worst.mean_mm)
        found = law_quantile(law, requirement.quantile)
        return ExactQuantile(found.quantile_mm, found.density, found.error_mm / max(found.quantile_mm, 1e-300), worst)
    own = _unit_quantile(model, demand, worst.mean_mm)
    return ExactQuantile(own.value_mm, own.density, own.standard_error_mm / max(own.value_mm, 1e-300), worst)


def _unit_quantile(
    model: LinearModel, demand: Demand, mean_mm: Array, stretch: Mapping[str, Array] | None = None
) -> UnitQuantile:
    """The required fraction of units' own quantile; ``stretch``: (3, 3) by which gains of some contributors are
    multiplied."""
    requirement = demand.requirement
    unit: list[Part] = []
    shot: list[Part] = []
    for block in model.blocks:
        gain = model.gain(block, requirement.error)
        if stretch is not None and block.contributor in stretch:
            gain = stretch[block.contributor] @ gain
        (unit if block.per_unit else shot).append(part_of(block, gain))
    laws = law_of(mean_mm, unit), law_of(np.zeros(3), shot)
    return unit_quantile(*laws, requirement.quantile, demand.fraction, log2_units=LOG2_UNITS)


def closed_form_at(problem: PlacementProblem, terms: DemandTerms, evaluation: Evaluation, choice: Choice) -> float:
    """The closed form, mm, at the choice of a promise and with its ends."""
    mechanics = mechanics_of(problem, choice)
    return closed_form_mm(terms, evaluation.noise, evaluation.made, choice.half_width, mechanics, evaluation.signs)


def no_correction(problem: PlacementProblem) -> Correction:
    zero = np.zeros((3, 3))
    return Correction(
        0.0,
        zero,
        zero,
        np.zeros(len(problem.half_widths)),
        np.zeros(3 * len(problem.pivots)),
        np.zeros(len(problem.spacings)),
    )


def correction_at(
    problem: PlacementProblem, terms: DemandTerms, choice: Choice, evaluation: Evaluation, same_ends: Array | None
) -> Correction:
    """The correction that makes value and gradient exact at a choice.  ``same_ends`` (B,) keeps the bounded sources
    where they are in the programme, when the worst vertex flips between iterates."""
    signs = evaluation.signs if same_ends is None else same_ends
    at_ends = evaluation if same_ends is None else replace(evaluation, signs=same_ends)
    difference = 2 * log(evaluation.exact_mm) - 2 * log(closed_form_at(problem, terms, at_ends, choice))
    exact = (_unit_gradient if terms.demand.per_unit else _exact_gradient)(problem, terms, choice, evaluation)
    form = _closed_gradient(problem, terms, choice, evaluation, signs)
    slope = Correction(
        0.0,
        exact.noise - form.noise,
        exact.made - form.made,
        exact.widths - form.widths,
        exact.pivots - form.pivots,
        exact.spacings - form.spacings,
    )
    return replace(slope, offset=difference - correction_value(slope, problem, choice, evaluation))


def correction_value(
    correction: Correction, problem: PlacementProblem, choice: Choice, evaluation: Evaluation
) -> float:
    """The correction at a choice."""
    mechanics = mechanics_of(problem, choice)
    return float(
        correction.offset
        + (correction.noise * evaluation.noise).sum()
        + (correction.made * evaluation.made).sum()
        + correction.widths @ np.log(choice.half_width)
        + correction.pivots @ mechanics.pivot_shift
        + correction.spacings @ np.log(choice.spacing)
    )


def _exact_gradient(
    problem: PlacementProblem, terms: DemandTerms, choice: Choice, evaluation: Evaluation
) -> Correction:
    """Gradient of log r^2 under the declared law; by differences along pivots and spacings, analytic otherwise."""
    error, p = terms.demand.requirement.error, terms.demand.requirement.quantile
    law, where = declared_law(evaluation.model, error, evaluation.mean_mm)
    slopes = law_gradient(law, law_quantile(law, p))
    per = 2 / evaluation.exact_mm
    gains = terms.gains.at(mechanics_of(problem, choice))
    ends = {index: evaluation.signs[b] for b, index in enumerate(terms.bounded)}
    widths = np.zeros(len(problem.half_widths))
    for index, source in enumerate(terms.sources):
        if source.free is None:
            continue
        moved = gains[index] * choice.half_width[source.free]
        if index in ends:
            widths[source.free] += float(slopes.by_mean @ moved) * ends[index]
        elif source.law is Law.NORMAL:
            scaled = moved * source.std_per_half_width
            widths[source.free] += 2 * float(scaled @ slopes.by_covariance @ scaled)
        else:
            column = where.get((source.contributor, source.index))
            widths[source.free] += 0.0 if column is None else float(slopes.by_log_column[column])

    curvature = per * slopes.by_covariance
    pivots, spacings = _mechanical_gradient(problem, terms, choice, curvature, curvature)
    return Correction(0.0, curvature, curvature, per * widths, pivots, spacings)


def _unit_gradient(problem: PlacementProblem, terms: DemandTerms, choice: Choice, evaluation: Evaluation) -> Correction:
    """Gradient of log r^2 of a per-unit quantile by central differences: the units are the same ones each time, and
    the value drawn from them is continuous, so that it has a slope of its own (:mod:`..tail.per_unit`).

    By a covariance C: its sources' gains stretched along each pair of its axes, ``C -> (1 + eps A) C (1 + eps A)'``,
    which never leaves the covariances.  With A = e_i e_j' + e_j e_i' (half of it for i = j) on those axes, C's
    eigenvalues l, and G the gradient sought, the slope is ``2 (l_i + l_j) G_ij`` (``2 l_i G_ii``).
    """
    groups: dict[bool, list[str]] = {True: [], False: []}
    for block in evaluation.model.blocks:
        if block.imaged:
            groups[block.per_unit].append(block.contributor)

    def by_covariance(covariance: Array, names: list[str]) -> Array:
        lengths, axes = np.linalg.eigh(covariance)
        found = np.zeros((3, 3))
        for i in range(3):
            for j in range(i, 3):
                size = lengths[i] + lengths[j] if i != j else lengths[i]
                if size <= 1e-9 * lengths[2]:
                    continue
                turn = np.zeros((3, 3))
                turn[i, j] = turn[j, i] = UNIT_STEP
                sides = [
                    _unit_quantile(
                        evaluation.model,
                        terms.demand,
                        evaluation.mean_mm,
                        dict.fromkeys(names, np.eye(3) + side * axes @ turn @ axes.T),
                    ).value_mm
                    for side in (1, -1)
                ]
                found[i, j] = found[j, i] = 2 * log(sides[0] / sides[1]) / (2 * UNIT_STEP) / (2 * size)
        return np.asarray(axes @ found @ axes.T)

    noise, made = by_covariance(evaluation.noise, groups[False]), by_covariance(evaluation.made, groups[True])
    widths = np.zeros(len(choice.half_width))
    for k in range(len(widths)):
        factor = np.ones(len(widths))
        factor[k] = np.exp(UNIT_STEP)
        sides = [
            evaluate_demand(problem, terms, replace(choice, half_width=width)).exact_mm
            for width in (choice.half_width * factor, choice.half_width / factor)
        ]
        widths[k] = 2 * log(sides[0] / sides[1]) / (2 * UNIT_STEP)
    return Correction(0.0, noise, made, widths, *_mechanical_gradient(problem, terms, choice, noise, made))


def _mechanical_gradient(
    problem: PlacementProblem, terms: DemandTerms, choice: Choice, by_noise: Array, by_made: Array
) -> tuple[Array, Array]:
    """Gradient of log r^2 by pivots (3P,) and spacings (L,), by differences, less what goes through the images."""
    found = []
    for low, high, width in _mechanical_steps(problem, choice):
        below, above = evaluate_demand(problem, terms, low), evaluate_demand(problem, terms, high)
        through_image = float(
            (by_noise * (above.noise - below.noise)).sum() + (by_made * (above.made - below.made)).sum()
        )
        found.append((2 * log(above.exact_mm / below.exact_mm) - through_image) / width)
    count = 3 * len(problem.pivots)
    return np.array(found[:count]).reshape(-1), np.array(found[count:]).reshape(-1)


def _mechanical_steps(problem: PlacementProblem, choice: Choice) -> list[tuple[Choice, Choice, float]]:
    """Choices on either side along each pivot coordinate (mm) and each spacing (its logarithm), and their distance."""
    found = []
    for p in range(choice.pivots_mm.size):
        step = np.zeros(choice.pivots_mm.size)
        step[p] = PIVOT_STEP_MM
        shift = step.reshape(choice.pivots_mm.shape)
        found.append(
            (
                replace(choice, pivots_mm=choice.pivots_mm - shift),
                replace(choice, pivots_mm=choice.pivots_mm + shift),
                2 * PIVOT_STEP_MM,
            )
        )
    for spread in range(choice.spacing.size):
        factor = np.ones(choice.spacing.size)
        factor[spread] = np.exp(SPACING_STEP)
        found.append(
            (
                replace(choice, spacing=choice.spacing / factor),
                replace(choice, spacing=choice.spacing * factor),
                2 * SPACING_STEP,
            )
        )
    return found


def _closed_gradient(
    problem: PlacementProblem, terms: DemandTerms, choice: Choice, evaluation: Evaluation, signs: Array
) -> Correction:
    """Gradient of the closed form's log r^2, by central differences (it costs microseconds)."""

    def form(noise: Array, made: Array, half_width: Array, at: Choice) -> float:
        return 2 * log(closed_form_mm(terms, noise, made, half_width, mechanics_of(problem, at), signs))

    base = (evaluation.noise, evaluation.made, choice.half_width, choice)
    scale = float(np.trace(evaluation.noise + evaluation.made)) or float(evaluation.exact_mm**2)
    by_noise, by_made = np.zeros((3, 3)), np.zeros((3, 3))
    for part, found in ((0, by_noise), (1, by_made)):
        for i in range(3):
            for j in range(i, 3):
                step = np.zeros((3, 3))
                step[i, j] = step[j, i] = STEP * scale
                sides = [form(*(b + s * step if k == part else b for k, b in enumerate(base))) for s in (1, -1)]  # type: ignore[arg-type, operator]
                slope = (sides[0] - sides[1]) / (2 * STEP * scale)
                found[i, j] = found[j, i] = slope / (1 if i == j else 2)
    widths = []
    for k in range(len(choice.half_width)):
        factor = np.ones(len(choice.half_width))
        factor[k] = np.exp(STEP)
        up, down = choice.half_width * factor, choice.half_width / factor
        above, below = (
            form(evaluation.noise, evaluation.made, up, choice),
            form(evaluation.noise, evaluation.made, down, choice),
        )
        widths.append((above - below) / (2 * STEP))
    mechanical = [
        (
            form(evaluation.noise, evaluation.made, choice.half_width, high)
            - form(evaluation.noise, evaluation.made, choice.half_width, low)
        )
        / w
        for low, high, w in _mechanical_steps(problem, choice)
    ]
    count = 3 * len(problem.pivots)
    return Correction(
        0.0,
        by_noise,
        by_made,
        np.array(widths).reshape(-1),
        np.array(mechanical[:count]).reshape(-1),
        np.array(mechanical[count:]).reshape(-1),
    )


def exact_ratios(problem: PlacementProblem, terms: tuple[DemandTerms, ...], choice: Choice) -> Array:
    """(T,) exact quantile over its limit of every demand at a choice."""
    evaluations = [evaluate_demand(problem, term, choice) for term in terms]
    return np.array([item.exact_mm / item.limit_mm for item in evaluations])


def leading_demands(
    problem: PlacementProblem, terms: tuple[DemandTerms, ...], choices: list[Choice], share: float
) -> set[int]:
    """Indices of the demands whose quantile over its limit is at least ``share`` of the largest at any of some
    choices: those that are likely to bind."""
    leading: set[int] = set()
    for choice in choices:
        values = exact_ratios(problem, terms, choice)
        leading |= {int(k) for k in np.flatnonzero(values >= share * values.max())}
    return leading


@dataclass(frozen=True, slots=True, eq=False)
class ErrorMoments:
    """Mean (3,), covariances (3, 3) of what is drawn once per unit and at each shot, and the displacement (3,) at one
    end of each source that is not normal; mm."""

    mean: Duck
    unit: Duck
    shot: Duck
    unit_uniform: tuple[Duck, ...]
    unit_triangular: tuple[Duck, ...]
    shot_uniform: tuple[Duck, ...]
    shot_triangular: tuple[Duck, ...]


def error_moments(
    terms: DemandTerms, noise: Duck, made: Duck, half_width: Duck, mechanics: Mechanics, signs: Duck
) -> ErrorMoments:
    """Moments at one target.

    noise, made (3, 3): covariances of image noise and of manufacturing; half_width (K,) native units; signs (B,):
    the end at which each of ``terms.bounded`` stands.  All but the terms may be symbols.
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
    return ErrorMoments(
        mean,
        covariance[True] + plain(fixed[True]),
        covariance[False] + plain(fixed[False]),
        tuple(columns[True, Law.UNIFORM]),
        tuple(columns[True, Law.TRIANGULAR]),
        tuple(columns[False, Law.UNIFORM]),
        tuple(columns[False, Law.TRIANGULAR]),
    )


def squared_quantile(demand: Demand, law: ErrorMoments) -> Duck:
    """The smooth closed form of the limited quantile, squared, mm^2.

    Pooled: of everything together.  Per unit: of each unit's own shots, that of the required fraction of units.
    """
    p = demand.requirement.quantile
    if demand.per_unit:
        return unit_quantile_squared(
            p, demand.fraction, law.mean, law.unit, law.shot, law.unit_uniform, law.unit_triangular
        )
    cumulants = square_cumulants(
        law.mean, law.unit + law.shot, law.unit_uniform + law.shot_uniform, law.unit_triangular + law.shot_triangular
    )
    return pearson_square(*cumulants, float(ndtri(p)))


def closed_form_mm(
    terms: DemandTerms, noise: Array, made: Array, half_width: Array, mechanics: Mechanics, signs: Array
) -> float:
    """The same in floats, mm."""
    law = error_moments(terms, plain(noise), plain(made), half_width, mechanics, signs)
    return sqrt(float(squared_quantile(terms.demand, law)))

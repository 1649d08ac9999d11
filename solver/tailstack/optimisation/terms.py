"""The first-order model split into what the optimiser can change and what it cannot.

At the biased geometry a mount, the hand-eye and the execution act on the error through gains that do not
depend on the layout (every estimator absorbs a rigid displacement exactly); only what acts through the images sees the
fiducials: image noise, manufacturing errors, errors of assumed intrinsics, and what moves the images of all fiducials
together.  The constants come from :func:`~tailstack.propagation.linear.linearise`, the rest from the same
:func:`~tailstack.propagation.noise.assemble` and :func:`~tailstack.propagation.linear.shift_together` that the
score runs, here on symbols.

Pivots enter those constants: a displacement ``R (x - p) + p + t`` and its derivative by the torsor are affine in the
pivot p.  So every gain is, and differences of the linear model at a few points give the coefficients exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..design.drawn import DrawnValues
from ..geometry.arrays import Array
from ..geometry.rotation import displacement
from ..laws import Drawn
from ..propagation.linear import (
    UNJUDGED,
    Chain,
    ErrorModel,
    KnownShift,
    LinearModel,
    chain_of,
    join,
    linearise_at,
    shift_together,
)
from ..propagation.noise import gains_of_images
from ..system import ArrayLike, Law, System, Way, std_per_half_width
from .problem import (
    Choice,
    EstimationTerms,
    PlacementProblem,
    QuantileConstraint,
    apply_choice,
    estimator_of,
    present_choice,
    source_of,
    with_pivots,
)
from .regions import bounding_box
from .symbols import gram, plain, times

PIVOT_STEP_MM = 64.0  # any step would do for an affine function; a large one loses no digits


@dataclass(frozen=True, slots=True, eq=False)
class Affine:
    """``base + sum_p w_p by_pivot[p]``, w (3P,) mm: pivot coordinates less the present ones."""

    base: Array  # (...)
    by_pivot: Array  # (3P, ...)

    def at(self, pivot_shift: ArrayLike) -> ArrayLike:
        """Value for floats or symbols (3P,) mm; the base itself when no pivot is free."""
        value: Any = self.base
        for w, slope in zip(pivot_shift, self.by_pivot, strict=True):
            if slope.any():
                value = value + times(plain(slope), w)
        return value


def pivot_shift_of(problem: PlacementProblem, choice: Choice) -> Array:
    """(3P,) mm: by how much the pivots are elsewhere."""
    return (choice.pivots_mm - present_choice(problem).pivots_mm).ravel()


def _differentiate(
    problem: PlacementProblem, base: tuple[Array, ...], parts_at: Callable[[Choice], tuple[Array, ...]]
) -> tuple[Affine, ...]:
    """Functions of a choice, (...) each, that are affine in its pivots; base: at the present ones."""
    here, moved = present_choice(problem), []
    for p in range(here.pivots_mm.size):
        positions = here.pivots_mm.copy()
        positions.flat[p] += PIVOT_STEP_MM
        moved.append(parts_at(replace(here, pivots_mm=positions)))
    each = []
    for k, start in enumerate(base):
        slope = np.array([there[k] - start for there in moved]).reshape(len(moved), *start.shape) / PIVOT_STEP_MM
        # Rounding of a difference is not a dependence: it would only lengthen the expressions.
        rounding = np.abs(slope) < 1e-13 * max(1.0, float(np.abs(slope).max(initial=0.0)))
        each.append(Affine(start, np.where(rounding, 0.0, slope)))
    return tuple(each)


@dataclass(frozen=True, slots=True)
class SourceTerm:
    """One scalar source: its law, and its size unless that is free."""

    contributor: str
    index: int  # within its contributor
    law: Law
    half_width: float  # native unit; read only where free is None
    std_per_half_width: float
    free: int | None  # index of the free half-width
    held: bool  # throughout what the demand reads by itself
    part: int = 0  # which of the scalars of what is free, where that is a value of a drawing
    drawn: DrawnValues | None = None  # which that is

    @property
    def ratio(self) -> float:
        """Its half-width for a free one of 1, between values of a drawing."""
        return 1.0 if self.drawn is None else float(self.drawn.ratios[self.part])

    def size(self, half_width: ArrayLike) -> Any:
        """Its half-width at free ones (K,), numbers or symbols, between values of a drawing."""
        if self.free is None:
            return self.half_width
        return half_width[self.free] if self.drawn is None else half_width[self.free] * self.ratio

    def size_at(self, half_width: Array) -> float:
        """Its half-width at free ones (K,), at a value of a drawing exactly."""
        if self.drawn is None or self.free is None:
            return float(self.size(half_width))
        return float(self.drawn.half_widths_at(float(half_width[self.free]))[self.part])


@dataclass(frozen=True, slots=True, eq=False)
class DemandTerms:
    """One quantile: the linear model's parts that no fiducial changes."""

    demand: QuantileConstraint
    reconstructed: Affine  # (T, 3) con: the targets that it joins as the estimator sees them, noise-free
    bias: Affine  # (3,) mm, without what comes through the images
    gains: Affine  # (S, 3) mm per native unit of each source
    sources: tuple[SourceTerm, ...]  # S, outside the images
    common: tuple[SourceTerm, ...]  # C, those that move the images of all fiducials of a view together
    vertex: Array  # (C,) native unit: where the demand says that these stand, 0 of those that vary
    to_error: Array  # (3, 3 T): displacements of the triangulated points to the error that is limited
    flange_to_error: Array  # (3, 3 T): likewise of displacements behind them, at the flange
    kept: Array  # (N,) 0 of a fiducial that is lost, otherwise 1

    @property
    def at_ends(self) -> tuple[int, ...]:
        """Indices of the sources, the common ones last, that stand at one of their ends: bounded, and free or of some
        size."""
        return tuple(
            i
            for i, source in enumerate((*self.sources, *self.common))
            if source.law is Law.BOUNDED and (source.free is not None or source.half_width > 0)
        )

    # At the present pivots, for the starts:
    @property
    def reconstructed_mm(self) -> Array:
        """(T, 3)."""
        return self.reconstructed.base

    @property
    def bias_mm(self) -> Array:
        return self.bias.base

    @property
    def covariance(self) -> Array:
        """(3, 3) mm^2 of the fixed sources outside the image."""
        total = np.zeros((3, 3))
        for source, gain in zip(self.sources, self.gains.base, strict=True):
            if source.free is None:
                total += np.outer(gain, gain) * (source.std_per_half_width * source.half_width) ** 2
        return total

    @property
    def free_gain(self) -> Array:
        """(3, K) mm per native unit of each free half-width; 0 where it does not act.  Of a value of a drawing the root
        of the sum of the squares of its scalars'."""
        free = [(source.free, gain * source.ratio) for source, gain in zip(self.sources, self.gains.base, strict=True)]
        count = 1 + max((k for k, _ in free if k is not None), default=-1)
        by_half_width = np.zeros((3, count))
        for k, gain in free:
            if k is not None:
                before = by_half_width[:, k]
                by_half_width[:, k] = np.hypot(before, gain) if before.any() else gain
        return by_half_width


def every_terms(problem: PlacementProblem) -> tuple[DemandTerms, ...]:
    """Coefficients of every demand; those of a loss are those of the same error with all fiducials."""
    made: dict[tuple[object, ...], DemandTerms] = {}
    terms = []
    for demand in (replace(demand, ends=ends) for demand in problem.demands for ends in problem.ends):
        key = demand.requirement.error, demand.site.name, demand.place, demand.ends
        if key not in made:
            made[key] = terms_of(problem, demand)
        mask = np.array([label not in demand.lost for label in problem.system.fiducial_labels], dtype=float)
        terms.append(replace(made[key], demand=demand, kept=mask))
    return tuple(terms)


def terms_of(problem: PlacementProblem, demand: QuantileConstraint) -> DemandTerms:
    """Coefficients of one quantile.  They do not depend on the layout, so a singular one is scattered first."""
    if is_singular(problem.system, problem.system.fiducials_mm):
        problem = replace(problem, system=scatter(problem))
    base = _parts(problem, present_choice(problem), demand)
    reconstructed, bias, gains = _differentiate(
        problem, base.values, lambda choice: _parts(problem, choice, demand).values
    )
    return DemandTerms(
        demand=demand,
        reconstructed=reconstructed,
        bias=bias,
        gains=gains,
        sources=_sources(problem, base.model, demand.level, Way.LINK),
        common=_sources(problem, base.model, demand.level, Way.SHARED),
        vertex=np.concatenate([np.zeros(0), *vertices_of(base.free, demand.ends)]),
        to_error=weigh(demand, [np.vstack([point.tcp_from_localisation, np.eye(3)]) for point in base.points]),
        flange_to_error=weigh(demand, [np.vstack([point.tcp_from_flange, np.zeros((3, 3))]) for point in base.points]),
        kept=np.ones(len(problem.system.fiducial_labels)),
    )


def weigh(demand: QuantileConstraint, each: Sequence[Array]) -> Array:
    """(3, 3 T) of what displacements of each target do to the errors there, at the tool and as located (6, 3)."""
    return np.hstack([weights @ own for weights, own in zip(demand.site.weights.values(), each, strict=True)])


def scatter(problem: PlacementProblem) -> System:
    """The system with its free fiducials anywhere in the boxes about their regions: a stand-in that is not singular."""
    fiducials = problem.system.fiducials_mm.copy()
    rng = np.random.default_rng(0)
    for place in problem.places:
        low, high = bounding_box(place.region)
        fiducials[list(place.fiducials)] = rng.uniform(low, high, (len(place.fiducials), 3))
    if is_singular(problem.system, fiducials):
        # Fixed fiducials in one plane: no freedom cures that, and nothing here depends on where they are.
        fiducials = fiducials + rng.uniform(-50, 50, fiducials.shape)
    return replace(problem.system, fiducials_mm=fiducials)


@dataclass(frozen=True, slots=True, eq=False)
class _Parts:
    free: ErrorModel  # bounded sources not at any end
    model: ErrorModel
    points: tuple[LinearModel, ...]  # at each target
    values: tuple[Array, Array, Array]  # reconstructed, bias less what comes through the images, gains


def _parts(problem: PlacementProblem, choice: Choice, demand: QuantileConstraint) -> _Parts:
    free, points = linearise_demand(chain_of(apply_choice(problem, choice)), demand)
    model, error = at_ends(free, demand.ends), demand.requirement.error
    gains = (block.gain(error).T for block in model.blocks if block.effect.way is Way.LINK)
    stacked = np.vstack([np.zeros((0, 3)), *gains])
    reconstructed = np.array([point.reconstructed_mm for point in points])
    bias = model.bias_mm(error) - model.imaged_bias_mm(error)
    return _Parts(free, model, points, (reconstructed, bias, stacked))


def linearise_demand(chain: Chain, demand: QuantileConstraint) -> tuple[ErrorModel, tuple[LinearModel, ...]]:
    """The linear model of what is limited, and that of each target, not judged.  Raises IllPosedError."""
    models = {target.name: linearise_at(chain, target, UNJUDGED) for target in demand.targets}
    points = tuple(models.values())
    return points[0] if demand.is_point else join(models, demand.measure, demand.site), points


def vertices_of(model: ErrorModel, ends: tuple[float, ...]) -> list[Array]:
    """(k,) native unit for each common block in turn: bounded sources at ``QuantileConstraint.ends``, others 0."""
    left, places = iter(ends), []
    for block in model.blocks:
        if block.effect.way is Way.SHARED:
            each = zip(block.effect.sources.are_bounded, block.half_width, strict=True)
            places.append(np.array([h * next(left, 0.0) if bounded else 0.0 for bounded, h in each]))
    return places


def at_ends(model: ErrorModel, ends: tuple[float, ...]) -> ErrorModel:
    """The linear model with the bounded common sources at ``QuantileConstraint.ends``: part of what is known."""
    if not ends:
        return model
    places = iter(vertices_of(model, ends))
    blocks, known = [], []
    for block in model.blocks:
        if block.effect.way is Way.SHARED:
            place = next(places)
            shifts = {error: gain @ place for error, gain in block.gains.items()}
            known.append(KnownShift(block.contributor, block.label, shifts))
            block = block.with_half_widths(np.where(place != 0, 0.0, block.half_width))
        blocks.append(block)
    return replace(
        model,
        biases={error: bias + sum(each.of(error) for each in known) for error, bias in model.biases.items()},
        known=(*model.known, *known),
        blocks=tuple(blocks),
    )


def _sources(problem: PlacementProblem, model: ErrorModel, level: Drawn, way: Way) -> tuple[SourceTerm, ...]:
    free = {
        (item.contributor, name): (k, part)
        for k, item in enumerate(problem.half_widths)
        for part, name in enumerate(item.names)
    }
    laws = free_laws(problem)
    sources = []
    for block in model.blocks:
        if block.effect.way is not way:
            continue
        for j, (name, law) in enumerate(zip(block.components, block.laws, strict=True)):
            k, part = free.get((block.contributor, name), (None, 0))
            half_width, std = float(block.half_width[j]), float(block.std[j])
            per, drawn = std / half_width if half_width > 0 else 0.0, None
            if k is not None:
                drawn = problem.half_widths[k].drawn
                per = laws[k][1] if drawn is None else std_per_half_width(law)
            held = block.effect.drawn.is_held(level)
            sources.append(SourceTerm(block.contributor, j, law, half_width, per, k, held, part, drawn))
    return tuple(sources)


def is_singular(system: System, fiducials_mm: Array) -> bool:
    """Whether fiducials (N, 3) lie in one plane, or on one line where intrinsics are believed: to rounding, an estimate
    has no answer then."""
    values = np.linalg.svd(fiducials_mm - fiducials_mm.mean(axis=0), compute_uv=False)
    return bool(values[1 if system.estimator.believes_intrinsics else 2] <= 1e-9 * values[0])


def free_laws(problem: PlacementProblem) -> tuple[tuple[Law, float], ...]:
    """Law and standard deviation per half-width of each free half-width (0 where bounded)."""
    each = (source_of(problem, free) for free in problem.half_widths)
    return tuple((sources.laws[j], float(sources.std_per_half_width[j])) for sources, j in each)


class ImageParts(NamedTuple):
    """What comes through the images and depends on the layout, of one error and in its frame: floats or symbols."""

    noise: ArrayLike  # (3, 3) mm^2, covariance of image noise
    made: ArrayLike  # (3, 3) mm^2, of manufacturing errors and assumed intrinsics, which each unit or mounting holds
    shift: ArrayLike  # (3,) mm, known
    gains: ArrayLike  # (C, 3) mm per native unit of each of ``DemandTerms.common``

    @property
    def numbers(self) -> ArrayLike:
        """(15 + 3 C,) all of them in a row, the covariances by their upper triangles."""
        upper = np.triu_indices(3)
        return np.concatenate([self.noise[upper], self.made[upper], self.shift, self.gains.ravel()])

    @staticmethod
    def of(numbers: ArrayLike) -> ImageParts:
        """Back from ``numbers``."""
        upper = np.triu_indices(3)
        covariances = np.zeros((2, 3, 3), numbers.dtype)
        for covariance, own in zip(covariances, (numbers[:6], numbers[6:12]), strict=True):
            covariance[upper] = covariance.T[upper] = own
        noise, made = covariances
        return ImageParts(noise, made, numbers[12:15], numbers[15:].reshape(-1, 3))


def image_parts_at(
    estimator: EstimationTerms,
    terms: DemandTerms,
    laid: System,
    projections: ArrayLike,
    assumed_shift: ArrayLike,
    reconstructed: ArrayLike,
) -> ImageParts:
    """What comes through the images at a layout.

    laid: a system whose fiducials and pivots, as projections (V, 3, 4), assumed_shift (3,) and reconstructed (T, 3),
    are object arrays of numbers or symbols.
    """
    points = laid.fiducials_mm @ plain(estimator.assumed_turn).T + assumed_shift
    own = estimator.imaging
    estimation = {name: plain(getattr(own.estimation, name)) for name in ("precision", "noise", "factors")}
    rest = {name: plain(getattr(own, name)) for name in ("per_error", "believed", "assumed")}
    imaging = own._replace(
        projections=projections, points=points, estimation=own.estimation._replace(**estimation), **rest
    )
    seat = laid.structure_connector
    first = displacement(seat.known, seat.pivot_mm, laid.rotation_form)
    shifts, at_flange = zip(*(shift_together(laid, first, target) for target in terms.demand.targets), strict=True)
    weights, (views, rows, _) = estimator.weights * terms.kept, shifts[0].shape
    gained = (gains_of_images(imaging, weights, *each) for each in zip(reconstructed, shifts, strict=True))
    columns = np.vstack([own for own, _ in gained])
    single, common, to_error = len(estimator.std), len(terms.common), plain(terms.to_error)
    noises, made = np.split(columns[:, :single] * plain(estimator.std), [views * rows], axis=1)
    noises = _tell_apart(noises, np.arange(views * rows) % rows >= rows - 2)
    noise, made = (to_error @ gram(part) @ to_error.T for part in (noises, made))
    moved = to_error @ columns[:, single:] + plain(terms.flange_to_error) @ np.vstack(at_flange)
    known = moved[:, common:].sum(axis=1) + moved[:, :common] @ plain(terms.vertex)
    return ImageParts(noise, made, known, moved[:, :common].T)


def _tell_apart(columns: ArrayLike, own: NDArray[np.bool_]) -> ArrayLike:
    """Columns (3 T, M) of T targets, those of noise of a target's ``own`` images (M,) once for each target."""
    target = np.arange(len(columns))[:, None] // 3
    each = (np.where(own & (target != t), 0.0, columns) for t in range(len(columns) // 3))
    return np.hstack([part if t == 0 else part[:, own] for t, part in enumerate(each)])


def lay(problem: PlacementProblem, points: ArrayLike, pivot_shift: ArrayLike) -> System:
    """The system with fiducials and pivots in numbers or symbols."""
    present = present_choice(problem).pivots_mm
    shifts = np.asarray(pivot_shift).reshape(present.shape)
    pivots = {free.contributor: pivot for free, pivot in zip(problem.pivots, present + shifts, strict=True)}
    return with_pivots(replace(problem.system, fiducials_mm=points), pivots)


def estimator_affine(problem: PlacementProblem) -> tuple[Affine, ...]:
    """Projections (V, 3, 4) and the shift of the assumed fiducials (3,) as functions of the pivots."""

    def parts(estimation: EstimationTerms) -> tuple[Array, Array]:
        return estimation.projections, estimation.assumed_shift_mm

    return _differentiate(
        problem, parts(problem.estimation), lambda choice: parts(estimator_of(apply_choice(problem, choice)))
    )


def blind_half_widths(problem: PlacementProblem, terms: tuple[DemandTerms, ...]) -> NDArray[np.bool_]:
    """(K,) whether a free half-width moves no limited error at all (its lever is nought)."""
    reach = np.zeros(len(problem.half_widths))
    for term in terms:
        every = np.abs(term.gains.base).max(axis=1, initial=0.0)
        every = every + np.abs(term.gains.by_pivot).max(axis=(0, 2), initial=0.0)
        for source, size in zip(term.sources, every, strict=True):
            if source.free is not None:
                reach[source.free] = max(reach[source.free], float(size))
    return reach <= 1e-12 * max(float(reach.max(initial=0.0)), 1e-300)

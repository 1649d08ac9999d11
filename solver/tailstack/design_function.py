"""A design as a function of numbers of its document, with the exact derivative of P95: for other programs' engines.

The derivative is the chain rule over what the score itself computes.  The law of an error has a mean, a covariance and
columns (:mod:`.tail.declared`), and the derivative of its quantile by each of them is known.  How they depend on a
number of the document is known where the number is a half-width, a standard deviation or a coordinate of a fiducial:
half-widths multiply gains that stay as they are, and fiducials enter through what images do to the point alone, and
what moves the images of all of them together.  That is differentiated by a complex step (Squire and Trapp 1998):
``Im f(x + i h) / h`` with h = 1e-30 loses no digit, because nothing is subtracted, and ``propagation/noise.py`` has no
square roots and no branches on values.

Whether a number is of that kind is found out, not listed: the design is compiled with the number moved by one step and
by two, and what changes must be affine in it and must be one of these things.  Any other number can be evaluated, but
has no derivative here, and the refusal says what it moves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .contributors import error_law
from .design import Design, compile_design, design_to_data, load_design
from .design.numbers import read_numbers
from .design.pointers import locate_numbers, pointer_of, set_numbers, value_at
from .errors import DesignError, IllPosedError, OutOfRangeError, Problem
from .geometry.arrays import Array
from .laws import BOUNDED, NORMAL
from .losses import without_fiducials
from .measures import MeasureName, Metric
from .propagation.linear import Block, Chain, ErrorModel, LinearModel, chain_of, image_gains, join, linearise_at
from .results import FiducialWorth, Score
from .results.verdicts import P95, Vector3, decisive_check
from .scoring import score, vector3
from .system import System, Way
from .tail.declared import LawGradient, LawQuantile, column_gradient, law_gradient, law_quantile

COMPLEX_STEP = 1e-30
NO_SLOPE = "the derivative is known of a quantile of all shots together"
STEP = 2.0**-10  # of a number, or of one where it is smaller: large enough that what is not affine shows
SAME = 1e-9  # relative: what differs by less is rounding
CURVATURE = 0.05  # relative: what one step may differ from its slope by


@dataclass(frozen=True, slots=True, eq=False)
class _Slope:
    """What one unit of a number does to a chain."""

    points_mm: Array | None  # (N, 3) of the fiducials as the estimator assumes them; None: they stay
    half_width: Mapping[str, Array]  # (k,) of each contributor, native unit
    std: Mapping[str, Array]


class DesignFunction:
    """``DesignFunction(design, inputs)``: a design as a function of some of its numbers, for other programs' engines.

    design: where everything else is taken from.  inputs: the numbers, as JSON pointers or names with dots between them,
    ``interfaces.connector_flange.tolerances.rx.half_width_deg``; ``*`` stands for every element, all of which take one
    value.  Values are in the unit of the document.  Raises DesignError for an input that leads to no number.
    """

    def __init__(self, design: Design, inputs: Sequence[str]) -> None:
        self.design = design
        self.pointers = tuple(pointer_of(design.source.data, path) for path in inputs)
        data = design.source.data
        self._places = tuple(locate_numbers(data, pointer, pointer, DesignError) for pointer in self.pointers)
        self._slopes: dict[int, _Slope] = {}  # of the inputs that were differentiated by so far

    @property
    def present(self) -> Array:
        """(n,) the inputs as they are in the design; of several elements the first."""
        return np.array([float(value_at(self.design.source.data, places[0])) for places in self._places])

    def design_at(self, values: Sequence[float] | Array) -> Design:
        """The design with these values (n,), checked anew.  Raises DesignError with the pointer of what is wrong."""
        given = read_numbers(values, "", OutOfRangeError)
        if given.shape != (len(self._places),):
            detail = f"{len(self._places)} numbers are varied; values of shape {given.shape} arrived"
            raise OutOfRangeError(Problem("", "wrong-length", detail, "give one value for each input, in their order"))
        data = set_numbers(self.design.source.data, self._places, given.tolist())
        return load_design(data, base_directory=self.design.source.directory)

    def score(self, values: Sequence[float] | Array, *, losses: bool = True) -> Score:
        """The score of the design with these values (n,); losses: as of :func:`tailstack.score`."""
        return score(self.design_at(values), losses=losses)

    def p95_gradient(
        self,
        values: Sequence[float] | Array,
        target: str | None = None,
        error: MeasureName = "tcp",
        quantile: float = P95,
    ) -> tuple[float, Array]:
        """(P95 in the unit of the measure, its derivative by each input (n,) per unit of the document) at one target.

        target: its name, of a measure that joins several that of its site; by default the first.  error: the measure,
        ``tcp`` at the tool, ``localisation`` or another.  quantile: of another order than P95.  At a worst vertex of
        bounded components the vertex stays.  Raises OutOfRangeError for an input by which the derivative is not known,
        where P95 itself is only sampled, and where fiducials are missed in some shots.
        """
        system = compile_design(self.design_at(values))
        if system.loss_probability:
            detail = "P95 is over shots in some of which fiducials are missed: its derivative is not known"
            hint = "leave out loss_probability to have that of shots that miss none, or take differences of evaluations"
            raise OutOfRangeError(Problem("/fiducials/loss_probability", "no-derivative", detail, hint))
        chain = chain_of(system)
        metric = _find_metric(system, target, error)
        points = [each for each in system.targets if each.name in metric.site.weights]
        models = {each.name: linearise_at(chain, each) for each in points}
        law = _Law(models, metric, quantile)
        slopes = [self._slope(k) for k in range(len(self.pointers))]
        by_input = [law.along(chain, slope, at) for slope, at in zip(slopes, self.pointers, strict=True)]
        return law.quantile.quantile_mm, np.array(by_input)

    def _slope(self, k: int) -> _Slope:
        """What one unit of input k does; found once, as it is the same everywhere.  Raises OutOfRangeError."""
        if k not in self._slopes:
            self._slopes[k] = self._find_slope(k)
        return self._slopes[k]

    @cached_property
    def _base(self) -> tuple[Chain, LinearModel]:
        return _at_first_target(self.design_at(self.present))

    def _find_slope(self, k: int) -> _Slope:
        step = STEP * max(abs(self.present[k]), 1.0)
        moved = []
        for size in (step, 2 * step):
            values = self.present.copy()
            values[k] += size
            moved.append(_at_first_target(self.design_at(values)))
        chain, model = self._base
        (once, first), (twice, second) = moved
        what = _foreign_change(chain, model, once, first)
        arrays = [(chain.imaging.points, once.imaging.points, twice.imaging.points)]
        for name in ("half_width", "std"):
            every = [[getattr(block, name) for block in each.blocks] for each in (model, first, second)]
            arrays += list(zip(*every, strict=True)) if not what else []
        if not what and not all(_is_affine(*each) for each in arrays):
            what = "a spread or a fiducial otherwise than in proportion"
        if what:
            detail = f"the derivative of P95 by {self.pointers[k]} is not known: it moves {what}"
            hint = "differentiate by half-widths, noise and positions of fiducials; any number can be evaluated"
            raise OutOfRangeError(Problem(self.pointers[k], "no-derivative", detail, hint))
        slopes = [(after - before) / step for before, after, _ in arrays]
        names, count = [block.contributor for block in model.blocks], len(model.blocks)
        half_width, std = (dict(zip(names, each, strict=True)) for each in (slopes[1 : 1 + count], slopes[1 + count :]))
        return _Slope(slopes[0] if slopes[0].any() else None, half_width, std)


class _Law:
    """The law of one measure at one site, and the derivative of a quantile of it along a change of the chain."""

    def __init__(self, models: Mapping[str, LinearModel], metric: Metric, quantile: float) -> None:
        self.models, self.metric = models, metric
        self.model = join(models, *metric)
        self.at = error_law(self.model, metric.measure.name, quantile)
        self.quantile: LawQuantile = law_quantile(self.at.law, quantile)

    @cached_property
    def gradient(self) -> LawGradient:
        return law_gradient(self.at.law, self.quantile)

    @cached_property
    def by_column(self) -> Array:
        """(3, k) derivative by each entry of the columns.  Raises OutOfRangeError."""
        gradient = column_gradient(self.at.law, self.quantile)
        if gradient is None:
            detail = "P95 is sampled here, or its law lies in a plane: its derivative is only known nearly"
            hint = "declare normal distributions, or take differences of evaluations"
            raise OutOfRangeError(Problem("", "no-derivative", detail, hint))
        return gradient

    def along(self, chain: Chain, slope: _Slope, pointer: str) -> float:
        """d P95 by one number, per unit of it."""
        error = self.at.error
        total = 0.0
        gains = [np.zeros_like(block.gain(error)) for block in self.model.blocks]
        if slope.points_mm is not None:
            each = {name: _slopes_by_points(chain, model, slope.points_mm) for name, model in self.models.items()}
            joined = join(each, *self.metric)
            gains, bias = [block.gain(error) for block in joined.blocks], joined.bias_mm(error)
            if bias.any():
                total += float(self.gradient.by_mean @ bias)
        columns = self.at.columns
        by_points = np.concatenate(gains, axis=1)
        spread = np.concatenate([slope.std[block.contributor] for block in self.model.blocks])
        change = by_points * columns.std + columns.gain * spread
        pull = self.gradient.by_covariance @ (columns.gain * columns.std)
        total += 2 * float((pull * change)[:, columns.kinds == NORMAL].sum())
        spread = np.concatenate([slope.half_width[block.contributor] for block in self.model.blocks])
        change = by_points * columns.half_width + columns.gain * spread
        if change[:, columns.wide].any():
            total += float((self.by_column * change[:, columns.wide]).sum())
        sources = [(block, j) for block in self.model.blocks for j in range(len(block.laws))]
        for k in np.flatnonzero((columns.kinds == BOUNDED) & change.any(axis=0)).tolist():
            total += self._sign(*sources[k], pointer) * float(self.gradient.by_mean @ change[:, k])
        return total

    def _sign(self, block: Block, j: int, pointer: str) -> float:
        """The end at which a bounded source stands, where it moves the mean to.  Raises OutOfRangeError."""
        sign = self.at.worst.signs.get((block.contributor, j))
        if sign is None:
            detail = "a bounded half-width of 0 has a derivative to one side only"
            raise OutOfRangeError(Problem(pointer, "no-derivative", detail, "begin above 0"))
        return sign


def _slopes_by_points(chain: Chain, model: LinearModel, points_mm: Array) -> ErrorModel:
    """What moving the fiducials along points_mm (N, 3) does to gains and bias."""
    moved = _with_points(chain, chain.imaging.points + 1j * COMPLEX_STEP * points_mm)
    aim = model.reconstructed_mm.astype(np.complex128)  # whose kind some of the arrays take
    images = image_gains(moved, model.target, aim, model.tcp_from_localisation, model.tcp_from_flange)
    by_effect = images.by_effect(moved)

    def slope(of: Array) -> Array:
        return np.asarray(np.imag(of) / COMPLEX_STEP)

    blocks = [
        Block(block.effect, {error: slope(by_effect[block.contributor][error]) for error in block.gains})
        if block.effect.way is not Way.LINK
        else Block(block.effect, {error: np.zeros_like(gain) for error, gain in block.gains.items()})
        for block in model.blocks
    ]
    known = images.known_shifts(moved.system)
    biases = {error: slope(sum((each.of(error) for each in known), np.zeros(3))) for error in model.biases}
    return ErrorModel(model.site, biases, (), tuple(blocks), None)


def _with_points(chain: Chain, points: Array) -> Chain:
    """A chain with other fiducials, (N, 3) as the estimator assumes them."""
    imaging, system = chain.imaging, chain.system
    nominal = system.fiducials_mm + (points - imaging.points) @ np.linalg.inv(imaging.per_error).T
    return replace(chain, imaging=imaging._replace(points=points), system=replace(system, fiducials_mm=nominal))


def _at_first_target(design: Design) -> tuple[Chain, LinearModel]:
    chain = chain_of(compile_design(design))
    return chain, linearise_at(chain, chain.system.targets[0])


def _foreign_change(chain: Chain, model: LinearModel, moved: Chain, other: LinearModel) -> str:
    """What else than half-widths and fiducials differs between a chain and one with a number moved; empty: nothing."""
    names, others = ([(block.contributor, block.components) for block in each.blocks] for each in (model, other))
    if names != others:
        return "a contributor that is not there without it"
    shift = moved.imaging.points - chain.imaging.points
    # With the fiducials of the first chain in its place the moved one must be the first ...
    back = linearise_at(_with_points(moved, chain.imaging.points), other.target) if shift.any() else other
    pairs: list[tuple[str, Array, Array]] = [
        ("a target", _positions(chain), _positions(moved)),
        ("the bias", model.bias_mm("tcp"), back.bias_mm("tcp")),
        ("the way to the tool", model.tcp_from_localisation, other.tcp_from_localisation),
    ]
    for block, same, farther in zip(model.blocks, back.blocks, other.blocks, strict=True):
        name = f"the gains of {block.label or block.contributor}"
        pairs.append((name, block.gain("tcp"), same.gain("tcp")))
        if block.effect.way is Way.LINK:
            pairs.append((name, block.gain("tcp"), farther.gain("tcp")))
    difference = next((name for name, first, second in pairs if not _is_same(first, second)), "")
    # ... and fiducials move the bias through the images alone, as the derivative says up to the curvature of a step.
    if not difference and shift.any():
        expected = _slopes_by_points(chain, model, shift).bias_mm("tcp")
        gap = np.abs(other.bias_mm("tcp") - model.bias_mm("tcp") - expected).max()
        if gap > CURVATURE * np.abs(expected).max() + SAME * np.abs(model.bias_mm("tcp")).max():
            difference = "the bias"
    return difference


def _positions(chain: Chain) -> Array:
    """(T, 3) of the targets."""
    return np.array([target.position_mm for target in chain.system.targets])


def _is_same(first: Array, second: Array) -> bool:
    return first.shape == second.shape and bool(
        np.abs(first - second).max(initial=0.0) <= SAME * np.abs(first).max(initial=0.0)
    )


def _is_affine(none: Array, once: Array, twice: Array) -> bool:
    """Whether an array goes on from two steps as it went from none to one."""
    return _is_same(twice - once + none, once) and bool(
        np.abs(twice - 2 * once + none).max(initial=0.0) <= SAME * np.abs(once - none).max(initial=0.0)
    )


def _find_metric(system: System, name: str | None, error: str) -> Metric:
    sites = [metric for metric in system.metrics if metric.measure.name == error]
    named = [metric for metric in sites if name in (None, metric.site.name)]
    if not named:
        known = ", ".join(metric.site.name for metric in sites[:20])
        raise OutOfRangeError(Problem("", "unknown-target", f"no target is called {name!r}; there are {known}"))
    return named[0]


def weigh_fiducials(design: Design, record: Score) -> tuple[FiducialWorth, ...]:
    """The worth of each fiducial of a design for what decides its score ``record``, in its unit, by mm in con.

    What is not known is None, with the reason: a derivative of what is no quantile, an answer of too few fiducials.
    """
    system, check = compile_design(design), decisive_check(record.verdict.checks)
    item = next((each for each in system.requirements if check and each.name == check.requirement), None)
    target = record.worst_target.name if check is None else check.target
    slopes: list[Vector3 | None] = [None] * len(system.fiducial_labels)
    why = "" if item is None or (item.level is None and item.row.by_quantile) else NO_SLOPE
    if not why:
        places = [f"/fiducials/points/{i}/position_mm/{k}" for i in range(len(slopes)) for k in range(3)]
        function = DesignFunction(load_design(design_to_data(design)), places)  # which has those of a file, too
        error, quantile = (item.error, item.quantile) if item else ("tcp", P95)
        try:
            _, by_place = function.p95_gradient(function.present, target, error, quantile)
            slopes = [vector3(each) for each in by_place.reshape(-1, 3)]
        except OutOfRangeError as refusal:
            why = refusal.problems[0].detail
    needed = {target, *(each.entry for each in system.targets if each.name == target)}
    own = [each for each in system.targets if each.name in needed] or system.targets
    stated = () if item is None else (replace(item, targets=(target,)),)
    system, worth = replace(system, targets=tuple(own), requirements=stated), []
    for label, slope in zip(system.fiducial_labels, slopes, strict=True):
        without, reason = None, ""
        try:
            left = score(without_fiducials(system, (label,)), losses=False)
            worst = next((each for each in left.targets if each.name == target), left.worst_target)
            without = left.verdict.checks[0].value if stated else worst.p95_mm
        except IllPosedError as refusal:
            reason = refusal.problems[0].detail
        worth.append(FiducialWorth(label, slope, without, "; ".join(filter(None, (why, reason)))))
    return tuple(worth)

"""The linear model of the error at one target: bias and a gain column for every scalar source.

Linearised at the *biased* geometry: the known installation errors enter as full finite displacements,
and the noise sees the effective projections ``P_v T_err1`` (physical reading).  Products of two random
sources are second order and left out; ``second_order`` and the Monte Carlo account for them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf, nan, sqrt
from typing import NamedTuple, assert_never

import numpy as np

from ..errors import IllPosedError, Problem
from ..estimation.resection import project
from ..geometry.arrays import Array
from ..geometry.rotation import Displacement, apply, carry, displacement, move_at, undo
from ..laws import Drawn
from ..measures import POINTS
from ..measures.measure import Measure, Site
from ..system import Act, ArrayLike, Effect, Law, Place, Reading, System, Target, Way
from .noise import Estimation, Imaging, gains_of_images
from .nonlinearity import (
    ANGLES_1,
    ANGLES_2,
    ANGLES_3,
    IMAGES,
    NO_TURNS,
    SIZE,
    Common,
    MatrixGains,
    Nonlinearity,
    Turns,
    images_beside_bias,
    matrix_covariance,
    motion_of_images,
    nonlinearity,
    second_order,
    turns_of,
    view_matrix_gains,
)

_STEP = 1e-3  # standard deviations of a mount by which its gains are differentiated


class Block(NamedTuple):
    """An effect, and what one native unit of each of its k sources does to the error."""

    effect: Effect
    gains: Mapping[str, Array]  # (3, k) per native unit, by the name of the measure, in its frame and unit

    @property
    def contributor(self) -> str:
        """Name of the effect."""
        return self.effect.name

    @property
    def label(self) -> str:
        """What people call it."""
        return self.effect.label

    @property
    def components(self) -> tuple[str, ...]:
        """k names."""
        return self.effect.sources.names

    @property
    def laws(self) -> tuple[Law, ...]:
        return self.effect.sources.laws

    @property
    def units(self) -> tuple[str, ...]:
        """Native unit of each source."""
        return self.effect.sources.units

    @property
    def half_width(self) -> Array:
        """(k,) native unit: rad, mm, px, N; sigma for image noise."""
        return self.effect.sources.half_width

    @property
    def std(self) -> Array:
        """(k,) native unit."""
        return self.effect.sources.std

    @property
    def spread(self) -> Array:
        """(k,) native unit: as ``Sources.spread``."""
        return self.effect.sources.spread

    @property
    def is_grouped(self) -> bool:
        """Whether it is one line of a budget, not component by component."""
        return self.effect.is_grouped

    def with_half_widths(self, half_width: Array) -> Block:
        """The same of sources with other half-widths (k,)."""
        return self._replace(effect=replace(self.effect, sources=replace(self.effect.sources, half_width=half_width)))

    def gain(self, error: str) -> Array:
        """(3, k) mm per native unit of each source, of one error and in its frame."""
        return self.gains[error]

    def columns_mm(self, error: str) -> Array:
        """(3, k) mm: what a standard deviation of each source does."""
        return self.gain(error) * self.std

    def bounded_columns_mm(self, error: str) -> Array:
        """(3, q) mm: what each of the ``Sources.are_bounded`` does at its half-width."""
        bounded = self.effect.sources.are_bounded
        return self.gain(error)[:, bounded] * self.half_width[bounded]

    def covariance(self, error: str) -> Array:
        """(3, 3) mm^2."""
        scaled = self.columns_mm(error)
        return np.asarray(scaled @ scaled.T)


class KnownShift(NamedTuple):
    """What a contributor is known to do to the error, beside the bias of mounts and load."""

    contributor: str
    label: str
    shifts: Mapping[str, Array]  # (3,) by the name of the measure

    def of(self, error: str) -> Array:
        return self.shifts[error]


@dataclass(frozen=True, slots=True, eq=False)
class Mounts:
    """What the mounts do at their biases.  Leading dimensions (...) are biases and pivots side by side."""

    first: Displacement
    undone: Array  # (..., 3, 3) inverse of the first interface's rotation
    second: Displacement
    third: Displacement
    to_tool: Array  # (4, 4) con -> tcp
    reading: Reading
    execution_bias_mm: Array  # (3,) tcp


class Passage(NamedTuple):
    """A target's way through the mounts to the tool; leading dimensions (...) as those of mounts and target."""

    reconstructed_mm: Array  # (..., 3) con: q_hat without noise and without the known shifts
    localisation_bias_mm: Array  # (..., 3) con, without these
    tcp_bias_mm: Array  # (..., 3) tcp, without these
    at_tool_mm: Array  # (..., 3) tcp: what the third mount displaces
    tcp_from_localisation: Array  # (..., 3, 3)
    tcp_from_flange: Array  # (..., 3, 3)
    by_torsors: tuple[Array, Array, Array]  # (..., 3, 6) of each mount: of the first in con, of the others in tcp

    def mount_gains(self, system: System) -> dict[str, dict[str, Array]]:
        """Gains (..., 3, k) of the sources of each mount and of the execution, on both errors at the target.

        What acts before the reconstructed point is also seen at the tool; what acts behind it is seen there alone.
        """
        return {link.name: self._gains_at(link.place, link.sources.direction) for link in system.links}

    def _gains_at(self, place: Place, direction: Array) -> dict[str, Array]:
        first, second, third = self.by_torsors
        match place:
            case Place.SEAT:
                localisation = first @ direction
                return {"tcp": self.tcp_from_localisation @ localisation, "localisation": localisation}
            case Place.FLANGE:
                tcp = second @ direction
            case Place.CONNECTOR:
                tcp = self.tcp_from_flange @ direction
            case Place.HAND_EYE:
                tcp = third @ direction
            case Place.TOOL:
                tcp = np.broadcast_to(np.eye(3), (*first.shape[:-1], 3)) @ direction
            case Place.INTRINSICS | Place.SHOT | Place.IMAGES | Place.BEADS | Place.ARM:
                raise AssertionError(place)  # before the reconstructed point, or of several effects: no link
            case _:
                assert_never(place)
        return {"tcp": tcp, "localisation": np.zeros_like(tcp)}


def mounts_of(
    system: System, biases: Sequence[Array] | None = None, pivots_mm: Sequence[Array] | None = None
) -> Mounts:
    """The mounts of a system; with other biases (..., 6), rad and mm, and pivots (..., 3) of its three mounts, theirs
    side by side."""
    biases = biases or [mount.known for mount in system.mounts]
    pivots_mm = pivots_mm or [mount.pivot_mm for mount in system.mounts]
    pairs = zip(biases, pivots_mm, strict=True)
    first, second, third = (displacement(*pair, system.rotation_form) for pair in pairs)
    undone = np.asarray(np.linalg.inv(first.rotation))
    return Mounts(first, undone, second, third, system.T_tcp_con, system.reading, system.execution.known)


class SeatMoves(NamedTuple):
    """The structure's mount moved a little along each of the n directions of what it varies by, in which it turns."""

    displaced: Displacement  # (n, ...)
    imaging: tuple[Imaging, ...]  # n
    back: Array  # (n, 3, 3) from there into the frame of the chain's points


@dataclass(frozen=True, eq=False)
class Chain:
    """What a system does at its bias, for all targets alike."""

    system: System
    imaging: Imaging
    weights: Array  # (V, N) 1 where a view's estimate uses a fiducial, otherwise 0
    mounts: Mounts
    matrix_gains: tuple[MatrixGains, ...]  # of the resected matrices (``nonlinearity.view_matrix_gains``)
    matrix_covariance: Array  # (12 V, 12 V) of them (``nonlinearity.matrix_covariance``)
    of_images: tuple[Effect, ...]  # ``effects_of_images``

    @cached_property
    def seat_moves(self) -> SeatMoves:
        """Of which ``gains_moved_by_seat`` asks at every target."""
        system, mount = self.system, self.system.structure_connector
        axes, sizes, _ = np.linalg.svd(mount.sources.direction * mount.sources.spread, full_matrices=False)
        directions = (axes * sizes)[:, axes[:3].any(axis=0) & (sizes > 0.0)].T
        first = displacement(mount.known + _STEP * directions, mount.pivot_mm, system.rotation_form)
        projections, *others = geometry_at(system.projections, system.fiducials_mm, first, system.reading)
        points, per_error = (np.broadcast_to(each, (len(directions), *each.shape[-2:])) for each in others)
        geometries = zip(projections, points, per_error, strict=True)
        imaging = tuple(
            self.imaging._replace(projections=each, points=points.copy(), per_error=per_error.copy())
            for each, points, per_error in geometries
        )
        if system.reading is Reading.PHYSICAL:
            return SeatMoves(first, imaging, self.mounts.undone @ first.rotation)
        return SeatMoves(first, imaging, self.mounts.first.rotation @ np.swapaxes(first.rotation, -1, -2))


def estimator_geometry(system: System) -> tuple[Array, Array, Array]:
    """What the estimator meets at the bias, in its own coordinates.

    Returns projections (V, 3, 4) with ``|p3| = 1``, the fiducials that it assumes (N, 3), and the linear map
    (3, 3) from a manufacturing error to a displacement of those.  Physical: ``P_v T_err1`` and the nominal
    fiducials.  Eq 18: ``P_v T_err1^-1`` and the moved ones.  The rescaling matters for the small-angle form,
    which is not rigid.
    """
    mount = system.structure_connector
    first = displacement(mount.known, mount.pivot_mm, system.rotation_form)
    return geometry_at(system.projections, system.fiducials_mm, first, system.reading)


def geometry_at(
    projections: Array, fiducials: Array, first: Displacement, reading: Reading
) -> tuple[Array, Array, Array]:
    """:func:`estimator_geometry` of projections (V, 3, 4), fiducials (..., N, 3) mm and displacements (...)."""
    if reading is Reading.PHYSICAL:
        nominal, per_error, between = fiducials.copy(), np.eye(3), first.matrix()
    else:
        per_error = first.rotation.copy()  # writable as the identity is: kernels see one kind
        nominal = fiducials @ np.swapaxes(per_error, -1, -2) + first.shift_mm[..., None, :]
        between = np.asarray(np.linalg.inv(first.matrix()), dtype=np.float64)
    effective = projections @ between[..., None, :, :]
    return np.asarray(effective / np.linalg.norm(effective[..., 2, :3], axis=-1)[..., None, None]), nominal, per_error


def estimation_of(system: System) -> Estimation:
    """What the estimator of a system is and knows, in the numbers that the gains take."""
    return Estimation(
        system.estimator.traits.unknowns,
        int(system.triangulation.traits.weighing),
        system.prior_precisions,
        np.array([(view.fiducial_noise_px, view.target_noise_px) for view in system.views]),
        factors_of(system),
    )


def factors_of(system: System) -> Array:
    """(V, 2, 2, 2) of the noise of each view, or (0, 2, 2, 2) where it is alike in all directions in every view."""
    each = [view.noise_factors for view in system.views]
    if all(factors is None for factors in each):
        return np.zeros((0, 2, 2, 2))
    return np.array([np.stack([np.eye(2)] * 2) if factors is None else factors for factors in each])


def effects_of_images(system: System) -> tuple[Effect, ...]:
    """The effects whose sources act through single images, as ``noise.assemble`` has them: image noise view by view,
    manufacturing, what views believe."""
    believed = (error for error in system.believed_errors if error is not None)
    return tuple(each for each in (*system.errors_of_points, *believed) if each.sources.count)


def imaging_of(system: System, projections: ArrayLike, points: ArrayLike, per_error: ArrayLike) -> Imaging:
    """What the estimator of a system makes of effective projections and fiducials as it assumes them
    (:func:`geometry_at`)."""
    errors = system.believed_errors
    each = [(v, error.sources) for v, error in enumerate(errors) if error is not None]
    return Imaging(
        projections,
        points,
        estimation_of(system),
        per_error,
        bool(system.manufacturing_std_mm.any()),
        np.hstack([np.zeros((3, 0)), *(sources.direction for _, sources in each)]),
        np.array([v for v, sources in each for _ in sources.names], dtype=np.int64),
        np.array([np.zeros(3) if error is None else error.known for error in errors]),
    )


def chain_of(system: System) -> Chain:
    """Everything :func:`linearise` needs that does not depend on the target."""
    mounts = mounts_of(system)
    projections, points, per_error = geometry_at(system.projections, system.fiducials_mm, mounts.first, system.reading)
    imaging = imaging_of(system, projections, points, per_error)
    gains = view_matrix_gains(projections, points, system.sees, imaging.estimation)
    std, believed = system.manufacturing_std_mm, system.believed_errors
    covariance = matrix_covariance(gains, projections, points, imaging.estimation, per_error, std, believed)
    return Chain(system, imaging, system.sees, mounts, gains, covariance, effects_of_images(system))


@dataclass(frozen=True, slots=True, eq=False)
class ErrorModel:
    """First order of measures at one of their sites: ``e = bias + sum over blocks of gain @ xi``."""

    site: str  # name of the target, or of what joins several
    biases: Mapping[str, Array]  # (3,) by the name of the measure, in its frame and unit
    known: tuple[KnownShift, ...]  # parts of the biases
    blocks: tuple[Block, ...]
    room: Array | None  # of ``Site``
    parts: tuple[tuple[ErrorModel, Array], ...] = field(default=(), kw_only=True)
    """Models at the targets that it joins, with their weights (3, 6) or (6, 6)."""
    doubt: str = field(default="", kw_only=True)  # of ``Site``

    def times_apart(self, error: str) -> float:
        """How many times larger the error would be if nothing of those at the targets that it joins cancelled: by so
        much more may its first order be off; inf where all of it does."""
        if not self.parts:
            return 1.0
        most = sum(
            float(np.linalg.norm(weights[:, 3 * k : 3 * k + 3], 2)) ** 2 * model.second_moment(point.name)
            for model, weights in self.parts
            for k, point in enumerate(POINTS)
        )
        own = self.second_moment(error)
        return max(1.0, sqrt(most / own)) if own else inf if most else 1.0

    def second_moment(self, error: str) -> float:
        """Mean square of the error's length; what is bounded counts by its half-width."""
        random = sum(float(((block.gain(error) * block.spread) ** 2).sum()) for block in self.blocks)
        return random + float((self.bias_mm(error) ** 2).sum())

    def bias_mm(self, error: str) -> Array:
        return self.biases[error]

    def imaged_bias_mm(self, error: str) -> Array:
        """(3,) the part of the bias that comes through the images, and depends on the layout."""
        return np.asarray(sum((each.of(error) for each in self.known), np.zeros_like(self.bias_mm(error))))


@dataclass(frozen=True, slots=True, eq=False)
class LinearModel(ErrorModel):
    """First order at one target: of the errors at the tool and as located."""

    target: Target
    reconstructed_mm: Array  # (3,) con: q_hat without noise and without the known shifts
    tcp_from_localisation: Array  # (3, 3): what a displacement of q_hat in con does in tcp
    tcp_from_flange: Array  # (3, 3): what a displacement behind q_hat, at the flange, does in tcp
    manufacturing_block_diagonal: Array  # (3, 3) con, covariance of Eq 16: cross-view terms dropped
    nonlinearity: Nonlinearity
    turns: Turns
    extrapolation: float  # distance of the point from the fiducials' centroid over their RMS radius

    @property
    def nu(self) -> float:
        """The validity number: the largest of the relative errors that first order takes for small."""
        return self.nonlinearity.nu


def pass_mounts(mounts: Mounts, target_mm: Array) -> Passage:
    """The way of targets (..., 3) mm, con, through the mounts.

    Reconstructed is, by the physical reading, ``T^-1 q``, what DLT makes of a structure that moved.  From
    ``T(b) T(b)^-1 x = x`` its derivative by the torsor is ``-(dTy_dy)^-1 dTy_db`` at ``y = T^-1 x``.
    """
    first, second, third = mounts.first, mounts.second, mounts.third
    if mounts.reading is Reading.PHYSICAL:
        reconstructed = apply(mounts.undone, target_mm - first.shift_mm)
        by_first = -mounts.undone @ first.by_torsor(reconstructed)
    else:
        reconstructed, by_first = first.move(target_mm), first.by_torsor(target_mm)
    turn, shift = mounts.to_tool[:3, :3], mounts.to_tool[:3, 3]
    at_tool = apply(turn, second.move(reconstructed)) + shift
    from_moved = third.rotation @ turn
    return Passage(
        reconstructed_mm=reconstructed,
        localisation_bias_mm=reconstructed - target_mm,
        tcp_bias_mm=third.move(at_tool) + mounts.execution_bias_mm - (apply(turn, target_mm) + shift),
        at_tool_mm=at_tool,
        tcp_from_localisation=from_moved @ second.rotation,
        tcp_from_flange=from_moved,
        by_torsors=(by_first, from_moved @ second.by_torsor(reconstructed), third.by_torsor(at_tool)),
    )


def linearise(system: System, target: Target) -> LinearModel:
    """Linear model of localisation and TCP error at one target (Eqs 15-16, cross-view terms kept).

    Raises IllPosedError when the layout or the views do not determine the point.
    """
    return linearise_at(chain_of(system), target)


def linearise_all(chain: Chain) -> dict[str, LinearModel]:
    """:func:`linearise` at every target, by its name."""
    return {target.name: linearise_at(chain, target) for target in chain.system.targets}


def models_of(system: System, models: Mapping[str, LinearModel]) -> dict[tuple[str, str], ErrorModel]:
    """The linear model of every measure wherever it is read, by the names of site and measure; models: at targets."""
    return {
        metric.key: models[metric.site.name] if metric.measure in POINTS else join(models, *metric)
        for metric in system.metrics
    }


def join(models: Mapping[str, ErrorModel], measure: Measure, site: Site) -> ErrorModel:
    """The linear model of a measure made of the errors at targets.

    What acts on the image of a target (``Effect.of_target``) is drawn for each of them, everything else once for all;
    of a site of two shots what is drawn at each shot is drawn for each, too.
    """
    parts = [(models[name], weights) for name, weights in site.weights.items()]

    def weigh(weights: Array, of: Callable[[str], Array]) -> Array:
        each = (weights[:, 3 * k : 3 * k + 3] @ of(point.name) for k, point in enumerate(POINTS))
        return np.asarray(sum(each))

    blocks = []
    for several in zip(*(model.blocks for model, _ in parts), strict=True):
        effect = several[0].effect
        gains = [weigh(weights, block.gain) for block, (_, weights) in zip(several, parts, strict=True)]
        apart = effect.of_target or (bool(site.other_shot) and effect.drawn is Drawn.SHOT)
        blocks += [Block(effect, {measure.name: each}) for each in (gains if apart else [np.sum(gains, 0)])]
    shifts: dict[tuple[str, str], Array] = {}
    for model, weights in parts:
        for known in model.known:
            key = known.contributor, known.label
            shifts[key] = shifts.get(key, 0.0) + weigh(weights, known.of)
    bias = np.sum([weigh(weights, model.bias_mm) for model, weights in parts], 0)
    shared = tuple(KnownShift(*key, {measure.name: shift}) for key, shift in shifts.items())
    biases, joined = {measure.name: bias}, tuple(parts)
    return ErrorModel(site.name, biases, shared, tuple(blocks), site.room, parts=joined, doubt=site.doubt)


class ValidityGrounds(NamedTuple):
    """By what the validity of a linear model is judged."""

    nonlinearity: Nonlinearity
    turns: Turns


UNJUDGED = ValidityGrounds(Nonlinearity(nan, nan, nan, nan, nan), NO_TURNS)  # where nobody asks: it is most of the work


def linearise_at(chain: Chain, target: Target, whole: LinearModel | ValidityGrounds | None = None) -> LinearModel:
    """:func:`linearise` where the chain is known already; by what its validity is judged is taken from ``whole``."""
    system = chain.system
    passage = pass_mounts(chain.mounts, target.position_mm)
    reconstructed = passage.reconstructed_mm
    to_tcp, from_moved = passage.tcp_from_localisation, passage.tcp_from_flange
    images = image_gains(chain, target, reconstructed, to_tcp, from_moved)
    if not np.isfinite(images.localisation).all():
        detail = f"the fiducials and views do not determine target {target.name!r}: a gain is not finite"
        hint = "run `tailstack validate` for the direction that is not determined"
        raise IllPosedError(Problem("/fiducials", "singular-layout", detail, hint))

    gains = images.by_effect(chain) | passage.mount_gains(system)
    in_order = (*chain.of_images, *system.links, *system.shared_image_errors)
    blocks = [Block(effect, gains[effect.name]) for effect in in_order if effect.sources.count]
    known = images.known_shifts(system)
    unimaged = {"tcp": passage.tcp_bias_mm, "localisation": passage.localisation_bias_mm}
    biases = {error: bias + sum(each.of(error) for each in known) for error, bias in unimaged.items()}
    columns = images.localisation[:, : images.single]
    if whole is None:
        imaging = chain.imaging
        numbers = nonlinearity(
            imaging.projections,
            imaging.points,
            chain.weights,
            reconstructed,
            chain.matrix_covariance,
            common_of(chain, images.shifts),
            imaging.estimation.noise_of(1),
            images.row_weights,
            published=not system.triangulation.traits.own_frame,
        )
        moved = gains_moved_by_seat(chain, target.position_mm, columns)
        at = (reconstructed, reconstructed, passage.at_tool_mm)
        turns = _turns(chain, at, blocks, biases, to_tcp, numbers.nu, moved)
    else:
        numbers, turns = whole.nonlinearity, whole.turns
    return LinearModel(
        site=target.name,
        target=target,
        reconstructed_mm=reconstructed,
        biases=biases,
        known=known,
        blocks=tuple(blocks),
        room=None,
        tcp_from_localisation=to_tcp,
        tcp_from_flange=from_moved,
        manufacturing_block_diagonal=eq16_manufacturing(chain, columns),
        nonlinearity=numbers,
        turns=turns,
        extrapolation=_extrapolation(chain.imaging.points, reconstructed),
    )


def gains_moved_by_seat(chain: Chain, target_mm: Array, at_rest: Array) -> float:
    """mm^2: second moment of what the structure's mount, where it turns, does to the gains of images.

    The structure is seen from elsewhere then.  That the error turns with it changes no norm, and is left out.
    at_rest (3, M): of single images (``noise.assemble``).
    """
    system = chain.system
    spread = np.concatenate([each.sources.spread for each in chain.of_images])
    square, still = 0.0, np.zeros((len(system.views), 2 * len(system.fiducials_mm) + 2, 0))
    first, each, backs = chain.seat_moves
    if system.reading is Reading.PHYSICAL:
        reconstructed = np.linalg.solve(first.rotation, (target_mm - first.shift_mm)[..., None])[..., 0]
    else:
        reconstructed = first.move(target_mm)
    for imaging, aim, back in zip(each, reconstructed, backs, strict=True):
        beside, _ = gains_of_images(imaging, chain.weights, aim, still)
        change = (back @ beside[:, : at_rest.shape[1]] - at_rest) * (spread / _STEP)
        square += float((change * change).sum())
    return square


def _turns(
    chain: Chain,
    points: tuple[Array, Array, Array],
    blocks: Sequence[Block],
    biases: dict[str, Array],
    to_tcp: Array,
    nu: float,
    gains_moved: float,
) -> Turns:
    """What first order leaves out because mounts turn or something is known, of both errors.

    points: that the three mounts displace; nu: of the images; gains_moved: ``gains_moved_by_seat``.  What is BOUNDED
    counts as known, with the signs that lengthen the bias.
    """
    system = chain.system
    mounts = system.mounts
    if any(Law.BOUNDED in block.laws for block in blocks):
        biases = {error: _lengthen(bias, error, blocks) for error, bias in biases.items()}
    turning = any(mount.sources.direction[:3].any() for mount in mounts)
    if not turning and not any(bias.any() for bias in biases.values()):
        return NO_TURNS
    z = np.zeros((SIZE, SIZE))
    for mount, start in zip(mounts, (ANGLES_1.start, ANGLES_2.start, ANGLES_3.start), strict=True):
        own = mount.sources.direction * mount.sources.spread
        z[start : start + 6, start : start + 6] = own @ own.T
    through = [block.gain("localisation") * block.spread for block in blocks if block.effect.way is not Way.LINK]
    images = np.hstack(through)
    z[IMAGES, IMAGES] = images @ images.T
    shared = [block for block in blocks if block.effect.way is Way.SHARED]
    behind = [block.gain("tcp") * block.spread for block in blocks if block.effect.acts_at(Place.TOOL)]
    behind += [(block.gain("tcp") - to_tcp @ block.gain("localisation")) * block.spread for block in shared]
    beside = np.hstack([np.zeros((3, 1)), *behind])
    local, bent, at_tool, bent_at_tool = second_order(
        (chain.mounts.first, chain.mounts.second, chain.mounts.third),
        mounts,
        chain.mounts.to_tool[:3, :3],
        points,
        system.reading is Reading.PHYSICAL,
    )
    out = NO_TURNS
    for error, jacobian, second, rest, of_images in (
        ("localisation", local, bent, np.zeros((3, 3)), np.eye(3)),
        ("tcp", at_tool, bent_at_tool, beside @ beside.T, to_tcp),
    ):
        total = jacobian @ z @ jacobian.T + rest
        turns = turns_of(jacobian, second, z, total, biases[error], gains_moved)
        grown = images_beside_bias(nu, z[IMAGES, IMAGES], of_images, total, biases[error])
        out = out.larger(turns._replace(images_beside_bias=grown))
    if any(
        law is Law.BOUNDED and mount.sources.direction[:3, j].any()
        for mount in mounts
        for j, law in enumerate(mount.sources.laws)
    ):  # a turn that stands at an end is itself known: its second order has one direction, and errs in its first power
        out = out._replace(along_bias=max(out[:2]))
    return out


def _lengthen(bias: Array, error: str, blocks: Sequence[Block]) -> Array:
    """A bias (3,) with each BOUNDED source at the end at which it lengthens it, the longest first."""
    columns = (column for block in blocks for column in block.bounded_columns_mm(error).T)
    for column in sorted(columns, key=lambda column: -float(column @ column)):
        bias = bias + (column if bias @ column >= 0 else -column)
    return bias


class ImageGains(NamedTuple):
    """What everything that acts through the images does at a target, in the order of ``noise.assemble``: single
    images and believed intrinsics, shifts of all images together, what is known of these and of believed intrinsics."""

    localisation: Array  # (3, M + C + E + V) con, mm per native unit
    tcp: Array  # the same in tcp
    single: int  # M
    shifts: Array  # (V, 2 N + 2, C + E) px (:func:`shift_together`)
    row_weights: Array  # (V, 2, 2) of the rows of triangulation

    def by_effect(self, chain: Chain) -> dict[str, dict[str, Array]]:
        """The gains (3, k) of the sources of each effect, by its name, on both errors at the target."""
        effects = (*chain.of_images, *chain.system.shared_image_errors)
        ends = np.cumsum([each.sources.count for each in effects])
        parts = (np.split(gains, ends, axis=1) for gains in (self.localisation, self.tcp))
        pairs = zip(effects, *parts, strict=False)
        return {each.name: {"tcp": tcp, "localisation": con} for each, con, tcp in pairs}

    def known_shifts(self, system: System) -> tuple[KnownShift, ...]:
        """What is known of effects, and does something: of believed intrinsics first."""
        errors = (*system.shared_image_errors, *system.believed_errors)
        views, count = len(system.views), len(errors)
        every = [
            KnownShift(error.name, error.label, {"tcp": tcp, "localisation": con})
            for error, con, tcp in zip(errors, self.localisation[:, -count:].T, self.tcp[:, -count:].T, strict=True)
            if error is not None and (con.any() or tcp.any())
        ]
        return (*every[-views:], *every[:-views])


def image_gains(chain: Chain, target: Target, aim_mm: ArrayLike, to_tcp: Array, from_flange: Array) -> ImageGains:
    """aim_mm (3,): the reconstructed point; to_tcp, from_flange (3, 3): what a displacement of it, and of its place on
    the flange, do in tcp.  Complex, where the chain's fiducials or the aim are."""
    shifts, at_flange = shift_together(chain.system, chain.mounts.first, target)
    columns, row_weights = gains_of_images(chain.imaging, chain.weights, aim_mm, shifts)
    tcp = to_tcp @ columns
    tcp[:, -at_flange.shape[1] :] += from_flange @ at_flange
    return ImageGains(columns, tcp, columns.shape[1] - at_flange.shape[1], shifts, row_weights)


def shift_together(system: System, first: Displacement, target: Target) -> tuple[ArrayLike, ArrayLike]:
    """What ``system.shared_image_errors`` do side by side: to the images (V, 2 N + 2, C + E) px, u and v of each
    fiducial, then of the target, and, behind the reconstructed point, at the flange (3, C + E + V) mm, con.

    The estimator knows nothing of them: what each does to the point is the sum of the gains of image noise, times its
    shifts.  Per native unit of each of their C sources; then what is known of each of the E effects; last, so that the
    columns are those of ``noise.assemble``, nothing for each view.  first: the displacement of the structure by its
    installation at the bias.
    """
    scene, to_con = system.scene(target.position_mm[None], project), undo(system.T_flange_con)
    views, rows, kind = len(system.views), 2 * len(system.fiducials_mm) + 2, system.fiducials_mm.dtype
    moved, turned = system.fiducials_mm, np.eye(3)
    if system.reading is Reading.PHYSICAL:
        moved, turned = moved @ first.rotation.T + first.shift_mm, first.rotation

    def see(v: int, steps: ArrayLike) -> ArrayLike:
        """(2 N, q) px: how the fiducials' images in a view move when they move by steps (N, 3, q) mm."""
        slopes = motion_of_images(system.views[v].projection, moved)
        return np.asarray((slopes @ steps).reshape(rows - 2, -1))

    def shift(act: Act, v: int, parameters: ArrayLike) -> ArrayLike:
        """(2 N or 2 N + 2, q) px: how images in a view move by parameters (m, q), the last of which are known."""
        each = act.by(parameters)
        match act.place:
            case Place.IMAGES:
                return each
            case Place.BEADS:
                steps = each.reshape(-1, 3, each.shape[1])
                return see(v, np.swapaxes(np.swapaxes(steps, 1, 2) @ turned.T, 1, 2))
            case Place.SHOT:
                at = displacement(each[:, -1], act.pivot_mm, system.rotation_form)
                shifts = see(v, at.by_torsor(moved) @ each)
                there = moved @ at.rotation.T + at.shift_mm
                images = (project(system.views[v].projection, points) for points in (there, moved))
                shifts[:, -1] = np.subtract(*images).ravel()
                return shifts
            case Place.CONNECTOR | Place.ARM:
                return np.zeros((0, each.shape[1]))
            case Place.INTRINSICS | Place.SEAT | Place.FLANGE | Place.HAND_EYE | Place.TOOL:
                raise AssertionError(act.place)  # what acts there acts nowhere else: a DirectEffect, no shared one
            case _:
                assert_never(act.place)

    images, flange = [], []
    for effect in system.shared_image_errors:
        parameters = np.column_stack([effect.sources.direction, effect.known])
        shifts, behind = np.zeros((views, rows, parameters.shape[1]), kind), np.zeros((3, parameters.shape[1]))
        for act in effect.act(scene):
            if act.place is Place.CONNECTOR:
                behind = behind + act.by(parameters)
            elif act.place is Place.ARM:
                behind = behind + move_at(carry(to_con, act.twists), target.position_mm).T @ act.by(parameters)
            for v, view in enumerate(system.views):
                if act.view in (None, view.name):
                    of_images = shift(act, v, parameters)
                    shifts[v, : len(of_images)] += of_images
        images.append(shifts)
        flange.append(behind)
    nothing = np.zeros((views, rows, 0), kind)
    each = [nothing, *(part[..., :-1] for part in images), *(part[..., -1:] for part in images)]
    own = [*(part[:, :-1] for part in flange), *(part[:, -1:] for part in flange), np.zeros((3, views))]
    return np.concatenate(each, axis=2), np.concatenate(own, axis=1)


def eq16_manufacturing(chain: Chain, columns: Array) -> Array:
    """(3, 3) mm^2 of the manufacturing errors as Eq 16 has it, cross-view terms dropped; columns (3, M)."""
    imaging, total = chain.imaging, np.zeros((3, 3))
    if imaging.manufactured:
        count = len(imaging.points)
        for v, projection in enumerate(imaging.projections):
            single = columns[:, v * (2 * count + 2) :][:, : 2 * count].reshape(3, count, 2)
            single = single @ np.linalg.inv(imaging.estimation.factors_of(0)[v])
            made = np.einsum("jic,ick->jik", single, motion_of_images(projection, imaging.points) @ imaging.per_error)
            scaled = (made * chain.system.manufacturing_std_mm).reshape(3, -1)
            total += scaled @ scaled.T
    return total


def common_of(chain: Chain, shifts: Array) -> Common:
    """All that moves the images of a view together, and the known errors of believed intrinsics, for the validity;
    shifts (V, 2 N + 2, C + E) px."""
    rows = shifts.shape[1] - 2
    spread = np.concatenate([np.zeros(0), *(each.sources.spread for each in chain.system.shared_image_errors)])
    random, known = shifts[:, :, : spread.size] * spread, shifts[:, :, spread.size :].sum(axis=2)
    by_intrinsics = np.array([gains.by_intrinsics for gains in chain.matrix_gains])
    assumed = (by_intrinsics @ chain.imaging.assumed[:, :, None])[:, :, 0]
    steady = bool(known.any() or assumed.any())
    every = np.concatenate([random, known[:, :, None]], axis=2) if steady else random
    by_noise = np.array([gains.by_noise.reshape(12, rows) for gains in chain.matrix_gains])
    of_matrices = by_noise @ every[:, :rows]
    if steady:
        of_matrices[:, :, -1] += assumed
    return Common(of_matrices, every[:, rows:], int(steady))


def _extrapolation(points: Array, target_mm: Array) -> float:
    """Distance of a point (3,) from the centroid of points (N, 3) over their RMS radius."""
    centroid = points.mean(axis=0)
    return float(np.linalg.norm(target_mm - centroid) / np.sqrt(((points - centroid) ** 2).sum(axis=1).mean()))


def covariance(model: ErrorModel, error: str) -> Array:
    """(3, 3) mm^2 covariance of the error, every random source included (bounded ones have none)."""
    return sum((block.covariance(error) for block in model.blocks), np.zeros((3, 3)))


def covariance_block_diagonal(model: LinearModel, error: str) -> Array:
    """The paper's Eq 16 as printed: shared fiducial errors treated as independent in each view."""
    total = covariance(model, error)
    for block in model.blocks:
        if block.is_grouped and block.effect.acts_at(Place.BEADS):
            shared = block.columns_mm("localisation")
            change = model.manufacturing_block_diagonal - shared @ shared.T
            to_frame = model.tcp_from_localisation if error == "tcp" else np.eye(3)
            total += to_frame @ change @ to_frame.T
    return total


def with_perfect_fiducials(model: ErrorModel, error: str) -> ErrorModel:
    """The linear model without what comes by way of the fiducials: their noise, their manufacture, assumed intrinsics,
    what moves their images together; and without any bias where some of it comes that way too."""
    rest = tuple(b for b in model.blocks if b.effect.way is Way.LINK or b.effect.of_target)
    if not model.imaged_bias_mm(error).any():
        return replace(model, blocks=rest)
    return replace(model, blocks=rest, biases={name: np.zeros_like(bias) for name, bias in model.biases.items()})

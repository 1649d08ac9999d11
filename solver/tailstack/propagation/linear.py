"""The linear model of the error at one target: bias and a gain column for every scalar source.

Linearised at the *biased* geometry: the known installation errors enter as full finite displacements,
and the noise sees the effective projections ``P_v T_err1`` (physical reading).  Products of two random
sources are second order and left out; ``second_order`` and the Monte Carlo account for them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..errors import IllPosedError, Problem
from ..geometry.rotation import Displacement, displacement
from ..system import Estimator, IntrinsicsError, Law, Reading, System, Target, Triangulation
from .noise import Estimation, noise_gains, noise_gains_jit
from .nonlinearity import Nonlinearity, matrix_covariance, nonlinearity
from .systematic import systematic_errors

ASSUMED = "assumed_intrinsics:"  # followed by the name of a view: the contributor
ROWS = {Triangulation.WEIGHTED: 1, Triangulation.REPROJECTION: 2}  # the others: 0
NO_GAIN = np.zeros((3, 0))


class Block(NamedTuple):
    """One contributor: k independent scalar sources and what one native unit of each does to the error."""

    contributor: str
    components: tuple[str, ...]
    laws: tuple[Law, ...]
    half_width: Array  # (k,) native unit: rad, mm, px, N; sigma for image noise
    std: Array  # (k,) native unit
    units: tuple[str, ...]
    localisation: Array  # (3, k) con, mm per native unit
    tcp: Array  # (3, k) tcp, mm per native unit
    grouped: bool  # reported as one line (all columns are alike), not component by component
    per_unit: bool  # drawn once per installed unit (True) or at each shot (False)
    label: str = ""  # what people call the contributor
    imaged: bool = False  # acts through the images: its gains are those of ``image_gains`` and depend on the layout
    common: bool = False  # moves the images of all fiducials of a view together: so do its gains


class KnownShift(NamedTuple):
    """What a contributor is known to do to the error, beside the bias of mounts and load."""

    contributor: str
    localisation_mm: Array  # (3,) con
    tcp_mm: Array  # (3,) tcp
    label: str

    def of(self, error: str) -> Array:
        return self.tcp_mm if error == "tcp" else self.localisation_mm


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """What a system does at its bias, for all targets alike."""

    system: System
    projections: Array  # (V, 3, 4), |p3| = 1: effective ones
    points: Array  # (N, 3) mm, the fiducials as the estimator is told them
    weights: Array  # (V, N) 1 where a view's estimate uses a fiducial, otherwise 0
    estimation: Estimation  # what the estimator is and knows
    intrinsics: tuple[IntrinsicsError | None, ...]  # of each view: the error of what it is told; None: no such error
    per_error: Array  # (3, 3) from a manufacturing error to a displacement of those
    first: Displacement
    undone: Array  # (3, 3) inverse of the first interface's rotation
    second: Displacement
    third: Displacement
    to_tool: Array  # (4, 4) con -> tcp
    manufacturing_std_mm: Array  # (N, 3)
    target_noise_px: Array  # (V,)
    matrix_covariance: Array  # (12 V, 12 V) of the resected matrices (``nonlinearity.matrix_covariance``)
    manufactured: bool  # whether fiducials have manufacturing errors, which the views share
    blocks: tuple[Block, ...]  # in the order of the chain, their gains left out


def estimator_geometry(system: System) -> tuple[Array, Array, Array]:
    """What the estimator meets at the bias, in its own coordinates.

    Returns projections (V, 3, 4) with ``|p3| = 1``, the fiducials it is told (N, 3), and the linear map
    (3, 3) from a manufacturing error to a displacement of those.  Physical: ``P_v T_err1`` and the nominal
    fiducials.  Eq 18: ``P_v T_err1^-1`` and the moved ones.  The rescaling matters for the small-angle form,
    which is not rigid.
    """
    mount = system.structure_connector
    return _estimator_geometry(system, displacement(mount.bias, mount.pivot_mm, system.rotation_form))


def _estimator_geometry(system: System, first: Displacement) -> tuple[Array, Array, Array]:
    projections = system.projections
    if system.reading is Reading.PHYSICAL:
        nominal, per_error, effective = system.fiducials_mm.copy(), np.eye(3), projections @ first.matrix()
    else:
        per_error = first.rotation.copy()  # writable as the identity is: kernels see one kind
        nominal = system.fiducials_mm @ per_error.T + first.shift_mm
        effective = projections @ np.linalg.inv(first.matrix())
    return effective / np.linalg.norm(effective[:, 2, :3], axis=1)[:, None, None], nominal, per_error


def estimation_of(system: System) -> Estimation:
    """What the estimator of a system is and knows, in the numbers that the gains take."""
    precision = np.zeros((len(system.views), 3))
    for v, view in enumerate(system.views):
        if system.estimator is Estimator.POSE_WITH_PRIOR and view.intrinsics_prior is not None:
            focal, centre = view.intrinsics_prior
            precision[v] = (view.fiducial_noise_px / np.array([focal, centre, centre])) ** 2
    return Estimation(
        system.estimator.unknowns,
        ROWS.get(system.triangulation, 0),
        precision,
        np.array([(view.fiducial_noise_px, view.target_noise_px) for view in system.views]),
    )


def believed_errors(system: System) -> tuple[IntrinsicsError | None, ...]:
    """For each view the error of the intrinsics that its estimate believes; None where there is none."""
    if not system.estimator.believes_intrinsics:
        return (None,) * len(system.views)
    return tuple(view.intrinsics_error for view in system.views)


def _label(contributor: str) -> str:
    return contributor.replace("_", " ").replace(":", ", ")


def _blocks(system: System) -> tuple[Block, ...]:
    """In the order of the chain, without gains: image noise view by view, manufacturing, mounts, execution."""
    blocks: list[Block] = []
    count = len(system.fiducials_mm)
    std = system.manufacturing_std_mm.ravel()

    def add_group(name: str, unit: str, law: Law, half_width: Array, std: Array, per_unit: bool) -> None:
        k = len(std)
        what = ("all",) * k, (law,) * k, half_width, std, (unit,) * k
        blocks.append(Block(name, *what, NO_GAIN, NO_GAIN, True, per_unit, _label(name), True))

    for view in system.views:
        for name, sigma in (
            (f"fiducial_noise:{view.name}", np.full(2 * count, view.fiducial_noise_px)),
            (f"target_noise:{view.name}", np.full(2, view.target_noise_px)),
        ):
            add_group(name, "px", Law.NORMAL, sigma, sigma, False)
    if std.any():
        wide = system.manufacturing_half_width_mm.ravel()
        add_group("fiducial_manufacturing", "mm", system.manufacturing_law, wide, std, True)
    told = [
        (f"{ASSUMED}{view.name}", _label(f"{ASSUMED}{view.name}"), error.sources, True, True)
        for view, error in zip(system.views, believed_errors(system), strict=True)
        if error is not None
    ]
    mounts = [(mount.name, mount.title, mount.sources, True, False) for mount in (*system.interfaces, system.hand_eye)]
    every = (*told, *mounts, ("execution", "execution", system.execution, False, False))
    for name, title, sources, per_unit, imaged in every:
        if sources.names:
            what = sources.names, sources.laws, sources.half_width, sources.std, sources.units
            blocks.append(Block(name, *what, NO_GAIN, NO_GAIN, False, per_unit, title, imaged))
    return tuple(blocks)


def chain_of(system: System) -> Chain:
    """Everything :func:`linearise` needs that does not depend on the target."""
    form = system.rotation_form
    first, second, third = (
        displacement(mount.bias, mount.pivot_mm, form) for mount in (*system.interfaces, system.hand_eye)
    )
    projections, points, per_error = _estimator_geometry(system, first)
    std, weights, estimation = system.manufacturing_std_mm, system.sees, estimation_of(system)
    return Chain(
        system=system,
        projections=projections,
        points=points,
        weights=weights,
        estimation=estimation,
        intrinsics=believed_errors(system),
        per_error=per_error,
        first=first,
        undone=np.asarray(np.linalg.inv(first.rotation)),
        second=second,
        third=third,
        to_tool=system.T_tcp_con,
        manufacturing_std_mm=std,
        target_noise_px=np.array([view.target_noise_px for view in system.views]),
        matrix_covariance=matrix_covariance(
            projections, points, weights, estimation, per_error, std, believed_errors(system)
        ),
        manufactured=bool(std.any()),
        blocks=_blocks(system),
    )


@dataclass(frozen=True, slots=True, eq=False)
class LinearModel:
    """First order at one target: ``e = bias + sum over blocks of gain @ xi``."""

    target: Target
    reconstructed_mm: Array  # (3,) con: q_hat without noise and without the known shifts
    localisation_bias_mm: Array  # (3,) con
    tcp_bias_mm: Array  # (3,) tcp
    known: tuple[KnownShift, ...]  # parts of both biases
    blocks: tuple[Block, ...]
    tcp_from_localisation: Array  # (3, 3): what a displacement of q_hat in con does in tcp
    tcp_from_flange: Array  # (3, 3): what a displacement behind q_hat, at the flange, does in tcp
    manufacturing_block_diagonal: Array  # (3, 3) con, covariance of Eq 16: cross-view terms dropped
    nonlinearity: Nonlinearity
    extrapolation: float  # distance of the point from the fiducials' centroid over their RMS radius

    @property
    def nu(self) -> float:
        """The validity number: the largest of the relative errors that first order takes for small."""
        return self.nonlinearity.nu

    def gain(self, block: Block, error: str) -> Array:
        return block.tcp if error == "tcp" else block.localisation

    def bias_mm(self, error: str) -> Array:
        return self.tcp_bias_mm if error == "tcp" else self.localisation_bias_mm

    def imaged_bias_mm(self, error: str) -> Array:
        """(3,) the part of the bias that comes through the images, and depends on the layout."""
        return np.asarray(sum((each.of(error) for each in self.known), np.zeros(3)))


def _reconstruct(chain: Chain, target: Target) -> tuple[Array, Array]:
    """``q_hat`` without noise and its derivative by the torsor of the first interface (3, 6).

    Physical: ``T^-1 q``, what DLT makes of a structure that moved.  From ``T(b) T(b)^-1 x = x`` the derivative is
    ``-(dTy_dy)^-1 dTy_db`` at ``y = T^-1 x``.
    """
    first = chain.first
    if chain.system.reading is Reading.PHYSICAL:
        back = chain.undone @ (target.position_mm - first.shift_mm)
        return back, -chain.undone @ first.by_torsor(back)
    return first.move(target.position_mm), first.by_torsor(target.position_mm)


def linearise(system: System, target: Target) -> LinearModel:
    """Linear model of localisation and TCP error at one target (Eqs 15-16, cross-view terms kept).

    Raises IllPosedError when the layout or the views do not determine the point.
    """
    return linearise_at(chain_of(system), target)


def linearise_all(system: System) -> dict[str, LinearModel]:
    """:func:`linearise` at every target, by its name."""
    chain = chain_of(system)
    return {target.name: linearise_at(chain, target) for target in system.targets}


def linearise_at(chain: Chain, target: Target, numbers: Nonlinearity | None = None) -> LinearModel:
    """:func:`linearise` where the chain is known already, and with ``numbers`` what its validity is judged by."""
    system = chain.system
    reconstructed, torsor_1 = _reconstruct(chain, target)
    images = image_gains(chain, reconstructed)
    if not np.isfinite(images.columns).all():
        raise IllPosedError(
            Problem(
                "/fiducials",
                "singular-layout",
                f"the fiducials and views do not determine target {target.name!r}: a gain is not finite",
                "run `tailstack validate` for the direction that is not determined",
            )
        )

    moved, torsor_2 = chain.second.move(reconstructed), chain.second.by_torsor(reconstructed)
    turn, shift = chain.to_tool[:3, :3], chain.to_tool[:3, 3]
    at_tool = turn @ moved + shift
    from_moved = chain.third.rotation @ turn
    to_tcp = from_moved @ chain.second.rotation
    # What acts before the reconstructed point is also seen at the tool; what acts behind it is seen there alone.
    before = {system.structure_connector.name: torsor_1 @ system.structure_connector.sources.direction}
    behind = {
        system.connector_flange.name: from_moved @ torsor_2 @ system.connector_flange.sources.direction,
        system.hand_eye.name: chain.third.by_torsor(at_tool) @ system.hand_eye.sources.direction,
        "execution": system.execution.direction,
    }
    blocks, start = [], 0
    for block in chain.blocks:
        if block.imaged:
            localisation = images.columns[:, start : start + len(block.laws)]
            start += len(block.laws)
        else:
            localisation = before.get(block.contributor, np.zeros((3, len(block.laws))))
        tcp = behind[block.contributor] if block.contributor in behind else to_tcp @ localisation
        blocks.append(block._replace(localisation=localisation, tcp=tcp))
    shifts, systematic = common_shifts(chain, target, images.columns, to_tcp, from_moved)
    known = (*_assumed_shifts(system, images.assumed_mm, to_tcp), *shifts)
    if numbers is None:
        numbers = nonlinearity(
            chain.projections,
            chain.points,
            chain.weights,
            reconstructed,
            chain.matrix_covariance,
            chain.target_noise_px,
            images.row_weights,
            published=system.triangulation is Triangulation.PUBLISHED,
        )
    return LinearModel(
        target=target,
        reconstructed_mm=reconstructed,
        localisation_bias_mm=reconstructed - target.position_mm + sum(each.localisation_mm for each in known),
        tcp_bias_mm=chain.third.move(at_tool)
        + system.execution_bias_mm
        - (turn @ target.position_mm + shift)
        + sum(each.tcp_mm for each in known),
        known=known,
        blocks=(*blocks, *systematic),
        tcp_from_localisation=to_tcp,
        tcp_from_flange=from_moved,
        manufacturing_block_diagonal=images.block_diagonal,
        nonlinearity=numbers,
        extrapolation=_extrapolation(chain.points, reconstructed),
    )


class ImageGains(NamedTuple):
    """What images do to the reconstructed point."""

    columns: Array  # (3, K) of every source that acts through them, mm per native unit: of the imaged blocks in turn
    block_diagonal: Array  # (3, 3) mm^2, of the manufacturing errors as Eq 16 has it: cross-view terms dropped
    assumed_mm: Array  # (3, V) of the known errors of the intrinsics that each view believes
    row_weights: Array  # (V, 2, 2) of the rows of triangulation


def _assumed_shifts(system: System, assumed_mm: Array, to_tcp: Array) -> tuple[KnownShift, ...]:
    """What the known errors of assumed intrinsics do: assumed_mm (3, V) con, to_tcp (3, 3)."""
    each = zip((f"{ASSUMED}{view.name}" for view in system.views), assumed_mm.T, strict=True)
    return tuple(KnownShift(name, shift, to_tcp @ shift, _label(name)) for name, shift in each if shift.any())


def common_shifts(
    chain: Chain, target: Target, of_images: Array, to_tcp: Array, from_moved: Array
) -> tuple[tuple[KnownShift, ...], tuple[Block, ...]]:
    """What moves the images of all beads together: what is known of it, and its blocks.

    of_images (3, K): see :func:`image_gains`; to_tcp, from_moved (3, 3): from a displacement of the reconstructed point
    and of its place on the flange, in con, to tcp.
    """
    known, blocks = [], []
    width = 2 * len(chain.points) + 2
    gains = [of_images[:, v * width : (v + 1) * width] for v in range(len(chain.projections))]
    for each in systematic_errors(chain.system, chain.first, target):
        localisation, fixed = each.localise(gains)
        if each.known_shift_px.any() or each.known_at_flange_mm.any():
            tcp = to_tcp @ fixed + from_moved @ each.known_at_flange_mm
            known.append(KnownShift(each.contributor, fixed, tcp, each.label))
        if (sources := each.sources).count:
            tcp = to_tcp @ localisation + from_moved @ each.at_flange_mm
            what = sources.names, sources.laws, sources.half_width, sources.std, sources.units
            block = Block(each.contributor, *what, localisation, tcp, False, each.per_unit, each.label, common=True)
            blocks.append(block)
    return tuple(known), tuple(blocks)


def image_gains(chain: Chain, target_mm: Array) -> ImageGains:
    """What images do to the reconstructed point.

    target_mm: (3,) the point without noise.  Columns, for each view: 2 N of its fiducials (u and v of each) and 2 of
    the target, mm per px; then 3 N of the manufacturing errors (x, y, z of each), mm per mm, if any is not 0; then
    those of the assumed intrinsics of each view that has an error of them.
    """
    views, count = len(chain.projections), len(chain.points)
    # Points with an imaginary part, by which these gains are differentiated, run the source that is not compiled.
    kind = chain.points.dtype
    fill = noise_gains if kind == np.complex128 else noise_gains_jit
    fiducial, aimed = np.zeros((views, count, 3, 2), kind), np.zeros((views, 3, 2), kind)
    made, assumed = np.zeros((views, count, 3, 3), kind), np.zeros((views, 3, 3), kind)
    row_weights = np.zeros((views, 2, 2), kind)
    fill(
        chain.projections,
        chain.points,
        chain.weights,
        chain.estimation,
        target_mm,
        fiducial,
        aimed,
        made,
        assumed,
        row_weights,
    )
    columns = []
    for v in range(views):
        columns += [fiducial[v].transpose(1, 0, 2).reshape(3, 2 * count), aimed[v]]
    block_diagonal, shifts = np.zeros((3, 3), kind), np.zeros((3, views), kind)
    if chain.manufactured:
        through = made @ chain.per_error
        columns.append(through.sum(axis=0).transpose(1, 0, 2).reshape(3, 3 * count))
        scaled = (through * chain.manufacturing_std_mm[:, None, :]).transpose(2, 0, 1, 3).reshape(3, -1)
        block_diagonal = scaled @ scaled.T
    for v, error in enumerate(chain.intrinsics):
        if error is not None:
            columns.append(assumed[v] @ error.sources.direction)
            shifts[:, v] = assumed[v] @ error.bias
    return ImageGains(np.hstack(columns), block_diagonal, shifts, row_weights)


def _extrapolation(points: Array, target_mm: Array) -> float:
    """Distance of a point (3,) from the centroid of points (N, 3) over their RMS radius."""
    centroid = points.mean(axis=0)
    return float(np.linalg.norm(target_mm - centroid) / np.sqrt(((points - centroid) ** 2).sum(axis=1).mean()))


def covariance(model: LinearModel, error: str) -> Array:
    """(3, 3) mm^2 covariance of the error, every random source included (bounded ones have none)."""
    total = np.zeros((3, 3))
    for block in model.blocks:
        scaled = model.gain(block, error) * block.std
        total += scaled @ scaled.T
    return total


def covariance_block_diagonal(model: LinearModel, error: str) -> Array:
    """The paper's Eq 16 as printed: shared fiducial errors treated as independent in each view."""
    total = covariance(model, error)
    for block in model.blocks:
        if block.contributor == "fiducial_manufacturing":
            shared = block.localisation * block.std
            change = model.manufacturing_block_diagonal - shared @ shared.T
            to_frame = model.tcp_from_localisation if error == "tcp" else np.eye(3)
            total += to_frame @ change @ to_frame.T
    return total


def largest_rotation_rad(model: LinearModel) -> float:
    """Largest standard deviation of a random rotation, half-width where it is bounded; rad."""
    largest = 0.0
    for block in model.blocks:
        if "rad" not in block.units:
            continue
        for unit, law, std, half_width in zip(block.units, block.laws, block.std, block.half_width, strict=True):
            if unit == "rad":
                largest = max(largest, float(half_width if law is Law.BOUNDED else std))
    return largest

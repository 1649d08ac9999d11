"""The linear model of the error at one target: bias and a gain column for every scalar source.

Linearised at the *biased* geometry: the known installation errors enter as full finite displacements,
and the noise sees the effective projections ``P_v T_err1`` (physical reading).  Products of two random
sources are second order and left out; ``second_order`` and the Monte Carlo account for them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import IllPosedError, Problem
from ..geometry.rotation import torsor_derivatives, torsor_transform
from ..system import Array, Law, Mount, Reading, RotationForm, Sources, System, Target
from .noise import noise_gains_jit


@dataclass(frozen=True, slots=True, eq=False)
class Block:
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


@dataclass(frozen=True, slots=True, eq=False)
class LinearModel:
    """First order at one target: ``e = bias + sum over blocks of gain @ xi``."""

    target: Target
    reconstructed_mm: Array  # (3,) con: q_hat without noise
    localisation_bias_mm: Array  # (3,) con
    tcp_bias_mm: Array  # (3,) tcp
    blocks: tuple[Block, ...]
    tcp_from_localisation: Array  # (3, 3): what a displacement of q_hat in con does in tcp
    manufacturing_block_diagonal: Array  # (3, 3) con, covariance of Eq 16: cross-view terms dropped
    nu: float  # validity number: largest over views
    extrapolation: float

    def gain(self, block: Block, error: str) -> Array:
        return block.tcp if error == "tcp" else block.localisation

    def bias_mm(self, error: str) -> Array:
        return self.tcp_bias_mm if error == "tcp" else self.localisation_bias_mm


def displace(mount: Mount, form: RotationForm, point: Array) -> tuple[Array, Array, Array]:
    """``T x``, ``dTx_dx`` (3, 3) and ``dTx_dtorsor`` (3, 6) at the mount's bias (Eqs 11-14)."""
    transform = torsor_transform(mount.bias, mount.pivot_mm, form)
    by_torsor = torsor_derivatives(mount.bias, mount.pivot_mm, point, form)
    return transform[:3, :3] @ point + transform[:3, 3], transform[:3, :3], by_torsor


def displace_back(mount: Mount, form: RotationForm, point: Array) -> tuple[Array, Array]:
    """``T^-1 x`` and ``dT^-1x_dtorsor`` (3, 6): what DLT makes of a structure that moved.

    From ``T(b) T(b)^-1 x = x``: the derivative is ``-(dTy_dy)^-1 dTy_db`` at ``y = T^-1 x``.
    """
    transform = torsor_transform(mount.bias, mount.pivot_mm, form)
    inverse = np.linalg.inv(transform[:3, :3])
    back = inverse @ (point - transform[:3, 3])
    return back, -inverse @ torsor_derivatives(mount.bias, mount.pivot_mm, back, form)


def estimator_geometry(system: System) -> tuple[Array, Array, Array]:
    """What the estimator meets at the bias, in its own coordinates.

    Returns projections (V, 3, 4) with ``|p3| = 1``, the fiducials it is told (N, 3), and the linear map
    (3, 3) from a manufacturing error to a displacement of those.  Physical: ``P_v T_err1`` and the nominal
    fiducials.  Eq 18: ``P_v T_err1^-1`` and the moved ones.  The rescaling matters for the small-angle form,
    which is not rigid.
    """
    mount = system.interface_1
    displacement = torsor_transform(mount.bias, mount.pivot_mm, system.rotation_form)
    projections = np.stack([view.projection for view in system.views])
    if system.reading is Reading.PHYSICAL:
        told, per_error, seen = system.fiducials_mm, np.eye(3), projections @ displacement
    else:
        per_error = displacement[:3, :3]
        told = system.fiducials_mm @ per_error.T + displacement[:3, 3]
        seen = projections @ np.linalg.inv(displacement)
    return seen / np.linalg.norm(seen[:, 2, :3], axis=1)[:, None, None], told, per_error


def _source_block(name: str, sources: Sources, localisation: Array, tcp: Array, per_unit: bool) -> Block:
    return Block(
        contributor=name,
        components=sources.names,
        laws=sources.laws,
        half_width=sources.half_width,
        std=sources.std,
        units=sources.units,
        localisation=localisation @ sources.direction,
        tcp=tcp @ sources.direction,
        grouped=False,
        per_unit=per_unit,
    )


def _noise_block(name: str, std_px: float, localisation: Array, to_tcp: Array) -> Block:
    count = localisation.shape[1]
    sigma = np.full(count, std_px)
    return Block(
        name, ("all",) * count, (Law.NORMAL,) * count, sigma, sigma, ("px",) * count, localisation,
        to_tcp @ localisation, grouped=True, per_unit=False,
    )  # fmt: skip


def validity_number(system: System, projections: Array, points: Array, per_error: Array, perspective: Array) -> float:
    """nu: standard deviation of the relative perspective error at the target, largest over views.

    ``dw(q)/w(q) - dw(c)/w(c)`` with w the estimated depth and c the fiducials' centroid: free of gauge, and
    the quantity whose smallness first order rests on.  Manufacturing errors count through their images.
    projections (V, 3, 4) and points (N, 3) as the estimator meets them, per_error (3, 3) its
    coordinates per manufacturing error; perspective (V, N, 2) per px.
    """
    homogeneous = np.hstack([points, np.ones((len(points), 1))])
    largest = 0.0
    for view, projection, gain in zip(system.views, projections, perspective, strict=True):
        image = homogeneous @ projection.T
        per_mm = projection[None, :2, :3] - image[:, :2, None] / image[:, 2, None, None] * projection[2, :3]
        shared = (
            np.einsum("ic,ick->ik", gain, per_mm @ per_error / image[:, 2, None, None]) * system.manufacturing_std_mm
        )
        variance = view.fiducial_noise_px**2 * (gain**2).sum() + (shared**2).sum()
        largest = max(largest, float(np.sqrt(variance)))
    return largest


def linearise(system: System, target: Target) -> LinearModel:
    """Linear model of localisation and TCP error at one target (Eqs 15-16, cross-view terms kept).

    Raises IllPosedError when the layout or the views do not determine the point.
    """
    form, first = system.rotation_form, system.interface_1
    projections, points, per_error = estimator_geometry(system)
    if system.reading is Reading.PHYSICAL:
        reconstructed, torsor_1 = displace_back(first, form, target.position_mm)
    else:
        reconstructed, _, torsor_1 = displace(first, form, target.position_mm)
    views, count = projections.shape[0], points.shape[0]
    fiducial, target_gain = np.zeros((views, count, 3, 2)), np.zeros((views, 3, 2))
    manufacturing, perspective = np.zeros((views, count, 3, 3)), np.zeros((views, count, 2))
    noise_gains_jit(projections, points, reconstructed, fiducial, target_gain, manufacturing, perspective)
    if not (np.isfinite(fiducial).all() and np.isfinite(target_gain).all()):
        raise IllPosedError(
            Problem(
                "/fiducials",
                "singular-layout",
                f"the fiducials and views do not determine target {target.name!r}: a gain is not finite",
                "run `tailstack validate` for the direction that is not determined",
            )
        )
    manufacturing = manufacturing @ per_error

    moved, dmoved_dq, torsor_2 = displace(system.interface_2, form, reconstructed)
    to_tool = system.T_tcp_con
    at_tool = to_tool[:3, :3] @ moved + to_tool[:3, 3]
    ended, dended, torsor_3 = displace(system.hand_eye, form, at_tool)
    from_moved = dended @ to_tool[:3, :3]
    to_tcp = from_moved @ dmoved_dq
    nominal = to_tool[:3, :3] @ target.position_mm + to_tool[:3, 3]

    zero = np.zeros((3, 6))
    blocks = []
    for v, view in enumerate(system.views):
        columns = fiducial[v].transpose(1, 0, 2).reshape(3, 2 * count)
        blocks.append(_noise_block(f"fiducial_noise:{view.name}", view.fiducial_noise_px, columns, to_tcp))
        blocks.append(_noise_block(f"target_noise:{view.name}", view.target_noise_px, target_gain[v], to_tcp))
    std = system.manufacturing_std_mm
    if std.any():
        columns = manufacturing.sum(axis=0).transpose(1, 0, 2).reshape(3, 3 * count)
        blocks.append(
            Block(
                "fiducial_manufacturing",
                ("all",) * (3 * count),
                (system.manufacturing_law,) * (3 * count),
                system.manufacturing_half_width_mm.ravel(),
                std.ravel(),
                ("mm",) * (3 * count),
                columns,
                to_tcp @ columns,
                grouped=True,
                per_unit=True,
            )
        )
    execution = system.execution
    every = [
        _source_block(first.name, first.sources, torsor_1, to_tcp @ torsor_1, True),
        _source_block(system.interface_2.name, system.interface_2.sources, zero, from_moved @ torsor_2, True),
        _source_block(system.hand_eye.name, system.hand_eye.sources, zero, torsor_3, True),
        _source_block("execution", execution, np.zeros((3, 3)), np.eye(3), False),
    ]
    blocks += [block for block in every if block.components]

    scaled = manufacturing * std[None, :, None, :]
    spread = points - points.mean(axis=0)
    return LinearModel(
        target=target,
        reconstructed_mm=reconstructed,
        localisation_bias_mm=reconstructed - target.position_mm,
        tcp_bias_mm=ended + system.execution_bias_mm - nominal,
        blocks=tuple(blocks),
        tcp_from_localisation=to_tcp,
        manufacturing_block_diagonal=np.einsum("vijk,vilk->jl", scaled, scaled),
        nu=validity_number(system, projections, points, per_error, perspective),
        extrapolation=float(
            np.linalg.norm(reconstructed - points.mean(axis=0)) / np.sqrt((spread**2).sum(axis=1).mean())
        ),
    )


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
            kept = block.localisation * block.std
            change = model.manufacturing_block_diagonal - kept @ kept.T
            to_frame = model.tcp_from_localisation if error == "tcp" else np.eye(3)
            total += to_frame @ change @ to_frame.T
    return total


def largest_rotation_rad(model: LinearModel) -> float:
    """Largest standard deviation of a random rotation, half-width where it is bounded; rad."""
    largest = 0.0
    for block in model.blocks:
        for unit, law, std, half_width in zip(block.units, block.laws, block.std, block.half_width, strict=True):
            if unit == "rad":
                largest = max(largest, float(half_width if law is Law.BOUNDED else std))
    return largest

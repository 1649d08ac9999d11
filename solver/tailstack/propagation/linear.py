"""The linear model of the error at one target: bias and a gain column for every scalar source.

Linearised at the *biased* geometry: the known installation errors enter as full finite displacements,
and the noise sees the effective projections ``P_v T_err1`` (physical reading).  Products of two random
sources are second order and left out; ``second_order`` and the Monte Carlo account for them.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from ..errors import IllPosedError, Problem
from ..system import Array, Law, Reading, System, Target
from .chain import Block, Chain, chain_of, estimator_geometry
from .noise import noise_gains_jit
from .parallax import parallax_gains

__all__ = [
    "Block",
    "LinearModel",
    "covariance",
    "covariance_block_diagonal",
    "estimator_geometry",
    "largest_rotation_rad",
    "linearise",
    "linearise_all",
    "validity_number",
]


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


def _reconstructed(chain: Chain, target: Target) -> tuple[Array, Array]:
    """``q_hat`` without noise and its derivative by the torsor of the first interface (3, 6).

    Physical: ``T^-1 q``, what DLT makes of a structure that moved.  From ``T(b) T(b)^-1 x = x`` the derivative is
    ``-(dTy_dy)^-1 dTy_db`` at ``y = T^-1 x``.
    """
    first = chain.first
    if chain.system.reading is Reading.PHYSICAL:
        back = chain.undone @ (target.position_mm - first.shift_mm)
        return back, -chain.undone @ first.by_torsor(back)
    return first.moved(target.position_mm), first.by_torsor(target.position_mm)


def validity_number(chain: Chain, perspective: Array, parallax: Array) -> float:
    """nu: standard deviation of what first order divides by, relative to itself; the largest of two kinds.

    The relative perspective error at the target, ``dw(q)/w(q) - dw(c)/w(c)`` with w the estimated depth and c the
    fiducials' centroid, of each view: free of gauge.  And the relative error of the firmness with which all rays
    cross (``parallax.py``).  Manufacturing errors count through their images.  perspective (V, N, 2) and parallax
    (V, N, 2, 2 V) per px.
    """
    through = np.einsum("vicx,vick->ikx", parallax, chain.per_depth) * chain.manufacturing_std_mm[:, :, None]
    noises = np.array([view.fiducial_noise_px for view in chain.system.views])
    largest = sqrt(float((noises**2 * (parallax**2).sum(axis=(1, 2, 3))).sum() + (through**2).sum()))
    for view, gain, per_depth in zip(chain.system.views, perspective, chain.per_depth, strict=True):
        shared = np.einsum("ic,ick->ik", gain, per_depth) * chain.manufacturing_std_mm
        variance = view.fiducial_noise_px**2 * (gain**2).sum() + (shared**2).sum()
        largest = max(largest, sqrt(variance))
    return largest


def linearise(system: System, target: Target) -> LinearModel:
    """Linear model of localisation and TCP error at one target (Eqs 15-16, cross-view terms kept).

    Raises IllPosedError when the layout or the views do not determine the point.
    """
    return linearise_at(chain_of(system), target)


def linearise_all(system: System) -> dict[str, LinearModel]:
    """:func:`linearise` at every target, by its name."""
    chain = chain_of(system)
    return {target.name: linearise_at(chain, target) for target in system.targets}


def linearise_at(chain: Chain, target: Target) -> LinearModel:
    """:func:`linearise` where the chain is known already."""
    projections, points, system = chain.projections, chain.points, chain.system
    reconstructed, torsor_1 = _reconstructed(chain, target)
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

    moved, torsor_2 = chain.second.moved(reconstructed), chain.second.by_torsor(reconstructed)
    turn, shift = chain.to_tool[:3, :3], chain.to_tool[:3, 3]
    at_tool = turn @ moved + shift
    from_moved = chain.third.rotation @ turn
    to_tcp = from_moved @ chain.second.rotation

    gains = {}
    by_view = fiducial.transpose(0, 2, 1, 3).reshape(views, 3, 2 * count)
    for view, columns, two in zip(system.views, by_view, target_gain, strict=True):
        gains[f"fiducial_noise:{view.name}"] = (columns, to_tcp @ columns)
        gains[f"target_noise:{view.name}"] = (two, to_tcp @ two)
    block_diagonal = np.zeros((3, 3))
    std = chain.manufacturing_std_mm
    if std.any():
        if system.reading is not Reading.PHYSICAL:  # where it is the identity
            manufacturing = manufacturing @ chain.per_error
        shared = manufacturing.sum(axis=0).transpose(1, 0, 2).reshape(3, 3 * count)
        gains["fiducial_manufacturing"] = (shared, to_tcp @ shared)
        scaled = manufacturing * std[None, :, None, :]
        block_diagonal = np.einsum("vijk,vilk->jl", scaled, scaled)
    for name, sources, localisation, tcp in (
        (system.interface_1.name, system.interface_1.sources, torsor_1, to_tcp @ torsor_1),
        (system.interface_2.name, system.interface_2.sources, None, from_moved @ torsor_2),
        (system.hand_eye.name, system.hand_eye.sources, None, chain.third.by_torsor(at_tool)),
        ("execution", system.execution, None, np.eye(3)),
    ):
        if sources.names:
            here = np.zeros((3, len(sources.names))) if localisation is None else localisation @ sources.direction
            gains[name] = (here, tcp @ sources.direction)
    return LinearModel(
        target=target,
        reconstructed_mm=reconstructed,
        localisation_bias_mm=reconstructed - target.position_mm,
        tcp_bias_mm=chain.third.moved(at_tool) + system.execution_bias_mm - (turn @ target.position_mm + shift),
        blocks=tuple(kind.block(*gains[kind.contributor]) for kind in chain.kinds),
        tcp_from_localisation=to_tcp,
        manufacturing_block_diagonal=block_diagonal,
        nu=validity_number(chain, perspective, parallax_gains(projections, points, reconstructed)),
        extrapolation=float(np.linalg.norm(reconstructed - chain.centroid)) / chain.radius,
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
        if "rad" not in block.units:
            continue
        for unit, law, std, half_width in zip(block.units, block.laws, block.std, block.half_width, strict=True):
            if unit == "rad":
                largest = max(largest, float(half_width if law is Law.BOUNDED else std))
    return largest

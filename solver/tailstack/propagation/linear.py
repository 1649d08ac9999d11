"""The linear model of the error at one target: bias and a gain column for every scalar source.

Linearised at the *biased* geometry: the known installation errors enter as full finite displacements,
and the noise sees the effective projections ``P_v T_err1`` (physical reading).  Products of two random
sources are second order and left out; ``second_order`` and the Monte Carlo account for them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..errors import IllPosedError, Problem
from ..system import Law, Reading, System, Target, Triangulation
from .chain import Block, Chain, chain_of, estimator_geometry
from .images import image_gains
from .nonlinearity import Nonlinearity, nonlinearity

__all__ = [
    "Block",
    "LinearModel",
    "covariance",
    "covariance_block_diagonal",
    "estimator_geometry",
    "largest_rotation_rad",
    "linearise",
    "linearise_all",
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
    system = chain.system
    reconstructed, torsor_1 = _reconstructed(chain, target)
    localisation = np.zeros((3, chain.kinds[-1].place.stop))  # what the images do comes first
    finite, block_diagonal, extrapolation = image_gains(
        chain.projections, chain.points, reconstructed, chain.per_error, chain.manufacturing_std_mm, localisation
    )
    if not finite:
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
    place = {kind.contributor: kind.place for kind in chain.kinds}
    mount = system.interface_1
    if mount.name in place:
        localisation[:, place[mount.name]] = torsor_1 @ mount.sources.direction
    tcp = to_tcp @ localisation
    for name, sources, acting in (
        (system.interface_2.name, system.interface_2.sources, from_moved @ torsor_2),
        (system.hand_eye.name, system.hand_eye.sources, chain.third.by_torsor(at_tool)),
        ("execution", system.execution, None),
    ):
        if name in place:
            tcp[:, place[name]] = sources.direction if acting is None else acting @ sources.direction
    numbers = nonlinearity(
        chain.projections, chain.points, reconstructed, chain.matrix_covariance, chain.target_noise_px,
        published=system.triangulation is Triangulation.PUBLISHED, coupled=chain.manufactured,
    )  # fmt: skip
    return LinearModel(
        target=target,
        reconstructed_mm=reconstructed,
        localisation_bias_mm=reconstructed - target.position_mm,
        tcp_bias_mm=chain.third.moved(at_tool) + system.execution_bias_mm - (turn @ target.position_mm + shift),
        blocks=tuple(kind.block(localisation, tcp) for kind in chain.kinds),
        tcp_from_localisation=to_tcp,
        manufacturing_block_diagonal=block_diagonal,
        nonlinearity=numbers,
        extrapolation=extrapolation,
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

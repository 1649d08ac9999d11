"""Benches of the first-order law, contributor by contributor, so that one of them can be scaled or displaced.

What the nonlinear chain adds is left out here: the question is which contributor would have to be how large, and the
answer is an interval that is much wider.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..contributors import KIND
from ..propagation.linear import Block, LinearModel, linearise
from ..system import TORSOR_COMPONENTS, Array, Law, Mount, Sources, System
from ..tail.law import UNIFORM
from .comparison_bench import when
from .comparison_statistics import Expected, bench_mean

MOST_ROWS = 100_000  # trials of the groups of a target, all benches together
MOST_BENCHES = 999
VANISHING_MM2 = 1e-12  # of a contributor to this error: nothing to be scaled
LEVER = 0.01  # rad
IMAGE_NOISE = "image_noise"  # of fiducials and targets in all views, as one contributor


@dataclass(frozen=True, slots=True, eq=False)
class Contribution:
    """One contributor of B benches."""

    name: str
    when: str  # unit, installation, shot
    errors: Array  # (B, n, 3) mm; its own part
    covariance: Array  # (3, 3) mm^2 of one draw


@dataclass(frozen=True, slots=True, eq=False)
class Displacement:
    """One component of a mount: what a fixed value of it does, and its own random part."""

    contributor: str
    component: str
    unit: str  # rad or mm
    gain: Array  # (3,) mm per unit
    half_width: float | None  # as declared; None where the design has it in place
    errors: Array | None  # (B, n, 3) mm; None where it is not random
    covariance: Array  # (3, 3) mm^2
    when: str


@dataclass(frozen=True, slots=True, eq=False)
class Law1:
    """The first-order law of a group's bench, sampled."""

    sizes: tuple[int, ...]
    bias_mm: Array  # (3,)
    total: Array  # (B, n, 3) mm, bias included
    contributions: tuple[Contribution, ...]
    displacements: tuple[Displacement, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """One level at one target: what was measured and the first-order law it is held against."""

    target: str
    sizes: tuple[int, ...]
    errors: Array | None  # (n, 3) mm, bias of bounded components taken off
    norms: Array | None  # (n,) mm
    summary: tuple[float, ...] | None  # mean and, if stated, standard deviation of the norm, mm
    expected: Expected
    law: Law1


def sampled_law(
    system: System,
    target: int,
    error: str,
    sizes: Sequence[int],
    seed: int,
    instrument_sd_mm: float,
    *,
    least: int,
    trials: int,
) -> Law1:
    """B benches (``least`` or more) of the first-order law at one target, with every contributor's own part.

    trials: of all the groups that are held together, which share the room there is.
    """
    model = linearise(system, system.targets[target])
    count = int(max(min(MOST_ROWS // trials, MOST_BENCHES), least))
    rng = np.random.default_rng([seed, 0x434F4D50])
    contributions, parts = [], {}
    total = np.broadcast_to(model.bias_mm(error), (count, sum(sizes), 3)).copy()
    for block in model.blocks:
        columns = _drawn(block, model.gain(block, error), rng, count, sizes)
        whole = sum(columns.values(), np.zeros((count, 1, 3)))
        total += whole
        scaled = model.gain(block, error) * block.std
        if np.trace(scaled @ scaled.T) > VANISHING_MM2:
            contributions.append(
                Contribution(block.contributor, when(block), np.broadcast_to(whole, total.shape), scaled @ scaled.T)
            )
        parts.update({(block.contributor, name): (block, j, errors) for (j, name), errors in columns.items()})
    seen = [part for part in contributions if part.name.split(":")[0] in ("fiducial_noise", "target_noise")]
    if len(seen) > 1:
        together = np.sum([part.errors for part in seen], axis=0)
        covariance = np.sum([part.covariance for part in seen], axis=0)
        contributions.insert(0, Contribution(IMAGE_NOISE, "shot", together, covariance))
    if instrument_sd_mm:
        noise = rng.normal(0.0, instrument_sd_mm, total.shape)
        total += noise
        contributions.append(Contribution("instrument", "shot", noise, instrument_sd_mm**2 * np.eye(3)))
    moved = tuple(_displacements(system, target, error, model, parts, total.shape))
    return Law1(tuple(sizes), model.bias_mm(error), total, tuple(contributions), moved)


def _drawn(
    block: Block, gain: Array, rng: np.random.Generator, count: int, sizes: Sequence[int]
) -> dict[tuple[int, str], Array]:
    """Errors (B, n or 1, 3) of each component of a block; a grouped block counts as one."""
    trials = sum(sizes)
    draws = {"unit": 1, "installation": len(sizes), "shot": trials}[when(block)]
    if block.grouped and all(law is Law.NORMAL for law in block.laws):
        scaled = gain * block.std
        values, vectors = np.linalg.eigh(scaled @ scaled.T)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        found = {(0, "all"): rng.standard_normal((count, draws, 3)) @ root.T}
    elif block.grouped:
        xi = np.stack([_scalars(block, j, rng, (count, draws)) for j in range(len(block.laws))], axis=-1)
        found = {(0, "all"): xi @ gain.T}
    else:
        found = {
            (j, name): _scalars(block, j, rng, (count, draws))[..., None] * gain[:, j]
            for j, name in enumerate(block.components)
        }
    if when(block) == "installation":
        return {key: np.repeat(errors, sizes, axis=1) for key, errors in found.items()}
    return found


def _scalars(block: Block, j: int, rng: np.random.Generator, shape: tuple[int, int]) -> Array:
    law, half = block.laws[j], float(block.half_width[j])
    if law is Law.NORMAL:
        return rng.normal(0.0, float(block.std[j]), shape)
    if law is Law.BOUNDED:
        return np.zeros(shape)
    if KIND[law] == UNIFORM:
        return rng.uniform(-half, half, shape)
    return half * (rng.random(shape) - rng.random(shape))


def _displacements(
    system: System,
    target: int,
    error: str,
    model: LinearModel,
    parts: dict[tuple[str, str], tuple[Block, int, Array]],
    shape: tuple[int, ...],
) -> list[Displacement]:
    """All six components of every mount, whether the design gives them a tolerance or not."""
    probed = replace(
        system, interface_1=_six(system.interface_1), interface_2=_six(system.interface_2),
        hand_eye=_six(system.hand_eye),
    )  # fmt: skip
    full = linearise(probed, system.targets[target])
    found = []
    for block in full.blocks:
        if block.grouped or block.contributor == "execution":
            continue
        for j, component in enumerate(block.components):
            gain = full.gain(block, error)[:, j]
            if not np.linalg.norm(gain) * (LEVER if block.units[j] == "rad" else 1.0) > 1e-3:
                continue  # turns about the target itself move nothing
            own = parts.get((block.contributor, component))
            covariance, errors, half = np.zeros((3, 3)), None, None
            if own is not None:
                declared, k, drawn = own
                scaled = model.gain(declared, error)[:, k] * declared.std[k]
                covariance, half = np.outer(scaled, scaled), float(declared.half_width[k])
                errors = np.broadcast_to(drawn, shape)
            found.append(
                Displacement(
                    block.contributor, component, block.units[j], gain, half, errors, covariance, when(block)
                )
            )  # fmt: skip
    return found


def _six(mount: Mount) -> Mount:
    """The mount with a source for each torsor component, to read their gains off the linear model."""
    sources = Sources(
        TORSOR_COMPONENTS, (Law.NORMAL,) * 6, np.ones(6), np.ones(6), ("rad",) * 3 + ("mm",) * 3, np.eye(6)
    )
    return replace(mount, sources=sources)


def scaled_expected(base: Expected, part: Contribution, factor: float) -> Expected:
    """Expected moments with one contributor's tolerance times a factor."""
    more = (factor**2 - 1) * part.covariance
    return replace(base, **{part.when: getattr(base, part.when) + more})


def mean_without(law: Law1, moved: Displacement) -> Array:
    """(B, 3) mean error of each bench about the bias, with one component standing still."""
    errors = law.total if moved.errors is None else law.total - moved.errors
    return bench_mean(errors, law.sizes) - law.bias_mm


def covariance_without(base: Expected, moved: Displacement, sizes: Sequence[int]) -> Array:
    """(3, 3) covariance of the mean of a bench, with one component standing still."""
    return replace(base, **{moved.when: getattr(base, moved.when) - moved.covariance}).of_mean(sizes)

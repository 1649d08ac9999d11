"""The declared law of the error at one target, put together from the parts each contributor has in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .arrays import Array
from .propagation.linear import Block, LinearModel
from .system import Law
from .tail.bounded import indistinguishable
from .tail.bounded import worst_case as worst_vertex
from .tail.declared import LinearLaw
from .tail.spectrum import VANISHING_MM

SHOWN = {"rad": ("deg", float(np.rad2deg(1.0))), "1": ("%", 100.0)}
KIND = {Law.UNIFORM: 0, Law.TRIANGULAR: 1}


def unit_for_people(unit: str) -> tuple[str, float]:
    """Displayed unit and the factor from the native one: rad -> (deg, 180/pi), a ratio -> (%, 100)."""
    return SHOWN.get(unit, (unit, 1.0))


class Part(NamedTuple):
    """What one contributor adds to a law: a Gaussian covariance, columns, or both."""

    covariance: Array | None  # (3, 3) mm^2
    columns: Array | None  # (3, k) mm
    kinds: tuple[int, ...]  # of the columns
    sources: tuple[int, ...]  # of the block, one a column


def part_of(block: Block, gain: Array) -> Part:
    """The part of one block with its gains (3, n) on the error."""
    normal = [j for j, law in enumerate(block.laws) if law is Law.NORMAL]
    other = [j for j, law in enumerate(block.laws) if law in KIND and block.half_width[j] > 0]
    scaled = gain[:, normal] * block.std[normal]
    columns = gain[:, other] * block.half_width[other]
    kinds = tuple(KIND[block.laws[j]] for j in other)
    return Part(scaled @ scaled.T if normal else None, columns if other else None, kinds, tuple(other))


def parts_of(model: LinearModel, error: str) -> tuple[Part, ...]:
    """The part of every block, in their order."""
    return tuple(part_of(block, model.gain(block, error)) for block in model.blocks)


def law_of(mean: Array, parts: Sequence[Part]) -> LinearLaw:
    """The law at ``mean`` (3,) mm that these parts make together; nothing random is left of spreads that vanish."""
    covariance = np.zeros((3, 3))
    columns: list[Array] = []
    kinds: list[int] = []
    for part in parts:
        if part.covariance is not None:
            covariance += part.covariance
        if part.columns is not None:
            columns.append(part.columns)
            kinds += part.kinds
    stacked = np.ascontiguousarray(np.concatenate(columns, axis=1)) if columns else np.zeros((3, 0))
    if covariance.trace() < VANISHING_MM**2 and not np.abs(stacked).max(initial=0.0) > VANISHING_MM:
        covariance, stacked = np.zeros((3, 3)), np.zeros_like(stacked)
    return LinearLaw(mean, covariance, stacked, np.array(kinds, dtype=np.int64))


def declared_law(model: LinearModel, error: str, mean: Array) -> tuple[LinearLaw, dict[tuple[str, int], int]]:
    """The law of the linear model at ``mean`` (3,): normal sources as a covariance, the others as columns.

    Returns the law and, for each non-Gaussian source (contributor, index), its column.
    """
    parts = [part_of(block, model.gain(block, error)) for block in model.blocks]
    keys = [(block.contributor, j) for block, part in zip(model.blocks, parts, strict=True) for j in part.sources]
    return law_of(mean, parts), {key: column for column, key in enumerate(keys)}


@dataclass(frozen=True, slots=True, eq=False)
class WorstCase:
    """The worst vertex of the bounded components: the mean there, and which end each takes."""

    mean_mm: Array  # (3,)
    signs: dict[tuple[str, int], float]  # (contributor, source) -> +1 or -1
    names: tuple[str, ...]  # e.g. ("structure_connector.rz=+0.1 deg",)

    def vertex(self, model: LinearModel) -> dict[str, float]:
        """The same ends by name, "contributor.component", as the simulation takes them."""
        components = {block.contributor: block.components for block in model.blocks}
        return {f"{name}.{components[name][j]}": sign for (name, j), sign in self.signs.items()}


@dataclass(frozen=True, slots=True, eq=False)
class ErrorLaw:
    """The declared law of one error at one target, bounded components at their worst ends."""

    error: str  # "tcp" or "localisation"
    worst: WorstCase
    parts: tuple[Part, ...]  # of every block
    law: LinearLaw
    total_covariance: Array  # (3, 3) mm^2, of all random sources


def error_law(model: LinearModel, error: str, quantile: float) -> ErrorLaw:
    parts = parts_of(model, error)
    worst = _worst_case(model, error, quantile, parts, frozenset())
    law = law_of(worst.mean_mm, parts)
    return ErrorLaw(error, worst, parts, law, law.total_covariance)


def worst_case(
    model: LinearModel, error: str, quantile: float, without: frozenset[tuple[str, int]] = frozenset()
) -> WorstCase:
    """Vertex of the box of bounded components with the largest quantile; ``without`` some of them."""
    return _worst_case(model, error, quantile, None, without)


def worst_vertices(model: LinearModel, error: str, quantile: float) -> tuple[dict[str, float], ...]:
    """The vertices that first order cannot tell from the worst one, the worst first: ends by "contributor.component".

    Components that first order says the error is blind to are left out.
    """
    keys = _bounded_sources(model)
    if not keys:
        return ({},)
    columns = _bounded_columns(model, error, keys)
    law = law_of(model.bias_mm(error), parts_of(model, error))
    worst = worst_vertex(law, columns, quantile)
    felt = [
        (k, f"{block.contributor}.{block.components[j]}") for k, (block, j) in enumerate(keys) if columns[:, k].any()
    ]
    return tuple(
        {name: float(signs[k]) for k, name in felt} for signs in indistinguishable(law, columns, quantile, worst.signs)
    )


def mean_at(model: LinearModel, error: str, vertex: Mapping[str, float]) -> Array:
    """(3,) mm: the bias with bounded components at these ends, by "contributor.component"."""
    mean = model.bias_mm(error).copy()
    for block, j in _bounded_sources(model):
        end = vertex.get(f"{block.contributor}.{block.components[j]}", 0.0)
        mean += model.gain(block, error)[:, j] * (block.half_width[j] * end)
    return mean


def _bounded_sources(model: LinearModel, without: frozenset[tuple[str, int]] = frozenset()) -> list[tuple[Block, int]]:
    return [
        (block, j)
        for block in model.blocks
        if Law.BOUNDED in block.laws
        for j, law in enumerate(block.laws)
        if law is Law.BOUNDED and block.half_width[j] > 0 and (block.contributor, j) not in without
    ]


def _bounded_columns(model: LinearModel, error: str, keys: list[tuple[Block, int]]) -> Array:
    """(3, q) mm: what each of these sources does at the end of its half-width."""
    return np.stack([model.gain(block, error)[:, j] * block.half_width[j] for block, j in keys], axis=1)


def _worst_case(
    model: LinearModel,
    error: str,
    quantile: float,
    parts: Sequence[Part] | None,
    without: frozenset[tuple[str, int]],
) -> WorstCase:
    keys = _bounded_sources(model, without)
    mean = model.bias_mm(error)
    if not keys:
        return WorstCase(mean, {}, ())
    law = law_of(mean, parts_of(model, error) if parts is None else parts)
    vertex = worst_vertex(law, _bounded_columns(model, error, keys), quantile)
    names = []
    for (block, j), sign in zip(keys, vertex.signs, strict=True):
        unit, factor = unit_for_people(block.units[j])
        names.append(f"{block.contributor}.{block.components[j]}={sign * block.half_width[j] * factor:+g} {unit}")
    signs = {(block.contributor, j): float(sign) for (block, j), sign in zip(keys, vertex.signs, strict=True)}
    return WorstCase(vertex.law.mean, signs, tuple(names))

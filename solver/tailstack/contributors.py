"""The declared law of the error at one target, put together from what each scalar source does to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .geometry.arrays import Array, frozen
from .laws import KIND, Drawn
from .propagation.linear import Block, ErrorModel
from .system import Law, Requirement
from .tail.bounded import indistinguishable
from .tail.bounded import worst_case as worst_vertex
from .tail.declared import LawReading, LinearLaw
from .tail.lattice import assemble_law, assemble_pair
from .tail.per_unit import UnitRisk, unit_risk

SHOWN = {"rad": ("deg", float(np.rad2deg(1.0))), "1": ("%", 100.0)}


def unit_for_people(unit: str) -> tuple[str, float]:
    """Displayed unit and the factor from the native one: rad -> (deg, 180/pi), a ratio -> (%, 100)."""
    return SHOWN.get(unit, (unit, 1.0))


class Columns(NamedTuple):
    """What each of K scalar sources does to one error, in the order of the blocks of a linear model."""

    gain: Array  # (3, K) mm per native unit
    std: Array  # (K,) native unit
    half_width: Array  # (K,) native unit
    kinds: NDArray[np.int64]  # (K,) by KIND
    drawn: NDArray[np.int64]  # (K,) ``Drawn.rank``: how often
    room: Array | None = None  # of ``LinearLaw``

    def only(self, which: NDArray[np.bool_]) -> Columns:
        """Of the sources with True in which (K,)."""
        gain = np.compress(which, self.gain, axis=1)  # C-contiguous, as kernels take it
        return Columns(gain, self.std[which], self.half_width[which], self.kinds[which], self.drawn[which], self.room)

    def constant_in(self, level: Drawn) -> NDArray[np.bool_]:
        """(K,) which stay what they are throughout one ``level`` (a unit, a mounting); the others are drawn again."""
        return np.asarray(self.drawn <= level.rank)

    @property
    def wide(self) -> NDArray[np.bool_]:
        """(K,) which sources have a column in the law: those of a law in SUMS that are wider than 0."""
        return np.asarray((self.kinds >= 0) & (self.half_width > 0))


@lru_cache(maxsize=512)
def _kinds_of(laws: tuple[Law, ...]) -> NDArray[np.int64]:
    return frozen(np.array([KIND[law] for law in laws], dtype=np.int64), np.int64)


def columns_of(model: ErrorModel, error: str) -> Columns:
    """Of every source of a model."""
    blocks = model.blocks
    return Columns(
        np.concatenate([block.gain(error) for block in blocks], axis=1),
        np.concatenate([block.std for block in blocks]),
        np.concatenate([block.half_width for block in blocks]),
        np.concatenate([_kinds_of(block.laws) for block in blocks]),
        np.repeat([block.effect.drawn.rank for block in blocks], [len(block.laws) for block in blocks]),
        model.room,
    )


def law_of(mean: Array, *each: Columns) -> LinearLaw:
    """The law at ``mean`` (3,) mm (two vectors: (6,)) that these sources make together; nothing random is left of
    spreads that vanish."""
    room = each[0].room
    if len(each) > 1:
        each = (Columns(*(np.concatenate(parts, axis=-1) for parts in zip(*(one[:5] for one in each), strict=True))),)
    return LinearLaw(mean, *(assemble_law if len(mean) == 3 else assemble_pair)(*each[0][:4]), room)


def declared_law(model: ErrorModel, error: str, mean: Array) -> LinearLaw:
    """The law of the linear model at ``mean`` (3,): normal sources as a covariance, the others as columns."""
    return law_of(mean, columns_of(model, error))


@dataclass(frozen=True, slots=True, eq=False)
class WorstCase:
    """The worst vertex of the bounded components: the mean there, and which end each takes."""

    mean_mm: Array  # (3,)
    signs: dict[tuple[str, int], float]  # (contributor, source) -> +1 or -1
    names: tuple[str, ...]  # e.g. ("structure_connector.rz=+0.1 deg",)

    def vertex(self, model: ErrorModel) -> dict[str, float]:
        """The same ends by name, "contributor.component", as the simulation takes them."""
        components = {block.contributor: block.components for block in model.blocks}
        return {f"{name}.{components[name][j]}": sign for (name, j), sign in self.signs.items()}


@dataclass(frozen=True, slots=True, eq=False)
class ErrorLaw:
    """The declared law of one error at one target, bounded components at their worst ends."""

    error: str  # "tcp" or "localisation"
    worst: WorstCase
    columns: Columns  # of every source
    law: LinearLaw

    @property
    def total_covariance(self) -> Array:
        """(3, 3) mm^2, of all random sources."""
        return self.law.total_covariance


Value = Callable[[LinearLaw], float]  # of a law, in its unit


def value_of(requirement: Requirement) -> Value | None:
    """What of a law is limited; None where a quantile decides it."""
    if requirement.row.by_quantile or requirement.row.of_law is None:
        return None
    return lambda law: read_value(requirement, LawReading(law, requirement.quantile, requirement.limit))


def read_value(requirement: Requirement, reading: LawReading) -> float:
    """What is limited, of a law that is read at the quantile and the limit of the requirement, in its unit."""
    row = requirement.row
    if row.by_quantile or row.of_law is None:
        return reading.quantile.quantile_mm
    found = row.of_law(reading)
    assert found is not None  # there is a limit
    return found


def error_law(model: ErrorModel, error: str, quantile: float, value: Value | None = None) -> ErrorLaw:
    """The law of the error at the vertex of bounded components that has the largest quantile, or value."""
    columns = columns_of(model, error)
    law = law_of(model.bias_mm(error), columns)
    worst = worst_case(model, error, quantile, law=law, value=value)
    return ErrorLaw(error, worst, columns, replace(law, mean=worst.mean_mm))


def risk_of_units(
    model: ErrorModel, at: ErrorLaw, quantile: float, limit: float | None, fraction: float, level: Drawn = Drawn.UNIT
) -> UnitRisk:
    """What ``fraction`` of installed units, or of mountings, keep their own quantile within, and how many keep a
    limit.

    What is drawn with the level or more rarely is held, everything else drawn again; ``at`` is the law of the error.
    """
    once = at.columns.constant_in(level)
    installed = law_of(at.worst.mean_mm, at.columns.only(once))
    shot = law_of(np.zeros_like(at.worst.mean_mm), at.columns.only(~once))
    return unit_risk(installed, shot, quantile, limit, fraction, log2_units=7)


def worst_case(
    model: ErrorModel,
    error: str,
    quantile: float,
    without: frozenset[tuple[str, int]] = frozenset(),
    law: LinearLaw | None = None,
    value: Value | None = None,
) -> WorstCase:
    """Vertex of the box of bounded components with the largest quantile, or value; ``without`` some of them.

    law: of the error at the bias, where it is there already.
    """
    keys = _bounded_sources(model, without)
    mean = model.bias_mm(error)
    if not keys:
        return WorstCase(mean, {}, ())
    law = law_of(mean, columns_of(model, error)) if law is None else law
    vertex = worst_vertex(law, bounded_columns(model, error, without), quantile, value)
    names = []
    for (block, j), sign in zip(keys, vertex.signs, strict=True):
        unit, factor = unit_for_people(block.units[j])
        names.append(f"{block.contributor}.{block.components[j]}={sign * block.half_width[j] * factor:+g} {unit}")
    signs = {(block.contributor, j): float(sign) for (block, j), sign in zip(keys, vertex.signs, strict=True)}
    return WorstCase(vertex.law.mean, signs, tuple(names))


def worst_vertices(
    model: ErrorModel, error: str, quantile: float, value: Value | None = None
) -> tuple[dict[str, float], ...]:
    """The vertices that first order cannot tell from the worst one, the worst first: ends by "contributor.component".

    Components that first order says the error is blind to are left out.
    """
    keys = _bounded_sources(model)
    if not keys:
        return ({},)
    columns = bounded_columns(model, error)
    law = law_of(model.bias_mm(error), columns_of(model, error))
    worst = worst_vertex(law, columns, quantile, value)
    names = [f"{block.contributor}.{block.components[j]}" for block, j in keys]
    felt = [(k, name) for k, name in enumerate(names) if columns[:, k].any()]
    several = indistinguishable(law, columns, quantile, worst.signs, value)
    return tuple({name: float(signs[k]) for k, name in felt} for signs in several)


def mean_at(model: ErrorModel, error: str, vertex: Mapping[str, float]) -> Array:
    """(3,) mm: the bias with bounded components at these ends, by "contributor.component"."""
    mean = model.bias_mm(error).copy()
    for block, j in _bounded_sources(model):
        end = vertex.get(f"{block.contributor}.{block.components[j]}", 0.0)
        mean += block.gain(error)[:, j] * (block.half_width[j] * end)
    return mean


def _bounded_sources(model: ErrorModel, without: frozenset[tuple[str, int]] = frozenset()) -> list[tuple[Block, int]]:
    return [
        (block, j)
        for block in model.blocks
        if Law.BOUNDED in block.laws
        for j, bounded in enumerate(block.effect.sources.are_bounded)
        if bounded and (block.contributor, j) not in without
    ]


def bounded_columns(model: ErrorModel, error: str, without: frozenset[tuple[str, int]] = frozenset()) -> Array:
    """(3, q) mm: what each bounded source does at the end of its half-width, in the order of the model."""
    columns = [block.gain(error)[:, j] * block.half_width[j] for block, j in _bounded_sources(model, without)]
    return np.ascontiguousarray(np.array(columns).reshape(-1, len(model.bias_mm(error))).T)

"""The budget: what each contributor does to the quantile of the error at one target.

A contributor is one block of the linear model; its components are the block's scalar sources.  Image
noise and manufacturing errors, whose scalars are all alike, are one line each; a mount has a line per
component and one for all of it together (a six-component installation error read as one contributor).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count
from math import sqrt

import numpy as np

from .propagation.linear import Block, LinearModel
from .results import Contributor
from .system import Array, Law
from .tail.bounded import worst_case as worst_vertex
from .tail.declared import LawBudget, LawQuantile, LinearLaw, law_budget, law_quantile, without_group

DEGREES = {"rad": ("deg", float(np.rad2deg(1.0)))}
LIGHT = 5e-3  # share s of variance below which a line is removed to first order: an error of about s^2, 3e-5 at most
KIND = {Law.UNIFORM: 0, Law.TRIANGULAR: 1}


def unit_for_people(unit: str) -> tuple[str, float]:
    """Displayed unit and the factor from the native one: rad -> (deg, 180/pi)."""
    return DEGREES.get(unit, (unit, 1.0))


def declared_law(
    model: LinearModel, error: str, mean: Array, blocks: tuple[Block, ...] | None = None
) -> tuple[LinearLaw, dict[tuple[str, int], int]]:
    """The law of the linear model at ``mean`` (3,): normal sources as a covariance, the others as columns.

    Returns the law and, for each non-Gaussian source (contributor, index), its column.  ``blocks`` limits it
    to some contributors (the per-unit reading splits installation from shots).
    """
    gaussian = np.zeros((3, 3))
    columns: list[Array] = []
    kinds: list[int] = []
    where: dict[tuple[str, int], int] = {}
    for block in model.blocks if blocks is None else blocks:
        gain = model.gain(block, error)
        normal = [j for j, law in enumerate(block.laws) if law is Law.NORMAL]
        if normal:
            scaled = gain * block.std if len(normal) == len(block.laws) else gain[:, normal] * block.std[normal]
            gaussian += scaled @ scaled.T
        if len(normal) < len(block.laws):
            wide = (block.half_width > 0).tolist()
            kept = [j for j, law in enumerate(block.laws) if law in KIND and wide[j]]
            where.update(zip(((block.contributor, j) for j in kept), count(len(kinds))))
            columns.append(gain[:, kept] * block.half_width[kept])
            kinds += [KIND[block.laws[j]] for j in kept]
    stacked = np.concatenate(columns, axis=1) if columns else np.zeros((3, 0))
    return LinearLaw(mean, gaussian, stacked, np.array(kinds, dtype=np.int64)), where


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """One line of the budget before its numbers: some sources of one block."""

    block: Block
    component: str
    sources: tuple[int, ...]


def lines_of(model: LinearModel) -> tuple[Line, ...]:
    lines = []
    for block in model.blocks:
        every = tuple(range(len(block.units)))
        if not block.grouped:
            lines += [Line(block, name, (j,)) for j, name in enumerate(block.components)]
        if block.grouped or len(every) > 1:
            lines.append(Line(block, "all", every))
    return tuple(lines)


def _removal(line: Line, gain: Array, where: dict[tuple[str, int], int]) -> tuple[Array | None, tuple[int, ...]]:
    """What taking a line away takes from the law: a Gaussian covariance, columns, or both."""
    normal = [j for j in line.sources if line.block.laws[j] is Law.NORMAL]
    scaled = gain[:, normal] * line.block.std[normal]
    columns = tuple(where[line.block.contributor, j] for j in line.sources if (line.block.contributor, j) in where)
    return (scaled @ scaled.T if normal else None), columns


def _by_variance(block: Block, gain: Array, where: dict[tuple[str, int], int], numbers: LawBudget) -> Array:
    """(k,) mm: derivative of the quantile by the logarithm of each source's variance; 0 for bounded sources."""
    scaled = gain * block.std
    slopes = np.asarray((scaled * (numbers.dr_dcovariance @ scaled)).sum(axis=0))
    for j, law in enumerate(block.laws):
        if law is not Law.NORMAL:
            column = where.get((block.contributor, j))
            slopes[j] = 0.0 if column is None else numbers.dr_dlog_column[column] / 2
    return slopes


def _by_half_width(
    block: Block, gain: Array, by_variance: Array, numbers: LawBudget, signs: dict[tuple[str, int], float]
) -> Array:
    """(k,) mm per native unit: derivative of the quantile by each half-width; a bounded source moves the mean."""
    half_width = np.where(block.half_width > 0, block.half_width, 1.0)
    slopes = np.asarray(2 * by_variance / half_width)
    for j in range(len(block.laws)):
        sign = signs.get((block.contributor, j))
        if sign is not None:
            slopes[j] = sign * float(numbers.dr_dmean @ gain[:, j])
    return slopes


def _without_light(quantile_mm: float, by_variance: float) -> float:
    """Quantile without a line of share s below LIGHT: its square is nearly linear in the variance, off by some s^2."""
    return sqrt(max(quantile_mm * (quantile_mm - 2 * by_variance), 0.0))


def budget(model: LinearModel, at: ErrorLaw, total: LawQuantile) -> tuple[Contributor, ...]:
    """The lines of the budget of the law's quantile at the worst vertex, in the order of the chain."""
    law, where, worst, error = at.law, at.where, at.worst, at.error
    variance = float(np.trace(law.total_covariance))
    lines = lines_of(model)
    gains = {block.contributor: model.gain(block, error) for block in model.blocks}
    # (3, k) gains squared: by axis, and of one native unit each
    squares = {name: (gain**2).sum(axis=0) for name, gain in gains.items()}
    parts = {b.contributor: squares[b.contributor] * b.std**2 for b in model.blocks}
    shares = [_sum(parts[line.block.contributor], line) / variance if variance > 0 else 0.0 for line in lines]
    heavy = [k for k, share in enumerate(shares) if share > LIGHT]
    removals = [_removal(lines[k], gains[lines[k].block.contributor], where) for k in heavy]
    numbers = law_budget(law, total.p, removals, total)
    without = dict(zip(heavy, (found.quantile_mm for found in numbers.without), strict=True))
    by_variance = {b.contributor: _by_variance(b, gains[b.contributor], where, numbers) for b in model.blocks}
    by_half_width = {
        b.contributor: _by_half_width(b, gains[b.contributor], by_variance[b.contributor], numbers, worst.signs)
        for b in model.blocks
    }
    rows = []
    for k, line in enumerate(lines):
        block, name, first = line.block, line.block.contributor, line.sources[0]
        unit, factor = unit_for_people(block.units[first])
        half_widths = block.half_width[line.sources[0] : line.sources[-1] + 1]
        alike = len(line.sources) == 1 or (block.grouped and bool((half_widths == half_widths[0]).all()))
        if any((name, j) in worst.signs for j in line.sources):
            without_mm = _without_bounded(model, error, block, list(line.sources), total.p)
        elif k in without:
            without_mm = without[k]
        else:
            without_mm = _without_light(total.quantile_mm, _sum(by_variance[name], line))
        laws = {str(law) for law in (block.laws if len(line.sources) > 1 else (block.laws[first],))}
        rows.append(
            Contributor(
                name=name,
                component=line.component,
                law=laws.pop() if len(laws) == 1 else "mixed",
                half_width=float(half_widths[0]) * factor if alike else None,
                unit=unit if alike else "",
                std=float(block.std[first]) * factor if alike else None,
                sensitivity_mm_per_unit=sqrt(_sum(squares[name], line)) / factor if alike else None,
                variance_share=shares[k],
                dp95_per_unit=_sum(by_half_width[name], line) / factor if alike else None,
                p95_without_mm=without_mm,
            )
        )
    return tuple(rows)


def _sum(values: Array, line: Line) -> float:
    """Over the sources of a line: one of them, or all."""
    return float(values[line.sources[0]] if len(line.sources) == 1 else values.sum())


@dataclass(frozen=True, slots=True, eq=False)
class WorstCase:
    """The worst vertex of the bounded components: the mean there, and which end each takes."""

    mean_mm: Array  # (3,)
    signs: dict[tuple[str, int], float]  # (contributor, source) -> +1 or -1
    names: tuple[str, ...]  # e.g. ("interface_1.rz=+0.1 deg",)

    def vertex(self, model: LinearModel) -> dict[str, float]:
        """The same ends by name, "contributor.component", as the simulation takes them."""
        components = {block.contributor: block.components for block in model.blocks}
        return {f"{name}.{components[name][j]}": sign for (name, j), sign in self.signs.items()}


@dataclass(frozen=True, slots=True, eq=False)
class ErrorLaw:
    """The declared law of one error at one target, bounded components at their worst ends."""

    error: str  # "tcp" or "localisation"
    worst: WorstCase
    law: LinearLaw
    where: dict[tuple[str, int], int]  # column of each source that is not normal


def error_law(model: LinearModel, error: str, quantile: float) -> ErrorLaw:
    worst = worst_case(model, error, quantile)
    return ErrorLaw(error, worst, *declared_law(model, error, worst.mean_mm))


def worst_case(
    model: LinearModel, error: str, quantile: float, without: frozenset[tuple[str, int]] = frozenset()
) -> WorstCase:
    """Vertex of the box of bounded components with the largest quantile; ``without`` some of them."""
    keys = [
        (block.contributor, j, block)
        for block in model.blocks
        for j, law in enumerate(block.laws)
        if law is Law.BOUNDED and block.half_width[j] > 0 and (block.contributor, j) not in without
    ]
    mean = model.bias_mm(error)
    if not keys:
        return WorstCase(mean, {}, ())
    columns = np.stack([model.gain(block, error)[:, j] * block.half_width[j] for _, j, block in keys], axis=1)
    law, _ = declared_law(model, error, mean)
    found = worst_vertex(law, columns, quantile)
    names = []
    for (contributor, j, block), sign in zip(keys, found.signs, strict=True):
        unit, factor = unit_for_people(block.units[j])
        names.append(f"{contributor}.{block.components[j]}={sign * block.half_width[j] * factor:+g} {unit}")
    signs = {(contributor, j): float(sign) for (contributor, j, _), sign in zip(keys, found.signs, strict=True)}
    return WorstCase(found.law.mean, signs, tuple(names))


def _without_bounded(model: LinearModel, error: str, block: Block, sources: list[int], quantile: float) -> float:
    """Quantile with a line removed that has bounded sources: the others may then be worst at another vertex."""
    gone = frozenset((block.contributor, j) for j in sources)
    mean = worst_case(model, error, quantile, without=gone).mean_mm
    law, where = declared_law(model, error, mean)
    removal = _removal(Line(block, "", tuple(sources)), model.gain(block, error), where)
    return law_quantile(without_group(law, *removal), quantile).quantile_mm

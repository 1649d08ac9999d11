"""The budget: what each contributor does to the quantile of the error at one target.

A contributor is one block of the linear model; its components are the block's scalar sources.  Image
noise and manufacturing errors, whose scalars are all alike, are one line each; a mount has a line per
component and one for all of it together (a six-component installation error read as one contributor).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import NamedTuple

import numpy as np

from .contributors import ErrorLaw, Part, law_of, unit_for_people, worst_case
from .propagation.linear import Block, LinearModel
from .results import Contributor
from .system import Array, Law
from .tail.declared import LawBudget, LawQuantile, law_budget, law_quantile, without_group

LIGHT = 1e-2  # share s of variance below which a line is removed to first order: an error of about s^2, 1e-4 at most

Removal = tuple[Array | None, tuple[int, ...]]  # what to take from a law: a Gaussian covariance, columns


class Line(NamedTuple):
    """One line of the budget before its numbers: some sources of one block."""

    block: Block
    component: str
    sources: tuple[int, ...]
    number: int  # of the block
    place: int  # of its number among those of all sources, followed by those of all blocks


def lines_of(model: LinearModel) -> tuple[Line, ...]:
    lines = []
    start, whole = 0, sum(len(block.units) for block in model.blocks)
    for number, block in enumerate(model.blocks):
        count = len(block.units)
        if not block.grouped:
            lines += [Line(block, name, (j,), number, start + j) for j, name in enumerate(block.components)]
        if block.grouped or count > 1:
            lines.append(Line(block, "all", tuple(range(count)), number, whole + number))
        start += count
    return tuple(lines)


@dataclass(frozen=True, slots=True, eq=False)
class _Sources:
    """All K scalar sources of a model, in the order of its blocks."""

    gain: Array  # (3, K)
    std: Array  # (K,)
    half_width: Array  # (K,)
    starts: list[int]  # of the blocks
    other: list[int]  # those that are not normal
    held: list[int]  # those of them that are a column of the law, in its order

    def of_lines(self, values: Array, lines: tuple[Line, ...]) -> list[list[float]]:
        """Of quantities (Q, K) of all sources, their sums over those of each line."""
        all_of = np.concatenate([values, np.add.reduceat(values, self.starts, axis=1)], axis=1)
        found: list[list[float]] = all_of[:, [line.place for line in lines]].tolist()
        return found


def _sources(model: LinearModel, at: ErrorLaw) -> _Sources:
    starts: list[int] = []
    other: list[int] = []
    held: list[int] = []
    start = 0
    for block, part in zip(model.blocks, at.parts, strict=True):
        starts.append(start)
        end = start + len(block.laws)
        if len(part.sources) == len(block.laws):
            other += range(start, end)
            held += range(start, end)
        elif part.columns is not None:
            other += [start + j for j, law in enumerate(block.laws) if law is not Law.NORMAL]
            held += [start + j for j in part.sources]
        start = end
    return _Sources(
        np.concatenate([model.gain(block, at.error) for block in model.blocks], axis=1),
        np.concatenate([block.std for block in model.blocks]),
        np.concatenate([block.half_width for block in model.blocks]),
        starts,
        other,
        held,
    )


def _removal(line: Line, at: ErrorLaw, gain: Array, first: list[int]) -> Removal:
    """What taking a line away takes from the law; gain: (3, k) of its block; first: column of each block."""
    part, start = at.parts[line.number], first[line.number]
    if len(line.sources) > 1:
        return part.covariance, tuple(range(start, start + len(part.sources)))
    j = line.sources[0]
    if line.block.laws[j] is Law.NORMAL:
        scaled = gain[:, j] * line.block.std[j]
        return scaled[:, None] * scaled, ()
    return None, tuple(start + k for k, source in enumerate(part.sources) if source == j)


def _first_columns(parts: tuple[Part, ...]) -> list[int]:
    starts = [0]
    for part in parts:
        starts.append(starts[-1] + len(part.sources))
    return starts


def _by_variance(sources: _Sources, numbers: LawBudget) -> Array:
    """(K,) mm: derivative of the quantile by the logarithm of each source's variance; 0 for bounded sources."""
    scaled = sources.gain * sources.std
    slopes = np.asarray((scaled * (numbers.dr_dcovariance @ scaled)).sum(axis=0))
    slopes[sources.other] = 0.0
    slopes[sources.held] = numbers.dr_dlog_column / 2
    return slopes


def _by_half_width(
    model: LinearModel, sources: _Sources, by_variance: Array, numbers: LawBudget, signs: dict[tuple[str, int], float]
) -> Array:
    """(K,) mm per native unit: derivative of the quantile by each half-width; a bounded source moves the mean."""
    slopes = np.asarray(2 * by_variance / np.where(sources.half_width > 0, sources.half_width, 1.0))
    if signs:
        names = [(block.contributor, j) for block in model.blocks for j in range(len(block.laws))]
        for k, name in enumerate(names):
            if name in signs:
                slopes[k] = signs[name] * float(numbers.dr_dmean @ sources.gain[:, k])
    return slopes


def _without_light(quantile_mm: float, by_variance: float) -> float:
    """Quantile without a line of share s below LIGHT: its square is nearly linear in the variance, off by some s^2."""
    return sqrt(max(quantile_mm * (quantile_mm - 2 * by_variance), 0.0))


def budget(model: LinearModel, at: ErrorLaw, total: LawQuantile) -> tuple[Contributor, ...]:
    """The lines of the budget of the law's quantile at the worst vertex, in the order of the chain."""
    variance = float(np.trace(at.total_covariance))
    lines, sources = lines_of(model), _sources(model, at)
    squares = (sources.gain**2).sum(axis=0)  # of one native unit each
    lengths, own = sources.of_lines(np.stack([squares, squares * sources.std**2]), lines)
    shares = [value / variance for value in own] if variance > 0 else [0.0] * len(lines)
    heavy = [k for k, share in enumerate(shares) if share > LIGHT]
    first = _first_columns(at.parts)
    removals = [_removal(lines[k], at, model.gain(lines[k].block, at.error), first) for k in heavy]
    numbers = law_budget(at.law, total.p, removals, total)
    by_variance = _by_variance(sources, numbers)
    by_half_width = _by_half_width(model, sources, by_variance, numbers, at.worst.signs)
    light, slopes = sources.of_lines(np.stack([by_variance, by_half_width]), lines)
    without = [_without_light(total.quantile_mm, slope) for slope in light]
    for k, found in zip(heavy, numbers.without, strict=True):
        without[k] = found.quantile_mm
    if signs := at.worst.signs:
        for k, line in enumerate(lines):
            if any((line.block.contributor, j) in signs for j in line.sources):
                without[k] = _without_bounded(model, at, line, total.p)
    return tuple(map(_row, lines, shares, without, lengths, slopes))


def _row(line: Line, share: float, without_mm: float, square: float, slope: float) -> Contributor:
    """A line with its numbers, those of one unit only where all its sources are alike; square: of the gains' length."""
    block, j = line.block, line.sources[0]
    law = block.laws[j]
    if len(line.sources) > 1 and not (block.grouped and bool((block.half_width == block.half_width[0]).all())):
        named = str(law) if block.laws.count(law) == len(block.laws) else "mixed"
        return Contributor(block.contributor, line.component, named, None, "", None, None, share, None, without_mm)
    unit, factor = unit_for_people(block.units[j])
    half_width, std = float(block.half_width[j]) * factor, float(block.std[j]) * factor
    sensitivity, slope = sqrt(square) / factor, slope / factor
    return Contributor(  # by place: names would be a quarter of the time
        block.contributor, line.component, str(law), half_width, unit, std, sensitivity, share, slope, without_mm
    )


def _without_bounded(model: LinearModel, at: ErrorLaw, line: Line, quantile: float) -> float:
    """Quantile with a line removed that has bounded sources: the others may then be worst at another vertex."""
    gone = frozenset((line.block.contributor, j) for j in line.sources)
    mean = worst_case(model, at.error, quantile, without=gone).mean_mm
    removal = _removal(line, at, model.gain(line.block, at.error), _first_columns(at.parts))
    return law_quantile(without_group(law_of(mean, at.parts), *removal), quantile).quantile_mm

"""The budget: what each contributor does to the quantile of the error at one target.

A contributor is one block of the linear model; its components are the block's scalar sources.  Image noise and
manufacturing errors, whose scalars are all alike, are one line each; a mount has a line per component and one for all
of it together (a six-component installation error read as one contributor).  What is known and shifts the error is a
line that only tells the quantile without it.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from .arrays import Array
from .contributors import ErrorLaw, law_of, unit_for_people, worst_case
from .propagation.linear import Block, LinearModel
from .results import Contributor
from .system import Law
from .tail.declared import LawGradient, LawQuantile, LinearLaw, law_gradient, law_quantile, without_group

LIGHT = 1e-2  # share s of variance below which a line is removed to first order: an error of about s^2, 1e-4 at most


class Line(NamedTuple):
    """One line of the budget before its numbers: some sources of one block."""

    block: Block
    component: str
    sources: tuple[int, ...]
    number: int  # of the block

    @property
    def alike(self) -> bool:
        """Whether its sources are, so that one half-width speaks for all of them."""
        return len(self.sources) == 1 or (
            self.block.grouped and bool((self.block.half_width == self.block.half_width[0]).all())
        )


def lines_of(model: LinearModel) -> tuple[Line, ...]:
    """The lines, in the order of the chain."""
    lines = []
    for number, block in enumerate(model.blocks):
        if not block.grouped:
            lines += [Line(block, name, (j,), number) for j, name in enumerate(block.components)]
        if block.grouped or len(block.units) > 1:
            lines.append(Line(block, "all", tuple(range(len(block.units))), number))
    return tuple(lines)


def budget(model: LinearModel, at: ErrorLaw, total: LawQuantile) -> tuple[Contributor, ...]:
    """The lines with their numbers; total: the quantile of the law, at the worst vertex of bounded components."""
    variance = float(np.trace(at.total_covariance))
    gradient = law_gradient(at.law, total, fine=False)
    slopes = [_slopes(model, at, number, gradient) for number in range(len(model.blocks))]
    rows = []
    for line in lines_of(model):
        square, spread, by_variance, by_half_width = slopes[line.number][:, list(line.sources)].sum(axis=1).tolist()
        share = spread / variance if variance > 0 else 0.0
        if any((line.block.contributor, j) in at.worst.signs for j in line.sources):
            # Without this line the other bounded components may be worst at another vertex.
            gone = frozenset((line.block.contributor, j) for j in line.sources)
            mean = worst_case(model, at.error, total.p, without=gone).mean_mm
            without = law_quantile(_remove(line, at, model, mean), total.p, fine=False).quantile_mm
        elif share > LIGHT:
            without = law_quantile(_remove(line, at, model, at.law.mean), total.p, fine=False).quantile_mm
        else:  # the square of the quantile is nearly linear in the variance
            without = sqrt(max(total.quantile_mm * (total.quantile_mm - 2 * by_variance), 0.0))
        rows.append(_row(line, share, without, sqrt(square), by_half_width))
    for known in model.known:
        rest = law_of(at.law.mean - known.of(at.error), at.parts)
        without = law_quantile(rest, total.p, fine=False).quantile_mm
        rows.append(
            Contributor(
                known.contributor, "known", "known", None, "", None, None, 0.0, None, without, f"{known.label}, known"
            )
        )
    return tuple(rows)


def _slopes(model: LinearModel, at: ErrorLaw, number: int, gradient: LawGradient) -> Array:
    """(4, k) of the sources of a block: the squared length of the gain, the variance, mm^2, and the derivatives of the
    quantile by the logarithm of the variance, mm, and by the half-width, mm per native unit.

    A bounded source has no variance: it moves the mean.
    """
    block, part = model.blocks[number], at.parts[number]
    gain = model.gain(block, at.error)
    scaled = gain * block.std
    normal = np.array([law is Law.NORMAL for law in block.laws])
    by_variance = np.where(normal, (scaled * (gradient.by_covariance @ scaled)).sum(axis=0), 0.0)
    first = sum(len(other.sources) for other in at.parts[:number])
    by_variance[list(part.sources)] = gradient.by_log_column[first : first + len(part.sources)] / 2
    by_half_width = 2 * by_variance / np.where(block.half_width > 0, block.half_width, 1.0)
    for j in range(len(block.laws)):
        if sign := at.worst.signs.get((block.contributor, j)):
            by_half_width[j] = sign * float(gradient.by_mean @ gain[:, j])
    return np.stack([(gain**2).sum(axis=0), (scaled**2).sum(axis=0), by_variance, by_half_width])


def _remove(line: Line, at: ErrorLaw, model: LinearModel, mean: Array) -> LinearLaw:
    """The law at this mean (3,) mm without the sources of a line."""
    part = at.parts[line.number]
    normal = [j for j in line.sources if line.block.laws[j] is Law.NORMAL]
    scaled = model.gain(line.block, at.error)[:, normal] * line.block.std[normal]
    first = sum(len(other.sources) for other in at.parts[: line.number])
    columns = [first + k for k, source in enumerate(part.sources) if source in line.sources]
    return without_group(law_of(mean, at.parts), scaled @ scaled.T if normal else None, columns)


def _row(line: Line, share: float, without_mm: float, sensitivity: float, slope: float) -> Contributor:
    """A line with its numbers, those of one unit only where all its sources are alike."""
    block, j = line.block, line.sources[0]
    if not line.alike:
        law = str(block.laws[j]) if block.laws.count(block.laws[j]) == len(block.laws) else "mixed"
        return Contributor(
            block.contributor, line.component, law, None, "", None, None, share, None, without_mm, block.label
        )
    unit, factor = unit_for_people(block.units[j])
    return Contributor(
        name=block.contributor,
        component=line.component,
        law=str(block.laws[j]),
        half_width=float(block.half_width[j]) * factor,
        unit=unit,
        std=float(block.std[j]) * factor,
        sensitivity_mm_per_unit=sensitivity / factor,
        variance_share=share,
        dp95_per_unit=slope / factor,
        p95_without_mm=without_mm,
        label=block.label,
    )

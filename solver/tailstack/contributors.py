"""The budget: what each contributor does to the quantile of the error at one target.

A contributor is one block of the linear model; its components are the block's scalar sources.  Image
noise and manufacturing errors, whose scalars are all alike, are one line each; a mount has a line per
component and one for all of it together (a six-component installation error read as one contributor).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .propagation.linear import Block, LinearModel
from .results import Contributor
from .system import Array, Law
from .tail.bounded import worst_case as worst_vertex
from .tail.declared import LawBudget, LinearLaw, law_budget, law_quantile, without_group

DEGREES = {"rad": ("deg", float(np.rad2deg(1.0)))}
LIGHT = 2e-3  # share of variance below which a line is removed to first order: an error of some 1e-6
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
        if block.grouped and block.laws[0] is Law.NORMAL:  # noise of many pixels: no look at each
            scaled = gain * block.std
            gaussian += scaled @ scaled.T
            continue
        moved = (gain * block.half_width).T
        for j, law in enumerate(block.laws):
            if law is Law.NORMAL:
                scaled = gain[:, j] * block.std[j]
                gaussian += scaled[:, None] * scaled
            elif law in KIND and block.half_width[j] > 0:
                where[block.contributor, j] = len(columns)
                columns.append(moved[j])
                kinds.append(KIND[law])
    stacked = np.stack(columns, axis=1) if columns else np.zeros((3, 0))
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


def _share(line: Line, gain: Array, total: float) -> float:
    chosen = list(line.sources)
    return float(((gain[:, chosen] * line.block.std[chosen]) ** 2).sum()) / total if total > 0 else 0.0


def _without_light(numbers: LawBudget, block: Array | None, columns: tuple[int, ...]) -> float:
    """Quantile without a line of share s below LIGHT, by its slope in the variance: off by some s^2 of it."""
    change = 0.0 if block is None else float((numbers.dr_dcovariance * block).sum())
    return numbers.total.quantile_mm - change - float(numbers.dr_dlog_column[list(columns)].sum()) / 2


def _slope(
    line: Line, gain: Array, where: dict[tuple[str, int], int], numbers: LawBudget, signs: dict[tuple[str, int], float]
) -> float:
    """dp/d(half-width) of a line whose sources share one half-width, mm per native unit.

    Normal: variance goes as h^2, so ``2/h <dr_dS, scaled scaled'>``.  Bounded: the mean moves by the signed gain.
    """
    total = 0.0
    for j in line.sources:
        key = (line.block.contributor, j)
        half_width = line.block.half_width[j]
        if key in signs:
            total += float(numbers.dr_dmean @ gain[:, j]) * signs[key]
        elif key in where:
            total += float(numbers.dr_dlog_column[where[key]]) / half_width
        elif half_width > 0 and line.block.laws[j] is Law.NORMAL:
            scaled = gain[:, j] * line.block.std[j]
            total += 2.0 * float(scaled @ numbers.dr_dcovariance @ scaled) / half_width
    return total


def budget(model: LinearModel, error: str, worst: WorstCase, quantile: float) -> tuple[Contributor, ...]:
    """The lines of the budget at the worst vertex, in the order of the chain."""
    law, where = declared_law(model, error, worst.mean_mm)
    lines = lines_of(model)
    gains = [model.gain(line.block, error) for line in lines]
    removals = [_removal(line, gain, where) for line, gain in zip(lines, gains, strict=True)]
    total = float(np.trace(law.total_covariance))
    shares = [_share(line, gain, total) for line, gain in zip(lines, gains, strict=True)]
    heavy = [k for k, share in enumerate(shares) if share > LIGHT]
    numbers = law_budget(law, quantile, [removals[k] for k in heavy])
    without_heavy = dict(zip(heavy, numbers.without, strict=True))
    rows = []
    for k, (line, gain) in enumerate(zip(lines, gains, strict=True)):
        block, chosen = line.block, list(line.sources)
        unit, factor = unit_for_people(block.units[chosen[0]])
        half_widths = block.half_width[chosen]
        alike = (len(chosen) == 1 or block.grouped) and np.ptp(half_widths) == 0
        without_mm = without_heavy[k].quantile_mm if k in without_heavy else _without_light(numbers, *removals[k])
        if any((block.contributor, j) in worst.signs for j in chosen):
            without_mm = _without_bounded(model, error, block, chosen, quantile)
        laws = {str(block.laws[j]) for j in chosen}
        rows.append(
            Contributor(
                name=block.contributor,
                component=line.component,
                law=laws.pop() if len(laws) == 1 else "mixed",
                half_width=float(half_widths[0]) * factor if alike else None,
                unit=unit if alike else "",
                std=float(block.std[chosen[0]]) * factor if alike else None,
                sensitivity_mm_per_unit=float(np.sqrt((gain[:, chosen] ** 2).sum())) / factor if alike else None,
                variance_share=shares[k],
                dp95_per_unit=_slope(line, gain, where, numbers, worst.signs) / factor if alike else None,
                p95_without_mm=without_mm,
            )
        )
    return tuple(rows)


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

"""The budget: what each contributor does to the quantile of the error at one target; and how far each lever leads.

A contributor is one block of the linear model; its components are the block's scalar sources.  Image noise and
manufacturing errors, whose scalars are all alike, are one line each; a mount has a line per component and one for all
of it together (a six-component installation error read as one contributor).  What is known and shifts the error is a
line that only tells the quantile without it.

The levers: how far each thing that can be changed leads a requirement by itself, everything else as it is.  Half-widths
leave the gains of a linear model as they are.  A source goes to the smallest that the design's ``optimise`` section
allows, where that frees any of its half-widths; every other lever is to be rid of its source.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from math import inf, radians, sqrt
from typing import NamedTuple

import numpy as np

from .contributors import ErrorLaw, error_law, law_of, risk_of_units, unit_for_people, value_of, worst_case
from .design.consistency import list_declared
from .design.document import DesignDocument
from .geometry.arrays import Array
from .laws import NORMAL, Drawn
from .propagation.linear import Block, ErrorModel, with_perfect_fiducials
from .results import Contributor, Lever
from .results.score import How
from .system import ROTATIONS, TRANSLATIONS, Requirement
from .tail.declared import LawGradient, LawQuantile, LawReading, law_gradient, law_quantile

LIGHT = 1e-2  # share s of variance below which a line is removed to first order: an error of about s^2, 1e-4 at most
IMAGE_NOISE = ("fiducial_noise", "target_noise")
Least = dict[tuple[str, str], float]  # smallest half-widths by interface and component, rad or mm


class BudgetEntry(NamedTuple):
    """One line of the budget before its numbers: some sources of one block."""

    block: Block
    component: str
    sources: tuple[int, ...]
    number: int  # of the block
    first: int  # where the sources of the block begin among those of the model

    @property
    def alike(self) -> bool:
        """Whether its sources are, so that one half-width speaks for all of them."""
        widths = self.block.half_width
        return len(self.sources) == 1 or (self.block.is_grouped and bool((widths == widths[0]).all()))

    @property
    def among_all(self) -> list[int]:
        """Its sources among those of the model."""
        return [self.first + j for j in self.sources]


def lines_of(model: ErrorModel) -> tuple[BudgetEntry, ...]:
    """The lines, in the order of the chain; components that are correlated have one together (``rx+ty``)."""
    lines, first = [], 0
    for number, block in enumerate(model.blocks):
        group = {j: each for each in block.effect.sources.together for j in each}
        parts = () if block.is_grouped else dict.fromkeys(group.get(j, (j,)) for j in range(len(block.units)))
        lines += [BudgetEntry(block, _join([block.components[j] for j in each]), each, number, first) for each in parts]
        if block.is_grouped or len(block.units) > 1:
            lines.append(BudgetEntry(block, "all", tuple(range(len(block.units))), number, first))
        first += len(block.units)
    return tuple(lines)


def _join(names: list[str]) -> str:
    """``rx+ty``; the scalars of an item of a drawing, ``A fit`` and ``A fit, 2``, are ``A fit``."""
    return names[0] if all(name.startswith(f"{names[0]}, ") for name in names[1:]) else "+".join(names)


def budget(model: ErrorModel, at: ErrorLaw, total: LawQuantile) -> tuple[Contributor, ...]:
    """The lines with their numbers; total: the quantile of the law, at the worst vertex of bounded components."""
    variance = float(np.trace(at.total_covariance))
    localised = (np.concatenate([block.columns_mm("localisation") for block in model.blocks], axis=1) ** 2).sum(axis=0)
    all_localised = float(localised.sum()) or 1.0
    slopes = np.vstack([_slopes(model, at, law_gradient(at.law, total, fine=False)), localised])
    rows = []
    for line in lines_of(model):
        sums = np.take(slopes, line.among_all, axis=1).sum(axis=1).tolist()
        square, spread, by_variance, by_half_width, of_localisation = sums
        share = spread / variance if variance > 0 else 0.0
        gone = frozenset((line.block.contributor, j) for j in line.sources) & at.worst.signs.keys()
        if gone or share > LIGHT:  # without a bounded source the others may be worst at another vertex
            mean = worst_case(model, at.error, total.p, without=gone).mean_mm if gone else at.law.mean
            remaining = np.ones(slopes.shape[1], dtype=np.bool_)
            remaining[line.among_all] = False
            without = law_quantile(law_of(mean, at.columns.only(remaining)), total.p, fine=False).quantile_mm
        else:  # the square of the quantile is nearly linear in the variance
            without = sqrt(max(total.quantile_mm * (total.quantile_mm - 2 * by_variance), 0.0))
        rows.append(_row(line, share, without, sqrt(square), by_half_width, of_localisation / all_localised))
    for known in model.known:
        rest = law_of(at.law.mean - known.of(at.error), at.columns)
        without = law_quantile(rest, total.p, fine=False).quantile_mm
        name, label = known.contributor, f"{known.label}, known"
        rows.append(Contributor(name, "known", "known", None, "", None, None, 0.0, None, without, label))
    return tuple(rows)


def _slopes(model: ErrorModel, at: ErrorLaw, gradient: LawGradient) -> Array:
    """(4, K) of all sources: the squared length of the gain, the variance, mm^2, and the derivatives of the quantile by
    the logarithm of the variance, mm, and by the half-width, mm per native unit.

    A bounded source has no variance: it moves the mean.
    """
    gain, std, half_width, kinds, *_ = at.columns
    scaled = gain * std
    by_variance = np.where(kinds == NORMAL, (scaled * (gradient.by_covariance @ scaled)).sum(axis=0), 0.0)
    by_variance[at.columns.wide] = gradient.by_log_column / 2
    by_half_width = 2 * by_variance / np.where(half_width > 0, half_width, 1.0)
    if at.worst.signs:
        sources = [(block.contributor, j) for block in model.blocks for j in range(len(block.laws))]
        signs = np.array([at.worst.signs.get(source, 0.0) for source in sources])
        by_half_width = np.where(signs != 0.0, signs * (gradient.by_mean @ gain), by_half_width)
    return np.stack([(gain**2).sum(axis=0), (scaled**2).sum(axis=0), by_variance, by_half_width])


def _row(
    line: BudgetEntry, share: float, without_mm: float, sensitivity: float, slope: float, localisation_share: float
) -> Contributor:
    """A line with its numbers, those of one unit only where all its sources are alike."""
    block, j, alike = line.block, line.sources[0], line.alike
    unit, factor = unit_for_people(block.units[j])
    one_law = alike or len({block.laws[k] for k in line.sources}) == 1
    return Contributor(
        name=block.contributor,
        component=line.component,
        law=str(block.laws[j]) if one_law else "mixed",
        half_width=float(block.half_width[j]) * factor if alike else None,
        unit=unit if alike else "",
        std=float(block.std[j]) * factor if alike else None,
        sensitivity_mm_per_unit=sensitivity / factor if alike else None,
        variance_share=share,
        dp95_per_unit=slope / factor if alike else None,
        p95_without_mm=without_mm,
        label=block.label,
        localisation_share=localisation_share,
        drawn=str(block.effect.drawn),
    )


# --- levers -----------------------------------------------------------------------------------------------


def list_levers(
    document: DesignDocument | None,
    requirement: Requirement,
    models: Sequence[ErrorModel],
    budgets: Sequence[Sequence[Contributor]] = (),
) -> tuple[Lever, ...]:
    """The levers on one requirement, the one that leads furthest first.

    models: of its error wherever it is limited; budgets: of it at each of them, where they are of what is limited: what
    it comes to without a source is taken from there.
    """
    error, section = requirement.error, None if document is None else document.optimise
    least = {} if document is None else _least_half_widths(document)
    groups: dict[str, dict[str, str]] = {}
    for block in models[0].blocks:
        name = block.contributor.partition(":")[0]
        groups.setdefault("image_noise" if name in IMAGE_NOISE else name, {})[block.contributor] = block.label
    lines = [{line.name: line for line in each if line.law != "known"} for each in budgets]  # the last is of all parts
    levers: list[Lever] = []

    def worths(changed: Iterable[ErrorModel]) -> list[float]:
        return [worth_of(requirement, model) for model in changed]

    def add(name: str, label: str, how: How, values: Sequence[float]) -> None:
        levers.append(Lever(requirement.name, name, label, max(values), how))

    for name, group in groups.items():
        limited = any(contributor in group for contributor, _ in least)
        alone = len(group) == 1 and not limited
        known = [each[contributor].p95_without_mm for each in lines for contributor in group if alone]
        label = name.replace("_", " ") if len(group) > 1 else next(iter(group.values()))
        values = known or worths(_narrow(model, group, least) for model in models)
        add(name, label, "least" if limited else "perfect", values)
    placed = [with_perfect_fiducials(model, error) for model in models]
    add("placement", "placement of the fiducials", "bound", worths(placed))
    if any(model.bias_mm(error).any() for model in models):
        none = {error: np.zeros_like(models[0].bias_mm(error))}
        add("bias", "known bias", "perfect", worths(replace(model, biases=none, known=()) for model in models))
    if section is not None and not (section.pivots or section.views):
        moves = any(each is not None for each in (section.box, section.region, section.regions))
        best = [_narrow(model, {name for name, _ in least}, least) for model in (placed if moves else models)]
        values = worths(best)
        left = _leading(best[int(np.argmax(values))], error)
        add("together", f"all that optimise frees; then {left}", "bound", values)
    return tuple(sorted(levers, key=lambda lever: lever.value))


def worth_of(requirement: Requirement, model: ErrorModel) -> float:
    """What a requirement limits, in its unit, of a model of its error, a quantile to 1e-4; no fiducial missed."""
    p = requirement.quantile
    at = error_law(model, requirement.error, p, value_of(requirement))
    if requirement.units_fraction is not None:
        level = requirement.level or Drawn.UNIT
        return risk_of_units(model, at, p, None, requirement.units_fraction, level).value_mm
    if requirement.row.of_law is None:
        return law_quantile(at.law, p, fine=False).quantile_mm
    return requirement.row.of_law(LawReading(at.law, p, requirement.limit)) or 0.0


def _least_half_widths(document: DesignDocument) -> Least:
    """Of what ``optimise`` frees."""
    section, least = document.optimise, Least()
    if section is None:
        return least
    if section.rotation_bounds is not None:
        least |= dict.fromkeys(list_declared(document, ROTATIONS), radians(section.rotation_bounds.min_deg))
    if section.translation_bounds is not None:
        least |= dict.fromkeys(list_declared(document, TRANSLATIONS), section.translation_bounds.min_mm)
    for free in section.tolerances:
        if getattr(document.interfaces, free.interface).features is not None:
            continue  # what a seat can reach is told of the whole of it
        widths = [getattr(grade, f"half_width_{free.unit}") for grade in free.grades or ()]
        smallest = min(widths or [getattr(free, f"min_{free.unit}")])
        least[free.interface, free.component] = radians(smallest) if free.unit == "deg" else smallest
    return least


def _narrow(model: ErrorModel, contributors: Collection[str], least: Least) -> ErrorModel:
    """With these at their least."""

    def narrow(block: Block) -> Block:
        allowed = [least.get((block.contributor, component), inf) for component in block.components]
        none = np.zeros_like(block.half_width)
        return block.with_half_widths(none if min(allowed) == inf else np.minimum(block.half_width, allowed))

    blocks = (narrow(block) if block.contributor in contributors else block for block in model.blocks)
    return replace(model, blocks=tuple(blocks))


def _leading(model: ErrorModel, error: str) -> str:
    """What has most of the mean square, in words."""
    squares = [(float((model.bias_mm(error) ** 2).sum()), "the known bias")]
    squares += [(float(((block.gain(error) * block.spread) ** 2).sum()), block.label) for block in model.blocks]
    square, label = max(squares)
    return f"{label} has {100 * square / (sum(each for each, _ in squares) or 1.0):.0f} % of what is left"

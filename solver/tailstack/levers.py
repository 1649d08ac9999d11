"""How far each thing that can be changed leads a requirement by itself, everything else as it is.

Half-widths leave the gains of a linear model as they are.  A source goes to the smallest that the design's ``optimise``
section allows, where that frees any of its half-widths; every other lever is to be rid of its source.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from math import inf, radians

import numpy as np

from .contributors import error_law, risk_of_units, value_of
from .design.consistency import list_declared
from .design.document import DesignDocument
from .levels import Drawn
from .propagation.linear import Block, ErrorModel, with_perfect_fiducials
from .results import Contributor, Lever
from .results.score import How
from .system import ROTATIONS, TRANSLATIONS, Requirement
from .tail.declared import law_quantile, law_summary

IMAGE_NOISE = ("fiducial_noise", "target_noise")
Least = dict[tuple[str, str], float]  # smallest half-widths by interface and component, rad or mm


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

    def add(name: str, label: str, how: How, changed: Sequence[ErrorModel], known: Sequence[float] = ()) -> None:
        value = max(known or (worth_of(requirement, model) for model in changed))
        levers.append(Lever(requirement.name, name, label, value, how))

    for name, group in groups.items():
        limited = any(contributor in group for contributor, _ in least)
        alone = len(group) == 1 and not limited
        known = [each[contributor].p95_without_mm for each in lines for contributor in group if alone]
        label = name.replace("_", " ") if len(group) > 1 else next(iter(group.values()))
        narrowed = [] if known else [_narrow(model, group, least) for model in models]
        add(name, label, "least" if limited else "perfect", narrowed, known)
    placed = [with_perfect_fiducials(model, error) for model in models]
    add("placement", "placement of the fiducials", "bound", placed)
    if any(model.bias_mm(error).any() for model in models):
        none = {error: np.zeros_like(models[0].bias_mm(error))}
        add("bias", "known bias", "perfect", [replace(model, biases=none, known=()) for model in models])
    if section is not None and not (section.pivots or section.views):
        moves = any(each is not None for each in (section.box, section.region, section.regions))
        best = [_narrow(model, {name for name, _ in least}, least) for model in (placed if moves else models)]
        left = _leading(max(best, key=lambda model: worth_of(requirement, model)), error)
        add("together", f"all that optimise frees; then {left}", "bound", best)
    return tuple(sorted(levers, key=lambda lever: lever.value))


def worth_of(requirement: Requirement, model: ErrorModel) -> float:
    """What a requirement limits, in its unit, of a model of its error; no fiducial missed."""
    p = requirement.quantile
    at = error_law(model, requirement.error, p, value_of(requirement))
    if requirement.units_fraction is not None:
        level = requirement.level or Drawn.UNIT
        return risk_of_units(model, at, p, None, requirement.units_fraction, level).value_mm
    if requirement.row.of_law is None:
        return law_quantile(at.law, p).quantile_mm
    return requirement.row.of_law(law_summary(at.law, p, requirement.limit)) or 0.0


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

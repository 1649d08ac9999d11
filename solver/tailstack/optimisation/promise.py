"""The quantile that is promised: the declared law of the linear model at a choice, bounded sources at their worst."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from ..contributors import declared_law, worst_case
from ..propagation.linear import LinearModel, linearise
from ..system import Array
from ..tail.declared import law_quantile
from .problem import PlacementProblem, apply_choice
from .terms import LAYOUT_BLOCKS, TargetTerms, moments


@dataclass(frozen=True, slots=True, eq=False)
class Promise:
    """One target at one choice."""

    exact_mm: float
    density: float  # of the error's norm there, 1/mm
    mean_mm: Array  # (3,) at the worst vertex
    signs: Array  # (B,) worst ends of the fixed bounded sources
    free_signs: Array  # (K,) of the free half-widths whose law is bounded; +1 elsewhere
    image: Array  # (3, 3) mm^2 of the image-side sources, in the frame of the limited error
    model: LinearModel


def image_part(model: LinearModel, error: str) -> Array:
    """(3, 3) mm^2 of image noise and manufacturing errors."""
    total = np.zeros((3, 3))
    for block in model.blocks:
        if block.contributor.startswith(LAYOUT_BLOCKS):
            scaled = model.gain(block, error) * block.std
            total += scaled @ scaled.T
    return total


def closed_form_mm(
    problem: PlacementProblem, terms: TargetTerms, image: Array, half_width: Array, signs: Array, free_signs: Array
) -> float:
    """The programme's own quantile, in floats."""
    law = moments(problem, terms, image, half_width, signs, free_signs)
    return sqrt(float(law.squared_quantile(problem.requirement.quantile, sqrt)))


def promise(problem: PlacementProblem, terms: TargetTerms, fiducials_mm: Array, half_width: Array) -> Promise:
    """Exact quantile of the declared law at one target, at the worst vertex of the bounded sources: the number the
    score reports.  Raises IllPosedError or NotConvergedError."""
    error, p = problem.requirement.error, problem.requirement.quantile
    model = linearise(apply_choice(problem, fiducials_mm, half_width), terms.target)
    worst = worst_case(model, error, p)
    law, _ = declared_law(model, error, worst.mean_mm)
    found = law_quantile(law, p)
    return Promise(
        exact_mm=found.quantile_mm,
        density=found.density,
        mean_mm=worst.mean_mm,
        signs=np.array([worst.signs.get(key, 1.0) for key in terms.bounded_keys]),
        free_signs=np.array([worst.signs.get(key, 1.0) for key in terms.free_keys]),
        image=image_part(model, error),
        model=model,
    )


def leading_targets(
    problem: PlacementProblem, terms: tuple[TargetTerms, ...], choices: list[tuple[Array, Array]], share: float
) -> set[int]:
    """Indices of the targets whose quantile is at least ``share`` of the largest at any of some choices
    (fiducials, half-widths): those that are likely to bind."""
    leading: set[int] = set()
    for fiducials, half_width in choices:
        values = np.array([promise(problem, term, fiducials, half_width).exact_mm for term in terms])
        leading |= {int(k) for k in np.flatnonzero(values >= share * values.max())}
    return leading

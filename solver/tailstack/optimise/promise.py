"""The quantile that is promised: the declared law of the linear model at a choice, bounded sources at their worst."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from math import sqrt

import numpy as np

from ..contributors import declared_law
from ..errors import NotConvergedError, Problem
from ..propagation.linear import LinearModel, linearise
from ..system import Array, Law, Target
from ..tail.declared import law_quantile
from .problem import PlacementProblem, apply_choice
from .terms import LAYOUT_BLOCKS, TargetTerms, moments

CONTENDERS = 4  # vertices whose exact quantile is computed: the closed form ranks all of them within 1 %


@dataclass(frozen=True, slots=True, eq=False)
class Promise:
    """One target at one choice."""

    exact_mm: float
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
    """Exact quantile of the declared law at one target, at the worst vertex of the bounded sources.

    The maximum over a bounded source is at an end of it: the quantile is quasi-convex in the mean, and
    the mean is affine in the source.  Raises IllPosedError or NotConvergedError.
    """
    error, p = problem.requirement.error, problem.requirement.quantile
    model = linearise(apply_choice(problem, fiducials_mm, half_width), terms.target)
    image = image_part(model, error)
    bounded = bounded_half_widths(problem)
    fixed_count = terms.bounded.shape[1]
    best: tuple[float, Array, Array] | None = None
    choices = []
    for ends in product((1.0, -1.0), repeat=fixed_count + len(bounded)):
        vertex = np.array(ends)
        free_signs = np.ones(len(problem.half_widths))
        free_signs[bounded] = vertex[fixed_count:]
        choices.append((vertex[:fixed_count], free_signs))
    if len(choices) > CONTENDERS:
        ranked = [closed_form_mm(problem, terms, image, half_width, *choice) for choice in choices]
        choices = [choices[k] for k in np.argsort(-np.array(ranked), kind="stable")[:CONTENDERS]]
    for signs, free_signs in choices:
        mean = terms.bias_mm + terms.bounded @ signs
        mean = mean + terms.free_gain[:, bounded] @ (free_signs[bounded] * half_width[bounded])
        value = _exact(model, error, mean, p)
        if best is None or value > best[0]:
            best = (value, signs, free_signs)
    assert best is not None
    return Promise(*best, image, model)


def bounded_half_widths(problem: PlacementProblem) -> list[int]:
    """Indices of the free half-widths whose law is bounded."""
    mounts = {mount.name: mount for mount in (problem.system.interface_1, problem.system.interface_2)}
    found = []
    for k, free in enumerate(problem.half_widths):
        sources = mounts[free.contributor].sources
        if sources.laws[sources.names.index(free.component)] is Law.BOUNDED:
            found.append(k)
    return found


def _exact(model: LinearModel, error: str, mean: Array, p: float) -> float:
    law, _ = declared_law(model, error, mean)
    value = law_quantile(law, p).quantile_mm
    if not np.isfinite(value):
        raise NotConvergedError(
            Problem("", "quantile", f"the quantile at target {model.target.name!r} did not converge")
        )
    return value


def worst_targets(
    problem: PlacementProblem, terms: tuple[TargetTerms, ...], choices: list[tuple[Array, Array]]
) -> tuple[Target, ...]:
    """Targets with the largest quantile at any of some choices (fiducials, half-widths), in the problem's order."""
    worst = set()
    for fiducials, half_width in choices:
        values = [promise(problem, term, fiducials, half_width).exact_mm for term in terms]
        worst.add(int(np.argmax(values)))
    return tuple(terms[k].target for k in sorted(worst))

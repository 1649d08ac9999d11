"""Where in the envelope information is worth having: how many of the fiducials the best mixture of layouts has there.

With weights w of the cells of ``global_bound`` in the place of fiducials, ``F = F0 + sum of w J' R^-1 J``, the mean
square that the images leave of an error, the trace of ``E F^-1 E'``, is convex in w: the best weights are the best of
all.  They are those of layouts, each the best where the mixture of those before knows least, whose shares are then
improved (Titterington 1978).  A picture, and no proof.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..design import Design
from ..design.loading import locate_refusals
from ..geometry.arrays import Array
from ..results import WorthyPlace
from ..scoring import vector3
from .global_bound import (
    Cells,
    Information,
    NoBound,
    cells_in,
    information_of,
    target_information,
    value_at,
    why_none,
)
from .problem import PlacementProblem, present_choice
from .regions import bounding_box, clip
from .request import read_request
from .starts import with_copies
from .terms import DemandTerms, every_terms

ROUNDS, UPDATES = 40, 8  # layouts that are mixed; updates of their shares after each
LEAST, MOST = 0.05, 100  # of a fiducial, at a place that is told; such places


def worthy_places(design: Design) -> tuple[WorthyPlace, ...]:
    """For what is nearest to its limit among what the ``optimise`` section asks for and can be bounded, the most
    valuable places first; none where no fiducial is free.  Raises DesignError."""
    with locate_refusals(design):
        problem = read_request(design).problem
        terms = [term for term in every_terms(problem) if not why_none(problem, term)]
    here = present_choice(problem)

    def share(term: DemandTerms) -> float:
        return value_at(problem, term, here) / term.demand.requirement.limit

    try:
        return weigh_places(problem, max(terms, key=share)) if terms else ()
    except NoBound:
        return ()


def weigh_places(problem: PlacementProblem, term: DemandTerms) -> tuple[WorthyPlace, ...]:
    """For one demand that has a bound.  Raises NoBound where a region reaches a source."""
    information = information_of(problem, term)
    groups = cells_in(information)
    found: list[tuple[float, Array]] = []
    for group, weights in zip(groups, mix_layouts(information, groups, term.to_error.T), strict=True):
        if not group.reach.any():  # a fixed fiducial
            continue
        worthy = weights >= LEAST
        places = clip(group.beads.region, group.centres[worthy] + bounding_box(group.beads.region).mean(axis=0))
        for weight, every in zip(weights[worthy].tolist(), with_copies(problem, places), strict=True):
            found += [(weight, at) for at in every[: len(group.places)]]
    found.sort(key=lambda pair: -pair[0])
    return tuple(WorthyPlace(vector3(np.round(at, 3)), round(weight, 3)) for weight, at in found[:MOST])


def mix_layouts(information: Information, groups: Sequence[Cells], aim: Array) -> list[Array]:
    """(n,) of each group: how many fiducials the best mixture of layouts has in each of its cells.

    aim (3, 3): a column for each component of the error, of displacements of the point.
    """
    base, seen = target_information(information), np.vstack([aim, np.zeros((information.unknowns - 3, 3))])
    held = [[np.full(len(group.centres), group.beads.number / len(group.centres)) for group in groups]]
    known, shares = [base + sum(group.evenly for group in groups)], np.ones(1)
    for _ in range(ROUNDS):
        for _ in range(UPDATES):
            z = np.linalg.solve(np.einsum("s,sde->de", shares, known), seen)
            told = np.einsum("da,sde,ea->s", z, known, z)
            shares = shares * told / (shares @ told)
        z = np.linalg.solve(np.einsum("s,sde->de", shares, known), seen)
        layout, knows = [], base.copy()
        for group in groups:
            values = ((group.slopes @ z) ** 2).sum(axis=(1, 2))
            best = np.argsort(-values, kind="stable")[: group.kept]
            rows = group.slopes[best].reshape(-1, information.unknowns)
            knows += group.in_each * (rows.T @ rows)
            layout.append(np.where(np.isin(np.arange(len(values)), best), float(group.in_each), 0.0))
        held.append(layout)
        known.append(knows)
        shares = np.append(shares * (1 - 1 / len(known)), 1 / len(known))
    return [shares @ np.array(own) for own in zip(*held, strict=True)]

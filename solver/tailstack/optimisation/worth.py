"""Where in the envelope information is worth having: how many of the fiducials the best mixture of layouts has there.

These are the weights of a convex problem (``global_bound.mix_layouts``).  A picture, and no proof.
"""

from __future__ import annotations

import numpy as np

from ..design import Design
from ..design.loading import locate_refusals
from ..geometry.arrays import Array
from ..results import WorthyPlace
from ..scoring import vector3
from .global_bound import NoBound, cells_in, information_of, mix_layouts, value_at, why_none
from .problem import PlacementProblem, present_choice
from .regions import bounding_box, clip
from .request import read_request
from .starts import with_copies
from .terms import DemandTerms, every_terms

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
    for group, weights in zip(groups, mix_layouts(information, groups, term.to_error.T)[1], strict=True):
        if not group.reach.any():  # a fixed fiducial
            continue
        worthy = weights >= LEAST
        places = clip(group.beads.region, group.centres[worthy] + bounding_box(group.beads.region).mean(axis=0))
        for weight, every in zip(weights[worthy].tolist(), with_copies(problem, places), strict=True):
            found += [(weight, at) for at in every[: len(group.places)]]
    found.sort(key=lambda pair: -pair[0])
    return tuple(WorthyPlace(vector3(np.round(at, 3)), round(weight, 3)) for weight, at in found[:MOST])

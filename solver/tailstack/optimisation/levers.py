"""How far the levers lead that only a search knows: moving fiducials within their regions, and one view more."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np

from ..design import Design
from ..errors import TailstackError
from ..results import Lever, Score
from ..scoring import score
from .offer import add_view
from .placement import settle
from .request import OptimiseRequest, read_request
from .search import ALONE, search
from .views import Aim, AimSearch, present_distance

STARTS = 4  # layouts to search from, beside the present one


def search_levers(design: Design, found: Score) -> Score:
    """The score of a design with what moving fiducials alone reaches, and a view more, as far as its ``optimise``
    section allows either: the best that was found in a few seconds, and no worse than the design as it is."""
    if (section := design.document.optimise) is None or not found.levers:
        return found
    request, levers = read_request(design), list(found.levers)
    for k, lever in enumerate(levers):
        if lever.name == "placement" and (value := _search_places(request, found, lever.requirement)) is not None:
            levers[k] = replace(lever, value=value, how="found")
    if section.added_view is not None:
        aims = AimSearch(add_view(design, section.added_view), lambda _: inf, ALONE)
        aims.free = [free for free in aims.free if free.view == section.added_view.add]
        start = Aim(0.0, 0.0, present_distance(aims.design, section.added_view.add))
        aimed = score(aims.aim(aims.scan((start,))), losses=False)
        for name in dict.fromkeys(lever.requirement for lever in levers):
            value = max(check.value for check in aimed.verdict.checks if check.requirement == name)
            levers.append(Lever(name, "view", f"one view more, {section.added_view.add}", value, "found"))
    place = [lever.requirement for lever in found.levers].index
    return replace(found, levers=tuple(sorted(levers, key=lambda each: (place(each.requirement), each.value))))


def _search_places(request: OptimiseRequest, found: Score, name: str) -> float | None:
    """What a requirement limits where the fiducials were placed best, all else as it is; None where they may not be
    moved, or nothing was found."""
    problem = request.problem
    own = tuple(item for item in problem.system.requirements if item.name == name and item.row.by_quantile)
    if not (problem.places and own):
        return None
    try:
        best = search(problem.layout_alone(own), starts=STARTS, seed=request.section.seed)
        ratio = settle(best, np.ones(len(best.terms))).worst_ratio
    except TailstackError:
        return None
    here = (check.value for check in found.verdict.checks if check.requirement == name)
    return min(ratio * own[0].limit, max(here))

"""Which fiducial went where: those of one kind may take each other's places, which changes nothing but the labels.

The places of a layout are given to labels by the assignment with the least movement in all (Kuhn 1955, Naval Research
Logistics Quarterly 2, 83-97), of which no two straight ways cross.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from math import inf
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from ..geometry.arrays import Array
from .problem import PlacementProblem
from .regions import distinct


class Places(NamedTuple):
    """Where fiducials are, and which of them may stand for one another: a group for a group."""

    points_mm: Array  # (N, 3), con; nan: anywhere
    groups: Sequence[tuple[int, ...]]  # of those that are free, each with its copies in the symmetry's order
    kinds: Sequence[Hashable]  # (N,): of one kind are fiducials that differ in nothing but their place


def match(now: Places, before: Places, reach_mm: float = inf) -> dict[int, int]:
    """Index now -> index before of what moves least in all, nothing by more than ``reach_mm``.

    A group may begin with any of its copies.  Where there are more groups on one side, some of it are left out.
    """
    least = np.full((len(now.groups), len(before.groups)), inf)
    turns = np.zeros(least.shape, dtype=int)
    for a, group in enumerate(now.groups):
        for b, own in enumerate(before.groups):
            for turn in range(len(group)):
                turned = group[turn:] + group[:turn]
                if any(now.kinds[i] != before.kinds[j] for i, j in zip(turned, own, strict=True)):
                    continue
                gaps = now.points_mm[list(turned)] - before.points_mm[list(own)]
                ways = np.nan_to_num(np.linalg.norm(gaps, axis=1))
                if ways.sum() < least[a, b] and ways.max() <= reach_mm:
                    least[a, b], turns[a, b] = ways.sum(), turn
    matched: dict[int, int] = {}
    for a, b in zip(*linear_sum_assignment(least), strict=True):
        group, turn = now.groups[a], turns[a, b]
        matched |= zip(group[turn:] + group[:turn], before.groups[b], strict=True)
    return matched


def list_places(problem: PlacementProblem, points_mm: Array, apart: Sequence[Hashable] = ()) -> Places:
    """The free fiducials of a problem, somewhere; ``apart`` (N,): what else tells one from another."""
    system, region = problem.system, dict.fromkeys(range(len(points_mm)), -1)
    for place, which in zip(problem.places, distinct(place.region for place in problem.places)[1], strict=True):
        region |= dict.fromkeys(place.fiducials, which)
    made, seen = system.manufacturing_half_width_mm.tolist(), system.sees.T.tolist()
    own = apart or [None] * len(points_mm)
    kinds = [(region[i], tuple(made[i]), tuple(seen[i]), own[i]) for i in range(len(points_mm))]
    return Places(points_mm, [place.fiducials for place in problem.places], kinds)


def take_nearest(problem: PlacementProblem, layout: Array) -> Array:
    """The places of a layout (N, 3), each taken by the fiducial that stays nearest to its own, in all."""
    if problem.stay is None:
        return layout
    matched = match(list_places(problem, layout), list_places(problem, problem.stay.home_mm))
    taken = layout.copy()
    for i, j in matched.items():
        taken[j] = layout[i]
    return taken

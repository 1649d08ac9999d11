"""Fiducial placement and tolerance budgets at least cost under a tail-risk limit (CasADi, IPOPT, cvxpy, HiGHS)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..extras import load_on_first_use

if TYPE_CHECKING:
    from .course import optimise
    from .placement import PlacementSolution, solve_placement
    from .problem import FreeFiducial, FreeHalfWidth, PlacementProblem
    from .task import influence

# Loaded on first use: who asks only for the prices of a design does not wait a second for the solvers.
_HOME = {
    "FreeHalfWidth": "problem",
    "FreeFiducial": "problem",
    "PlacementProblem": "problem",
    "PlacementSolution": "placement",
    "influence": "task",
    "optimise": "course",
    "solve_placement": "placement",
}

__all__ = [
    "FreeFiducial",
    "FreeHalfWidth",
    "PlacementProblem",
    "PlacementSolution",
    "influence",
    "optimise",
    "solve_placement",
]

__getattr__ = load_on_first_use(__name__, _HOME)


def __dir__() -> list[str]:
    return __all__

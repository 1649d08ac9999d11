"""Fiducial placement and tolerance budgets at least cost under a tail-risk limit (CasADi, IPOPT, cvxpy, HiGHS)."""

from __future__ import annotations

from .optimising import influence, optimise
from .placement import PlacementSolution, solve_placement
from .problem import FreeHalfWidth, Place, PlacementProblem

__all__ = [
    "FreeHalfWidth",
    "Place",
    "PlacementProblem",
    "PlacementSolution",
    "influence",
    "optimise",
    "solve_placement",
]

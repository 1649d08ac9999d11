"""Fiducial placement and rotational tolerance budgets at least cost under a tail-risk limit (CasADi and IPOPT)."""

from __future__ import annotations

from .optimising import optimise, problem_of
from .placement import PlacementSolution, solve_placement
from .problem import FreeHalfWidth, PlacementProblem

__all__ = ["FreeHalfWidth", "PlacementProblem", "PlacementSolution", "optimise", "problem_of", "solve_placement"]

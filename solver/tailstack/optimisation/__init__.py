"""Fiducial placement and tolerance budgets at least cost under a tail-risk limit (CasADi, IPOPT, cvxpy, HiGHS)."""

from ..extras import load_on_first_use

# Who asks only for the prices of a design does not wait a second for the solvers.
__getattr__, __dir__, __all__ = load_on_first_use(__name__, __file__)

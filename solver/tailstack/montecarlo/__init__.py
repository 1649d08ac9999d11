"""Monte Carlo of the full nonlinear chain, written independently of the first-order model."""

from .chain import draw, evaluate, run_indices
from .plan import ChainPlan, at_vertex, bounded_names, compile_plan

__all__ = ["ChainPlan", "at_vertex", "bounded_names", "compile_plan", "draw", "evaluate", "run_indices"]

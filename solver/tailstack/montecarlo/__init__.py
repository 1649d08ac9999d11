"""Monte Carlo of the full nonlinear chain, written independently of the first-order model."""

from .chain import draw, evaluate, run_indices
from .estimators import (
    CvarEstimate,
    ExceedanceEstimate,
    QuantileEstimate,
    cvar_estimate,
    exceedance_estimate,
    interval_ranks,
    quantile_estimate,
)
from .plan import ChainPlan, bounded_names, compile_plan
from .radial import LinearChain, RadialEstimate, gains_in_plan_order, radial
from .simulate import ErrorSample, Run, Samples, Simulation, deepen, simulate
from .stopping import AdaptiveRun, Goal, simulate_to_precision

__all__ = [
    "AdaptiveRun",
    "ChainPlan",
    "CvarEstimate",
    "ErrorSample",
    "ExceedanceEstimate",
    "Goal",
    "LinearChain",
    "QuantileEstimate",
    "RadialEstimate",
    "Run",
    "Samples",
    "Simulation",
    "bounded_names",
    "compile_plan",
    "cvar_estimate",
    "deepen",
    "draw",
    "evaluate",
    "exceedance_estimate",
    "gains_in_plan_order",
    "interval_ranks",
    "quantile_estimate",
    "radial",
    "run_indices",
    "simulate",
    "simulate_to_precision",
]

"""So many trials of a system and nothing else: what tests and benchmarks hold other answers against."""

from __future__ import annotations

from typing import Any

from tailstack.montecarlo.plan import ChainPlan, compile_plan
from tailstack.montecarlo.simulate import Run, Samples, Simulation
from tailstack.system import System


def simulate(system: System | ChainPlan, *, trials: int, seed: int, **more: Any) -> Samples:
    """Trials of the full nonlinear chain; more: fields of :class:`Simulation`."""
    plan = system if isinstance(system, ChainPlan) else compile_plan(system)
    return Run(Simulation(plan, seed, **more)).grow(trials)

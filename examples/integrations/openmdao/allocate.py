"""How loose may four tolerances be?  Least cost with P95 within its limit, by OpenMDAO's SLSQP and by tailstack.

``python allocate.py DESIGN`` needs tailstack with its extra optimise, and openmdao.
"""

from __future__ import annotations

import sys
from math import radians

import numpy as np
import openmdao.api as om
from tailstack_openmdao import TailComponent

from tailstack import Design, load_design, optimise

BOUNDS_DEG = 0.01, 0.5
FREE = {  # the half-widths, and what a degree of each costs: weight / degrees
    ("structure_connector", "rx"): 1.0,
    ("structure_connector", "ry"): 1.0,
    ("connector_flange", "rx"): 3.0,
    ("connector_flange", "ry"): 2.0,
}
PATHS = [f"interfaces.{interface}.tolerances.{component}.half_width_deg" for interface, component in FREE]


def allocate(design: Design, limit_mm: float) -> tuple[np.ndarray, float, float]:
    """(half-widths in degrees, cost, P95 in mm) by OpenMDAO."""
    weights = np.array(list(FREE.values()))
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("tail", TailComponent(design=design, inputs=PATHS), promotes=["*"])
    cost = om.ExecComp("cost = sum(weight / values)", weight=weights, values=np.ones(len(PATHS)))
    problem.model.add_subsystem("price", cost, promotes=["values", "cost"])
    problem.model.set_input_defaults("values", np.full(len(PATHS), 0.05))
    problem.model.add_design_var("values", lower=BOUNDS_DEG[0], upper=BOUNDS_DEG[1], ref=0.1)
    problem.model.add_constraint("p95_mm", upper=limit_mm)
    problem.model.add_objective("cost", ref=100.0)
    problem.driver = om.ScipyOptimizeDriver(optimizer="SLSQP", tol=1e-10, disp=False)
    problem.setup()
    if problem.run_driver().success is False:
        raise SystemExit("SLSQP did not converge")
    return problem.get_val("values"), float(problem.get_val("cost")[0]), float(problem.get_val("p95_mm")[0])


def with_the_same_freedom(design: Design, limit_mm: float) -> Design:
    """The design with the same question in its own section ``optimise``, whose prices are by the radian."""
    low, high = BOUNDS_DEG
    tolerances = [
        {
            "interface": interface,
            "component": component,
            "min_deg": low,
            "max_deg": high,
            "cost_weight": radians(weight),
        }
        for (interface, component), weight in FREE.items()
    ]
    asked = design.with_value("optimise", {"tolerances": tolerances})
    return asked.with_value("requirements.0.limit_mm", limit_mm)


def main(path: str) -> None:
    design, limit_mm = load_design(path), 1.1
    widths, cost, p95 = allocate(design, limit_mm)
    print(f"OpenMDAO:  cost {cost:.2f}, P95 {p95:.4f} mm,", *(f"{width:.4f}" for width in widths), "deg")
    found = optimise(with_the_same_freedom(design, limit_mm))
    widths = np.array([change.after_half_width for change in found.tolerances])
    print(f"tailstack: cost {found.cost_exact_law:.2f} at the limit itself; so that the simulation confirms it:")
    print(
        f"           cost {found.cost_after:.2f}, P95 {found.p95_after_mm:.4f} mm,",
        *(f"{w:.4f}" for w in widths),
        "deg",
    )


if __name__ == "__main__":
    main(*sys.argv[1:])

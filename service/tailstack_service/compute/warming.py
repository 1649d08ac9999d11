"""What nearly every task needs, in steps short enough that a task which comes in between does not wait for long."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module

from ..work.task import ADVANCE, Task, UnitResult


def steps() -> list[Callable[[], object]]:
    """Modules to import, then the compiled kernels, in the order in which they are to be called."""
    optimiser = "tailstack.optimisation.optimising"
    modules = ("numpy", "scipy.linalg", "tailstack.design", "tailstack.verification", optimiser, "casadi")
    return [*(partial(import_module, name) for name in modules), check_once]


def check_once() -> None:
    """The smallest Monte Carlo check there is, as a job would do it."""
    from ..http.example import EXAMPLE_DESIGN
    from ..work.perform import perform
    from ..work.requests import canonical

    asked = {"trials": 1_000, "precision": None, "seed": 0, "method": "plain", "max_trials": 1_000}
    request = canonical({"design": EXAMPLE_DESIGN, **asked})
    units: tuple[UnitResult, ...] = ()
    while more := perform(Task("verification", request, ADVANCE, units)).more:
        results = [(spec, perform(Task("verification", request, spec)).result or b"") for spec in more]
        units += tuple(UnitResult(len(units) + k, *pair) for k, pair in enumerate(results))

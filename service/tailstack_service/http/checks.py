"""What is looked at before a computation is accepted as a job: everything that can be known in milliseconds."""

from __future__ import annotations

from collections.abc import Callable
from math import prod
from typing import Any

from tailstack.design import Design, check_design
from tailstack.errors import LimitError, Problem, TailstackError

from ..settings import Settings, variable
from .asked import Asked
from .bodies import Placed
from .options import OptimisationOptions, ReportOptions, SweepOptions, VerificationOptions, within


def _placed(asked: Asked[Any], design: Design, check: Callable[[Design], object]) -> None:
    """Check the design, every refusal placed in what was sent.  Raises Placed."""
    try:
        check(design)
    except TailstackError as error:
        raise Placed(error, asked.prefix) from None


def check_verification(asked: Asked[VerificationOptions], design: Design, settings: Settings) -> None:
    """Geometry that determines an answer, trials within the limit.  Raises Placed, LimitError."""
    within(asked.options.trials, "max_trials", settings, "/trials")
    _placed(asked, design, check_design)


def check_optimisation(asked: Asked[OptimisationOptions], design: Design, settings: Settings) -> None:
    """An ``optimise`` section without contradictions that can change anything.  Raises Placed, LimitError."""
    within(asked.options.starts, "max_starts", settings, "/starts")
    _check_freedom(asked, design, settings, asked.options.starts is None)


def _check_freedom(asked: Asked[Any], design: Design, settings: Settings, starts_of_design: bool) -> None:
    from tailstack.optimisation import influence

    wanted = design.document.optimise
    if starts_of_design and wanted is not None:
        _placed(asked, design, lambda _: within(wanted.starts, "max_starts", settings, "/optimise/starts"))
    _placed(asked, design, check_design)
    _placed(asked, design, influence)


def check_report(asked: Asked[ReportOptions], design: Design, settings: Settings) -> None:
    """What its parts need.  Raises Placed, LimitError."""
    within(asked.options.trials, "max_trials", settings, "/trials")
    if "optimisation" in asked.options.parts:
        _check_freedom(asked, design, settings, True)
    else:
        _placed(asked, design, check_design)


def check_sweep(asked: Asked[SweepOptions], design: Design, settings: Settings) -> None:
    """Every axis leads to a number of the design, and there are not too many points.

    Raises SweepError with the pointer to the axis, LimitError, Placed.
    """
    from tailstack.sweeping import read_axes

    axes = asked.options.axes
    within(asked.options.trials, "max_trials", settings, "/trials")
    points = prod(axis.size for axis in axes)
    if points > settings.max_sweep_points:
        sizes = " × ".join(str(axis.size) for axis in axes)
        raise LimitError(
            Problem(
                "/axes",
                "too-many",
                f"at most {settings.max_sweep_points} points are computed in one sweep; got {sizes} = {points}",
                f"take fewer values, or start the service with a higher {variable('max_sweep_points')}",
            )
        )
    read_axes(design, sweep_options(asked.options, design)["axes"])
    _placed(asked, design, check_design)


def sweep_options(options: SweepOptions, design: Design) -> dict[str, Any]:
    """The options as a job keeps them: paths with names turned into pointers."""
    from tailstack.sweeping import axis_pointer

    kept = options.model_dump(exclude_none=True)
    return {**kept, "axes": [{**axis, "pointer": axis_pointer(design, axis["pointer"])} for axis in kept["axes"]]}

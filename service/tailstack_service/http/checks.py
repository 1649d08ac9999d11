"""What is looked at before a computation is accepted as a job: everything that can be known in milliseconds."""

from __future__ import annotations

import copy
from math import prod
from typing import Any

from tailstack.design import Design, check_design, load_design
from tailstack.errors import LimitError, Problem, TailstackError

from ..problems import RequestError
from ..settings import Settings, variable
from .asked import Asked
from .bodies import limits_of
from .operations import placed
from .options import Axis, OptimisationOptions, ReportOptions, SweepOptions, VerificationOptions, within


def check_verification(asked: Asked[VerificationOptions], design: Design, settings: Settings) -> None:
    """Geometry that determines an answer, trials within the limit.  Raises Placed, LimitError."""
    within(asked.options.trials, "max_trials", settings, "/trials")
    placed(asked, design, check_design)


def check_optimisation(asked: Asked[OptimisationOptions], design: Design, settings: Settings) -> None:
    """An ``optimise`` section without contradictions that can change anything.  Raises Placed, LimitError."""
    within(asked.options.starts, "max_starts", settings, "/starts")
    _check_freedom(asked, design, settings, asked.options.starts is None)


def _check_freedom(asked: Asked[Any], design: Design, settings: Settings, starts_of_design: bool) -> None:
    from tailstack.optimisation import influence

    wanted = design.document.optimise
    if starts_of_design and wanted is not None:
        placed(asked, design, lambda _: within(wanted.starts, "max_starts", settings, "/optimise/starts"))
    placed(asked, design, check_design)
    placed(asked, design, influence)


def check_report(asked: Asked[ReportOptions], design: Design, settings: Settings) -> None:
    """What its parts need.  Raises Placed, LimitError."""
    within(asked.options.trials, "max_trials", settings, "/trials")
    if "optimisation" in asked.options.parts:
        _check_freedom(asked, design, settings, True)
    else:
        placed(asked, design, check_design)


def check_sweep(asked: Asked[SweepOptions], design: Design, settings: Settings) -> None:
    """Every axis leads to a number of the design and stays within what that number may be.

    Raises RequestError with the pointer to the axis, LimitError, Placed.
    """
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
    placed(asked, design, check_design)
    data = asked.data(design)
    pointers = [axis.pointer for axis in axes]
    for index, axis in enumerate(axes):
        if axis.pointer in pointers[:index]:
            raise RequestError(Problem(f"/axes/{index}/pointer", "given-twice", f"{axis.pointer} varies already"))
        for value in _extremes(axis):
            varied = copy.deepcopy(data)
            _set_number(varied, axis.pointer, value, f"/axes/{index}/pointer")
            _check_value(varied, axis, value, index, settings)


def _extremes(axis: Axis) -> tuple[float, float]:
    values = axis.values if axis.values is not None else [axis.start or 0.0, axis.stop or 0.0]
    return min(values), max(values)


def _check_value(varied: dict[str, Any], axis: Axis, value: float, index: int, settings: Settings) -> None:
    try:
        load_design(varied, allow_files=False, limits=limits_of(settings))
    except TailstackError as error:
        first = error.problems[0]
        detail = f"with {value:g} at {axis.pointer} the design is not valid: {first.pointer}: {first.detail}"
        raise RequestError(Problem(f"/axes/{index}", "not-valid", detail, first.hint)) from None


def _set_number(data: Any, pointer: str, value: float, at: str) -> None:
    """Replace the number that a JSON pointer leads to.  Raises RequestError placed ``at``."""
    *way, last = [step.replace("~1", "/").replace("~0", "~") for step in pointer.split("/")[1:]]
    node, gone = data, ""
    for step in [*way, last]:
        key: Any = int(step) if isinstance(node, list) and step.isascii() and step.isdigit() else step
        known = range(len(node)) if isinstance(node, list) else node if isinstance(node, dict) else ()
        if key not in known:
            hint = f"below {gone or 'the design'}: {', '.join(map(str, list(known)[:12]))}" if known else ""
            raise RequestError(Problem(at, "not-found", f"the design, as it was sent, has nothing at {pointer}", hint))
        gone += f"/{step}"
        parent, name, node = node, key, node[key]
    if isinstance(node, bool) or not isinstance(node, int | float):
        raise RequestError(Problem(at, "not-a-number", f"{pointer} is not a number of the design"))
    parent[name] = value

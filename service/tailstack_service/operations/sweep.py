"""Many designs from one: numbers of the design varied over a grid, every point scored or checked.

PATH names a number of the document by its fields with dots between them (views.AP.fiducial_noise_px), or by a JSON
pointer (/views/0/fiducial_noise_px); * stands for every element (views.*.fiducial_noise_px).
"""

from __future__ import annotations

import argparse
from math import prod
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from tailstack.errors import LimitError, Problem
from tailstack.montecarlo import MAX_TRIALS
from tailstack.results.sweep import Sweep

from ..console.command_line import exit_code_of_points
from ..console.flags import Flag
from ..environment import variable
from ..problems import RequestError
from .operation import (
    Call,
    Csv,
    Demand,
    FigureFile,
    LateImport,
    MostTrials,
    Operation,
    Options,
    Seed,
    Trials,
    run_function,
    within_trials,
)

if TYPE_CHECKING:
    from tailstack.design import Design
    from tailstack.sweeping import VariedNumber

    from ..settings import Settings
    from .request import Request

NO_TRIALS = "ask for check verification, or leave trials out"


class Axis(Options):
    """One number of the design and the values that it takes: a list, or a range."""

    pointer: Annotated[str, Field(min_length=1, max_length=500)] = Field(examples=["/views/0/fiducial_noise_px"])
    """JSON pointer to a number of the design as it was sent, /views/0/fiducial_noise_px, or a path of names,
    views.AP.fiducial_noise_px; * stands for every element."""
    values: Annotated[list[float], Field(min_length=1)] | None = Field(None, examples=[[0.1, 0.2, 0.4]])
    """The values, in this order."""
    start: float | None = None
    """First value of a range."""
    stop: float | None = None
    """Last value of a range, included."""
    count: Annotated[int, Field(ge=1)] | None = None
    """Number of values of a range, evenly spaced."""

    @model_validator(mode="after")
    def _one_form(self) -> Axis:
        parts = (self.start, self.stop, self.count)
        whole_range, any_of_range = None not in parts, parts != (None, None, None)
        if (self.values is None) != whole_range or (self.values is not None and any_of_range):
            raise PydanticCustomError("one-of", "give values, or start, stop and count", {"at": ""})
        return self

    @property
    def size(self) -> int:
        """Number of values."""
        return len(self.values) if self.values is not None else self.count or 0


def _parse_axis(text: str) -> dict[str, Any]:
    """An axis as it is typed, as it stands in a request."""
    path, separator, values = text.rpartition("=")
    try:
        if not separator or not path:
            raise ValueError(text)
        if ":" in values:
            start, stop, count = values.split(":")
            return {"pointer": path, "start": float(start), "stop": float(stop), "count": int(count)}
        return {"pointer": path, "values": [float(value) for value in values.split(",")]}
    except ValueError:
        raise argparse.ArgumentTypeError(
            "expected PATH=START:STOP:COUNT or PATH=V1,V2,... with numbers, like views.*.fiducial_noise_px=0.1:0.5:5; "
            f"got {text!r}"
        ) from None


WORDS = "START:STOP:COUNT evenly spaced values, or V1,V2,... ; once for each axis, the last one runs fastest"
TEXT = {"pattern": "^[^=]+=.+$", "examples": ["views.AP.fiducial_noise_px=0.1:0.5:5"]}
AXES = Flag(WORDS, name="set", metavar="PATH=VALUES", parse=_parse_axis, repeats=True, in_query="set", text=TEXT)


class SweepOptions(Options):
    """What varies, and what is computed at each point."""

    axes: Annotated[list[Axis], Field(min_length=1, max_length=6), AXES] = Field(
        examples=[[{"pointer": "/views/0/fiducial_noise_px", "values": [0.1, 0.2, 0.4]}]]
    )
    """Numbers of the design that vary; every combination of their values is a point."""
    check: Annotated[Literal["score", "verification"], Flag("what is computed")] = "score"
    """What is computed at each point."""
    trials: Annotated[Trials | None, Flag("trials of each verification")] = None
    """Trials at each point, for check verification; absent: to the solver's own precision."""
    max_trials: Annotated[MostTrials, Flag("without --trials: stop each verification after so many")] = MAX_TRIALS
    seed: Annotated[Seed, Flag("seed of every verification")] = 0
    """Seed of every check: one for all points, which then differ by their designs alone."""

    @model_validator(mode="after")
    def _trials_of_a_check(self) -> SweepOptions:
        if self.trials is not None and self.check == "score":
            raise PydanticCustomError("no-trials", "a score draws no trials", {"at": "/trials", "hint": NO_TRIALS})
        return self

    @classmethod
    def of_record(cls, record: Any, **others: Any) -> Self | None:
        axes = [{"pointer": axis.pointer, "values": list(axis.values)} for axis in record.axes]
        return super().of_record(record, axes=axes, max_trials=record.max_trials or MAX_TRIALS, seed=record.seed or 0)

    def keep(self, *designs: Design) -> dict[str, Any]:
        """Paths with names are turned into pointers."""
        from tailstack.design.pointers import pointer_of

        options, data = self.model_dump(exclude_none=True), designs[0].source.data
        return {**options, "axes": [{**axis, "pointer": pointer_of(data, axis["pointer"])} for axis in options["axes"]]}


def _read_axes(asked: Call | Request) -> tuple[VariedNumber, ...]:
    """Raises SweepError with the pointer to the axis."""
    from tailstack.sweeping import read_axes

    return read_axes(asked.design, asked.options.keep(asked.design)["axes"])


def _check(request: Request, settings: Settings) -> None:
    """Every axis leads to a number of the design, and there are not too many points.

    Raises SweepError with the pointer to the axis, LimitError, RefusedAt.
    """
    from tailstack.design import check_design

    axes = request.options.axes
    if request.options.check == "verification":
        within_trials(request, settings)
    points = prod(axis.size for axis in axes)
    if points > settings.max_sweep_points:
        sizes = " × ".join(str(axis.size) for axis in axes)
        detail = f"at most {settings.max_sweep_points} points are computed in one sweep; got {sizes} = {points}"
        hint = f"take fewer values, or start the service with a higher {variable('max_sweep_points')}"
        raise LimitError(Problem("/axes", "too-many", detail, hint))
    _read_axes(request)
    request.refuse_by(check_design)


def _demand(record: Sweep) -> Demand:
    points = prod(len(axis.values) for axis in record.axes)
    if points != len(record.points):
        detail = f"its axes make {points:,} points, the record holds {len(record.points):,}"
        raise RequestError(Problem("/points", "bad-result", detail, "give a file that tailstack sweep wrote"))
    if record.check == "score":
        return Demand(checks=0)
    at = "/max_trials" if record.trials is None else "/trials"
    trials = points * (record.trials or record.max_trials or MAX_TRIALS)
    return Demand(trials=trials, trials_at=at, checks=points, trusted="the Monte Carlo checks of all points")


# --- the command ------------------------------------------------------------------------------------------


def _check_drawable(call: Call) -> None:
    """Raises RequestError."""
    from ..report.charts import refuse_undrawable

    refuse_undrawable([axis.values for axis in _read_axes(call)])


OPERATION = Operation(
    name="sweep",
    verb="sweep",
    path="/v1/sweeps",
    summary="Score or check many designs: numbers of one varied over a grid",
    description="Scores, or checks, the design at every point of a grid of some of its numbers.",
    title="answer of sweep: every point of a grid of designs",
    options=SweepOptions,
    example={
        "axes": [{"pointer": "/views/0/fiducial_noise_px", "start": 0.1, "stop": 0.5, "count": 2}],
        "check": "score",
    },
    record=lambda: Sweep,
    run=run_function(
        LateImport("tailstack", "sweep"),
        "progress",
        arguments=lambda call: call.arguments() | {"axes": _read_axes(call)},
    ),
    cut=True,
    check=_check,
    document=LateImport("..report.chapters.sweep", "sweep_document"),
    exit_code=exit_code_of_points,
    demand=_demand,
    figure=FigureFile(
        "P95 over one axis of several values, or two", LateImport("..report.charts", "draw_sweep"), _check_drawable
    ),
    csv=Csv("point and target", LateImport("..report.chapters.sweep", "sweep_csv")),
)

"""The error at the tool along the direction of a target: how much too deep, or not deep enough."""

from __future__ import annotations

from .measure import DIRECTED, Measure, at_each_direction, on_each_side

MEASURE = Measure(
    name="axial",
    words="the axial error at the tool",
    brief=", axial",
    meaning="error at the tool along the direction of the target, either way",
    frame="tcp",
    sites=at_each_direction(0, 1),
    needs=DIRECTED,
)
ONE_SIDED = on_each_side(MEASURE)

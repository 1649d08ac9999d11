"""The error at the tool across the direction of a target: how far off its axis an instrument comes."""

from __future__ import annotations

from .measure import DIRECTED, Measure, at_each_direction

MEASURE = Measure(
    name="lateral",
    words="the lateral error at the tool",
    brief=", lateral",
    meaning="error at the tool across the direction of the target",
    frame="tcp",
    sites=at_each_direction(1, 3),
    needs=DIRECTED,
)

"""The error at the tool."""

from __future__ import annotations

from .measure import Measure, at_each_target

MEASURE = Measure(
    name="tcp",
    words="the error at the tool",
    brief="",
    meaning="error at the tool, everything included",
    frame="tcp",
    sites=at_each_target(0),
)

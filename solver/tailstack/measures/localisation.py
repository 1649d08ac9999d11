"""The error of the located target, before the connector and the tool."""

from __future__ import annotations

from .measure import Measure, at_each_target

MEASURE = Measure(
    name="localisation",
    words="the error of the located target",
    brief=", located",
    meaning="of the reconstructed target in con",
    frame="con",
    sites=at_each_target(3),
)

"""Measures, each whole in a file of its own, listed here once.

To add one: a file with its ``Measure``, and its line in ``MEASURES``.  What scores, simulates, judges and reports asks
for them here.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal, NamedTuple

from . import localisation, tcp
from .measure import Measure, Site

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

MEASURES: tuple[Measure, ...] = (
    tcp.MEASURE,
    localisation.MEASURE,
)
POINTS = MEASURES[:2]  # the errors at one target, in the order in which the simulation has them
MEASURE = {measure.name: measure for measure in MEASURES}
POINT_ERRORS = tuple(measure.name for measure in POINTS)
PointError = Literal["tcp", "localisation"]
if TYPE_CHECKING:
    MeasureName = str
else:
    MeasureName = Literal[tuple(MEASURE)]


class Metric(NamedTuple):
    """A measure at one of its sites."""

    measure: Measure
    site: Site

    @property
    def key(self) -> tuple[str, str]:
        """Names of the site and of the measure."""
        return self.site.name, self.measure.name


def metrics_at(targets: Mapping[str, NDArray[np.float64]], to_tcp: NDArray[np.float64]) -> tuple[Metric, ...]:
    """Every measure wherever it is read: ``POINTS`` target by target, then the others.  targets (3,) mm, con, by name;
    to_tcp (4, 4) from con."""
    of_points = zip(*(measure.sites(targets, to_tcp) for measure in POINTS), strict=True)
    points = [Metric(*each) for sites in of_points for each in zip(POINTS, sites, strict=True)]
    return (*points, *joined_at(targets, to_tcp))


def joined_at(targets: Mapping[str, NDArray[np.float64]], to_tcp: NDArray[np.float64]) -> tuple[Metric, ...]:
    """Of ``metrics_at`` those of measures that join several targets, which are the last."""
    joining = MEASURES[len(POINTS) :]
    return tuple(Metric(measure, site) for measure in joining for site in measure.sites(targets, to_tcp))

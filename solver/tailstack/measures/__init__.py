"""Measures, each whole in a file of its own, listed here once.

To add one: a file with its ``Measure``, and its line in ``MEASURES``.  What scores, simulates, judges and reports asks
for them here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, NamedTuple

from . import angle, axial, lateral, localisation, tcp
from .measure import Measure, Site

if TYPE_CHECKING:
    from .measure import Array, MeasuredTarget

MEASURES: tuple[Measure, ...] = (
    tcp.MEASURE,
    localisation.MEASURE,
    lateral.MEASURE,
    axial.MEASURE,
    angle.MEASURE,
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


def metrics_at(targets: Sequence[MeasuredTarget], to_tcp: Array) -> tuple[Metric, ...]:
    """Every measure wherever it is read: ``POINTS`` target by target, then the others.  to_tcp (4, 4) from con."""
    of_points = zip(*(measure.sites(targets, to_tcp) for measure in POINTS), strict=True)
    points = [Metric(*each) for sites in of_points for each in zip(POINTS, sites, strict=True)]
    return (*points, *derived_at(targets, to_tcp))


def derived_at(targets: Sequence[MeasuredTarget], to_tcp: Array) -> tuple[Metric, ...]:
    """Of ``metrics_at`` those of other measures than ``POINTS``, which are the last."""
    others = MEASURES[len(POINTS) :]
    return tuple(Metric(measure, site) for measure in others for site in measure.sites(targets, to_tcp))

"""Measures, each whole in a file of its own, listed here once.

To add one: a file with its ``Measure``, and its line in ``MEASURES``.  What scores, simulates, judges and reports asks
for them here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple

from . import angle, axial, component, corridor, lateral, localisation, point_to_point, rigid_body, tcp
from .measure import Measure, Measured, Site

MEASURES: tuple[Measure, ...] = (
    tcp.MEASURE,
    localisation.MEASURE,
    lateral.MEASURE,
    axial.MEASURE,
    angle.MEASURE,
    corridor.MEASURE,
    *component.MEASURES,
    point_to_point.MEASURE,
    *rigid_body.MEASURES,
    *axial.ONE_SIDED,
    *component.ONE_SIDED,
)
POINTS = MEASURES[:2]  # the errors at one target, in the order in which the simulation has them
MEASURE = {measure.name: measure for measure in MEASURES}
POINT_ERRORS = tuple(measure.name for measure in POINTS)
STATED = tuple(measure for measure in MEASURES if not measure.side)  # as requirements name them
PointError = Literal["tcp", "localisation"]
if TYPE_CHECKING:
    MeasureName = str
    StatedName = str
else:
    MeasureName = Literal[tuple(MEASURE)]
    StatedName = Literal[tuple(measure.name for measure in STATED)]


class Metric(NamedTuple):
    """A measure at one of its sites."""

    measure: Measure
    site: Site

    @property
    def key(self) -> tuple[str, str]:
        """Names of the site and of the measure."""
        return self.site.name, self.measure.name


def metrics_of(design: Measured) -> tuple[Metric, ...]:
    """Every measure wherever it is read: ``POINTS`` target by target, then the others."""
    of_points = zip(*(measure.sites(design) for measure in POINTS), strict=True)
    points = [Metric(*each) for sites in of_points for each in zip(POINTS, sites, strict=True)]
    return (*points, *derived_of(design))


def derived_of(design: Measured) -> tuple[Metric, ...]:
    """Of ``metrics_of`` those of other measures than ``POINTS``, which are the last."""
    return tuple(Metric(measure, site) for measure in MEASURES[len(POINTS) :] for site in measure.sites(design))

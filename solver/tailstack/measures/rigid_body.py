"""Errors of a rigid body, a named cluster of targets: of the rigid motion that fits its points as they come out.

Against another body they are what is left of them when that one, fitted likewise, is put back to where it was planned.
"""

from __future__ import annotations

from .measure import Measure, Measured, Site, Sites

FITTED = "of the rigid motion that fits the points of a body"
FARTHEST = "it is that of the point farthest from the centroid, and the largest is no less: another may have more"
AGAINST = "what both bodies have in common cancels in the estimate"


def sites_of(name: str) -> Sites:
    """Where a measure of bodies is read: at every body."""

    def sites(design: Measured) -> tuple[Site, ...]:
        from .rigid_fit import BodyFit

        doubts = [FARTHEST if name == "worst_point" else AGAINST if body.against else "" for body in design.bodies]
        pairs = zip(design.bodies, doubts, strict=True)
        return tuple(BodyFit(design, body).site(name, doubt) for body, doubt in pairs)

    return sites


def measure_bodies(name: str, words: str, meaning: str, unit: str = "mm") -> Measure:
    """A measure of every body."""
    return Measure(
        name=name,
        words=words,
        brief=f", {name.replace('_', ' ')}",
        meaning=f"{meaning}, everything included",
        frame="tcp",
        sites=sites_of(name),
        needs="bodies: [{name: ..., targets: [three or more]}] of the design, and those targets or its name",
        unit=unit,
    )


MEASURES = (
    measure_bodies("rotation", "the rotation of the body", f"rotation {FITTED}", "deg"),
    measure_bodies("translation", "the translation of the body", f"shift of the centroid {FITTED}"),
    measure_bodies(
        "worst_point",
        "the error of the body's worst point",
        "largest error of any point of a body, in radiostereometry MTPM",
    ),
)

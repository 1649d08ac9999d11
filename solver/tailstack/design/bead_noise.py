"""Noise of the images of beads from what makes it: quanta, contrast, size, focal spot and pixels."""

from __future__ import annotations

from math import pi
from typing import Annotated

import numpy as np
from pydantic import Field

from ..errors import DesignError, Problem
from ..fields import Length, Pixels, Record, exactly_one
from ..geometry.arrays import Array
from ..geometry.camera import depths, intrinsics_of
from ..ranges import BALL_MM, AnySize

MARGIN_PX = 1.0  # of background that the centroid takes in around a shadow with its penumbra
LEAST_FOUND = 10.0  # signal of a shadow over the noise in its window: of less the formula is not meant


class BeadNoise(Record):
    """What the noise of a bead's centroid follows from, in place of a number."""

    model_config, _one_level = exactly_one("snr", "counts", needed="snr: 30")

    diameter_mm: Annotated[Length, BALL_MM] = Field(examples=[3.0])
    """Diameter of the beads, mm; not a shift of their images, which is fiducials.diameter_mm."""
    contrast: Annotated[float, Field(ge=1e-3, le=1), AnySize("its domain is what anybody means")] = Field(
        examples=[0.3]
    )
    """Share of the background that the shadow of a bead takes away, on average over the shadow."""
    snr: Annotated[float, Field(ge=0.1, le=1e5), AnySize("a ratio of any size")] | None = Field(
        default=None, examples=[30.0]
    )
    """Mean of a pixel of the background over its standard deviation. Give either this or counts."""
    counts: Annotated[float, Field(ge=0.01, le=1e10), AnySize("a number of quanta of any size")] | None = Field(
        default=None, examples=[900.0]
    )
    """Quanta that a pixel of the background detects in an image: its snr squared. At 70 kV some 30,000 per mm^2 and
    microgray at the detector, times its quantum efficiency and the area of a pixel."""
    focal_spot_mm: Annotated[float, Field(ge=0, le=10), AnySize("0 to 2 mm, which its domain says")] | None = Field(
        default=None, examples=[0.6]
    )
    """Width of the focal spot, mm: its penumbra grows with the magnification. The view has to say how far its detector
    is. Default 0."""
    other_px: Pixels | None = Field(default=None, examples=[0.05])
    """Standard deviation of what quanta do not explain, anatomy behind a bead and the software, px; added in squares.
    Default 0."""


def bead_noise(section: BeadNoise, projection: Array, fiducials_mm: Array, detector_mm: float, pointer: str) -> Array:
    """(3, n) px per coordinate: what quanta, the grid of pixels and the rest give each fiducial (n, 3), mm, con.

    Of a shadow of radius r px and mean contrast C, blurred by a penumbra of width w, the centroid of ``background -
    image`` over a window of radius R has the variance ``(pi R^4 / 4 - C A (r^2 / 4 + w^2 / 16)) / (B C^2 A^2)``, A = pi
    r^2, B counts a pixel: Poisson's, weighed by the squared distance, over the square of the shadow's mass.  (For a
    window as wide as the shadow these are the limits of Zhang 2015, doi:10.4236/ijmpcero.2015.44033.)  The grid pulls a
    centroid by ``s / pi`` times the sine of its phase, s the Fourier transform of the shadow, a disc blurred by a disc,
    at one cycle a pixel: its square on average over phases and radii.  Raises DesignError.
    """
    spot, other = section.focal_spot_mm or 0.0, section.other_px or 0.0
    if spot and not np.isfinite(detector_mm):
        cure = "leave focal_spot_mm out, or give the view by its distances"
        detail = "the penumbra needs the distance of the detector, which this view does not state"
        raise DesignError(Problem(f"{pointer}/focal_spot_mm", "missing-field", detail, cure))
    camera = intrinsics_of(projection)
    focal = (camera[0] + camera[2]) / 2
    depth = depths(projection, fiducials_mm)
    scale = focal / depth[depth > 0]  # px per mm; what lies behind the source is refused elsewhere
    snr = section.snr or (section.counts or 0.0) ** 0.5
    radius, penumbra = section.diameter_mm / 2 * scale, spot * np.maximum(scale - focal / detector_mm, 0.0)
    window, shadow = radius + penumbra / 2 + MARGIN_PX, pi * radius**2
    found = section.contrast * snr * shadow / (pi**0.5 * window)
    if found.size and found.min() < LEAST_FOUND:
        detail = (
            f"the shadow of a bead, {2 * radius.min():.3g} px wide, is {found.min():.2g} times the noise of what lies "
            f"in its window; a centroid needs {LEAST_FOUND:g}"
        )
        raise DesignError(Problem(pointer, "bead-not-found", detail, "a larger bead, or more contrast or snr"))
    moment = pi * window**4 / 4 - section.contrast * shadow * (radius**2 / 4 + penumbra**2 / 16)
    quanta = moment**0.5 / (snr * section.contrast * shadow)
    grid = (2 / pi**3 / (2 * pi * radius) ** 3 * np.exp(-((pi * penumbra) ** 2) / 4)) ** 0.5
    return np.array([quanta, grid, np.full(len(scale), other)])


def describe_noise(name: str, parts: Array) -> tuple[float, str]:
    """The root mean square over fiducials of (3, n) px, to four digits, and a sentence about it."""
    each = (parts**2).sum(axis=0) ** 0.5
    quanta, grid, other = (float((part**2).mean()) ** 0.5 if part.size else 0.0 for part in parts)
    if not each.size:
        return other, ""
    mean = float(f"{float((each**2).mean()) ** 0.5:.4g}")
    words = f"{mean:.4g} px, the root mean square over beads ({each.min():.4g} to {each.max():.4g})"
    causes = f"quanta {quanta:.2g}, pixel grid {grid:.2g}, other {other:.2g} px"
    return mean, f"fiducial noise of {name}: {words}; of {causes}"

"""What ISO 16087 asks for beside a migration, field by field."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from .verdicts import Vector3

Profile = Literal["rsa"]


@dataclass(frozen=True, slots=True)
class DoubleExaminations:
    """What two examinations come out to differ by where nothing has moved; x, y, z in tcp."""

    rotation_deg: Vector3
    """Precision of the rotation about x, y and z: 1.96 standard deviations of its difference, deg."""
    translation_mm: Vector3
    """Precision of the translation of the markers' centroid along x, y and z, likewise, mm."""
    fitting_error_mm: float
    """Mean error of rigid-body fitting of the body's own markers: root mean square of what their distances change, mm.
    """
    mtpm_mean_mm: float | None
    """Mean of the maximum total point motion, mm; null to first order, which has no largest point."""
    mtpm_p95_mm: float | None
    """The same: what 95 % of double examinations keep, mm."""


@dataclass(frozen=True, slots=True)
class MarkerModel:
    """A body as radiostereometry knows it, by its markers."""

    body: str
    """Name of the body."""
    against: str | None
    """Name of the body that its movement is read against; null: against the cage."""
    markers: int
    """How many."""
    condition_number_per_m: float
    """Of the markers, 1/m: the smaller, the better they are spread."""
    estimate: DoubleExaminations
    """To first order."""
    simulated: DoubleExaminations | None
    """By pairs of simulated examinations; null: none were drawn."""
    simulated_from: DoubleExaminations | None
    """Lower ends of the intervals of 95 % of what was simulated."""
    simulated_to: DoubleExaminations | None
    """Their upper ends."""


@dataclass(frozen=True, slots=True)
class CrossingLines:
    """The shortest distance of the two rays that see a marker, everything drawn, to first order."""

    target: str
    """Name of the marker."""
    views: tuple[str, str]
    """Names of the views."""
    mean_mm: float
    """Expected distance, mm, of a normal law with this root mean square."""
    rms_mm: float
    """Root of its mean square, mm."""


@dataclass(frozen=True, slots=True)
class Radiostereometry:
    """The numbers that ISO 16087 asks for beside a migration."""

    bodies: tuple[MarkerModel, ...]
    """Every body of the design."""
    crossing_lines: tuple[CrossingLines, ...]
    """Every marker of a body in every two views."""
    drawn_anew: tuple[str, ...]
    """Sources of error that are drawn anew at the second examination."""
    kept: tuple[str, ...]
    """Those that are drawn once per unit, and are the same at both."""
    pairs: int | None
    """Double examinations that were simulated; null: none."""

"""A system under the conditions of a published cell: its noise, its known installation error, no tolerances."""

from __future__ import annotations

from dataclasses import replace
from math import radians, sqrt

import numpy as np

from ..system import System, no_sources
from .published import Setting


def nominal(system: System) -> System:
    """The geometry alone: no installation error, no tolerances, manufacturing errors or execution; its image noise."""
    still = np.zeros(6)
    exact = np.zeros_like(system.fiducials_mm)
    for array in (still, exact):
        array.setflags(write=False)
    mounts = {
        name: replace(getattr(system, name), bias=still, sources=no_sources(6))
        for name in ("interface_1", "interface_2", "hand_eye")
    }
    shift = np.zeros(3)
    shift.setflags(write=False)
    return replace(
        system, manufacturing_half_width_mm=exact, execution_bias_mm=shift, execution=no_sources(3), requirements=(),
        **mounts,
    )  # fmt: skip


def with_noise(system: System, noise_px: float) -> System:
    """The same noise on every fiducial and target image, px per coordinate."""
    views = tuple(replace(view, fiducial_noise_px=noise_px, target_noise_px=noise_px) for view in system.views)
    return replace(system, views=views)


def with_installation(system: System, rotation_deg: float, translation_mm: float) -> System:
    """A known installation error of the structure about its pivot: ``rotation_deg`` in each of the three angles of
    Eq 12, and a translation of this length along (1, 1, 1)."""
    bias = np.array([radians(rotation_deg)] * 3 + [translation_mm / sqrt(3.0)] * 3)
    bias.setflags(write=False)
    return replace(system, interface_1=replace(system.interface_1, bias=bias))


def under(system: System, setting: Setting) -> System:
    """A nominal system under the conditions of a cell."""
    return with_noise(with_installation(system, setting.rotation_deg, setting.translation_mm), setting.noise_px)

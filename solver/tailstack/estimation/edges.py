"""Where the geometry determines no answer; a file of its own, so that kernels reach no more than they use."""

from __future__ import annotations

TOUCHING_MM = 1e-3  # two fiducials closer than this are one
COLLINEAR = 1e-5  # second over first singular value of the centred fiducials
COPLANAR = 1e-5  # third over first
SINGULAR = 1e-6  # second smallest over largest singular value of the normalised design matrix
NO_PARALLAX = 1e-4  # sine of the angle between two rays
THICK = 0.3  # thickness over width, above which a structure's images allow no mirrored pose

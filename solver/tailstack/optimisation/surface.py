"""Regions near a surface of triangles, and a smooth function that stands for the distance in the programme.

The distance from triangles has kinks at their edges, over which a solver does not go.  The programme has a cubic spline
in its place, on a grid over the region: of the signed distance where a side is asked for, else of the squared one,
which is smooth through the surface.  How far the spline is off at a fiducial is corrected from solve to solve, as the
closed form of a quantile is corrected to the exact law: what is kept in the end is the distance itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.ndimage import distance_transform_edt, spline_filter

from ..geometry.arrays import Array
from ..geometry.mesh import Mesh

NODES = 60_000  # of the grid
BAND = 3.0  # steps of the grid about the region in which the distance is that from triangles
ROUNDS = 8  # in which a point is brought to its distance
INSET_MM = 1e-5  # of the programme's distances: what rounding to 1e-6 mm, and a solver, may add


@dataclass(frozen=True, eq=False)
class NearSurface:
    """Points at such a distance from a surface, on one side of it or on both."""

    mesh: Mesh  # con, mm; closed and counterclockwise from outside where a side is asked for
    most_mm: float
    least_mm: float = 0.0
    side: int = 0  # 1: outside, -1: inside, 0: both

    def measure(self, points: Array, *, roughly: bool = False) -> tuple[Array, Array, Array]:
        """How far points (M, 3) are from the surface, below zero on the other side than is asked for, mm (M,); what is
        nearest there (M, 3), and the unit direction away from it (M, 3)."""
        near = self.mesh.nearest(points, roughly=roughly)
        offset = points - near.at_mm
        outside = np.where((offset * near.normal).sum(axis=1) >= 0, 1.0, -1.0)
        sign = outside * self.side if self.side else np.ones(len(points))
        size = near.distance_mm[:, None]
        normal = near.normal * (self.side or 1)
        away = np.where(size > 1e-9, sign[:, None] * offset / np.where(size > 0, size, 1.0), normal)
        return sign * near.distance_mm, near.at_mm, away

    def clip(self, points: Array) -> Array:
        """(M, 3) points of the region near to points (M, 3); the nearest ones where only the upper distance binds."""
        placed = points.copy()
        for _ in range(ROUNDS):
            distance, at, away = self.measure(placed)
            out = (distance > self.most_mm) | (distance < self.least_mm)
            if not out.any():
                break
            wanted = np.clip(distance, self.least_mm, self.most_mm)
            placed[out] = (at + wanted[:, None] * away)[out]
        return placed

    def sample(self, rng: np.random.Generator, count: int, on_surface: float) -> Array:
        """(count, 3) random points: even over the triangles, and over the distances or at the largest."""
        areas = self.mesh.areas_mm2
        which = rng.choice(len(areas), count, p=areas / areas.sum())
        weights = rng.dirichlet([1.0, 1.0, 1.0], count)
        on = (weights[:, :, None] * self.mesh.places_mm[which]).sum(axis=1)
        deep = rng.uniform(self.least_mm, self.most_mm, count)
        deep = np.where(rng.random(count) < on_surface, self.most_mm, deep)
        sign = np.full(count, self.side) if self.side else rng.choice([-1, 1], count)
        return self.clip(on + (sign * deep)[:, None] * self.mesh.normals[which])

    @property
    def box_mm(self) -> Array:
        """(2, 3) of the region, no narrower."""
        corners = self.mesh.corners_mm[np.unique(self.mesh.triangles)]
        out = 0.0 if self.side < 0 else self.most_mm
        return np.array([corners.min(axis=0) - out, corners.max(axis=0) + out])

    @cached_property
    def level(self) -> Any:
        """The spline, a CasADi function (3,) -> (): of the distance on the side that is asked for, or squared."""
        import casadi as ca  # regions are drawn in reports, which do without

        low, high = self.box_mm
        step, counts = (float(np.prod(high - low + 4 * self.most_mm)) / NODES) ** (1 / 3) / 1.2, np.full(3, NODES)
        while np.prod(counts) > 2 * NODES:
            step *= 1.2
            counts = np.ceil((high - low) / step).astype(int) + 5  # two steps more at each end
        axes = [a - 2 * step + step * np.arange(n) for a, n in zip(low, counts, strict=True)]
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        knots = [(axis[0] + step * (np.arange(len(axis) + 4) - 2)).tolist() for axis in axes]
        coefficients = spline_filter(self._level_on(nodes, step)).ravel("F").tolist()
        return ca.Function.bspline("level", knots, coefficients, [3, 3, 3], 1)

    def _level_on(self, nodes: Array, step: float) -> Array:
        """At the nodes (A, B, C, 3) of a grid, in a band about the region by the triangles, beyond it nearly."""
        distance = self.mesh.distance_about(nodes.reshape(-1, 3)).reshape(nodes.shape[:3])
        near = distance <= self.most_mm + BAND * np.sqrt(3) * step
        found = self.measure(nodes[near], roughly=True)[0]
        distance[near] = np.abs(found)
        if self.side == 0:
            return np.asarray(distance**2)
        signs = np.ones_like(distance)
        signs[near] = np.where(found < 0, -1.0, 1.0)
        # a straight way to the nearest node of the band does not cross the surface
        nearest = distance_transform_edt(~near, return_distances=False, return_indices=True)
        return np.asarray(signs[tuple(nearest)] * distance)

    def exact_level(self, points: Array) -> Array:
        """(M,) what the spline stands for at points (M, 3)."""
        distance = self.measure(points)[0]
        return distance if self.side else np.asarray(distance**2)

    @property
    def slope_mm(self) -> float:
        """What the level changes by for a mm at the largest distance."""
        return 1.0 if self.side else 2 * self.most_mm

    def rows(self, level: Any) -> list[tuple[str, Any, bool]]:
        """(name, expression, equality), as those of other regions, of a level."""
        power = 1 if self.side else 2
        low, high = self.least_mm + INSET_MM, self.most_mm - INSET_MM
        if high <= low:
            return [("distance", (level - ((low + high) / 2) ** power) / self.scale, True)]
        rows: list[tuple[str, Any, bool]] = []
        if self.least_mm > 0 or self.side:
            name = "smallest distance" if self.least_mm > 0 else "surface"
            rows.append((name, (level - low**power) / self.scale, False))
        return [*rows, ("largest distance", (high**power - level) / self.scale, False)]

    @property
    def scale(self) -> float:
        """What the rows are divided by."""
        return self.most_mm if self.side else self.most_mm**2

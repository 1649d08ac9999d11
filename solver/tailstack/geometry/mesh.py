"""Surfaces of triangles: what is nearest on them, on which side of them a point is, how far.

The side is that of the angle-weighted normal at the nearest point (Baerentzen and Aanaes 2005, Signed distance
computation using the angle weighted pseudonormal), which is right at edges and corners too.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .arrays import Array

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

PIECES = 20_000  # about so many a surface is looked up by
MOST_PIECES = 8 * PIECES
AT_ONCE = 200_000  # pairs of a point and a triangle
ROUGHLY, CANDIDATES = 6, 64  # pieces whose triangles are looked at; where more could be nearest, all are
ON_EDGE = 1e-9  # of a weight: a nearest point is on the edge, or at the corner


class Edges(NamedTuple):
    """How the triangles of a surface meet."""

    open: NDArray[np.int64]  # (E, 2) corners of edges that one triangle has
    crossed: NDArray[np.int64]  # (F, 2) of edges that several have otherwise than two in opposite directions


class Nearest(NamedTuple):
    """Of M points."""

    at_mm: Array  # (M, 3) the nearest points of the surface
    distance_mm: Array  # (M,)
    normal: Array  # (M, 3) unit normal there, outwards; at an edge or corner weighted by angles


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface of triangles that have an area, counterclockwise as seen from outside; mm."""

    corners_mm: Array  # (V, 3)
    triangles: NDArray[np.int64]  # (T, 3) corners of each

    @cached_property
    def places_mm(self) -> Array:
        """(T, 3, 3) the corners of each triangle."""
        return self.corners_mm[self.triangles]

    @cached_property
    def area_normals(self) -> Array:
        """(T, 3) normals, as long as twice the areas."""
        a, b, c = np.moveaxis(self.places_mm, 1, 0)
        return np.cross(b - a, c - a)

    @property
    def normals(self) -> Array:
        """(T, 3) of unit length, outwards."""
        return np.asarray(self.area_normals / np.linalg.norm(self.area_normals, axis=1, keepdims=True))

    @property
    def areas_mm2(self) -> Array:
        return np.asarray(np.linalg.norm(self.area_normals, axis=1) / 2)

    @property
    def volume_mm3(self) -> float:
        """What a closed surface encloses; below zero where its triangles face inwards."""
        return float((self.places_mm[:, 0] * self.area_normals).sum() / 6)

    @cached_property
    def _sides(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
        """Edges (E, 2); of the sides opposite to the first corners, then the second, then the third (3T,): which edge
        each is, and whether it runs from the lower corner to the higher."""
        first, second = np.concatenate([self.triangles[:, [(k + 1) % 3, (k + 2) % 3]] for k in range(3)]).T
        edges, which = np.unique(np.sort([first, second], axis=0).T, axis=0, return_inverse=True)
        return edges, which.ravel(), first < second

    def find_edges(self) -> Edges:
        """Where it is no closed surface with one outside."""
        edges, which, rising = self._sides
        uses, up = np.bincount(which), np.bincount(which, rising)
        return Edges(edges[uses == 1], edges[(uses > 2) | ((uses == 2) & (up != 1))])

    def slice(self, axis: int, height_mm: float) -> list[Array]:
        """The lines (n, 3) along which a plane across x, y or z cuts it."""
        sides, which, _ = self._sides
        ends = self.corners_mm[sides]
        above = ends[:, :, axis] > height_mm
        cut = above[:, 0] != above[:, 1]
        part = (height_mm - ends[cut, 0, axis]) / (ends[cut, 1, axis] - ends[cut, 0, axis])
        at = np.zeros((len(sides), 3))
        at[cut] = ends[cut, 0] + part[:, None] * (ends[cut, 1] - ends[cut, 0])
        crossed = np.where(cut[which.reshape(3, -1)], which.reshape(3, -1), -1)
        pairs = np.sort(crossed, axis=0)[1:].T
        joined: dict[int, list[int]] = {}
        for one, other in pairs[pairs[:, 0] >= 0].tolist():
            joined.setdefault(one, []).append(other)
            joined.setdefault(other, []).append(one)
        lines = []
        for begin in sorted(joined, key=lambda edge: len(joined[edge]) != 1):  # open lines from their ends
            line, here = [begin], begin
            while joined[here]:
                there = joined[here].pop()
                joined[there].remove(here)
                line, here = [*line, there], there
            if len(line) > 1:
                lines.append(at[line])
        return lines

    def nearest(self, points_mm: Array, *, roughly: bool = False) -> Nearest:
        """What is nearest to points (M, 3); ``roughly``: on the triangles with the nearest centres."""
        pieces = len(self._owner)
        reach_mm = self._pieces[2] * (1 + 1e-9) + 1e-9  # how far a corner of a piece is from its centre at most
        count = min(ROUGHLY if roughly else CANDIDATES, pieces)
        at, triangle = np.empty_like(points_mm), np.empty(len(points_mm), dtype=np.int64)
        for first in range(0, len(points_mm), AT_ONCE // count):
            part = slice(first, first + AT_ONCE // count)
            away, found = self._tree.query(points_mm[part], np.arange(1, count + 1))
            at[part], triangle[part] = self._nearest_of(points_mm[part], self._owner[found])
            if roughly or count == pieces:
                continue
            # the triangle nearest to a point has a piece with its centre no further than the nearest centre and that
            for m in first + np.flatnonzero(away[:, -1] <= away[:, 0] + reach_mm):
                alone, every = slice(m, m + 1), np.arange(len(self.triangles))[None, :]
                at[alone], triangle[alone] = self._nearest_of(points_mm[alone], every)
        return Nearest(at, np.linalg.norm(points_mm - at, axis=1), self._normals_at(at, triangle))

    def _nearest_of(self, points_mm: Array, among: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
        """The nearest points of triangles (M, K), K for each point, and on which they are."""
        each = np.repeat(points_mm, among.shape[1], axis=0)
        at = _onto_triangles(each, self.places_mm[among.ravel()])
        best = ((at - each) ** 2).sum(axis=1).reshape(among.shape).argmin(axis=1)
        rows = np.arange(len(among))
        return at.reshape(*among.shape, 3)[rows, best], among[rows, best]

    @cached_property
    def _pieces(self) -> tuple[Array, NDArray[np.int64], float]:
        """Centres (P, 3) of triangles cut until they are alike in size, whose they are, how far a corner is at most."""
        places, owner = self.places_mm, np.arange(len(self.triangles))
        wanted = np.sqrt(float(self.areas_mm2.sum()) / PIECES)
        while True:
            sides = np.linalg.norm(np.roll(places, -1, axis=1) - places, axis=2)
            long = sides.max(axis=1) > 3 * wanted
            if not long.any() or len(places) + long.sum() > MOST_PIECES:
                break
            longest = sides[long].argmax(axis=1)
            turned = places[long][np.arange(long.sum())[:, None], (longest[:, None] + np.arange(3)) % 3]
            middle = turned[:, :2].mean(axis=1)
            halves = [
                np.stack([turned[:, 0], middle, turned[:, 2]], 1),
                np.stack([middle, *turned[:, 1:].swapaxes(0, 1)], 1),
            ]
            places, owner = np.concatenate([places[~long], *halves]), np.concatenate([owner[~long], *[owner[long]] * 2])
        centres = places.mean(axis=1)
        return centres, owner, float(np.linalg.norm(places - centres[:, None], axis=2).max())

    @cached_property
    def _tree(self) -> cKDTree:
        from scipy.spatial import cKDTree  # a second to import, and few designs name a surface

        return cKDTree(self._pieces[0])

    @property
    def _owner(self) -> NDArray[np.int64]:
        return self._pieces[1]

    def distance_about(self, points_mm: Array) -> Array:
        """(M,) distance of points (M, 3), too large by less than the size of a piece."""
        return np.asarray(self._tree.query(points_mm)[0])

    @cached_property
    def _bordering(self) -> tuple[Array, Array]:
        """(T, 3, 3) of each triangle: unit normals at its corners, by the angles there, and on the sides opposite."""
        normals, size = self.normals, np.linalg.norm(self.area_normals, axis=1)
        at_corners = np.zeros_like(self.corners_mm)
        for k in range(3):
            one, other = (self.places_mm[:, (k + n) % 3] - self.places_mm[:, k] for n in (1, 2))
            angle = np.arctan2(size, (one * other).sum(axis=1))
            np.add.at(at_corners, self.triangles[:, k], angle[:, None] * normals)
        which = self._sides[1].reshape(3, -1)
        on_sides = np.zeros((int(which.max()) + 1, 3))
        np.add.at(on_sides, which, normals)
        return _unit(at_corners)[self.triangles], _unit(on_sides)[which.T]

    def _normals_at(self, at_mm: Array, triangle: NDArray[np.int64]) -> Array:
        """(M, 3) at points of triangles."""
        at_corners, on_sides = self._bordering
        weights = _weights(at_mm, self.places_mm[triangle], self.area_normals[triangle])
        inner, rows = weights > ON_EDGE, np.arange(len(triangle))
        corner, side = at_corners[triangle][rows, inner.argmax(axis=1)], on_sides[triangle][rows, inner.argmin(axis=1)]
        count = inner.sum(axis=1)[:, None]
        return np.asarray(np.where(count == 3, self.normals[triangle], np.where(count == 2, side, corner)))


def _unit(rows: Array) -> Array:
    """Rows (M, 3) of unit length; those without a length stay."""
    size = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray(rows / np.where(size > 0, size, 1.0))


def _weights(at_mm: Array, places_mm: Array, area_normals: Array) -> Array:
    """(M, 3) of the corners of triangles (M, 3, 3) at points in their planes, or below and above them."""
    a, b, c = np.moveaxis(places_mm, 1, 0)
    size = (area_normals**2).sum(axis=1)
    first, second = ((np.cross(q - p, at_mm - p) * area_normals).sum(axis=1) / size for p, q in ((b, c), (c, a)))
    return np.stack([first, second, 1 - first - second], axis=1)


def _onto_triangles(points_mm: Array, places_mm: Array) -> Array:
    """(M, 3) the points of triangles (M, 3, 3) that are nearest to points (M, 3)."""
    a, b, c = np.moveaxis(places_mm, 1, 0)
    weights = _weights(points_mm, places_mm, np.cross(b - a, c - a))
    onto = (weights[:, :, None] * places_mm).sum(axis=1)
    outside = (weights < 0).any(axis=1)
    sides = [_onto_segment(points_mm[outside], p[outside], q[outside]) for p, q in ((a, b), (b, c), (c, a))]
    away = [((side - points_mm[outside]) ** 2).sum(axis=1) for side in sides]
    onto[outside] = np.choose(np.argmin(away, axis=0)[:, None], sides)
    return np.asarray(onto)


def _onto_segment(points_mm: Array, start: Array, end: Array) -> Array:
    along = end - start
    part = ((points_mm - start) * along).sum(axis=1) / (along**2).sum(axis=1)
    return np.asarray(start + np.clip(part, 0, 1)[:, None] * along)

"""How good any layout could be, whichever way free views look: boxes of directions, halved where least is known.

A view that is turned about its isocentre c sees a point x where it saw ``c + Q (x - c)`` before, Q a rotation, and one
whose source is d mm further away as if x were d mm further along the beam.  So unknowns z are chosen at the middle of a
box of directions, in the view's own frame, and are carried along with it: in every direction of the box they are
unknowns of the same target part, and any bound what layouts know (``global_bound``).  What beads and the target's own
images (F0) tell of them is enclosed over cells and box together: an image's displacement by its tangent in the place of
the bead and in the direction, and a bound of the rest (``enclosure``).  That is convex in both, and so are the largest
of a cell, the sum of the N largest cells and its sum with F0: the most is at a corner of the box, one direction for all
beads.

*The rest.*  Of a view turned by a vector p (its axis, as long as the angle) ``Q = exp(p0) exp(-p)``.  Its slopes are
those of the left Jacobian at p0, and its tangent is off by at most ``|p - p0|^2 / 2``: the second derivative of the
exponential of a skew matrix along u averages products of rotations with u twice.

*Halving.*  The box whose bound of the mean square is least is halved across its widest side until that bound is near
the least of single directions, or the budget is spent.  Every box that is left counts: along each direction of a net
the most that is known in any, of the mean square the least of any.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from heapq import heappop, heappush
from math import hypot, inf, radians, sqrt
from typing import NamedTuple

import numpy as np

from ..design import Design, compile_design
from ..design.optimise_document import FreeView
from ..geometry.arrays import Array
from ..geometry.rotation import displacement, left_jacobian, rigid_transform, rigidity_defect, skew, turn_by, unit
from ..results.digits import number
from ..system import Reading, System
from .global_bound import (
    AS_THEY_LOOK,
    INSIDE,
    AsTheyLook,
    ImagesBound,
    Information,
    Looks,
    NoBound,
    cells_in,
    counts_manufacturing,
    covariance_in,
    even_information,
    information_about,
    mix_layouts,
    most_known,
    net_through,
    root_of,
    slopes_by_images,
    spread_directions,
    still,
    target_information,
    why_none,
)
from .mixture import information_by_rows
from .problem import PlacementProblem
from .terms import DemandTerms
from .views import find_view, present_distance

MOST_NUMBERS = 4  # that turn views or move their sources: all corners of them are counted together
LEAST_BOXES, PER_START, MOST_BOXES = 12, 3, 48  # looked into: more beside a longer search
NEAR = 0.02  # of a root mean square, to the least of single directions
ROUNDS = 12  # layouts that are added to the mixture of a box
FREQUENCY = 2  # of the net of directions of errors
ROUNDED = 4e-6  # rad by which six decimals of the directions that are written turn a view, and more
RIGID = 1e-9


class FreeAim(NamedTuple):
    """How one view may be aimed, by two turns, rad, where it has a cone, and one distance, mm, where that is free."""

    view: str
    projection: Array  # (3, 4) as it is written
    beam: Array  # (3,) unit vector, con
    axes: Array  # (2, 3) con, about which it turns to the right and up
    isocentre_mm: Array  # (3,)
    cone: float  # rad
    distance_mm: float  # of its source as it is written
    distances_mm: tuple[float, float] | None  # between which it may be
    words: str

    @property
    def bounds(self) -> Array:
        """(n, 2) the least and the largest of its n numbers."""
        turns = [(-self.cone, self.cone)] * 2 if self.cone else []
        return np.array([*turns, *([self.distances_mm] if self.distances_mm else [])])

    @property
    def sizes(self) -> Array:
        """(n,) by which their widths are compared."""
        return np.array([*([1.0] * 2 if self.cone else []), *([self.distance_mm] if self.distances_mm else [])])

    def turn_at(self, numbers: Array) -> Array:
        """(3,) the vector by which numbers (n,) turn it, con, rad."""
        return np.asarray(numbers[:2] @ self.axes if self.cone else np.zeros(3))

    def sees_at(self, numbers: Array) -> Array:
        """(4, 4): where the view as it is written sees the points that this one, so aimed, sees; con."""
        back = turn_by(-self.turn_at(numbers))
        away = numbers[-1] - self.distance_mm if self.distances_mm else 0.0
        return rigid_transform(back, self.isocentre_mm - back @ self.isocentre_mm + away * self.beam)

    def holds(self, at: Array, half: Array) -> bool:
        """Whether some of a box of numbers is within the cone."""
        return not self.cone or hypot(*np.maximum(np.abs(at[:2]) - half[:2], 0.0)) <= self.cone


def read_looks(design: Design, starts: int) -> Looks:
    """How the views of a design may look, and how long that is searched beside a search from so many starts."""
    section = design.document.optimise
    if section is None or not section.free_views:
        return AS_THEY_LOOK
    system = compile_design(design)
    aims = tuple(_read_aim(design, system, free) for free in section.free_views)
    if sum(len(aim.bounds) for aim in aims) > MOST_NUMBERS or rigidity_defect(_seat_of(system)[:3, :3]) > RIGID:
        return AsTheyLook("views as these were aimed (no bound over what else they may look at)")
    return AimedViews(aims, min(MOST_BOXES, LEAST_BOXES + PER_START * starts))


def _read_aim(design: Design, system: System, free: FreeView) -> FreeAim:
    _, view = find_view(design, free.view)
    limits = free.source_isocentre_mm
    beam, words = unit(np.array(view.beam, dtype=float)), []
    right = unit(np.cross(beam, view.up_direction))
    if free.cone_deg:
        words.append(f"over all directions of {free.view} within cone_deg {free.cone_deg:g}")
    if limits is not None:
        words.append(f"over all distances of its source from {limits[0]:g} to {limits[1]:g} mm")
    return FreeAim(
        free.view,
        next(each.projection for each in system.views if each.name == free.view),
        beam,
        np.cross(beam, [right, np.cross(right, beam)]),
        np.array(view.isocentre_mm),
        radians(free.cone_deg),
        present_distance(design, free.view),
        None if limits is None else (limits[0], limits[1]),
        " and ".join(words),
    )


def solve_along(information: Array, directions: Array) -> Array:
    """(K, D): of information (D, D) the least ``z' F z`` whose target part is a direction, for each of (K, 3)."""
    rest = -np.linalg.solve(information[3:, 3:], information[3:, :3] @ directions.T).T
    return np.concatenate([directions, rest], axis=1)


def _seat_of(system: System) -> Array:
    """(4, 4) through which every view sees at the known error of the seat (``estimator_geometry``)."""
    mount = system.structure_connector
    first = displacement(mount.known, mount.pivot_mm, system.rotation_form).matrix()
    return first if system.reading is Reading.PHYSICAL else np.asarray(np.linalg.inv(first))


@dataclass(slots=True, eq=False)
class AimBox:
    """Ways to aim, and what no layout undercuts in any of them."""

    at: Array  # (P,) numbers of its middle
    half: Array  # (P,) its half extents
    least: float = 0.0  # bound of the mean square that is branched by, mm^2 of the error
    alone: float = inf  # about the least of its middle alone
    known: float = inf  # what any layout knows of z, together
    seen: Array = field(default_factory=lambda: np.zeros((3, 3)))  # (A, 3) target parts of z
    mixture: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (D, D) information of a good mixture of layouts

    def bound(self, weight: Array) -> float:
        """mm^2 that ``trace(weight S)`` of no layout is below, weight (3, 3): by the best of its roots for z."""
        return float(np.linalg.svd(self.seen @ root_of(weight), compute_uv=False).sum() ** 2 / self.known) * INSIDE


@dataclass(frozen=True, slots=True, eq=False)
class AimedViews:
    """Views that may look elsewhere."""

    aims: tuple[FreeAim, ...]
    most: int  # boxes that are looked into
    found: dict[tuple[float, ...], ImagesBound] = field(default_factory=dict)  # of each target

    @property
    def words(self) -> str:
        return f"other views, {' and '.join(aim.words for aim in self.aims)}"

    def bound_images(self, problem: PlacementProblem, term: DemandTerms, half_width: Array) -> ImagesBound:
        if reason := why_none(problem, term):
            raise NoBound(reason)
        count = len(problem.system.fiducial_labels)
        key = (*term.reconstructed_mm[0].tolist(), counts_manufacturing(problem, term), count)
        if key not in self.found:
            self.found[key] = self._bound(problem, term, half_width)
        return self.found[key]

    def _bound(self, problem: PlacementProblem, term: DemandTerms, half_width: Array) -> ImagesBound:
        bounds = np.concatenate([aim.bounds for aim in self.aims])
        root = AimBox(bounds.mean(axis=1), np.diff(bounds)[:, 0] / 2)
        information = self.aim(problem, term.reconstructed_mm[0], root, every_law=True)
        metric = covariance_in(even_information(information, cells_in(information)))
        felt = slopes_by_images(term, half_width, term.to_error @ metric @ term.to_error.T)
        weight = term.to_error.T @ felt @ term.to_error
        boxes, looked = self._halve(root, lambda box: self._look(box, problem, term, weight))
        points, faces = spread_directions(FREQUENCY)
        directions = points @ np.linalg.cholesky(covariance_in(min(boxes, key=lambda box: box.alone).mixture)).T
        known = np.max([self._know(box, problem, term, directions) for box in boxes], axis=0)
        above = 100 * (sqrt(min(box.alone for box in boxes) / boxes[0].least) - 1)
        remark = f" {looked} boxes of what views may look at were looked into"
        if looked >= self.most:
            remark += f"; more might raise what is said of the root mean square by up to {number(above, 2)} %"
        net = net_through(directions, faces, known, metric)
        return ImagesBound(net, lambda other: min(box.bound(other) for box in boxes), f"{remark}.")

    def _halve(self, root: AimBox, look: Callable[[AimBox], None]) -> tuple[list[AimBox], int]:
        """What is left of a box, that with the least bound first, and how many were looked into."""
        look(root)
        sizes = np.concatenate([aim.sizes for aim in self.aims])
        heap, looked, best = [(root.least, 0, root)], 1, root.alone
        while looked < self.most and sqrt(heap[0][0] / best) < 1 - NEAR:
            above = heappop(heap)[2]
            side = (np.arange(len(sizes)) == (above.half / sizes).argmax()) * above.half / 2
            for middle in (above.at - side, above.at + side):
                box = AimBox(middle, above.half - side, above.least)
                if self._cones_hold(box.at, box.half):
                    look(box)
                    looked += 1
                    best = min(best, box.alone)
                    heappush(heap, (box.least, looked, box))
        if heap[0][0] == 0:
            raise NoBound(f"{looked} boxes of what views may look at are too wide for one")
        return [box for _, _, box in sorted(heap)], looked

    def _cones_hold(self, at: Array, half: Array) -> bool:
        parts = np.cumsum([len(aim.bounds) for aim in self.aims])[:-1]
        each = zip(self.aims, np.split(at, parts), np.split(half, parts), strict=True)
        return all(aim.holds(middle, wide) for aim, middle, wide in each)

    def _look(self, box: AimBox, problem: PlacementProblem, term: DemandTerms, weight: Array) -> None:
        """Choose z for a box, and bound the mean square of a weight (3, 3) there."""
        information = self.aim(problem, term.reconstructed_mm[0], box, every_law=True)
        cells, base = cells_in(information), target_information(information)
        aims = root_of(weight)
        z, held = mix_layouts(information, cells, aims, ROUNDS)
        box.seen, box.mixture = z[:, :3], base.copy()
        told = float(np.einsum("kd,de,ke->", z, base, z))
        for group, share in zip(cells, held, strict=True):
            box.mixture += information_by_rows(group.slopes, share)
            told += float(group.most(group.told_along(z).sum(axis=1, keepdims=True))[0])
        if self._cones_hold(box.at, 0.0 * box.half):
            box.alone = float((aims.T * box.seen).sum()) ** 2 / told
        try:
            box.known = float(most_known(information, cells, z, together=True)[0])
        except NoBound:  # the box reaches the source of a view
            return
        box.least = max(box.least, box.bound(weight))

    def _know(self, box: AimBox, problem: PlacementProblem, term: DemandTerms, directions: Array) -> Array:
        """(n,) the most that any layout knows in a box along directions (n, 3)."""
        information = self.aim(problem, term.reconstructed_mm[0], box, counts_manufacturing(problem, term))
        return most_known(information, cells_in(information), solve_along(box.mixture, directions))

    def aim(self, problem: PlacementProblem, target: Array, box: AimBox, every_law: bool) -> Information:
        """What images can tell of a target (3,) mm in any way to aim that a box holds."""
        seat = _seat_of(problem.system)
        back, views, first = np.linalg.inv(seat), list(problem.system.views), 0
        names, ways, spins, owners = [view.name for view in views], [], [], []
        turns = still(len(views))
        for aim in self.aims:
            v, own = names.index(aim.view), slice(first, first := first + len(aim.bounds))
            numbers, half = box.at[own], box.half[own]
            views[v] = replace(views[v], projection=aim.projection @ aim.sees_at(numbers))
            turns.pivots_mm[v] = back[:3, :3] @ aim.isocentre_mm + back[:3, 3]
            turns.bent[v] = (half[:2] ** 2).sum() / 2 + ROUNDED if aim.cone else ROUNDED
            turn = left_jacobian(aim.turn_at(numbers))
            beam = turn_by(aim.turn_at(numbers)) @ aim.beam
            for k, wide in enumerate(half):
                way = np.zeros((4, 4))
                if aim.cone and k < 2:
                    way[:3, :3] = -skew(turn @ aim.axes[k]) * wide
                    way[:3, 3] = -way[:3, :3] @ aim.isocentre_mm
                else:
                    way[:3, 3] = beam * wide
                ways.append((back @ way @ seat)[:3])
                spins.append(np.ascontiguousarray(ways[-1][:, :3]))
                owners.append(v)
        turns = turns._replace(ways=np.array(ways), spins=np.array(spins), of_view=np.array(owners, dtype=np.int64))
        aimed = replace(problem, system=replace(problem.system, views=tuple(views)))
        return replace(information_about(aimed, target, every_law), turns=turns)

"""Layouts to compare with: as a careless designer might draw them, and as a textbook would."""

from __future__ import annotations

from itertools import product

import numpy as np

from tailstack.geometry.arrays import Array
from tailstack.optimisation.problem import PlacementProblem
from tailstack.optimisation.regions import BoxRegion, Cylinder, across_axis, distinct, sample
from tailstack.optimisation.starts import BATCHES, CANDIDATES, keep_rules, put_apart, spacing_of, with_copies
from tailstack.optimisation.terms import DemandTerms

SEEDS = 0xCA7E  # keeps these seeds apart from those of the starts


def careless_layouts(problem: PlacementProblem, terms: tuple[DemandTerms, ...], count: int, seed: int) -> list[Array]:
    """Up to ``count`` layouts (N, 3) mm as a careless designer might draw them: random, but within every rule.

    Fiducials are drawn uniformly in their regions one after the other, and again where one breaks a rule.  Fewer
    are returned when the rules are too tight for that.  Layout k depends on (seed, k) alone.
    """
    groups = np.array([place.fiducials for place in problem.places], dtype=np.int64)
    regions, which = distinct(place.region for place in problem.places)
    projections, layouts = problem.estimation.projections, []
    for k in range(count):
        rng = np.random.default_rng([seed, SEEDS, k])
        for _ in range(BATCHES):
            pools = []
            for region in regions:
                drawn = with_copies(problem, sample(region, rng, 4 * CANDIDATES, 0.0))
                pools.append(drawn[keep_rules(problem, terms, region, drawn)])
            own = [pools[r] for r in which]
            tried, orders = [problem.estimation.assume(pool) for pool in own], [np.arange(len(pool)) for pool in own]
            assumed = problem.estimation.assume(problem.system.fiducials_mm)
            chosen = put_apart(groups, tried, orders, assumed, projections, spacing_of(problem), anyway=False)
            if chosen is not None:
                layout = problem.system.fiducials_mm.copy()
                for group, pool, c in zip(groups, own, chosen, strict=True):
                    layout[group] = pool[c]
                layouts.append(layout)
                break
    return layouts


def textbook_layout(problem: PlacementProblem) -> tuple[str, Array] | None:
    """What a textbook would do with the free fiducials, as (name, layout (N, 3) mm), or None where it has no answer.

    One box for all: its corners, then midpoints of edges, centres of faces, its centre; six or seven leave out opposite
    corners.  One cylinder for all: two rings at its ends.  It may break rules.
    """
    regions, _ = distinct(place.region for place in problem.places)
    free = list(problem.free_fiducials)
    if len(regions) != 1 or problem.symmetry or len(free) < 6:
        return None
    region = regions[0]
    made = None
    if isinstance(region, BoxRegion):
        made = _on_lattice(region, len(free))
    elif isinstance(region, Cylinder):
        made = _on_rings(region, len(free))
    if made is None:
        return None
    layout = problem.system.fiducials_mm.copy()
    layout[free] = made[1]
    return made[0], layout


def _on_lattice(box: BoxRegion, count: int) -> tuple[str, Array] | None:
    """Up to 27 points (count, 3) of a box: opposite ones follow each other."""
    if count > 27 or not (box.high_mm > box.low_mm).all():
        return None
    half = [point for point in product((-1, 0, 1), repeat=3) if point <= (0, 0, 0)]
    half.sort(key=lambda point: point.count(0))
    ordered = [sign * np.array(point) for point in half for sign in (1, -1)][:27]
    chosen = ordered[8 - count :][:count] if count < 8 else ordered[:count]
    names = (
        (8, "the corners of the box"),
        (20, "corners and edges of the box"),
        (26, "corners, edges and faces of the box"),
    )
    name = next((text for most, text in names if count <= most), "corners, edges, faces and centre of the box")
    return name, (box.low_mm + box.high_mm) / 2 + (box.high_mm - box.low_mm) / 2 * np.array(chosen)


def _on_rings(cylinder: Cylinder, count: int) -> tuple[str, Array] | None:
    """Half of the points (count, 3) on each rim, one ring turned by half a step."""
    if cylinder.height_mm <= 0:
        return None
    across = np.array(across_axis(cylinder.axis))
    rings = []
    for size, along, turn in (((count + 1) // 2, 0.0, 0.0), (count // 2, cylinder.height_mm, 0.5)):
        angle = 2 * np.pi * (np.arange(size) + turn) / size
        rim = cylinder.radius_mm * np.stack([np.cos(angle), np.sin(angle)], axis=1) @ across
        rings.append(cylinder.base_mm + along * cylinder.axis + rim)
    return "two rings at the ends of the cylinder", np.concatenate(rings)

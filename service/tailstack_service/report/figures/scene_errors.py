"""Errors as items of a scene: the bias as an arrow, the covariance as an ellipsoid, both magnified."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tailstack.arrays import Array
from tailstack.results import Score
from tailstack.system import System

from ...rendering.panels import round_step
from ...rendering.svg import printable
from .scene_records import Item, point, points_of
from .shapes import semi_axes

SHARE = 0.16  # of the layout's diagonal: the longest semi-axis or bias as drawn
MOST_ELLIPSOIDS = 6  # targets with the largest P95


def magnification_of(pairs: Sequence[tuple[System, Score]], radius: float) -> float:
    """1, 2 or 5 times a power of ten, so that the largest ellipsoid and bias can be seen and hide nothing."""
    sizes = [0.0]
    for _, score in pairs:
        for target in score.targets:
            sizes.append(float(np.linalg.norm(target.bias_mm)))
            sizes.append(float(np.linalg.norm(semi_axes(np.array(target.covariance_mm2))[0])))
    return round_step(SHARE * 2 * radius / max(sizes)) if max(sizes) > 1e-9 else 0.0


def errors(system: System, score: Score, magnification: float, called: str = "") -> list[Item]:
    """Bias and ellipsoid of the targets with the largest P95, one per region.

    ``called``: of a layout that another one is drawn over, what it is called; its errors have layers of their own.
    """
    if magnification == 0.0:
        return []
    suffix, when = ("-before", f"{called}: ") if called else ("", "")
    regions = {target.name: target.region or target.name for target in system.targets}
    places = {target.name: target.position_mm for target in system.targets}
    from_tcp = system.T_tcp_con[:3, :3].T
    items: list[Item] = []
    seen: set[str] = set()
    for target in sorted(score.targets, key=lambda entry: entry.p95_mm, reverse=True):
        if regions[target.name] in seen or len(seen) == MOST_ELLIPSOIDS:
            continue
        seen.add(regions[target.name])
        at = places[target.name]
        kinds = (("tcp", target, from_tcp), ("localisation", target.localisation, np.eye(3)))
        for kind, metric, turn in kinds[: 1 if suffix else 2]:
            bias = turn @ np.array(metric.bias_mm)
            covariance = turn @ np.array(metric.covariance_mm2) @ turn.T
            centre = at + magnification * bias
            axes = semi_axes(covariance)
            word = "TCP" if kind == "tcp" else "localisation"
            name = printable(target.name, 40)
            if np.linalg.norm(axes[0]) > 0:
                lengths = ", ".join(f"{float(np.linalg.norm(axis)):.3g}" for axis in axes)
                title = (
                    f"{when}{word} error at {name}: 95 % ellipsoid, semi-axes {lengths} mm, P95 {metric.p95_mm:.3f} mm"
                )
                points = (point(centre), *points_of(magnification * axes))
                items.append(Item("ellipsoid", f"{kind}{suffix}", f"{kind}{suffix}", points, "", title))
            size = float(np.linalg.norm(bias))
            if kind == "tcp" and magnification * size > 1e-3:
                title = f"{when}bias of the TCP error at {name}: {size:.3g} mm"
                items.append(Item("arrow", f"bias{suffix}", f"bias{suffix}", points_of([at, centre]), "", title))
    return items


def extent(item: Item) -> Array:
    """(M, 3) points around an error as drawn."""
    points = np.array(item.points)
    if item.kind != "ellipsoid":
        return points
    reach = np.sqrt((points[1:] ** 2).sum(axis=0))
    return np.vstack([points[0] + sign * reach[k] * axis for k, axis in enumerate(np.eye(3)) for sign in (-1.0, 1.0)])

"""The error of the distance between two targets, whose errors have their resection, seats and manufacture in common."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain, combinations
from typing import TYPE_CHECKING

from .measure import Measure, Measured, Site

if TYPE_CHECKING:
    from .measure import Array, MeasuredTarget

NAME = "point_to_point"


def site_between(start: MeasuredTarget, end: MeasuredTarget, to_tcp: Array) -> Site | None:
    """The distance between two targets; None where they are in one place."""
    import numpy as np

    line = to_tcp[:3, :3] @ (end.position_mm - start.position_mm)
    length = np.sqrt((line**2).sum())
    if length == 0:
        return None
    weights = np.zeros((3, 6))
    weights[0, :3] = line / length

    def exact(errors: Mapping[str, Array]) -> Array:
        """The distance, without what cancels where the error is small."""
        moved = errors[end.name][:3] - errors[start.name][:3]
        reached = np.sqrt(((moved + line[:, None]) ** 2).sum(axis=0))
        longer = ((2 * line[:, None] + moved) * moved).sum(axis=0) / (reached + length)
        return np.stack([longer, np.zeros_like(longer), np.zeros_like(longer)])

    name, doubt = f"{start.name} to {end.name}", "what both ends have in common cancels in the estimate"
    return Site(name, {start.name: -weights, end.name: weights}, exact, doubt=doubt)


def sites(design: Measured) -> tuple[Site, ...]:
    """Of every two of the targets that a requirement names."""
    named = {target.name: target for target in design.targets}
    pairs = dict.fromkeys(chain.from_iterable(combinations(each, 2) for each in design.demands.get(NAME, ())))
    found = (site_between(named[start], named[end], design.T_tcp_con) for start, end in pairs)
    return tuple(site for site in found if site is not None)


MEASURE = Measure(
    name=NAME,
    words="the error of a distance",
    brief=", distance",
    meaning="error of the distance between every two of the targets that are named",
    frame="tcp",
    sites=sites,
    needs="two targets or more, in different places",
)

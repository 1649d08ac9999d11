"""How far the executed trajectory comes off the planned one: the radius of the corridor that it needs.

Of a straight trajectory the distance across is convex along it, and largest at an end: the number is the larger of the
two ends' distances, whose joint law counts, as both share nearly all of their errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from .measure import DRAWN_ANEW, Measure, Measured, Site, list_directed

if TYPE_CHECKING:
    from .measure import Array, Exact


def list_sites(design: Measured) -> tuple[Site, ...]:
    """Of each target with an entry and a corridor."""
    import numpy as np

    found = []
    for target, entry, axes in list_directed(design):
        if entry is not None and target.corridor_mm is not None:
            ends = entry.name, target.name
            weights = dict(zip(ends, np.zeros((2, 6, 6)), strict=True))
            for row, name in enumerate(ends):
                weights[name][3 * row : 3 * row + 2, :3] = axes[1:]
            found.append(Site(" to ".join(ends), weights, _take_longer(weights), target.corridor_mm))
    return tuple(found)


def _take_longer(weights: Mapping[str, Array]) -> Exact:
    """The error across at the end where it is larger."""

    def take(errors: Mapping[str, Array]) -> Array:
        import numpy as np

        each = [(own[:, :, None] * errors[name]).sum(axis=1) for name, own in weights.items()]
        first, last = np.split(np.sum(each, axis=0), 2)
        return np.asarray(np.where((first**2).sum(axis=0) > (last**2).sum(axis=0), first, last))

    return take


MEASURE = Measure(
    name="corridor",
    words="the radius that the trajectory needs",
    brief=", corridor",
    meaning=f"radius about the planned axis within which both ends of the executed one are; {DRAWN_ANEW}",
    frame="tcp",
    sites=list_sites,
    needs="a target with entry: NAME of another and corridor_mm, and both among those named",
    calibrated=False,
    paired=True,
)

"""The angle between the axis of an instrument as planned and as executed, from where it enters to where it ends.

Both ends share one resection of the views, the seats, the robot's pose and the load; the noise of their images is drawn
for each.  Of two shots each end has all that a shot draws of its own.  To first order an angle is what the ends differ
by across the axis, over its length; trials have it whole.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from .measure import DRAWN_ANEW, Measure, Measured, Site, degrees_between, list_directed

if TYPE_CHECKING:
    from .measure import Array, Exact


def list_sites(design: Measured) -> tuple[Site, ...]:
    """Of each target with an entry."""
    import numpy as np

    found = []
    for target, entry, axes in list_directed(design):
        if entry is not None:
            length = float(np.linalg.norm(target.position_mm - entry.position_mm))
            weights = np.zeros((3, 6))
            weights[:2, :3] = np.rad2deg(axes[1:]) / length
            ends = entry.name, target.name
            both, turn = {ends[0]: -weights, ends[1]: weights}, _turn(ends, axes, length)
            found.append(Site(" to ".join(ends), both, turn, other_shot=ends[0] if target.two_shots else ""))
    return tuple(found)


def _turn(ends: tuple[str, str], axes: Array, length_mm: float) -> Exact:
    """The angle itself, across the axis, deg."""

    def turn(errors: Mapping[str, Array]) -> Array:
        import numpy as np

        between = (errors[ends[1]] - errors[ends[0]])[:3] / length_mm
        ahead, *across = ((axis[:, None] * between).sum(axis=0) for axis in axes)
        size = np.sqrt(across[0] ** 2 + across[1] ** 2)
        times = degrees_between(1 + ahead, size) / np.where(size > 0, size, 1)
        return np.stack([across[0] * times, across[1] * times, 0 * times])

    return turn


MEASURE = Measure(
    name="angle",
    words="the angle of the executed axis",
    brief=", angle",
    meaning=f"angle between the planned axis from entry to target and the executed one; {DRAWN_ANEW}",
    frame="tcp",
    sites=list_sites,
    needs="a target with entry: NAME of another, and both among those named",
    unit="deg",
)

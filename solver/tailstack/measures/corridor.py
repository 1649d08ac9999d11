"""How far the executed trajectory comes off the planned one: the radius of the channel that it needs.

The channel is a cylinder, a cone (another radius where the instrument enters) or elliptic, and is widened alike all
round: the number is what its narrowest radius has to be.  Of a straight trajectory the distance across less what the
channel has there is convex along it, and largest at an end: the number is the larger of the two ends', whose joint law
counts, as both share nearly all of their errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from .measure import DRAWN_ANEW, Measure, Measured, Site, list_directed

if TYPE_CHECKING:
    from .measure import Array, Exact

NEWTON_STEPS = 8  # from below, where every one stays, and at most two components are beyond


def list_sites(design: Measured) -> tuple[Site, ...]:
    """Of each target with an entry and a corridor."""
    import numpy as np

    found = []
    for target, entry, axes in list_directed(design):
        if entry is not None and (channel := target.channel) is not None:
            ends = entry.name, target.name
            weights = dict(zip(ends, np.zeros((2, 6, 6)), strict=True))
            across = axes[1:] if channel.major is None else _axes_across(axes[0], design.T_tcp_con, channel.major)
            for row, name in enumerate(ends):
                weights[name][3 * row : 3 * row + 2, :3] = across
            room = np.zeros(6)
            room[[0, 1, 3, 4]] = np.array([channel.entry_mm, channel.end_mm]).ravel() - channel.narrowest_mm
            exact = _take_needed(weights, room)
            of_shape = channel.narrowest_mm, room if room.any() else None
            other = ends[0] if target.two_shots else ""
            found.append(Site(" to ".join(ends), weights, exact, *of_shape, other_shot=other))
    return tuple(found)


def _axes_across(along: Array, to_tcp: Array, major: Array) -> Array:
    """(2, 3) in tcp, of the major half-axis and of the minor one; major (3,) in con."""
    import numpy as np

    first = to_tcp[:3, :3] @ major
    first -= along * (along @ first)
    first /= np.sqrt((first**2).sum())
    return np.stack([first, np.cross(along, first)])


def _take_needed(weights: Mapping[str, Array], room: Array) -> Exact:
    """The error across at the end that needs more, as long as what it needs."""

    def take(errors: Mapping[str, Array]) -> Array:
        import numpy as np

        each = [(own[:, :, None] * errors[name]).sum(axis=1) for name, own in weights.items()]
        first, last = np.split(np.sum(each, axis=0), 2)
        if not room.any():
            return np.asarray(np.where((first**2).sum(axis=0) > (last**2).sum(axis=0), first, last))
        needed = radius_within(first, room[:3]), radius_within(last, room[3:])
        longer = np.where(needed[0] > needed[1], first, last)
        size = np.sqrt((longer**2).sum(axis=0))
        return np.asarray(longer * (np.maximum(*needed) / np.where(size > 0, size, 1)))

    return take


def radius_within(across: Array, room: Array) -> Array:
    """(n,) the smallest r, 0 or more, at which vectors across (3, n) are within half-axes r + room, room (3,); by sums,
    quotients and square roots alone, which are alike on every processor.

    Newton's method on ``sum (x / (r + room))^2 = 1``, which is convex and falls, from where one component alone is on
    the border.
    """
    import numpy as np

    radius = np.maximum((np.abs(across) - room[:, None]).max(axis=0), 0.0)
    for _ in range(NEWTON_STEPS):
        wide = np.where(across == 0, 1.0, np.maximum(radius + room[:, None], 1e-300))
        squares = (across / wide) ** 2
        size = squares.sum(axis=0)
        step = np.where(size > 1, (size - 1) / np.where(size > 1, 2 * (squares / wide).sum(axis=0), 1.0), 0.0)
        radius = radius + step
    return np.asarray(radius)


MEASURE = Measure(
    name="corridor",
    words="the radius that the trajectory needs",
    brief=", corridor",
    meaning="radius about the planned axis within which both ends of the executed one are (of a cone or an elliptic "
    f"channel, widened alike all round: its narrowest one); {DRAWN_ANEW}",
    frame="tcp",
    sites=list_sites,
    needs="a target with entry: NAME of another and corridor_mm, and both among those named",
    paired=True,
)

"""What a measure is: a number of an error that is limited and told, with its unit.

At each target two errors are known, with all that they have in common: at the tool, in tcp, and as located, in con, mm.
A measure is linear in them, ``e = sum over targets of weights @ (error at the tool, error as located)``, to first order
at least; its number is the norm of e.  Of fewer than three components the other rows are 0: its law then lies exactly
in a plane or on a line.  Of one component it may be counted on one side alone, where it then is e itself, and 0 on the
other: a known part on that side adds to what is random, one on the other takes from it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Exact = Callable[[Mapping[str, Array]], Array]
Sites = Callable[["Measured"], tuple["Site", ...]]

DRAWN_ANEW = "both ends share all that is drawn, the noise of the images of these two targets excepted"
TWO_SHOTS = "each end has images and a pose of its own: both share the unit and its mounting"
SIDES = ("above", "below")  # 0, of an error with its sign
ONE_SIDE = "what is known may take away nearly all of it"
DIRECTED = "a target with direction: [x, y, z] in con, or entry: NAME of another"


class Channel(NamedTuple):
    """What the axis of an instrument has to stay in: an ellipse across it at either end, straight in between."""

    entry_mm: tuple[float, float]  # half-axes where it enters, the major one first
    end_mm: tuple[float, float]
    major: Array | None = None  # (3,) con, along the major ones as far as it is across; None: circles

    @property
    def narrowest_mm(self) -> float:
        """The smallest half-axis."""
        return min(*self.entry_mm, *self.end_mm)

    @property
    def words(self) -> str:
        """Of what size, for people."""
        ends = [
            f"{minor:g}" if self.major is None else f"{minor:g} by {major:g}"
            for major, minor in (self.entry_mm, self.end_mm)
        ]
        name = "radius" if self.major is None else "half-axes"
        return f"{name} {ends[1]} mm" + ("" if ends[0] == ends[1] else f", {ends[0]} mm at the entry")


class MeasuredTarget(Protocol):
    """A target, as a measure sees it."""

    @property
    def name(self) -> str: ...
    @property
    def position_mm(self) -> Array: ...  # (3,) con
    @property
    def direction(self) -> Array | None: ...  # (3,) con
    @property
    def entry(self) -> str | None: ...  # name of the target at which an instrument enters that comes to this one
    @property
    def channel(self) -> Channel | None: ...  # in which its axis has to stay
    @property
    def two_shots(self) -> bool: ...  # whether what a shot draws is drawn for the entry and for it


class MeasuredBody(NamedTuple):
    """A rigid body, known by some of the targets."""

    name: str  # as in the design
    targets: tuple[str, ...]  # names of three or more
    against: tuple[str, ...] = ()  # of those of the body that it is read against


class Measured(Protocol):
    """A design, as a measure sees it."""

    @property
    def targets(self) -> Sequence[MeasuredTarget]: ...
    @property
    def bodies(self) -> Sequence[MeasuredBody]: ...
    @property
    def T_tcp_con(self) -> Array: ...  # (4, 4) con -> tcp, mm
    @property
    def demands(self) -> Mapping[str, Sequence[tuple[str, ...]]]: ...  # by measure: targets each requirement names


@dataclass(frozen=True, slots=True, eq=False)
class Site:
    """Where a measure is read."""

    name: str  # of the target, or what joins several, "A to B": as records name it
    weights: Mapping[str, Array]  # by target (3, 6): of the error at the tool, x, y, z in tcp, then as located, in con
    exact: Exact | None = None
    """Where the above is no more than first order: e (3, n) of n trials, from their errors by target (6, n)."""
    corridor_mm: float | None = None  # beyond which, and by so much more, breaches are counted
    room: Array | None = None
    """(6,) of two vectors: half-axes beyond the narrowest, within which lengths are equal; (1,) of one number that
    counts above 0 alone: it has no end on the other side."""

    doubt: str = ""
    """Why it is not known how far first order is from a simulation, behind a colon; empty: it was calibrated."""

    other_shot: str = ""  # name of a target whose errors are those of another shot of the same mounting; empty: none

    @property
    def is_one_sided(self) -> bool:
        """Whether e is one number, of which that above 0 counts."""
        return self.room is not None and len(self.room) == 1

    @property
    def is_scalar(self) -> bool:
        """Whether e is one number, with its sign."""
        return not any(rows[1:].any() for rows in self.weights.values())


@dataclass(frozen=True, slots=True, eq=False)
class Measure:
    """A measure, and all that is said of it; listed in ``MEASURES`` of ``measures/__init__.py``."""

    name: str  # in documents and records
    words: str  # as people say it: the error at the tool
    brief: str  # the same in a table, behind P95; empty where nothing need be said
    meaning: str  # one sentence without a full stop, of the field by which a requirement names it
    frame: str  # of e
    sites: Sites
    """Where it is read: nowhere, unless the design declares what it takes."""
    needs: str = "more targets, or all"  # what to declare, or to name, where a requirement finds no site
    unit: str = "mm"  # of e; the field of a limit is named after it
    paired: bool = False  # whether e is two vectors, weights (6, 6), and its number the length of the longer
    side: str = ""  # one of ``SIDES``, where that alone counts of the measure that a requirement names

    @property
    def vectors(self) -> int:
        """How many e is."""
        return 2 if self.paired else 1

    @property
    def limit_field(self) -> str:
        """Name of the field of a requirement that limits it."""
        return f"limit_{self.unit}"


def at_each_target(first: int) -> Sites:
    """Sites of one of the two errors itself, at every target; first: its first column in the weights."""

    def sites(design: Measured) -> tuple[Site, ...]:
        import numpy as np  # here: who only names measures waits for no arrays

        picked = np.eye(6)[first : first + 3]
        return tuple(Site(target.name, {target.name: picked}) for target in design.targets)

    return sites


def list_directed(design: Measured) -> list[tuple[MeasuredTarget, MeasuredTarget | None, Array]]:
    """Targets to which an instrument comes in a direction; the one at which it enters, if that is known; and the axes
    (3, 3) in tcp: along it, and two across."""
    import numpy as np

    named, found = {target.name: target for target in design.targets}, []
    for target in design.targets:
        entry = None if target.entry is None else named[target.entry]
        direction = target.direction if entry is None else target.position_mm - entry.position_mm
        if direction is not None:
            along = design.T_tcp_con[:3, :3] @ (direction / np.linalg.norm(direction))
            across = np.cross(along, np.eye(3)[int(np.abs(along).argmin())])
            across /= np.linalg.norm(across)
            found.append((target, entry, np.stack([along, across, np.cross(along, across)])))
    return found


def at_each_direction(first: int, last: int) -> Sites:
    """Sites of components of the error at the tool, at every target with a direction: along it is 0, across it 1, 2."""

    def sites(design: Measured) -> tuple[Site, ...]:
        import numpy as np

        found = []
        for target, _, axes in list_directed(design):
            weights = np.zeros((3, 6))
            weights[: last - first, :3] = axes[first:last]
            found.append(Site(target.name, {target.name: weights}))
        return tuple(found)

    return sites


def on_each_side(base: Measure, sites_of: Callable[[str], Sites] | None = None) -> tuple[Measure, ...]:
    """A measure of one number, counted above 0 alone and below it; sites_of: those of ``base``, where they go by the
    name of the measure that is asked for."""

    def measure(side: str) -> Measure:
        name, sign = f"{base.name}_{side}", 1.0 if side == "above" else -1.0

        def sites(design: Measured) -> tuple[Site, ...]:
            import numpy as np

            if not (asked := set(chain.from_iterable(design.demands.get(name, ())))):
                return ()
            half = np.full(1, np.inf)
            return tuple(
                replace(site, weights={at: sign * rows for at, rows in site.weights.items()}, room=half, doubt=ONE_SIDE)
                for site in (sites_of(name) if sites_of else base.sites)(design)
                if asked.issuperset(site.weights)
            )

        words, brief = f"{base.words} {side} 0", f"{base.brief} {side} 0"
        return replace(base, name=name, words=words, brief=brief, sites=sites, side=side)

    return tuple(measure(side) for side in SIDES)


def degrees_between(ahead: Array, across: Array) -> Array:
    """(n,) deg, of the components of a vector along an axis and, not negative, across it: by sums and square roots
    alone, which are alike on every processor."""
    import numpy as np

    tangent = across / (np.sqrt(across**2 + ahead**2) + ahead)  # of half the angle
    for _ in range(4):
        tangent = tangent / (1 + np.sqrt(1 + tangent**2))
    square, series = tangent**2, np.zeros_like(tangent)
    for odd in range(17, 0, -2):
        series = 1 / odd - square * series
    return np.asarray(np.rad2deg(32 * tangent * series))

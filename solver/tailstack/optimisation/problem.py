"""What the optimiser may change and what it must keep, on plain arrays: no document, no solver."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, product
from math import degrees, inf
from typing import Any, Literal

import numpy as np

from ..design.drawn import DrawnValues
from ..errors import DesignError, Problem
from ..geometry.arrays import Array, frozen
from ..laws import Drawn
from ..measures import MEASURE, POINTS
from ..measures.measure import Measure, Site
from ..propagation.linear import effects_of_images, estimator_geometry, imaging_of
from ..propagation.noise import Imaging
from ..system import ArrayLike, DirectEffect, Requirement, Sources, System, Target, put_mounts
from .prices import Price, cost_of
from .regions import Isometry, KeepOut, Shape

Objective = Literal["cost", "quantile", "scaling"]
ROUNDED = 1e-5  # of the cost limit, left for half-widths that are rounded down
SMOOTH_MM = 0.05  # how round the price of moving is about 0
MOST_FIDUCIALS = 64  # memory and time of the programme go as their square


@dataclass(frozen=True, slots=True)
class FreeHalfWidth:
    """One half-width of a mount that may be set, and what it costs."""

    contributor: str  # "structure_connector" or "connector_flange"
    component: str  # name of the source: rx ... tz, or a locator
    minimum: float  # native unit of the source (rad, mm)
    maximum: float
    price: Price
    pointer: str = "/optimise/tolerances"  # where the user gave the bounds
    drawn: DrawnValues | None = None  # of a drawing: half-widths are sizes, and component its name
    also: tuple[str, ...] = ()  # what else of the drawing has the same value

    @property
    def names(self) -> tuple[str, ...]:
        """Of its sources."""
        return (self.component,) if self.drawn is None else self.drawn.names

    def half_widths_at(self, value: float) -> Array:
        """(n,) of its sources."""
        return np.array([value]) if self.drawn is None else self.drawn.half_widths_at(value)


@dataclass(frozen=True, slots=True)
class FreeFiducial:
    """A fiducial that may go anywhere in a region, followed by its copies under the symmetry, in that order."""

    fiducials: tuple[int, ...]  # indices into system.fiducials_mm
    region: Shape
    pointer: str = "/optimise/box"


@dataclass(frozen=True, slots=True, eq=False)
class PivotVariable:
    """The pivot of a mount, free in a box."""

    contributor: str
    low_mm: Array  # (3,) con
    high_mm: Array  # (3,)
    pointer: str = "/optimise/pivots"


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """A value for everything that may change."""

    fiducials_mm: Array  # (N, 3) all of them, con
    half_width: Array  # (K,) native units
    pivots_mm: Array  # (P, 3) con


@dataclass(frozen=True, slots=True, eq=False)
class QuantileConstraint:
    """One requirement at one site of its measure: one quantile that has one limit."""

    requirement: Requirement
    site: Site
    targets: tuple[Target, ...]  # that it joins, in its order: one, of a measure of a single target
    lost: tuple[str, ...] = ()  # labels of the fiducials that are lost, in all views
    place: str = ""  # of two vectors of which the longer has the limit, whose this is: the name of its target
    ends: tuple[float, ...] = ()  # -1 or 1: where each bounded source of ``count_ends`` stands; (): wherever is worst

    @property
    def subject(self) -> tuple[str, ...]:
        """What has the limit, wherever bounded sources stand."""
        return self.requirement.name, self.site.name, *self.lost

    @property
    def key(self) -> tuple[str, ...]:
        return *self.subject, self.place, *map(str, self.ends)

    @property
    def text(self) -> str:
        nested = f" of {100 * self.fraction:g} % of {self.level.plural}" if self.is_nested else ""
        without = f" without {' and '.join(self.lost)}" if self.lost else ""
        signs = "".join("+" if end > 0 else "-" for end in self.ends)
        at = f", bounded errors of images at {signs}" if signs else ""
        where = f", {self.place}" if self.place else ""
        what = name_held(self.requirement, "" if self.is_point else self.measure.words)
        return f"{what}{nested} at target {self.site.name!r}{where}{without}{at}"

    @property
    def measure(self) -> Measure:
        """What is limited."""
        return MEASURE[self.requirement.error]

    @property
    def is_point(self) -> bool:
        """Whether that is an error at one target, mm."""
        return self.measure in POINTS

    @property
    def limit_text(self) -> str:
        """With its unit."""
        return f"{self.requirement.limit:g} {self.measure.unit}"

    @property
    def is_convex(self) -> bool:
        """Whether what is limited is convex in the half-widths, whatever the laws."""
        return self.requirement.row.convex and not self.is_nested

    @property
    def is_nested(self) -> bool:
        """Whether each unit, or each mounting, is read by itself."""
        return self.requirement.level is not None

    @property
    def level(self) -> Drawn:
        """What is read by itself; of pooled demands, which ask for no level, a unit."""
        return self.requirement.level or Drawn.UNIT

    @property
    def fraction(self) -> float:
        """Nested: the fraction of units, or of mountings, whose own quantile must meet the limit."""
        return self.requirement.units_fraction or self.requirement.quantile


@dataclass(frozen=True, slots=True, eq=False)
class Homes:
    """What speaks against moving fiducials: a price, or a ball about the place of each."""

    home_mm: Array  # (N, 3) con; nan of a new one
    cost_per_mm: float = 0.0
    at_most_mm: float = inf

    @property
    def at_home(self) -> tuple[int, ...]:
        """Indices of those that have a place to stay at."""
        return tuple(int(i) for i in np.flatnonzero(~np.isnan(self.home_mm[:, 0])))

    def ways(self, points: ArrayLike) -> list[ArrayLike]:
        """(3,) from the place of each of ``at_home`` to where it is, mm; points (N, 3), floats or symbols."""
        return [points[i] - self.home_mm[i] for i in self.at_home]

    def price_smoothly(self, points: ArrayLike, root: Callable[[Any], Any]) -> Any:
        """The price with ``sqrt(d^2 + s^2) - s`` for each distance d, s being ``SMOOTH_MM``: it has a slope at 0, and
        is never more than what is asked, nor less by more than s for each."""
        return self.cost_per_mm * sum(root(way @ way + SMOOTH_MM**2) - SMOOTH_MM for way in self.ways(points))


@dataclass(frozen=True, slots=True, eq=False)
class Survival:
    """What must hold when fiducials are lost."""

    lost: int  # so many, whichever
    requirement: Requirement


@dataclass(frozen=True, slots=True, eq=False)
class EstimationTerms:
    """What the layout enters through, the same for every target."""

    imaging: Imaging
    assumed_shift_mm: Array  # (3,): fiducials as the estimator assumes them are X @ assumed.T + assumed_shift_mm
    std: Array  # (M,) native unit, of the sources of the columns that ``noise.assemble`` fills
    weights: Array  # (V, N) 1 where a view's estimate uses a fiducial, otherwise 0

    @property
    def projections(self) -> Array:
        """(V, 3, 4) effective, |p3| = 1."""
        return np.ascontiguousarray(self.imaging.projections)

    @property
    def assumed_turn(self) -> Array:
        """(3, 3): see ``assumed_shift_mm``."""
        return np.asarray(self.imaging.per_error)

    def assume(self, points: Array) -> Array:
        """Positions (..., 3), con, as the estimator assumes them."""
        flat = points.reshape(-1, 3) @ self.assumed_turn.T + self.assumed_shift_mm
        return np.ascontiguousarray(flat.reshape(points.shape))


def estimator_of(system: System) -> EstimationTerms:
    projections, points, per_error = estimator_geometry(system)
    # In the physical reading the estimator assumes X itself, in the Eq 18 reading the displaced X.
    return EstimationTerms(
        imaging=imaging_of(system, projections, points, per_error),
        assumed_shift_mm=points[0] - per_error @ system.fiducials_mm[0],
        std=np.concatenate([effect.sources.std for effect in effects_of_images(system)]),
        weights=system.sees,
    )


@dataclass(frozen=True, eq=False)
class PlacementProblem:
    """Least cost of the free half-widths with every quantile within its limit, over all that is free.

    ``objective``: "cost"; "quantile", the smallest largest ratio of a quantile to its limit (within
    ``cost_limit`` when half-widths are free); "scaling", one factor on all half-widths as they are, as large as
    the limits allow.  ``system`` holds everything else, fixed.
    """

    system: System
    requirements: tuple[Requirement, ...]
    places: tuple[FreeFiducial, ...] = ()
    half_widths: tuple[FreeHalfWidth, ...] = ()
    pivots: tuple[PivotVariable, ...] = ()
    objective: Objective = "cost"
    cost_limit: float | None = None
    symmetry: tuple[Isometry, ...] = ()
    keep_out: tuple[KeepOut, ...] = ()
    min_spacing_mm: float = 0.0
    min_projected_spacing_px: float = 0.0  # between the images of two fiducials, in every view
    image_margin_px: float = 0.0  # from the image's border, in views whose size is stated
    target_clearance_px: float = 0.0  # between the image of a fiducial and that of a required target
    survival: Survival | None = None
    stay: Homes | None = None

    @cached_property
    def estimation(self) -> EstimationTerms:
        return estimator_of(self.system)

    @property
    def free_fiducials(self) -> tuple[int, ...]:
        """Indices of the fiducials that move, ascending."""
        return tuple(sorted(i for place in self.places for i in place.fiducials))

    @property
    def distances(self) -> dict[str, tuple[str, str, float]]:
        """By the kind of a rule that asks for a distance: its field, the unit, and how far."""
        return {
            "spacing": ("min_spacing_mm", "mm", self.min_spacing_mm),
            "projected_spacing": ("min_projected_spacing_px", "px", self.min_projected_spacing_px),
            "target_clearance": ("target_clearance_px", "px", self.target_clearance_px),
        }

    @property
    def demands(self) -> tuple[QuantileConstraint, ...]:
        """Every requirement wherever it is asked for, in the order of the system; then what must hold after every
        loss."""
        asked = tuple(demand for requirement in self.requirements for demand in demands_of(self.system, requirement))
        if self.survival is None:
            return asked
        losses = combinations(self.system.fiducial_labels, self.survival.lost)
        each = product(demands_of(self.system, self.survival.requirement), losses)
        return (*asked, *(replace(demand, lost=lost) for demand, lost in each))

    @property
    def in_mm(self) -> tuple[QuantileConstraint, ...]:
        """Those of errors at targets, with all fiducials; where none is asked for, the error at the tool at all targets
        that are joined."""
        asked = tuple(demand for demand in self.demands if demand.is_point and not demand.lost)
        names = tuple(target.name for target in self.targets)
        stand_in = replace(self.requirements[0], error=POINTS[0].name, targets=names)
        return asked or demands_of(self.system, stand_in)

    @property
    def ends(self) -> tuple[tuple[float, ...], ...]:
        """Where the bounded sources that move the images of all fiducials together may stand: all vertices, as which is
        worst changes with the layout and at the optimum several are; one that is empty where the layout stays."""
        return tuple(product((1.0, -1.0), repeat=count_ends(self.system) if self.moves else 0))

    @property
    def moves(self) -> bool:
        """Whether anything may be elsewhere: fiducials or pivots."""
        return bool(self.places or self.pivots)

    @property
    def targets(self) -> tuple[Target, ...]:
        """The targets that some requirement names, in the order of the system."""
        return targets_of(self.system, self.requirements)

    def layout_alone(self, requirements: tuple[Requirement, ...]) -> PlacementProblem:
        """The same for the layout that keeps requirements best, at no price: nothing else is free."""
        free = replace(self, requirements=requirements, objective="quantile", half_widths=(), pivots=())
        stay = self.stay and replace(self.stay, cost_per_mm=0.0)
        return replace(free, cost_limit=None, survival=None, stay=stay)

    @property
    def lower(self) -> Array:
        """(K,) smallest half-widths, native unit."""
        return np.array([free.minimum for free in self.half_widths])

    @property
    def upper(self) -> Array:
        """(K,) largest half-widths, native unit."""
        return np.array([free.maximum for free in self.half_widths])

    def cost(self, half_width: Array) -> float:
        """Sum over the free half-widths (K,), native unit."""
        return sum((cost_of(f.price, float(h)) for f, h in zip(self.half_widths, half_width, strict=True)), 0.0)

    def price_of(self, choice: Choice) -> float:
        """Of the half-widths and of what has been moved."""
        return self.cost(choice.half_width) + self.price_of_moving(choice.fiducials_mm)

    def price_of_moving(self, fiducials_mm: Array) -> float:
        """Of a layout (N, 3), as it is asked: without what makes it smooth."""
        if self.stay is None or not self.stay.cost_per_mm:
            return 0.0
        return self.stay.cost_per_mm * sum(float(np.linalg.norm(way)) for way in self.stay.ways(fiducials_mm))


def name_held(requirement: Requirement, of: str) -> str:
    """What the search holds a requirement by, in words; ``of`` what, if that is named: a share beyond a limit by the
    quantile that it leaves."""
    return (replace(requirement, statistic="quantile") if requirement.row.unit else requirement).name_value(of)


def demands_of(system: System, requirement: Requirement) -> tuple[QuantileConstraint, ...]:
    """A requirement at every site of its measure that it names, in the order of the system.

    Of the longer of two vectors each has the limit by itself, and half of what may be beyond, of shots and of units or
    mountings: then no more is (the probability of either is at most the sum of both).
    """
    targets, demands = {target.name: target for target in system.targets}, []
    for measure, site in system.metrics:
        if measure.name != requirement.error or site.name not in requirement.targets:
            continue
        if site.other_shot:
            detail = f"{requirement.name} limits {measure.words} of two shots, which no search knows"
            hint = "name the other requirements in optimise.requirement; the check judges all"
            raise DesignError(Problem("/optimise/requirement", "two-shots", detail, hint))
        if not measure.paired:
            demands.append(QuantileConstraint(requirement, site, tuple(targets[name] for name in site.weights)))
            continue
        fraction = None if requirement.units_fraction is None else (1 + requirement.units_fraction) / 2
        half = replace(requirement, quantile=(1 + requirement.quantile) / 2, min_yield=fraction)
        room = np.zeros(6) if site.room is None else site.room
        scale = requirement.limit / (requirement.limit + room)  # within the limit then just where it is now
        for name, weights in site.weights.items():
            rows = slice(first := int(weights.any(axis=1).argmax()), first + 3)
            alone = replace(site, weights={name: weights[rows] * scale[rows, None]}, exact=None, room=None)
            demands.append(QuantileConstraint(half, alone, (targets[name],), place=name))
    return tuple(demands)


def targets_of(system: System, requirements: Sequence[Requirement]) -> tuple[Target, ...]:
    """The targets that some requirement names, in the order of the system; all of them where a measure joins several,
    as its sites follow from all."""
    if any(MEASURE[requirement.error] not in POINTS for requirement in requirements):
        return system.targets
    named = {name for requirement in requirements for name in requirement.targets}
    return tuple(target for target in system.targets if target.name in named)


def count_ends(system: System) -> int:
    """How many bounded sources move the images of all fiducials of a view together."""
    return sum(int(effect.sources.are_bounded.sum()) for effect in system.shared_image_errors)


def mount_named(system: System, contributor: str) -> DirectEffect:
    """The interface a contributor name stands for."""
    return {mount.name: mount for mount in system.interfaces}[contributor]


def label_of(problem: PlacementProblem, contributor: str) -> str:
    """What people call an interface."""
    return mount_named(problem.system, contributor).label


def source_of(problem: PlacementProblem, free: FreeHalfWidth) -> tuple[Sources, int]:
    """The sources that a free half-width is one of, or the first of, and which."""
    sources = mount_named(problem.system, free.contributor).sources
    return sources, sources.names.index(free.names[0])


def in_words(problem: PlacementProblem, index: int) -> str:
    """What the user calls a free half-width: the interface's label and the component."""
    free = problem.half_widths[index]
    return f"{label_of(problem, free.contributor)} {', '.join((free.component, *free.also))}"


def unit_of(problem: PlacementProblem, index: int) -> str:
    """Native unit of a free half-width: rad or mm."""
    sources, j = source_of(problem, problem.half_widths[index])
    return sources.units[j]


def for_people(problem: PlacementProblem, index: int, value: float) -> tuple[float, str]:
    """A free half-width (or a bound of it) in the unit of the document: deg or mm."""
    return (degrees(value), "deg") if unit_of(problem, index) == "rad" else (value, "mm")


def present_choice(problem: PlacementProblem) -> Choice:
    """Everything as it is in the system."""
    widths = []
    for free in problem.half_widths:
        sources = mount_named(problem.system, free.contributor).sources
        own = sources.half_width[[sources.names.index(name) for name in free.names]]
        widths.append(float(own[0]) if free.drawn is None else free.drawn.size_of(own))
    pivots = [mount_named(problem.system, free.contributor).pivot_mm for free in problem.pivots]
    return Choice(problem.system.fiducials_mm, np.array(widths), np.array(pivots).reshape(-1, 3))


def width_bounds(problem: PlacementProblem, present: Array) -> tuple[Array, Array]:
    """Bounds of the variables that stand for half-widths: their logarithms, or that of the common factor."""
    low, high = np.log(problem.lower), np.log(problem.upper)
    if problem.objective == "scaling" and len(low):
        return np.array([(low - np.log(present)).max()]), np.array([(high - np.log(present)).min()])
    return low, high


def least_half_widths(problem: PlacementProblem, present: Array) -> Array:
    """(K,) the smallest half-widths that are allowed together, native units."""
    if problem.objective != "scaling" or not problem.half_widths:
        return problem.lower
    return np.asarray(present * np.exp(width_bounds(problem, present)[0][0]))


def apply_choice(problem: PlacementProblem, choice: Choice) -> System:
    """The system with a choice made."""
    mounts = {mount.name: mount for mount in problem.system.interfaces}
    for free, value in zip(problem.half_widths, choice.half_width, strict=True):
        mount = mounts[free.contributor]
        widths = mount.sources.half_width.copy()
        widths[[mount.sources.names.index(name) for name in free.names]] = free.half_widths_at(float(value))
        mounts[free.contributor] = replace(mount, sources=replace(mount.sources, half_width=frozen(widths)))
    first, second = mounts.values()
    system = replace(
        problem.system, fiducials_mm=frozen(choice.fiducials_mm), structure_connector=first, connector_flange=second
    )
    pivots = {free.contributor: at for free, at in zip(problem.pivots, frozen(choice.pivots_mm), strict=True)}
    return with_pivots(system, pivots)


def with_pivots(system: System, pivots_mm: Mapping[str, ArrayLike]) -> System:
    """The system with the pivots (3,) of some interfaces elsewhere, and what is seated at them: numbers or symbols."""
    first, second = (
        replace(mount, pivot_mm=pivots_mm[mount.name]) if mount.name in pivots_mm else mount
        for mount in system.interfaces
    )
    return put_mounts(system, first, second)

"""From the document's ``optimise`` section to problems on arrays, and from a choice back to a document."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import ceil, degrees, floor, inf, log10, radians
from typing import Any

import numpy as np

from tailstack.fields import INTERFACES

from ..design import Design, Revision, compile_design, revise_design
from ..design.compile import torsor_of_features
from ..design.consistency import list_declared
from ..design.drawn import find_drawn, price_of, read_values
from ..design.features import Feature
from ..design.frames import mesh_of
from ..design.optimise_document import (
    CostCurve,
    FreeTolerance,
    Optimise,
    RotationBounds,
    SearchBall,
    SearchBox,
    SearchCylinder,
    SearchShape,
    SearchSurface,
    Stay,
    Survive,
    Symmetry,
    TranslationBounds,
)
from ..errors import DesignError, Problem
from ..geometry.arrays import Array, frozen
from ..measures import MEASURE, POINTS
from ..system import ROTATIONS, TRANSLATIONS, Requirement, System, put_mounts
from .matching import list_places, match
from .prices import Price, PricedGrade, cost_of, grade_for, of_grades, reciprocal, slope_of
from .problem import (
    MOST_FIDUCIALS,
    ROUNDED,
    Choice,
    FreeFiducial,
    FreeHalfWidth,
    Homes,
    PivotVariable,
    PlacementProblem,
    Survival,
    unit_of,
)
from .regions import Ball, BoxRegion, Cylinder, Isometry, KeepOut, Shape, Solid, bounding_box, clip, mirror, turns
from .surface import NearSurface

POSITION_DECIMALS = (3, 6)  # mm: a micrometre, unless that breaks the spacing
STAYS_MM = 1e-3  # what rounding alone has moved is where it was
WIDTH_DECIMALS = 6  # degrees and mm, rounded down
AT_BOUND = 1e-6  # relative: a half-width that near its bound is at it


@dataclass(frozen=True, slots=True, eq=False)
class OptimiseRequest:
    """What a document asks for."""

    design: Design
    section: Optimise
    problem: PlacementProblem  # with the fiducials as they are in number
    graded: bool  # whether half-widths are bought from tables of grades


def read_request(design: Design) -> OptimiseRequest:
    """The freedom that the document's ``optimise`` section gives, on the compiled design.  Raises DesignError."""
    section = design.document.optimise
    if section is None:
        detail = "the design has no optimise section: nothing is free to change"
        hint = "add optimise with a box, rotation_bounds or tolerances"
        raise DesignError(Problem("", "missing-field", detail, hint))
    # The search has all fiducials in every shot; what missing them adds is measured by the check of what it finds.
    system, half_widths = _half_widths(design, section, replace(compile_design(design), loss_probability=()))
    requirements = _requirements(system, section.requirement)
    if section.goal == "pareto" and not any(MEASURE[item.error] in POINTS for item in requirements):
        hint = "name a requirement in mm beside it in optimise.requirement, or objective: cost"
        raise DesignError(Problem("/optimise/objective", "unsupported", "a front is traced along a limit in mm", hint))
    problem = PlacementProblem(
        system=system,
        requirements=requirements,
        places=_places(system, section),
        half_widths=half_widths,
        pivots=tuple(
            PivotVariable(free.interface, np.array(free.box.min_mm), np.array(free.box.max_mm), f"/optimise/pivots/{k}")
            for k, free in enumerate(section.pivots)
        ),
        objective="cost" if section.goal == "pareto" else section.goal,
        cost_limit=section.cost_limit,
        symmetry=_symmetry(section.symmetry),
        keep_out=tuple(
            KeepOut(zone.name, _solid(zone.solid), zone.clearance_mm, f"/optimise/keep_out/{index}")
            for index, zone in enumerate(section.keep_out)
        ),
        min_spacing_mm=section.min_spacing_mm,
        min_projected_spacing_px=section.min_projected_spacing_px,
        image_margin_px=section.image_margin_px,
        target_clearance_px=section.target_clearance_px,
        stay=None if section.stay is None else _stay(section.stay, system, system.fiducial_labels),
    )
    if section.survive is not None:
        problem = replace(problem, survival=_survival(section.survive, problem))
    return OptimiseRequest(design, section, problem, any(free.price.curve == "grades" for free in half_widths))


def _requirements(system: System, named: str | list[str] | None) -> tuple[Requirement, ...]:
    names = [named] if isinstance(named, str) else named
    return tuple(item for item in system.requirements if names is None or item.name in names)


def _survival(wanted: Survive, problem: PlacementProblem) -> Survival:
    names = tuple(target.name for target in problem.targets)
    return Survival(wanted.lost, Requirement("survive", POINTS[0].name, 0.95, wanted.limit_mm, 0.95, names))


def _stay(wanted: Stay, before: System, labels: Sequence[str]) -> Homes:
    """Of fiducials by their labels; those that the design does not have are new."""
    homes = dict(zip(before.fiducial_labels, before.fiducials_mm, strict=True))
    home_mm = np.array([homes.get(label, np.full(3, np.nan)) for label in labels])
    return Homes(frozen(home_mm), wanted.cost_per_mm or 0.0, wanted.at_most_mm or inf)


def _shape(shape: SearchShape) -> Shape:
    return _near_surface(shape) if isinstance(shape, SearchSurface) else _solid(shape)


@lru_cache(maxsize=4)
def _near_surface(shape: SearchSurface) -> NearSurface:
    """One for each section: the spline over it is made once."""
    side = {"both": 0, "inside": -1, "outside": 1}[shape.side]
    return NearSurface(mesh_of(shape), shape.distance_mm, shape.at_least_mm, side)


def _solid(shape: SearchBox | SearchCylinder | SearchBall) -> Solid:
    if isinstance(shape, SearchBox):
        return BoxRegion(np.array(shape.min_mm), np.array(shape.max_mm))
    if isinstance(shape, SearchBall):
        return Ball(np.array(shape.centre_mm), shape.radius_mm, shape.inner_radius_mm)
    axis = np.array(shape.axis, dtype=float)
    axis /= np.linalg.norm(axis)
    tube = Cylinder(np.array(shape.base_mm), axis, shape.height_mm, shape.radius_mm, shape.inner_radius_mm)
    if (sector := shape.sector) is None:
        return tube
    towards = np.array(sector.towards, dtype=float) - axis * (axis @ sector.towards)
    return replace(tube, towards=towards / np.linalg.norm(towards), half_angle=radians(sector.width_deg / 2))


def _symmetry(symmetry: Symmetry | None) -> tuple[Isometry, ...]:
    if symmetry is None:
        return ()
    if symmetry.mirror is not None:
        return mirror(np.array(symmetry.mirror.point_mm), np.array(symmetry.mirror.normal))
    turn = symmetry.rotation
    assert turn is not None  # the document holds exactly one
    return turns(np.array(turn.point_mm), np.array(turn.axis), turn.order)


def _places(system: System, section: Optimise) -> tuple[FreeFiducial, ...]:
    """Free fiducials with their regions, in groups of the symmetry's size."""
    size, index = 1 + len(_symmetry(section.symmetry)), system.fiducial_labels.index
    free = [label for label in system.fiducial_labels if label not in section.fixed]
    groups = [(each.fiducials, each.shape, f"/optimise/regions/{k}") for k, each in enumerate(section.regions or ())]
    if section.box is not None:
        groups = [(free, section.box, "/optimise/box")]
    elif section.region is not None:
        groups = [(free, section.region.shape, "/optimise/region")]
    return tuple(
        FreeFiducial(tuple(map(index, labels[k : k + size])), region, pointer)
        for labels, region, pointer in ((labels, _shape(shape), pointer) for labels, shape, pointer in groups)
        for k in range(0, len(labels) - size + 1, size)
    )


def _half_widths(design: Design, section: Optimise, system: System) -> tuple[System, tuple[FreeHalfWidth, ...]]:
    """The half-widths set free: those listed, and all others of a kind that has common bounds; in the chain's order.
    And the system, with places for all values of a drawing that are free."""
    listed = {(free.interface, free.component): index for index, free in enumerate(section.tolerances)}
    half_widths: list[FreeHalfWidth] = []
    for bounds, components, pointer in (
        (section.rotation_bounds, ROTATIONS, "/optimise/rotation_bounds"),
        (section.translation_bounds, TRANSLATIONS, "/optimise/translation_bounds"),
    ):
        if bounds is None:
            continue
        low, high = _bounds(bounds)
        half_widths += [
            FreeHalfWidth(interface, component, low, high, _price(bounds.cost, bounds.cost_weight), pointer)
            for interface, component in list_declared(design.document, components)
            if (interface, component) not in listed
        ]
    for index, free in enumerate(section.tolerances):
        if getattr(design.document.interfaces, free.interface).features is None:
            half_widths.append(_read_listed(free, f"/optimise/tolerances/{index}"))
    for name in INTERFACES:
        interface = getattr(design.document.interfaces, name)
        own = [(index, free) for index, free in enumerate(section.tolerances) if free.interface == name]
        if own and interface.features is not None:
            drawn = [_read_drawn(index, free, interface.features, section.grade_prices) for index, free in own]
            places = {key: parts for each in drawn if each.drawn for key, parts in each.drawn.places.items()}
            sources, _ = torsor_of_features(interface.features, np.array(interface.pivot_mm), "", places)
            mount = replace(getattr(system, name), sources=sources)
            system = put_mounts(system, *(mount if each.name == name else each for each in system.interfaces))
            half_widths += drawn
    order = (*ROTATIONS, *TRANSLATIONS)  # locators follow, in the order of the document

    def place(free: FreeHalfWidth) -> tuple[int, int]:
        component = order.index(free.component) if free.component in order else len(order)
        return INTERFACES.index(free.contributor), component

    return system, tuple(sorted(half_widths, key=place))


def _read_drawn(
    index: int, free: FreeTolerance, features: Sequence[Feature], prices: Mapping[Any, float] | None
) -> FreeHalfWidth:
    feature, _ = find_drawn(features)[free.component]
    values = read_values(features, free)
    each = zip(free.grades or (), values.sizes[1:], strict=True)
    price = of_grades(tuple(PricedGrade(own.label, size, price_of(feature, own, prices) or 0.0) for own, size in each))
    bounds, pointer = (min(values.sizes[1:]), max(values.sizes[1:])), f"/optimise/tolerances/{index}"
    return FreeHalfWidth(free.interface, free.component, *bounds, price, pointer, values, tuple(free.also))


def _bounds(bounds: RotationBounds | TranslationBounds) -> tuple[float, float]:
    if isinstance(bounds, RotationBounds):
        return radians(bounds.min_deg), radians(bounds.max_deg)
    return bounds.min_mm, bounds.max_mm


def _price(curve: CostCurve | None, weight: float) -> Price:
    if curve is None:
        return reciprocal(weight)
    if curve.curve == "exponential":
        scale = radians(curve.scale_deg) if curve.scale_deg is not None else float(curve.scale_mm or 0.0)
        return Price("exponential", curve.weight, scale=scale)
    return Price("power", curve.weight, 1.0 if curve.curve == "reciprocal" else 2.0)


def _read_listed(free: FreeTolerance, pointer: str) -> FreeHalfWidth:
    native = radians if free.unit == "deg" else float
    if free.grades is not None:
        grades = tuple(
            PricedGrade(grade.label, native(getattr(grade, f"half_width_{free.unit}")), grade.price or 0.0)
            for grade in free.grades
        )
        price = of_grades(grades)
        low, high = min(g.half_width for g in grades), max(g.half_width for g in grades)
    else:
        price = _price(free.cost, free.cost_weight)
        low, high = (native(getattr(free, f"{end}_{free.unit}")) for end in ("min", "max"))
    return FreeHalfWidth(free.interface, free.component, low, high, price, pointer)


def with_count(request: OptimiseRequest, count: int) -> PlacementProblem:
    """The problem with so many fiducials: the last free ones left out, or new ones added to the region.

    New ones take the next free labels F1, F2, ... and the manufacturing tolerance of the others.
    """
    problem, section = request.problem, request.section
    system = problem.system
    present = len(system.fiducial_labels)
    if count == present:
        return problem
    free = [i for i, label in enumerate(system.fiducial_labels) if label not in section.fixed]
    remaining = sorted(set(range(present)) - set(free[len(free) - (present - count) :] if count < present else ()))
    labels = [system.fiducial_labels[i] for i in remaining]
    positions, made = system.fiducials_mm[remaining], system.manufacturing_half_width_mm[remaining]
    if count > present:
        low, high = bounding_box(problem.places[0].region)
        new, middle = count - present, (low + high) / 2
        unused = (f"F{number}" for number in range(1, 10**6) if f"F{number}" not in labels)
        labels += [next(unused) for _ in range(new)]
        # Where they stand does not matter: only the first start looks, and spreads what lies together.
        rng = np.random.default_rng(0)
        positions = np.vstack([positions, middle + 0.9 * (rng.uniform(low, high, (new, 3)) - middle)])
        made = np.vstack([made, np.repeat(made[:1], new, axis=0)])
    system = replace(
        system, fiducial_labels=tuple(labels), fiducials_mm=frozen(positions), manufacturing_half_width_mm=frozen(made)
    )
    stay = None if section.stay is None else _stay(section.stay, problem.system, labels)
    return replace(problem, system=system, places=_places(system, section), stay=stay)


def list_counts(request: OptimiseRequest) -> tuple[int, ...]:
    """The numbers of fiducials to be tried, ascending.  Raises DesignError when the symmetry allows none."""
    count, problem = request.section.count, request.problem
    present = len(problem.system.fiducial_labels)
    if count is None:
        return (present,)
    if count.max > MOST_FIDUCIALS:
        detail = f"up to {count.max} fiducials; a layout of at most {MOST_FIDUCIALS} is optimised"
        raise DesignError(Problem("/optimise/count/max", "too-many", detail, f"max: {MOST_FIDUCIALS}"))
    fixed, size = len(request.section.fixed), 1 + len(problem.symmetry)
    tried = tuple(n for n in range(count.min, count.max + 1) if n > fixed and (n - fixed) % size == 0)
    if not tried:
        detail = (
            f"no number of fiducials from {count.min} to {count.max} makes whole groups of {size} beside "
            f"{fixed} fixed ones"
        )
        raise DesignError(Problem("/optimise/count", "incomplete-group", detail, "widen the range"))
    return tried


def label_places(request: OptimiseRequest, problem: PlacementProblem, layout: Array) -> tuple[str, ...]:
    """(N,) labels of a layout of the problem: each of the design's is where its fiducial moves least in all.

    What no view lists apart, and what has no loss probability of its own, may stand for one another.
    """
    points = request.design.document.fiducials.points or ()
    losses = {label: own.loss_probability for label, own in zip(request.design.fiducials.labels, points, strict=False)}
    before, labels = request.problem.system, problem.system.fiducial_labels
    matched = match(
        list_places(problem, layout, [losses.get(label) for label in labels]),
        list_places(request.problem, before.fiducials_mm, [losses.get(label) for label in before.fiducial_labels]),
        inf if problem.stay is None else problem.stay.at_most_mm,
    )
    new = (label for label in labels if label not in before.fiducial_labels)
    free = set(problem.free_fiducials)
    return tuple(
        before.fiducial_labels[matched[i]] if i in matched else next(new) if i in free else label
        for i, label in enumerate(labels)
    )


def in_order(request: OptimiseRequest, labels: tuple[str, ...]) -> list[int]:
    """Where each label stands in the order of the document, new ones last."""
    known = request.design.fiducials.labels
    return sorted(range(len(labels)), key=lambda i: known.index(labels[i]) if labels[i] in known else len(known) + i)


def revise(request: OptimiseRequest, problem: PlacementProblem, choice: Choice) -> Design:
    """The design with a choice written into it: positions rounded to a micrometre, half-widths rounded down."""
    order = in_order(request, problem.system.fiducial_labels)
    fiducials = _round_positions(problem, choice)[order]
    widths: dict[tuple[str, str], float] = {}
    drawn: dict[tuple[str, str], str | float] = {}
    for k, (free, value) in enumerate(zip(problem.half_widths, choice.half_width, strict=True)):
        if free.drawn is None:
            widths[free.contributor, free.component] = round_down(problem, k, float(value))
        elif (bought := grade_for(free.price, float(value))) is not None:
            chosen = value_named(request.section, free, bought.name)
            drawn |= {(free.contributor, name): chosen for name in (free.component, *free.also)}
    return revise_design(
        request.design,
        Revision(
            labels=[problem.system.fiducial_labels[i] for i in order],
            fiducials_mm=fiducials if problem.places else None,
            half_width=widths,
            drawn=drawn,
            pivot_mm={
                free.contributor: np.clip(np.round(value, POSITION_DECIMALS[0]), free.low_mm, free.high_mm)
                for free, value in zip(problem.pivots, choice.pivots_mm, strict=True)
            },
        ),
    )


def value_named(section: Optimise, free: FreeHalfWidth, name: str) -> str | float:
    """The value of a drawing whose grade has a name."""
    listed = section.tolerances[int(free.pointer.rpartition("/")[2])].grades or ()
    return next(grade.drawn_value for grade in listed if grade.label == name and grade.drawn_value is not None)


def _round_positions(problem: PlacementProblem, choice: Choice) -> Array:
    """Positions to a micrometre where that keeps the spacing; copies of a symmetry and curved regions to 1e-6 mm."""
    free = list(problem.free_fiducials)
    fiducials = problem.system.fiducials_mm.copy()
    coarse = not problem.symmetry and all(isinstance(place.region, BoxRegion) for place in problem.places)
    for decimals in POSITION_DECIMALS if coarse else POSITION_DECIMALS[1:]:
        fiducials[free] = np.round(choice.fiducials_mm[free], decimals) + 0.0  # no negative zeros
        for place in problem.places:
            if isinstance(place.region, BoxRegion | NearSurface) and not problem.symmetry:
                index = list(place.fiducials)
                fiducials[index] = clip(place.region, fiducials[index])
        if (homes := problem.stay) is not None:
            near = np.linalg.norm(fiducials - homes.home_mm, axis=1) < STAYS_MM
            fiducials = np.where(near[:, None], homes.home_mm, fiducials)
        if smallest_gap(fiducials, free) >= problem.min_spacing_mm:
            break
    return fiducials


def smallest_gap(points: Array, free: list[int]) -> float:
    """Distance of the closest pair with a free fiducial in it, mm; inf when there is none."""
    gaps = [float(np.linalg.norm(points[i] - points[j])) for i in free for j in range(len(points)) if i != j]
    return min(gaps, default=np.inf)


def round_down(problem: PlacementProblem, index: int, half_width: float) -> float:
    """A free half-width, native unit, on the grid of the document, never looser; at a bound or grade it is that.

    Where the cost is limited the grid is as fine as the room that the search leaves for it (``ROUNDED``).
    """
    free = problem.half_widths[index]
    for bound in (free.minimum, free.maximum, *(grade.half_width for grade in free.price.grades)):
        if abs(half_width - bound) <= AT_BOUND * bound:
            return bound
    shown, back = (degrees, radians) if unit_of(problem, index) == "rad" else (float, float)
    decimals = WIDTH_DECIMALS
    if problem.cost_limit is not None:
        steepness = -slope_of(free.price, half_width) / cost_of(free.price, half_width) / shown(1.0)
        decimals = max(decimals, ceil(log10(2 * steepness / ROUNDED)))
    return max(free.minimum, back(floor(shown(half_width) * 10**decimals) / 10**decimals))

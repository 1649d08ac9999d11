"""The layout in space as data: what the viewer turns and what the picture on paper shows, from one list of items.

A scene is items in con, mm: fiducials, targets, interfaces, frames, zones, beams and errors, in layers that are shown
or hidden, and cameras to look from.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from math import cos, radians, sin, sqrt
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from tailstack.design import Design, compile_design
from tailstack.design.frames import mesh_of
from tailstack.design.optimise_document import SearchBox, SearchCylinder, SearchRegion, SearchSurface, Sector, Shaped
from tailstack.geometry.arrays import Array
from tailstack.geometry.rotation import unit
from tailstack.measures.measure import Channel
from tailstack.montecarlo.chain import run_indices, run_other_shots
from tailstack.montecarlo.plan import compile_plan
from tailstack.system import DirectEffect, System

from .beams import Beam, beams_of
from .svg import LONGEST, in_lines, printable, round_step

if TYPE_CHECKING:
    from tailstack.results import Score, TargetScore, WorthyPlace
    from tailstack.scoring import Errors, TargetErrors
Point3 = tuple[float, float, float]
Kind = Literal["mark", "line", "face", "ellipsoid", "arrow"]


@dataclass(frozen=True, slots=True)
class Item:
    """One thing to draw: a mark at a point, a line or face through points, an arrow between two, an ellipsoid.

    ``points``: con, mm; of an ellipsoid its centre and the ends of its three semi-axes, each from the centre.
    ``look``: of a mark its shape, else the key of a style.
    """

    kind: Kind
    layer: str
    look: str
    points: tuple[Point3, ...]
    label: str = ""
    title: str = ""


@dataclass(frozen=True, slots=True)
class Layer:
    """Items that are shown or hidden together."""

    key: str
    label: str
    shown: bool


@dataclass(frozen=True, slots=True)
class ViewDirection:
    """A direction to look from, at infinite distance: ``right`` and ``up`` of the page in con."""

    key: str
    label: str
    right: Point3
    up: Point3


@dataclass(frozen=True, slots=True)
class LayoutScene:
    """A layout in con, mm.  ``near`` and ``far``: points that have to be in sight, of the structure, of everything."""

    title: str
    words: str  # the scene for those who do not see it
    magnification: float  # of ellipsoids and biases; 0 where there are none
    note: str  # what is drawn to which scale
    layers: tuple[Layer, ...]
    cameras: tuple[ViewDirection, ...]
    items: tuple[Item, ...]
    near: tuple[Point3, ...]
    far: tuple[Point3, ...]
    before: str = "before"  # what the layout below is called, where this one is drawn over another


LOOKS: dict[str, dict[str, Any]] = {  # of lines, faces, arrows and ellipsoids
    "floor": {"stroke": "#c8c8c8", "width": 0.6, "fill": "#efefef", "opacity": 0.7},
    "drop": {"stroke": "#9a9a9a", "width": 0.7, "dash": [1, 2.5]},
    "ray": {"stroke": "#6b7780", "width": 0.9},
    "axis": {"stroke": "#6b7780", "width": 0.8, "dash": [6, 3]},
    "beam": {"stroke": "#4b5660", "width": 1.6},
    "detector": {"stroke": "#4b5660", "width": 1.1, "fill": "#9fb3c4", "opacity": 0.25},
    "guessed": {"stroke": "#4b5660", "width": 1.1, "fill": "#9fb3c4", "opacity": 0.15, "dash": [4, 3]},
    "region": {"stroke": "#d55e00", "width": 0.9, "dash": [3, 2]},
    "room": {"stroke": "#0072b2", "width": 0.8, "dash": [2, 3]},
    "worthy": {"stroke": "#00795a", "width": 0.8, "fill": "#00795a", "opacity": 0.2},
    "keep-out": {"stroke": "#b3261e", "width": 1.1, "dash": [5, 2]},
    "frame": {"stroke": "#222222", "width": 1.3},
    "locator": {"stroke": "#222222", "width": 1.4},
    "lever": {"stroke": "#00795a", "width": 0.9, "dash": [8, 2, 2, 2]},
    "moved": {"stroke": "#8a8a8a", "width": 0.9},
    "tcp": {"stroke": "#a84600", "width": 1.1, "fill": "#e69f00", "opacity": 0.3},
    "tcp-before": {"stroke": "#6b7780", "width": 1.0, "fill": "#9aa4ad", "opacity": 0.2, "dash": [3, 2]},
    "localisation": {"stroke": "#00618f", "width": 1.0, "fill": "#56b4e9", "opacity": 0.25},
    "trajectory": {"stroke": "#222222", "width": 1.4},
    "corridor": {"stroke": "#00795a", "width": 0.9},
    "executed": {"stroke": "#a84600", "width": 0.6},
    "bias": {"stroke": "#8c1d5b", "width": 1.8},
    "bias-before": {"stroke": "#6b7780", "width": 1.4},
}


def point(values: Array, decimals: int = 3) -> Point3:
    x, y, z = (round(float(v), decimals) + 0.0 for v in values)
    return (x, y, z)


def points_of(values: Iterable[Array]) -> tuple[Point3, ...]:
    return tuple(point(value) for value in values)


def place_in_words(values: Array) -> str:
    x, y, z = point(values, 2)
    return f"x {x:.2f}, y {y:.2f}, z {z:.2f} mm"


CIRCLE = 36  # pieces of a circle
P95_GAUSSIAN = sqrt(7.814727903251179)  # radius of the ball that holds 95 % of a standard Gaussian in three dimensions

Lines = list[Array]  # each (n, 3), mm


def box_lines(low: Array, high: Array) -> Lines:
    """The twelve edges of an axis-parallel box between two corners (3,)."""
    corners = {ends: np.where(ends, high, low) for ends in product((0, 1), repeat=3)}
    return [
        np.array([corners[a], corners[b]])
        for a, b in combinations(corners, 2)
        if sum(x != y for x, y in zip(a, b, strict=True)) == 1
    ]


def circle(centre: Array, normal: Array, radius_mm: float) -> Array:
    """(CIRCLE + 1, 3) a closed circle about ``centre`` across ``normal``."""
    first, second = across(normal)
    angles = np.linspace(0.0, 2 * np.pi, CIRCLE + 1)[:, None]
    return np.asarray(centre + radius_mm * (np.cos(angles) * first + np.sin(angles) * second))


def across(direction: Array) -> tuple[Array, Array]:
    """Two unit vectors across a direction (3,) and each other."""
    along = unit(np.asarray(direction, dtype=float))
    first = unit(np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))]))
    return first, np.cross(along, first)


def cylinder_lines(base: Array, axis: Array, height_mm: float, radius_mm: float) -> Lines:
    """Both rims and four lines along the wall."""
    along = height_mm * unit(np.asarray(axis, dtype=float))
    rim = circle(base, axis, radius_mm)
    walls = [np.array([rim[k], rim[k] + along]) for k in range(0, CIRCLE, CIRCLE // 4)]
    return [rim, rim + along, *walls]


def channel_lines(begin: Array, end: Array, channel: Channel, times: float) -> Lines:
    """Both rims and four lines along the wall, half-axes so many times as long; con, mm."""
    along = unit(end - begin)
    first, second = across(along)
    if channel.major is not None:
        second = unit(np.cross(along, channel.major))
        first = np.cross(second, along)
    angles = np.linspace(0.0, 2 * np.pi, CIRCLE + 1)[:, None]
    rims = [
        centre + times * (major * np.cos(angles) * first + minor * np.sin(angles) * second)
        for centre, (major, minor) in ((begin, channel.entry_mm), (end, channel.end_mm))
    ]
    return [*rims, *(np.array([rims[0][k], rims[1][k]]) for k in range(0, CIRCLE, CIRCLE // 4))]


def ball_lines(centre: Array, radius_mm: float) -> Lines:
    """Three great circles."""
    return [circle(centre, axis, radius_mm) for axis in np.eye(3)]


def region_lines(region: Shaped) -> Lines:
    """A search region or a keep-out zone of the design document; a tube or shell has its inner surface too; of what is
    near a surface, cuts through that."""
    if isinstance(region, SearchRegion) and region.surface is not None:
        return surface_lines(region.surface)
    shape = region.solid
    if isinstance(shape, SearchBox):
        return box_lines(np.array(shape.min_mm), np.array(shape.max_mm))
    radii = dict.fromkeys(radius for radius in (shape.radius_mm, shape.inner_radius_mm) if radius > 0)
    if isinstance(shape, SearchCylinder):
        base, axis = np.array(shape.base_mm), np.array(shape.axis)
        if shape.sector is not None:
            return sector_lines(shape, shape.sector)
        return [line for radius in radii for line in cylinder_lines(base, axis, shape.height_mm, radius)]
    return [line for radius in radii for line in ball_lines(np.array(shape.centre_mm), radius)]


def sector_lines(shape: SearchCylinder, sector: Sector) -> Lines:
    """Both ends, and the upright edges."""
    axis = unit(np.array(shape.axis, dtype=float))
    towards = np.array(sector.towards, dtype=float)
    towards = unit(towards - axis * (axis @ towards))
    angles = np.radians(np.linspace(-0.5, 0.5, CIRCLE // 2) * sector.width_deg)[:, None]
    arc = np.cos(angles) * towards + np.sin(angles) * np.cross(axis, towards)
    rim = np.array(shape.base_mm) + np.vstack([shape.radius_mm * arc, shape.inner_radius_mm * arc[::-1]])
    rim = np.vstack([rim, rim[:1]])
    along = shape.height_mm * axis
    last = CIRCLE // 2
    return [rim, rim + along, *(np.array([rim[k], rim[k] + along]) for k in (0, last - 1, last, 2 * last - 1))]


SLICES, MOST_POINTS = 6, 120  # of a surface, and of one line


def surface_lines(surface: SearchSurface) -> Lines:
    """Cuts across the longest side of the box about it."""
    mesh = mesh_of(surface)
    low, high = mesh.corners_mm.min(axis=0), mesh.corners_mm.max(axis=0)
    axis = int((high - low).argmax())
    heights = np.linspace(low[axis], high[axis], SLICES + 2)
    heights[[0, -1]] += 1e-3 * (high[axis] - low[axis]) * np.array([1, -1])
    lines = [line for height in heights for line in mesh.slice(axis, float(height))]
    return [line[np.unique(np.linspace(0, len(line) - 1, MOST_POINTS).astype(int))] for line in lines]


def semi_axes(covariance_mm2: Array) -> Array:
    """(3, 3) one semi-axis per row, longest first: the ellipsoid that holds 95 % of a Gaussian, mm."""
    values, vectors = np.linalg.eigh(covariance_mm2)
    rows = (vectors * np.sqrt(np.maximum(values, 0.0))).T[::-1] * P95_GAUSSIAN
    # The sign of an eigenvector is free: the same picture on every machine needs one.
    leading = np.take_along_axis(rows, np.abs(rows).argmax(axis=1)[:, None], axis=1)
    return np.asarray(np.where(leading < 0, -rows, rows))


MOST_DROPS = 60  # lines down to the floor; more would be a curtain


def structure_points(system: System) -> Array:
    """(M, 3) mm: fiducials, targets, and pivots that turn."""
    pivots = [mount.pivot_mm for mount in system.interfaces if turns(mount)]
    return np.vstack(
        [system.fiducials_mm, [target.position_mm for target in system.targets], *([pivots] if pivots else [])]
    )


def turns(mount: DirectEffect) -> bool:
    """Whether the seat has an error at all: the pivot of a perfect one means nothing."""
    return mount.sources.count > 0 or bool(np.any(mount.known))


def radius_of(points_mm: Array) -> float:
    low, high = points_mm.min(axis=0), points_mm.max(axis=0)
    return max(0.5 * float(np.linalg.norm(high - low)), 1.0)


def floor(systems: Sequence[System]) -> list[Item]:
    """The rectangle below all fiducials."""
    places = np.vstack([system.fiducials_mm for system in systems])
    low, high = places.min(axis=0), places.max(axis=0)
    pad = 0.06 * max(float((high - low).max()), 1.0)
    (x0, y0), (x1, y1), z = low[:2] - pad, high[:2] + pad, low[2]
    return [Item("face", "floor", "floor", points_of(np.array([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]])))]


def fiducials(system: System, old: System | None, called: str) -> list[Item]:
    """Fiducials with their height over the lowest; of another layout, by label, those that stood elsewhere."""
    before = {} if old is None else dict(zip(old.fiducial_labels, old.fiducials_mm, strict=True))
    lowest = min(float(each.fiducials_mm[:, 2].min()) for each in (system, old) if each is not None)
    items = []
    for name, at in zip(system.fiducial_labels, system.fiducials_mm, strict=True):
        whole, was = printable(name, LONGEST), before.pop(name, None)
        if len(system.fiducials_mm) <= MOST_DROPS:
            items.append(Item("line", "floor", "drop", points_of([at, np.array([at[0], at[1], lowest])])))
        if was is not None and differ(was, at):
            items.append(Item("line", "before", "moved", points_of([was, at])))
            title = f"{whole} {called}: {place_in_words(was)}"
            items.append(Item("mark", "before", "old", (point(was),), "", title))
        look = "fiducial" if old is None or was is not None else "new"
        title = f"fiducial {whole}: {place_in_words(at)}"
        items.append(Item("mark", "fiducials", look, (point(at),), in_lines(name, 18), title))
    for name, was in before.items():
        title = f"{printable(name, LONGEST)}, only {called}: {place_in_words(was)}"
        items.append(Item("mark", "before", "old", (point(was),), "", title))
    return items


def differ(was: Array, now: Array) -> bool:
    return not np.allclose(was, now, rtol=0, atol=1e-6)


def targets(design: Design, system: System) -> list[Item]:
    items, regions = [], set()
    for target in system.targets:
        label = target.name if target.region is None else "" if target.region in regions else target.region
        regions.add(target.region)
        title = f"target {printable(target.name, LONGEST)}: {place_in_words(target.position_mm)}"
        items.append(Item("mark", "targets", "target", (point(target.position_mm),), in_lines(label, 18), title))
    for region in (entry.region for entry in design.document.targets if entry.region is not None):
        lines: Lines = []
        if region.box is not None:
            centre, half = np.array(region.box.centre_mm), 0.5 * np.array(region.box.size_mm)
            lines = box_lines(centre - half, centre + half)
        elif region.sphere is not None:
            lines = ball_lines(np.array(region.sphere.centre_mm), region.sphere.radius_mm)
        items += [Item("line", "targets", "region", points_of(line)) for line in lines]
    return items


def mounts(design: Design, system: System, old: System | None, length: float) -> list[Item]:
    interfaces = design.document.interfaces
    items = []
    mounts = (
        ("pivot 1", system.structure_connector, interfaces.structure_connector, old and old.structure_connector),
        ("pivot 2", system.connector_flange, interfaces.connector_flange, old and old.connector_flange),
    )
    for name, mount, document, was in mounts:
        if not turns(mount):
            continue
        title = f"{name}, {printable(mount.label, LONGEST)}: {place_in_words(mount.pivot_mm)}"
        items.append(Item("mark", "pivots", name, (point(mount.pivot_mm),), name, title))
        if was and differ(was.pivot_mm, mount.pivot_mm):
            items.append(Item("line", "before", "moved", points_of([was.pivot_mm, mount.pivot_mm])))
        for target in system.targets[:1]:
            arm = float(np.linalg.norm(target.position_mm - mount.pivot_mm))
            lever_title = f"{name} to {printable(target.name, LONGEST)}: {arm:.1f} mm"
            points = points_of([mount.pivot_mm, target.position_mm])
            items.append(Item("line", "levers", "lever", points, f"{arm:.0f} mm", lever_title))
        for contact, at, normal in document.contacts if document is not None else ():
            begin = at - length * normal / np.linalg.norm(normal)
            title = f"locator {printable(contact, LONGEST)}: {place_in_words(at)}"
            items.append(Item("arrow", "locators", "locator", points_of([begin, at]), in_lines(contact, 18), title))
    return items


def frames(system: System, length: float) -> list[Item]:
    """The axes of con, flange and tcp; frames that coincide are named together."""
    frames: list[tuple[str, Array]] = []
    for name, transform in (("con", np.eye(4)), ("flange", system.T_flange_con), ("tcp", system.T_tcp_con)):
        here: Array = np.asarray(np.linalg.inv(transform), dtype=np.float64)
        for k, (others, there) in enumerate(frames):
            if np.allclose(here, there, rtol=0, atol=1e-6):
                frames[k] = (f"{others} = {name}", there)
                break
        else:
            frames.append((name, here))
    items = []
    for name, pose in frames:
        origin = pose[:3, 3]
        for axis, direction in zip("xyz", pose[:3, :3].T, strict=True):
            label = f"{name} {axis}" if axis == "x" else axis
            ends = points_of([origin, origin + length * direction])
            items.append(Item("arrow", "frames", "frame", ends, label, f"frame {name}, axis {axis}"))
    return items


def zones(design: Design) -> list[Item]:
    section = design.document.optimise
    if section is None:
        return []
    items = []
    for zone in section.keep_out:
        title = f"keep-out zone {printable(zone.name, LONGEST)}, clearance {zone.clearance_mm:g} mm"
        for k, line in enumerate(region_lines(zone)):
            label = in_lines(zone.name, 24) if k == 0 else ""
            items.append(Item("line", "keep-out", "keep-out", points_of(line), label, title))
    regions: list[Any] = [region for region in (section.region, *(section.regions or ())) if region is not None]
    lines = [line for region in regions for line in region_lines(region)]
    if section.box is not None:
        lines += box_lines(np.array(section.box.min_mm), np.array(section.box.max_mm))
    return items + [Item("line", "room", "room", points_of(line), "", "where fiducials may go") for line in lines]


WORTHY_MM = 5.0  # radius of the ball at a place that all the best layouts take


def worthy(places: Sequence[WorthyPlace]) -> list[Item]:
    """A ball where fiducials tell most, its volume as many of them as the best mixture of layouts has there."""
    items = []
    for place in places:
        at, radius_mm = np.array(place.position_mm), WORTHY_MM * place.fiducials ** (1 / 3)
        title = f"the best mixture of layouts has {place.fiducials:.2g} fiducials about {place_in_words(at)}"
        items.append(Item("ellipsoid", "worthy", "worthy", (point(at), *points_of(radius_mm * np.eye(3))), "", title))
    return items


AZIMUTH, ELEVATION = radians(-62), radians(20)  # of the eye of the first camera
RIGHT = np.array([-sin(AZIMUTH), cos(AZIMUTH), 0.0])
UP = np.array([-sin(ELEVATION) * cos(AZIMUTH), -sin(ELEVATION) * sin(AZIMUTH), cos(ELEVATION)])


def beam_items(beam: Beam, system: System, crowded: bool) -> list[Item]:
    """Source, edges of the beam, detector and the images on it; ``crowded``: only the source is named, and shortly."""
    name = printable(beam.view.name, LONGEST)
    corners = beam.on_detector(beam.corners_px)
    distance = f"{beam.detector_mm:.0f} mm from the source" if beam.stated else "its distance is not stated"
    source = in_lines(name if crowded else f"{name} source", 18)
    title = f"source of view {name}: {place_in_words(beam.source_mm)}"
    items = [Item("mark", "beams", "source", (point(beam.source_mm),), source, title)]
    items += [Item("line", "beams", "ray", points_of([beam.source_mm, corner])) for corner in corners]
    look = "detector" if beam.stated and beam.sized else "guessed"
    label = "" if crowded else in_lines(f"{name} detector", 18)
    items.append(Item("face", "beams", look, points_of(corners), label, f"detector of view {name}, {distance}"))
    middle = beam.source_mm + beam.detector_mm * beam.direction
    items.append(Item("line", "beams", "axis", points_of([beam.source_mm, middle])))
    images = beam.images(system.fiducials_mm)
    images = images[np.isfinite(images).all(axis=1)]
    items += [Item("mark", "beams", "image", (point(place),)) for place in beam.on_detector(images)]
    return items


def beam_arrow(beam: Beam, shown: Array) -> Item:
    """An arrow towards the structure, from outside it, with the name of the view."""
    centre, radius = (shown.min(axis=0) + shown.max(axis=0)) / 2, radius_of(shown)
    along = unit(centre - beam.source_mm)
    ends = points_of([centre - 1.5 * radius * along, centre - 1.15 * radius * along])
    name = beam.view.name
    return Item("arrow", "directions", "beam", ends, in_lines(name, 18), f"beam of view {printable(name, LONGEST)}")


def cameras(beams: Sequence[Beam]) -> tuple[ViewDirection, ...]:
    cameras = [ViewDirection("iso", "Oblique", point(RIGHT, 6), point(UP, 6))]
    for k, beam in enumerate(beams[:6], 1):
        label = f"From {printable(beam.view.name, LONGEST)} source"
        cameras.append(ViewDirection(f"view-{k}", label, point(beam.right, 6), point(beam.up, 6)))
    return (*cameras, ViewDirection("top", "From +z", (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))


SHARE = 0.16  # of the layout's diagonal: the longest semi-axis or bias as drawn
MOST_ELLIPSOIDS = 6  # targets with the largest P95


def magnification_of(pairs: Sequence[tuple[System, Score | Errors]], radius: float) -> float:
    """1, 2 or 5 times a power of ten, so that the largest ellipsoid and bias can be seen and hide nothing."""
    sizes = [0.0]
    for _, score in pairs:
        score_targets: Sequence[TargetScore | TargetErrors] = score.targets
        for target in score_targets:
            sizes.append(float(np.linalg.norm(target.bias_mm)))
            sizes.append(float(np.linalg.norm(semi_axes(np.array(target.covariance_mm2))[0])))
    return round_step(SHARE * 2 * radius / max(sizes)) if max(sizes) > 1e-9 else 0.0


def errors(system: System, score: Score | Errors, magnification: float, called: str = "") -> list[Item]:
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
    score_targets: Sequence[TargetScore | TargetErrors] = score.targets
    for target in sorted(score_targets, key=lambda entry: entry.p95_mm, reverse=True):
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
            name = printable(target.name, LONGEST)
            if np.linalg.norm(axes[0]) > 0:
                lengths = ", ".join(f"{float(np.linalg.norm(axis)):.3g}" for axis in axes)
                size_words = f"95 % ellipsoid, semi-axes {lengths} mm, P95 {metric.p95_mm:.3f} mm"
                title = f"{when}{word} error at {name}: {size_words}"
                points = (point(centre), *points_of(magnification * axes))
                items.append(Item("ellipsoid", f"{kind}{suffix}", f"{kind}{suffix}", points, "", title))
            size = float(np.linalg.norm(bias))
            if kind == "tcp" and magnification * size > 1e-3:
                title = f"{when}bias of the TCP error at {name}: {size:.3g} mm"
                items.append(Item("arrow", f"bias{suffix}", f"bias{suffix}", points_of([at, centre]), "", title))
    return items


EXECUTED = 50  # axes drawn of each trajectory


def _draw_executed(system: System) -> Array:
    """(2, T, 3, n) mm in tcp, of shots and, where a trajectory has one at each end, of others of the same mountings."""
    plan = compile_plan(system)
    found = run_indices(plan, 0, 0, EXECUTED).errors
    others = run_other_shots(plan, 0, 0, EXECUTED) if any(each.two_shots for each in system.targets) else found
    return np.stack([found, others])[:, :, 0]


def trajectories(system: System, magnification: float) -> Iterator[Item]:
    """Planned trajectories; magnified as errors are, their corridors, and the axes of some shots of a simulation."""
    named = {target.name: k for k, target in enumerate(system.targets)}
    entered = [(named[target.entry], k, target) for k, target in enumerate(system.targets) if target.entry is not None]
    if not entered:
        return
    shots = magnification * system.T_tcp_con[:3, :3].T @ _draw_executed(system) if magnification else None
    for first, last, target in entered:
        begin, end = system.targets[first].position_mm, target.position_mm
        name = f"{printable(target.entry or '', LONGEST)} to {printable(target.name, LONGEST)}"
        yield Item("line", "targets", "trajectory", points_of([begin, end]), "", f"trajectory {name}")
        if shots is None:
            continue
        own = shots[int(target.two_shots), first], shots[0, last]
        for shot in np.flatnonzero(np.isfinite(own).all(axis=(0, 1))):
            title = f"{name}: executed axis of shot {shot + 1} of a simulation, seed 0"
            ends = points_of([begin + own[0][:, shot], end + own[1][:, shot]])
            yield Item("line", "executed", "executed", ends, "", title)
        if target.channel is not None:
            title = f"corridor of {name}: {target.channel.words}"
            lines = channel_lines(begin, end, target.channel, magnification)
            yield from (Item("line", "corridor", "corridor", points_of(line), "", title) for line in lines)


def extent(item: Item) -> Array:
    """(M, 3) points around an error as drawn."""
    points = np.array(item.points)
    if item.kind != "ellipsoid":
        return points
    reach = np.sqrt((points[1:] ** 2).sum(axis=0))
    return np.vstack([points[0] + sign * reach[k] * axis for k, axis in enumerate(np.eye(3)) for sign in (-1.0, 1.0)])


MOST_NAMED = 3  # views: of more, detectors have no names of their own


def scene_of(
    design: Design, score: Score | Errors | None, title: str, before: tuple[Design, Score | None] | None = None,
    called: str = "before", places: Sequence[WorthyPlace] = (),
) -> LayoutScene:  # fmt: skip
    """The scene of a design and what was computed of it, if it was.

    before: another one that it is drawn over, without errors where it has no score.  called: what that one is called.
    places: where fiducials tell most.
    Positions are nominal; ellipsoids and biases are first order, at the magnification that the scene states.  Raises
    DesignError, IllPosedError for a design that does not compile.
    """
    system = compile_design(design)
    old = None if before is None else compile_design(before[0])
    beams = beams_of(design, system)
    scores: list[tuple[System, Score | Errors]] = [] if score is None else [(system, score)]
    if before is not None and old is not None and before[1] is not None:
        scores.append((old, before[1]))
    systems = [system] if old is None else [system, old]
    structures = [structure_points(each) for each in systems]
    radius = radius_of(structures[0])
    magnification = magnification_of(scores, radius)
    items: list[Item] = [
        *floor(systems),
        *fiducials(system, old, called),
        *targets(design, system),
        *mounts(design, system, old, 0.16 * radius),
        *frames(system, 0.3 * radius),
        *zones(design),
        *worthy(places),
    ]
    drawn = [item for k, (at, its) in enumerate(scores) for item in errors(at, its, magnification, called if k else "")]
    drawn += trajectories(system, magnification)
    shown = np.vstack([*structures, items[0].points, *(extent(item) for item in drawn)])
    arrows = [beam_arrow(beam, shown) for beam in beams]
    items += [*drawn, *arrows, *(item for beam in beams for item in beam_items(beam, system, len(beams) > MOST_NAMED))]
    ends = [np.vstack([beam.source_mm, beam.on_detector(beam.corners_px)]) for beam in beams]
    return LayoutScene(
        title=printable(title, 2 * LONGEST),
        words=_words(system, beams, magnification, old, called),
        magnification=magnification,
        note=_note(beams, system, magnification),
        layers=_layers(items, system, called),
        cameras=cameras(beams),
        items=tuple(items),
        near=points_of(np.vstack([shown, *(np.array(arrow.points) for arrow in arrows)])),
        far=points_of(np.vstack([shown, *ends])),
        before=called,
    )


def scene_data(scene: LayoutScene) -> dict[str, Any]:
    """A scene as plain data for the viewer."""
    return {
        "title": scene.title,
        "words": scene.words,
        "note": scene.note,
        "magnification": scene.magnification,
        "looks": LOOKS,
        "layers": [{"key": e.key, "label": e.label, "shown": e.shown} for e in scene.layers],
        "cameras": [{"key": e.key, "label": e.label, "right": e.right, "up": e.up} for e in scene.cameras],
        "items": [
            {"kind": e.kind, "layer": e.layer, "look": e.look, "points": e.points}
            | ({"label": e.label} if e.label else {})
            | ({"title": e.title} if e.title else {})
            for e in scene.items
        ],
        "near": scene.near,
        "far": scene.far,
    }


def scene_json(scene: LayoutScene) -> str:
    """That as JSON; it can stand in an HTML script element, and is the same for the same scene."""
    text = json.dumps(scene_data(scene), ensure_ascii=True, allow_nan=False, separators=(",", ":"))  # noqa: TID251 - in a page
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _layers(items: Sequence[Item], system: System, called: str) -> tuple[Layer, ...]:
    known = (
        Layer("fiducials", f"Fiducials ({len(system.fiducials_mm)})", True),
        Layer("labels", "Labels", True),
        Layer("floor", "Height over lowest fiducial", True),
        Layer("targets", "Targets", True),
        Layer("tcp", "Error at the tool, 95 % ellipsoid", True),
        Layer("bias", "Bias at the tool", True),
        Layer("localisation", "Error as located, 95 % ellipsoid", False),
        Layer("corridor", "Corridors of trajectories", True),
        Layer("executed", f"Executed axes, {EXECUTED} shots", True),
        Layer("pivots", "Pivots of the interfaces", True),
        Layer("levers", "Lever arms to the first target", False),
        Layer("locators", "Locators", True),
        Layer("frames", "Frames con, flange, tcp", False),
        Layer("directions", "Beam directions", True),
        Layer("beams", "Sources and detectors", False),
        Layer("keep-out", "Keep-out zones", True),
        Layer("room", "Where fiducials may go", False),
        Layer("worthy", "Where fiducials tell most", True),
        Layer("before", f"Layout {called}", True),
        Layer("tcp-before", f"Error at the tool, {called}", True),
        Layer("bias-before", f"Bias at the tool, {called}", True),
    )
    used = {item.layer for item in items} | {"labels"}
    return tuple(layer for layer in known if layer.key in used)


def _note(beams: Sequence[Beam], system: System, magnification: float) -> str:
    words = "Positions are nominal, in the connector frame con, mm; marks are not to scale."
    if magnification > 0:
        size = "are drawn to scale" if magnification == 1 else f"are magnified {magnification:g} times"
        words += (
            f" Error ellipsoids and biases {size}: estimated, the ellipsoid that holds 95 % of a normal scatter as "
            "large, about target + bias."
        )
    if magnification > 0 and any(target.entry is not None for target in system.targets):
        words += " So are corridors and what executed axes are off by, about the planned trajectory."
    unknown = [printable(beam.view.name, LONGEST) for beam in beams if not beam.stated]
    if unknown:
        words += f" Where the detector of {', '.join(unknown)} stands is not stated: it is drawn behind what it images."
    return words


def _words(system: System, beams: Sequence[Beam], magnification: float, old: System | None, called: str) -> str:
    targets = ", ".join(printable(target.name, LONGEST) for target in system.targets[:5])
    views = ", ".join(printable(beam.view.name, LONGEST) for beam in beams)
    words = f"{len(system.fiducials_mm)} fiducials, targets {targets}, views {views}, in the connector frame, mm. "
    if old is not None:
        words += f"Drawn over the layout {called}, with {len(old.fiducials_mm)} fiducials. "
    return words + (f"Errors are magnified {magnification:g} times." if magnification else "")

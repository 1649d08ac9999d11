"""The layout in space as data: what the viewer turns and what the picture on paper shows, from one list of items."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import cos, radians, sin
from typing import Any, Literal

import numpy as np

from tailstack.design import Design, compile_design
from tailstack.results import Score
from tailstack.system import Array, System

from ...rendering.layout_picture import turns
from ...rendering.panels import round_step
from ...rendering.svg import printable
from .beams import Beam, beams_of
from .shapes import Lines, ball_lines, box_lines, region_lines, semi_axes

Point3 = tuple[float, float, float]
Kind = Literal["mark", "line", "face", "ellipsoid", "arrow"]

AZIMUTH, ELEVATION = radians(-62), radians(20)  # of the eye of the first camera
SHARE = 0.16  # of the layout's radius: the longest semi-axis or bias as drawn
MOST_ELLIPSOIDS = 6  # targets with the largest P95


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
class Camera:
    """A direction to look from, at infinite distance: ``right`` and ``up`` of the page in con."""

    key: str
    label: str
    right: Point3
    up: Point3


@dataclass(frozen=True, slots=True)
class Scene:
    """A layout in con, mm.  ``near`` and ``far``: points that have to be in sight, of the structure, of everything."""

    title: str
    words: str  # the scene for those who do not see it
    magnification: float  # of ellipsoids and biases; 0 where there are none
    note: str  # what is drawn to which scale
    layers: tuple[Layer, ...]
    cameras: tuple[Camera, ...]
    items: tuple[Item, ...]
    near: tuple[Point3, ...]
    far: tuple[Point3, ...]


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
    "keep-out": {"stroke": "#b3261e", "width": 1.1, "dash": [5, 2]},
    "frame": {"stroke": "#222222", "width": 1.3},
    "locator": {"stroke": "#222222", "width": 1.4},
    "lever": {"stroke": "#00795a", "width": 0.9, "dash": [8, 2, 2, 2]},
    "moved": {"stroke": "#8a8a8a", "width": 0.9},
    "tcp": {"stroke": "#a84600", "width": 1.1, "fill": "#e69f00", "opacity": 0.3},
    "tcp-before": {"stroke": "#6b7780", "width": 1.0, "fill": "#9aa4ad", "opacity": 0.2, "dash": [3, 2]},
    "localisation": {"stroke": "#00618f", "width": 1.0, "fill": "#56b4e9", "opacity": 0.25},
    "bias": {"stroke": "#8c1d5b", "width": 1.8},
    "bias-before": {"stroke": "#6b7780", "width": 1.4},
}


def scene_of(design: Design, score: Score, title: str, before: tuple[Design, Score] | None = None) -> Scene:
    """The scene of a design and what was computed of it; ``before``: another one that it is drawn over.

    Positions are nominal; ellipsoids and biases are first order, at the magnification that the scene states.
    Raises DesignError, IllPosedError for a design that does not compile.
    """
    system = compile_design(design)
    old = None if before is None else (compile_design(before[0]), before[1])
    beams = beams_of(design, system)
    radius = _radius(_structure(system))
    pairs = [(system, score)] + ([] if old is None else [old])
    magnification = _magnification(pairs, radius)
    near = [_structure(system), *([] if old is None else [_structure(old[0])])]
    items: list[Item] = [*_floor(np.vstack([system.fiducials_mm, *([] if old is None else [old[0].fiducials_mm])]))]
    items += _fiducials(system, None if old is None else old[0])
    items += _targets(design, system)
    items += _mounts(design, system, None if old is None else old[0], 0.16 * radius)
    items += _frames(system, 0.3 * radius)
    items += _zones(design)
    for which, (at, found) in enumerate(pairs):
        drawn = _errors(at, found, magnification, "" if which == 0 else "-before")
        items += drawn
        near += [_extent(item) for item in drawn]
    shown = np.vstack(near)
    arrows = [_beam_arrow(beam, shown) for beam in beams]
    items += arrows
    far = [shown]
    for beam in beams:
        far += [beam.source_mm[None, :], beam.on_detector(beam.corners_px)]
        items += _beam(beam, system)
    near += [np.array(arrow.points) for arrow in arrows]
    return Scene(
        title=printable(title, 160),
        words=_words(system, beams, magnification, None if old is None else old[0]),
        magnification=magnification,
        note=_note(beams, magnification),
        layers=_layers(items, system),
        cameras=_cameras(beams),
        items=tuple(items),
        near=_points(np.vstack(near)),
        far=_points(np.vstack(far)),
    )


def scene_json(scene: Scene) -> str:
    """A scene as JSON for the viewer; it can stand in an HTML script element, and is the same for the same scene."""
    data = {
        "title": scene.title,
        "words": scene.words,
        "note": scene.note,
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
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


# --- what is where --------------------------------------------------------------------------------


def _point(values: Array) -> Point3:
    x, y, z = (round(float(v), 3) + 0.0 for v in values)
    return (x, y, z)


def _points(values: Iterable[Array]) -> tuple[Point3, ...]:
    return tuple(_point(value) for value in values)


def _at(values: Array) -> str:
    x, y, z = (round(float(v), 2) + 0.0 for v in values)
    return f"x {x:.2f}, y {y:.2f}, z {z:.2f} mm"


def _structure(system: System) -> Array:
    """(M, 3) mm: fiducials, targets, and pivots that turn."""
    pivots = [mount.pivot_mm for mount in (system.interface_1, system.interface_2) if turns(mount)]
    return np.vstack(
        [system.fiducials_mm, [target.position_mm for target in system.targets], *([pivots] if pivots else [])]
    )


def _radius(points_mm: Array) -> float:
    low, high = points_mm.min(axis=0), points_mm.max(axis=0)
    return max(0.5 * float(np.linalg.norm(high - low)), 1.0)


def _floor(fiducials_mm: Array) -> list[Item]:
    """The rectangle below all fiducials, and how high each stands over it."""
    low, high = fiducials_mm.min(axis=0), fiducials_mm.max(axis=0)
    pad = 0.06 * max(float((high - low).max()), 1.0)
    (x0, y0), (x1, y1), z = low[:2] - pad, high[:2] + pad, low[2]
    corners = np.array([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]])
    return [Item("face", "floor", "floor", _points(corners))]


def _fiducials(system: System, old: System | None) -> list[Item]:
    before: dict[str, Array] = {}
    if old is not None:
        before = dict(zip(old.fiducial_labels, old.fiducials_mm, strict=True))
    lowest = min(
        float(places[:, 2].min()) for places in [system.fiducials_mm, *([] if old is None else [old.fiducials_mm])]
    )
    items = []
    for name, place in zip(system.fiducial_labels, system.fiducials_mm, strict=True):
        label = printable(name, 18)
        was = before.pop(name, None)
        items.append(Item("line", "floor", "drop", _points([place, np.array([place[0], place[1], lowest])])))
        if was is not None and not np.allclose(was, place, rtol=0, atol=1e-6):
            items.append(Item("line", "before", "moved", _points([was, place])))
            items.append(Item("mark", "before", "old", (_point(was),), "", f"{label} before: {_at(was)}"))
        look = "fiducial" if old is None or was is not None else "new"
        items.append(Item("mark", "fiducials", look, (_point(place),), label, f"fiducial {label}: {_at(place)}"))
    for name, was in before.items():
        items.append(Item("mark", "before", "old", (_point(was),), "", f"{printable(name, 18)}, left out: {_at(was)}"))
    return items


def _targets(design: Design, system: System) -> list[Item]:
    items, regions = [], set()
    for target in system.targets:
        label = target.name if target.region is None else "" if target.region in regions else target.region
        regions.add(target.region)
        title = f"target {printable(target.name, 40)}: {_at(target.position_mm)}"
        items.append(Item("mark", "targets", "target", (_point(target.position_mm),), printable(label, 18), title))
    for entry in design.document.targets:
        region = entry.region
        if region is None:
            continue
        lines: Lines = []
        if region.box is not None:
            centre, half = np.array(region.box.centre_mm), 0.5 * np.array(region.box.size_mm)
            lines = box_lines(centre - half, centre + half)
        elif region.sphere is not None:
            lines = ball_lines(np.array(region.sphere.centre_mm), region.sphere.radius_mm)
        items += [Item("line", "targets", "region", _points(line)) for line in lines]
    return items


def _mounts(design: Design, system: System, old: System | None, length: float) -> list[Item]:
    interfaces = design.document.interfaces
    items = []
    mounts = (
        ("pivot 1", system.interface_1, interfaces.structure_connector, old and old.interface_1),
        ("pivot 2", system.interface_2, interfaces.connector_flange, old and old.interface_2),
    )
    for name, mount, document, was in mounts:
        if not turns(mount):
            continue
        title = f"{name}, {printable(mount.label or mount.name, 60)}: {_at(mount.pivot_mm)}"
        items.append(Item("mark", "pivots", name, (_point(mount.pivot_mm),), name, title))
        if was and not np.allclose(was.pivot_mm, mount.pivot_mm, rtol=0, atol=1e-6):
            items.append(Item("line", "before", "moved", _points([was.pivot_mm, mount.pivot_mm])))
        for target in system.targets[:1]:
            arm = float(np.linalg.norm(target.position_mm - mount.pivot_mm))
            said = f"{name} to {printable(target.name, 40)}: {arm:.1f} mm"
            points = _points([mount.pivot_mm, target.position_mm])
            items.append(Item("line", "levers", "lever", points, f"{arm:.0f} mm", said))
        for locator in (document.locators or ()) if document is not None else ():
            at, normal = np.array(locator.position_mm), np.array(locator.normal, dtype=float)
            begin = at - length * normal / np.linalg.norm(normal)
            said = f"locator {printable(locator.name, 18)}: {_at(at)}"
            items.append(Item("arrow", "locators", "locator", _points([begin, at]), printable(locator.name, 18), said))
    return items


def _frames(system: System, length: float) -> list[Item]:
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
            ends = _points([origin, origin + length * direction])
            items.append(Item("arrow", "frames", "frame", ends, label, f"frame {name}, axis {axis}"))
    return items


def _zones(design: Design) -> list[Item]:
    section = design.document.optimise
    if section is None:
        return []
    items = []
    for zone in section.keep_out:
        title = f"keep-out zone {printable(zone.name, 40)}, clearance {zone.clearance_mm:g} mm"
        for k, line in enumerate(region_lines(zone)):
            label = printable(zone.name, 24) if k == 0 else ""
            items.append(Item("line", "keep-out", "keep-out", _points(line), label, title))
    regions: list[Any] = [region for region in (section.region, *(section.regions or ())) if region is not None]
    lines = [line for region in regions for line in region_lines(region)]
    if section.box is not None:
        lines += box_lines(np.array(section.box.min_mm), np.array(section.box.max_mm))
    return items + [Item("line", "room", "room", _points(line), "", "where fiducials may go") for line in lines]


# --- errors ---------------------------------------------------------------------------------------


def _magnification(pairs: Sequence[tuple[System, Score]], radius: float) -> float:
    """1, 2 or 5 times a power of ten, so that the largest ellipsoid and bias can be seen and hide nothing."""
    sizes = [0.0]
    for _, score in pairs:
        for target in score.targets:
            sizes.append(float(np.linalg.norm(target.bias_mm)))
            sizes.append(float(np.linalg.norm(semi_axes(np.array(target.covariance_mm2))[0])))
    return round_step(SHARE * 2 * radius / max(sizes)) if max(sizes) > 1e-9 else 0.0


def _errors(system: System, score: Score, magnification: float, suffix: str) -> list[Item]:
    """Bias and ellipsoid of the targets with the largest P95, one per region."""
    if magnification == 0.0:
        return []
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
            when = "before, " if suffix else ""
            word = "TCP" if kind == "tcp" else "localisation"
            name = printable(target.name, 40)
            if np.linalg.norm(axes[0]) > 0:
                lengths = ", ".join(f"{float(np.linalg.norm(axis)):.3g}" for axis in axes)
                title = (
                    f"{when}{word} error at {name}: 95 % ellipsoid, semi-axes {lengths} mm, P95 {metric.p95_mm:.3f} mm"
                )
                points = (_point(centre), *_points(magnification * axes))
                items.append(Item("ellipsoid", f"{kind}{suffix}", f"{kind}{suffix}", points, "", title))
            size = float(np.linalg.norm(bias))
            if kind == "tcp" and magnification * size > 1e-3:
                title = f"{when}bias of the TCP error at {name}: {size:.3g} mm"
                items.append(Item("arrow", f"bias{suffix}", f"bias{suffix}", _points([at, centre]), "", title))
    return items


def _extent(item: Item) -> Array:
    """(M, 3) points around an error as drawn."""
    points = np.array(item.points)
    if item.kind != "ellipsoid":
        return points
    reach = np.sqrt((points[1:] ** 2).sum(axis=0))
    return np.vstack([points[0] + sign * reach[k] * axis for k, axis in enumerate(np.eye(3)) for sign in (-1.0, 1.0)])


# --- beams ----------------------------------------------------------------------------------------


def _beam(beam: Beam, system: System) -> list[Item]:
    name = printable(beam.view.name, 18)
    corners = beam.on_detector(beam.corners_px)
    said = f"{beam.detector_mm:.0f} mm from the source" if beam.stated else "its distance is not stated"
    items = [
        Item(
            "mark",
            "beams",
            "source",
            (_point(beam.source_mm),),
            f"{name} source",
            f"source of view {name}: {_at(beam.source_mm)}",
        )
    ]
    for corner in corners:
        items.append(Item("line", "beams", "ray", _points([beam.source_mm, corner])))
    look = "detector" if beam.stated and beam.sized else "guessed"
    items.append(Item("face", "beams", look, _points(corners), f"{name} detector", f"detector of view {name}, {said}"))
    middle = beam.source_mm + beam.detector_mm * beam.direction
    items.append(Item("line", "beams", "axis", _points([beam.source_mm, middle])))
    images = beam.images(system.fiducials_mm)
    images = images[np.isfinite(images).all(axis=1)]
    items += [Item("mark", "beams", "image", (_point(place),)) for place in beam.on_detector(images)]
    return items


def _beam_arrow(beam: Beam, shown: Array) -> Item:
    """An arrow towards the structure, from outside it, with the name of the view."""
    centre, radius = (shown.min(axis=0) + shown.max(axis=0)) / 2, _radius(shown)
    along = centre - beam.source_mm
    along = along / np.linalg.norm(along)
    ends = _points([centre - 1.25 * radius * along, centre - 0.85 * radius * along])
    return Item(
        "arrow",
        "directions",
        "beam",
        ends,
        printable(beam.view.name, 18),
        f"beam of view {printable(beam.view.name, 18)}",
    )


def _cameras(beams: Sequence[Beam]) -> tuple[Camera, ...]:
    right = np.array([-sin(AZIMUTH), cos(AZIMUTH), 0.0])
    up = np.array([-sin(ELEVATION) * cos(AZIMUTH), -sin(ELEVATION) * sin(AZIMUTH), cos(ELEVATION)])
    cameras = [Camera("iso", "Oblique", _unit(right), _unit(up))]
    for k, beam in enumerate(beams[:6]):
        label = f"From {printable(beam.view.name, 18)} source"
        cameras.append(Camera(f"view-{k + 1}", label, _unit(beam.right), _unit(beam.up)))
    return (*cameras, Camera("top", "From +z", (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))


def _unit(values: Array) -> Point3:
    x, y, z = (round(float(v), 6) + 0.0 for v in values)
    return (x, y, z)


# --- words ----------------------------------------------------------------------------------------


def _layers(items: Sequence[Item], system: System) -> tuple[Layer, ...]:
    known = (
        Layer("fiducials", f"Fiducials ({len(system.fiducials_mm)})", True),
        Layer("labels", "Labels", True),
        Layer("floor", "Height over lowest fiducial", True),
        Layer("targets", "Targets", True),
        Layer("tcp", "Error at the tool, 95 % ellipsoid", True),
        Layer("bias", "Bias at the tool", True),
        Layer("localisation", "Error as localised, 95 % ellipsoid", False),
        Layer("pivots", "Pivots of the interfaces", True),
        Layer("levers", "Lever arms to the first target", False),
        Layer("locators", "Locators", True),
        Layer("frames", "Frames con, flange, tcp", False),
        Layer("directions", "Beam directions", True),
        Layer("beams", "Sources and detectors", True),
        Layer("keep-out", "Keep-out zones", True),
        Layer("room", "Where fiducials may go", False),
        Layer("before", "Where things were", True),
        Layer("tcp-before", "Error at the tool, before", True),
        Layer("bias-before", "Bias at the tool, before", True),
    )
    used = {item.layer for item in items} | {"labels"}
    return tuple(layer for layer in known if layer.key in used)


def _note(beams: Sequence[Beam], magnification: float) -> str:
    words = "Positions are nominal, in the connector frame con, mm; marks are not to scale."
    if magnification > 0:
        words += (
            f" Error ellipsoids and biases are magnified {magnification:g} times: first order, the ellipsoid that "
            "holds 95 % of a Gaussian with the covariance, about target + bias."
        )
    unknown = [printable(beam.view.name, 18) for beam in beams if not beam.stated]
    if unknown:
        words += f" Where the detector of {', '.join(unknown)} stands is not stated: it is drawn behind what it images."
    return words


def _words(system: System, beams: Sequence[Beam], magnification: float, old: System | None) -> str:
    targets = ", ".join(printable(target.name, 30) for target in system.targets[:5])
    views = ", ".join(printable(beam.view.name, 30) for beam in beams)
    words = f"{len(system.fiducials_mm)} fiducials, targets {targets}, views {views}, in the connector frame, mm. "
    if old is not None:
        words += f"Drawn over the layout before, with {len(old.fiducials_mm)} fiducials. "
    return words + (f"Errors are magnified {magnification:g} times." if magnification else "")


def without(scene: Scene, *layers: str) -> Scene:
    """The scene with some layers hidden at first."""
    return replace(scene, layers=tuple(replace(e, shown=e.shown and e.key not in layers) for e in scene.layers))

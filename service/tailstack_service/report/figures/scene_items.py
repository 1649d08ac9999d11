"""The layout as items of a scene: fiducials, targets, interfaces, frames and zones, in con, mm."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tailstack.arrays import Array
from tailstack.design import Design
from tailstack.system import System

from ...rendering.layout_picture import turns
from ...rendering.svg import printable
from .scene_records import Item, place_in_words, point, points_of
from .shapes import Lines, ball_lines, box_lines, region_lines

MOST_DROPS = 60  # lines down to the floor; more would be a curtain


def structure_points(system: System) -> Array:
    """(M, 3) mm: fiducials, targets, and pivots that turn."""
    pivots = [mount.pivot_mm for mount in (system.interface_1, system.interface_2) if turns(mount)]
    return np.vstack(
        [system.fiducials_mm, [target.position_mm for target in system.targets], *([pivots] if pivots else [])]
    )


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
        label, was = printable(name, 18), before.pop(name, None)
        if len(system.fiducials_mm) <= MOST_DROPS:
            items.append(Item("line", "floor", "drop", points_of([at, np.array([at[0], at[1], lowest])])))
        if was is not None and moved(was, at):
            items.append(Item("line", "before", "moved", points_of([was, at])))
            said = f"{label} {called}: {place_in_words(was)}"
            items.append(Item("mark", "before", "old", (point(was),), "", said))
        look = "fiducial" if old is None or was is not None else "new"
        said = f"fiducial {label}: {place_in_words(at)}"
        items.append(Item("mark", "fiducials", look, (point(at),), label, said))
    for name, was in before.items():
        said = f"{printable(name, 18)}, only {called}: {place_in_words(was)}"
        items.append(Item("mark", "before", "old", (point(was),), "", said))
    return items


def moved(was: Array, now: Array) -> bool:
    return not np.allclose(was, now, rtol=0, atol=1e-6)


def targets(design: Design, system: System) -> list[Item]:
    items, regions = [], set()
    for target in system.targets:
        label = target.name if target.region is None else "" if target.region in regions else target.region
        regions.add(target.region)
        title = f"target {printable(target.name, 40)}: {place_in_words(target.position_mm)}"
        items.append(Item("mark", "targets", "target", (point(target.position_mm),), printable(label, 18), title))
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
        items += [Item("line", "targets", "region", points_of(line)) for line in lines]
    return items


def mounts(design: Design, system: System, old: System | None, length: float) -> list[Item]:
    interfaces = design.document.interfaces
    items = []
    mounts = (
        ("pivot 1", system.interface_1, interfaces.structure_connector, old and old.interface_1),
        ("pivot 2", system.interface_2, interfaces.connector_flange, old and old.interface_2),
    )
    for name, mount, document, was in mounts:
        if not turns(mount):
            continue
        title = f"{name}, {printable(mount.label or mount.name, 60)}: {place_in_words(mount.pivot_mm)}"
        items.append(Item("mark", "pivots", name, (point(mount.pivot_mm),), name, title))
        if was and moved(was.pivot_mm, mount.pivot_mm):
            items.append(Item("line", "before", "moved", points_of([was.pivot_mm, mount.pivot_mm])))
        for target in system.targets[:1]:
            arm = float(np.linalg.norm(target.position_mm - mount.pivot_mm))
            said = f"{name} to {printable(target.name, 40)}: {arm:.1f} mm"
            points = points_of([mount.pivot_mm, target.position_mm])
            items.append(Item("line", "levers", "lever", points, f"{arm:.0f} mm", said))
        for locator in (document.locators or ()) if document is not None else ():
            at, normal = np.array(locator.position_mm), np.array(locator.normal, dtype=float)
            begin = at - length * normal / np.linalg.norm(normal)
            said = f"locator {printable(locator.name, 18)}: {place_in_words(at)}"
            items.append(
                Item("arrow", "locators", "locator", points_of([begin, at]), printable(locator.name, 18), said)
            )
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
        title = f"keep-out zone {printable(zone.name, 40)}, clearance {zone.clearance_mm:g} mm"
        for k, line in enumerate(region_lines(zone)):
            label = printable(zone.name, 24) if k == 0 else ""
            items.append(Item("line", "keep-out", "keep-out", points_of(line), label, title))
    regions: list[Any] = [region for region in (section.region, *(section.regions or ())) if region is not None]
    lines = [line for region in regions for line in region_lines(region)]
    if section.box is not None:
        lines += box_lines(np.array(section.box.min_mm), np.array(section.box.max_mm))
    return items + [Item("line", "room", "room", points_of(line), "", "where fiducials may go") for line in lines]

"""The layout in space as data: what the viewer turns and what the picture on paper shows, from one list of items."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np

from tailstack.design import Design, compile_design
from tailstack.results import Score
from tailstack.system import System

from ...rendering.svg import printable
from .beams import Beam, beams_of
from .scene_beams import beam_arrow, beam_items, cameras
from .scene_errors import errors, extent, magnification_of
from .scene_items import fiducials, floor, frames, mounts, radius_of, structure_points, targets, zones
from .scene_records import LOOKS, Item, Layer, Scene, points_of

MOST_NAMED = 3  # views: of more, detectors have no names of their own

__all__ = ["Scene", "scene_json", "scene_of"]


def scene_of(
    design: Design,
    score: Score,
    title: str,
    before: tuple[Design, Score] | None = None,
    called: str = "before",
) -> Scene:
    """The scene of a design and what was computed of it; ``before``: another one that it is drawn over.

    ``called``: what that one is called.  Positions are nominal; ellipsoids and biases are first order, at the
    magnification that the scene states.  Raises DesignError, IllPosedError for a design that does not compile.
    """
    system = compile_design(design)
    old = None if before is None else compile_design(before[0])
    beams = beams_of(design, system)
    judged = [(system, score)] + ([] if before is None or old is None else [(old, before[1])])
    structures = [structure_points(at) for at, _ in judged]
    radius = radius_of(structures[0])
    magnification = magnification_of(judged, radius)
    items: list[Item] = [
        *floor([at for at, _ in judged]),
        *fiducials(system, old, called),
        *targets(design, system),
        *mounts(design, system, old, 0.16 * radius),
        *frames(system, 0.3 * radius),
        *zones(design),
    ]
    drawn = list(errors(system, score, magnification))
    if before is not None and old is not None:
        drawn += errors(old, before[1], magnification, called)
    shown = np.vstack([*structures, items[0].points, *(extent(item) for item in drawn)])
    arrows = [beam_arrow(beam, shown) for beam in beams]
    items += [*drawn, *arrows, *(item for beam in beams for item in beam_items(beam, system, len(beams) > MOST_NAMED))]
    ends = [np.vstack([beam.source_mm, beam.on_detector(beam.corners_px)]) for beam in beams]
    return Scene(
        title=printable(title, 160),
        words=_words(system, beams, magnification, old, called),
        magnification=magnification,
        note=_note(beams, magnification),
        layers=_layers(items, system, called),
        cameras=cameras(beams),
        items=tuple(items),
        near=points_of(np.vstack([shown, *(np.array(arrow.points) for arrow in arrows)])),
        far=points_of(np.vstack([shown, *ends])),
        before=called,
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
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))  # noqa: TID251 - in a page
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _layers(items: Sequence[Item], system: System, called: str) -> tuple[Layer, ...]:
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
        Layer("beams", "Sources and detectors", False),
        Layer("keep-out", "Keep-out zones", True),
        Layer("room", "Where fiducials may go", False),
        Layer("before", f"Layout {called}", True),
        Layer("tcp-before", f"Error at the tool, {called}", True),
        Layer("bias-before", f"Bias at the tool, {called}", True),
    )
    used = {item.layer for item in items} | {"labels"}
    return tuple(layer for layer in known if layer.key in used)


def _note(beams: Sequence[Beam], magnification: float) -> str:
    words = "Positions are nominal, in the connector frame con, mm; marks are not to scale."
    if magnification > 0:
        size = "are drawn to scale" if magnification == 1 else f"are magnified {magnification:g} times"
        words += (
            f" Error ellipsoids and biases {size}: first order, the ellipsoid that holds 95 % of a Gaussian with the "
            "covariance, about target + bias."
        )
    unknown = [printable(beam.view.name, 18) for beam in beams if not beam.stated]
    if unknown:
        words += f" Where the detector of {', '.join(unknown)} stands is not stated: it is drawn behind what it images."
    return words


def _words(system: System, beams: Sequence[Beam], magnification: float, old: System | None, called: str) -> str:
    targets = ", ".join(printable(target.name, 30) for target in system.targets[:5])
    views = ", ".join(printable(beam.view.name, 30) for beam in beams)
    words = f"{len(system.fiducials_mm)} fiducials, targets {targets}, views {views}, in the connector frame, mm. "
    if old is not None:
        words += f"Drawn over the layout {called}, with {len(old.fiducials_mm)} fiducials. "
    return words + (f"Errors are magnified {magnification:g} times." if magnification else "")

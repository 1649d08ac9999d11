"""The coordinates of a layout, in space and in every image: its record, and the document of that, without a picture."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from tailstack.design import Design, compile_design
from tailstack.errors import IllPosedError
from tailstack.estimation.checks import imaged_fiducials
from tailstack.geometry.arrays import Array
from tailstack.results import Provenance
from tailstack.results.record import Published
from tailstack.results.tables import LONG_TABLE, PAPER, Column, Table, tabulate
from tailstack.scoring import provenance, score_errors
from tailstack.system import System

from ...rendering.document import Document, KeyNumber, Section, compose_document
from ..beams import Beam, beams_of
from ..scene import scene_data, scene_of

Point = tuple[float, float, float]
Pixel = tuple[float, float]


@dataclass(frozen=True, slots=True)
class PlacedPoint:
    """A fiducial or target by its name."""

    label: str
    """Label of the fiducial, or name of the target."""
    position_mm: Point
    """Nominal position in con, mm."""


@dataclass(frozen=True, slots=True)
class ImagedPoint:
    """A fiducial or target in one image, without noise; a fiducial as the structure sits with its known bias."""

    label: str
    """Label of the fiducial, or name of the target."""
    image_px: Pixel | None
    """Its image, px; null behind the source."""
    inside: bool
    """Whether the image is on the detector, as far as the view states its size."""
    used: bool = True
    """Whether the view's estimate uses it: false for a fiducial that `views[].sees` leaves out."""


@dataclass(frozen=True, slots=True)
class ImagedView:
    """One view: how it images, and what is where in its image."""

    view: str
    """Name of the view."""
    projection: tuple[tuple[float, float, float, float], ...]
    """3x4: nominal position of a fiducial in con (mm, 1) to (u w, v w, w), px; the known bias is in it."""
    target_projection: tuple[tuple[float, float, float, float], ...]
    """3x4: the same for what does not sit on the structure, such as targets."""
    image_size_px: Pixel | None
    """Width and height of the image, px; null where the design does not state them."""
    margin_px: float
    """Distance from the edge that the optimiser keeps, px."""
    source_mm: Point
    """The X-ray source in con, mm."""
    fiducials: tuple[ImagedPoint, ...]
    """Images of the fiducials."""
    targets: tuple[ImagedPoint, ...]
    """Images of the targets."""


@dataclass(frozen=True, slots=True, repr=False)
class Layout(Published):
    """Where fiducials and targets are, in space and in every image."""

    schema: Literal["tailstack/layout/1"]
    fiducials: tuple[PlacedPoint, ...]
    """Fiducials in the order of the design."""
    targets: tuple[PlacedPoint, ...]
    """Targets, regions expanded to their samples."""
    views: tuple[ImagedView, ...]
    """One for each view."""
    scene: dict[str, Any] | None
    """What reports and the web page turn in space, if it was asked for: its shape may change with the version."""
    provenance: Provenance
    """What was computed from what, and what it does not include."""


def lay_out(design: Design, *, scene: bool = False) -> Layout:
    """Compile the design and image it.  Raises DesignError.

    A layout that determines no answer is laid out nevertheless: a picture shows best what is wrong with it.
    """
    system = compile_design(design)
    places = imaged_fiducials(system)
    targets = np.array([target.position_mm for target in system.targets])
    target_names = tuple(target.name for target in system.targets)
    section = design.document.optimise
    installed = _displacement(system)
    views = tuple(
        ImagedView(
            view=beam.view.name,
            projection=tuple(map(_numbers, beam.view.projection @ installed)),
            target_projection=tuple(map(_numbers, beam.view.projection)),
            image_size_px=None if beam.view.image_size_px is None else _numbers(beam.view.image_size_px),
            margin_px=0.0 if section is None else float(section.image_margin_px),
            source_mm=_numbers(beam.source_mm),
            fiducials=_image_points(beam, system.fiducial_labels, places, used),
            targets=_image_points(beam, target_names, targets, np.ones(len(targets))),
        )
        for beam, used in zip(beams_of(design, system), system.sees, strict=True)
    )
    return Layout(
        schema="tailstack/layout/1",
        fiducials=_place_points(system.fiducial_labels, system.fiducials_mm),
        targets=_place_points(target_names, targets),
        views=views,
        scene=_scene(design) if scene else None,
        provenance=provenance(system),
    )


def _scene(design: Design) -> dict[str, Any]:
    """The layout in space; where it can be scored, with its errors."""
    record = None
    with suppress(IllPosedError):
        record = score_errors(design)
    return scene_data(scene_of(design, record, design.name))


def _image_points(beam: Beam, labels: Sequence[str], points: Array, used: Array) -> tuple[ImagedPoint, ...]:
    low, high = beam.corners_px.min(axis=0), beam.corners_px.max(axis=0)
    imaged = []
    for label, image, weight in zip(labels, beam.images(points), used, strict=True):
        seen = bool((image == image).all())  # NaN behind the source
        inside = seen and (not beam.sized or bool(((image >= low) & (image <= high)).all()))
        imaged.append(ImagedPoint(label, _numbers(image) if seen else None, inside, bool(weight)))
    return tuple(imaged)


def _displacement(system: System) -> Array:
    """(4, 4): from a nominal position of a fiducial in con to where it is when it is imaged."""
    origin, *ends = imaged_fiducials(replace(system, fiducials_mm=np.vstack([np.zeros(3), np.eye(3)])))
    return np.block(
        [[np.column_stack([end - origin for end in ends]), origin[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]]
    )


def _place_points(labels: Sequence[str], points: Array) -> tuple[PlacedPoint, ...]:
    return tuple(PlacedPoint(label, _numbers(point)) for label, point in zip(labels, points, strict=True))


def _numbers(values: Iterable[float]) -> Any:
    return tuple(float(value) for value in values)


# --- as a document ------------------------------------------------------------------------------------


def layout_document(layout: Layout, sha256: str) -> Document:
    """Where every fiducial and target is imaged, view by view; no picture, which is made of the design."""
    outside = [
        f"{point.label} in {view.view}"
        for view in layout.views
        for point in (*view.fiducials, *view.targets)
        if point.used and not point.inside
    ]
    sentence = f"Outside the image: {', '.join(outside)}." if outside else "Every fiducial and target is in its images."
    return compose_document(
        layout,
        sha256,
        (
            Section("In space", (_places_table(layout),), on=PAPER),
            Section("In the images", tuple(map(_image_table, layout.views))),
        ),
        "tailstack layout design.yaml --json",
        "With the design of the hash named above; `tailstack report design.yaml` draws it.",
        kind="Layout",
        status="layout",
        sentence=sentence,
        numbers=(
            KeyNumber("Fiducials", str(len(layout.fiducials))),
            KeyNumber("Targets", str(len(layout.targets))),
            KeyNumber("Outside an image", str(len(outside))),
        ),
        question="Where everything is imaged: without noise, as the structure sits with its known bias.",
        method="pinhole images",
        opening=(sentence,),
    )


def _places_table(layout: Layout) -> Table:
    columns = (
        Column("Fiducial or target", of=lambda point: point.label),
        *(Column(axis, "mm", "fixed", of=partial(_coordinate, k)) for k, axis in enumerate("xyz")),
    )
    caption = "Nominal positions in the connector frame con"
    return tabulate("Positions", caption, columns, (*layout.fiducials, *layout.targets), most=LONG_TABLE)


def _coordinate(axis: int, point: PlacedPoint) -> float:
    return point.position_mm[axis]


def _image_table(view: ImagedView) -> Table:
    size = "size not stated" if view.image_size_px is None else "{:.0f} x {:.0f} px".format(*view.image_size_px)
    columns = (
        Column("Fiducial or target", brief=f"view {view.view}, {size}", of=lambda point: point.label),
        Column("u", "px", "fixed", 1, brief="u, px", of=lambda point: point.image_px and point.image_px[0]),
        Column("v", "px", "fixed", 1, brief="v, px", of=lambda point: point.image_px and point.image_px[1]),
        Column("Remark", brief=" ", of=_remark),
    )
    points = (*view.fiducials, *view.targets)
    shown = columns if any(map(_remark, points)) else columns[:-1]
    return tabulate(f"Images {view.view}", f"In view {view.view}, {size}", shown, points, most=LONG_TABLE)


def _remark(point: ImagedPoint) -> str:
    return "not used" if not point.used else "" if point.inside else "outside"

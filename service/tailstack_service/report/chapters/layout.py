"""The layout: its scene in space, which a screen can turn, what each view sees, and its coordinates as tables."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from tailstack.design import Design, load_design
from tailstack.errors import TailstackError
from tailstack.results import Score
from tailstack.results.tables import PAPER, Column, Table, tabulate
from tailstack.scoring import score

from ..blocks import Block, Document, Figure, KeyNumber, Listing, Paragraph, Section
from ..images import draw_images
from ..scene import scene_json, scene_of
from ..scene_picture import draw_scene
from .tables import closing_sections, provenance_facts

if TYPE_CHECKING:
    from ...operations.layout import ImagedPoint, ImagedView, Layout, PlacedPoint

Known = tuple[dict[str, object], Score]  # a design document and what was computed of it


def layout_blocks(
    now: Known,
    title: str,
    name: str = "layout",
    before: Known | None = None,
    called: str = "before",
    of: str = "",
) -> tuple[Block, ...]:
    """Pictures of a layout, drawn over another one if that is given.

    name: kebab-case, unique in the report.  called: what the other layout is called.  of: begins the captions, where
    one document shows several layouts.
    """
    design, old = load_inside(now[0]), None if before is None else (load_inside(before[0]), before[1])
    scene = scene_of(design, now[1], title, old, called)
    caption = f"{of}The layout in the connector frame con, mm: nominal positions"
    if scene.magnification > 0:
        size = "to scale" if scene.magnification == 1 else f"{scene.magnification:g} times their size"
        caption += f"; ellipsoids that hold 95 % of a normal scatter, about target plus bias, {size}"
    caption += "." if old is None else f". In grey: {called}."
    images = draw_images(design, f"{title}: what each view sees", f"{name}-images", None if old is None else old[0])
    seen = f"{of}What each view sees: as the structure sits with its known bias, no noise."
    return (
        Figure(name, draw_scene(scene, name), caption, scene=scene_json(scene)),
        Figure(f"{name}-images", images, seen),
    )


def score_if_determined(data: dict[str, object]) -> Known | None:
    """A design with its score, for its picture; None where it has none: its layout may not determine an answer."""
    try:
        return data, score(load_inside(data), losses=False)
    except TailstackError:
        return None


def load_inside(data: dict[str, object]) -> Design:
    return load_design(data, allow_files=False)


# --- of the record ----------------------------------------------------------------------------------------

MOST_POINTS = 400  # of a page


def layout_document(layout: Layout, sha256: str) -> Document:
    """Where every fiducial and target is imaged, view by view; no picture, which is made of the design."""
    made = layout.provenance
    outside = [
        f"{point.label} in {view.view}"
        for view in layout.views
        for point in (*view.fiducials, *view.targets)
        if point.used and not point.inside
    ]
    sentence = f"Outside the image: {', '.join(outside)}." if outside else "Every fiducial and target is in its images."
    return Document(
        kind="Layout",
        title=made.design_name,
        tone="neutral",
        status="layout",
        sentence=sentence,
        numbers=(
            KeyNumber("Fiducials", str(len(layout.fiducials))),
            KeyNumber("Targets", str(len(layout.targets))),
            KeyNumber("Outside an image", str(len(outside))),
        ),
        matters=(),
        sections=(
            Section("In space", (_places_table(layout),), on=PAPER),
            Section("In the images", tuple(map(_image_table, layout.views))),
            *closing_sections(
                made.not_included,
                Listing("tailstack layout design.yaml --json"),
                Paragraph("With the design of the hash named above; `tailstack report design.yaml` draws it."),
            ),
        ),
        provenance=provenance_facts(made, sha256, layout.schema),
        made=made,
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
    return tabulate("Positions", caption, columns, (*layout.fiducials, *layout.targets), most=MOST_POINTS)


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
    return tabulate(f"Images {view.view}", f"In view {view.view}, {size}", shown, points, most=MOST_POINTS)


def _remark(point: ImagedPoint) -> str:
    return "not used" if not point.used else "" if point.inside else "outside"

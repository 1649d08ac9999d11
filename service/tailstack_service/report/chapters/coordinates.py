"""The coordinates of a layout, in space and in every image: the document of its record, which holds no picture."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from tailstack.results.tables import LONG_TABLE, PAPER, Column, Table, tabulate

from ..blocks import Document, KeyNumber, Listing, Paragraph, Section
from .tables import closing_sections, provenance_facts

if TYPE_CHECKING:
    from ...operations.layout import ImagedPoint, ImagedView, Layout, PlacedPoint


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
                made,
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

"""The sheet for whoever makes a reference structure: its beads and seats with their tolerances as drawn, and nothing
of what was computed: no requirement, no price, no target.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy.optimize import isotonic_regression

from tailstack.geometry.arrays import Array
from tailstack.results import Provenance
from tailstack.results.look import BLUE, FAINT, INK, MUTED
from tailstack.results.record import Published
from tailstack.results.tables import LONG_TABLE, Column, Row, Table
from tailstack.tolerances import say_law

from ...rendering.document import Document, Facts, Figure, KeyNumber, Paragraph, Section
from ...rendering.text import csv_text, plain_text
from ..svg import WIDTH, Kind, MarkedPoint, label_places, line, picture, shape, text, trim

if TYPE_CHECKING:
    from tailstack.design import Design
    from tailstack.design.document import Interface

Point = tuple[float, float, float]
DATUM = (
    "Datum: origin and axes of the connector frame con, right-handed. Lengths in mm, angles in deg. A tolerance is a "
    "half-width: ± about the nominal value, rotations about axes through the pivot of their seat. Deviations of "
    "pins and faces stand as drawn, upper and lower."
)
SECTIONS = ("/fiducials", "/interfaces")  # of the design, that the sheet is made of


@dataclass(frozen=True, slots=True)
class DrawnTolerance:
    """A half-width as drawn."""

    component: str
    """x, y, z of a bead; rx, ry, rz, tx, ty, tz of a seat, or the name of its locator."""
    half_width: float
    """Half-width, in `unit`."""
    unit: str
    """mm or deg."""
    law: str
    """Law of the deviation within it: uniform, triangular, normal, ..."""
    coverage_factor: float | None = None
    """Of a normal law: how many standard deviations the half-width is."""
    position_mm: Point | None = None
    """Contact point of a locator in con, mm; null: of a component."""
    normal: Point | None = None
    """Direction of a locator in con; null: of a component."""


@dataclass(frozen=True, slots=True)
class DrawnFeature:
    """A pin, face or spigot of a seat, by what its drawing states: sizes, deviations and zones are no half-widths."""

    name: str
    """Its name."""
    stated: str
    """What the drawing states, in a line: size and fit, the deviations of hole and pin, zones."""
    position_mm: Point
    """Where it is in con, mm."""
    normal: Point
    """Its axis, or the normal of its face, in con."""


@dataclass(frozen=True, slots=True)
class DrawnSeat:
    """A seat, and how far the part may be off in it."""

    name: str
    """structure_connector or connector_flange."""
    label: str
    """What the drawing calls it; may be empty."""
    pivot_mm: Point
    """Point in con that the displacement is reduced at, mm."""
    tolerances: tuple[DrawnTolerance, ...]
    """Components or locators that have one."""
    together: bool
    """Whether the design says how components go together."""
    features: tuple[DrawnFeature, ...] = ()
    """Of a seat that is drawn by its pins and faces."""


@dataclass(frozen=True, slots=True)
class DrawnBead:
    """A bead as drawn."""

    label: str
    """Its label."""
    position_mm: Point
    """Nominal position of its centre in con, mm."""


@dataclass(frozen=True, slots=True, repr=False)
class Sheet(Published):
    """What a supplier needs of a design, and no more."""

    schema: Literal["tailstack/sheet/1"]
    datum: str
    """Frame, units and what a tolerance is, in words."""
    beads: tuple[DrawnBead, ...]
    """In the order of the design."""
    diameter_mm: float | None
    """Diameter of all of them, mm; null: the design does not state it."""
    bead_tolerances: tuple[DrawnTolerance, ...]
    """Of every bead along x, y and z; empty: none is declared."""
    seats: tuple[DrawnSeat, ...]
    """Seats that the design describes."""
    provenance: Provenance
    """Which design; `assumed` has what of the sheet nobody stated."""


def draw_up_sheet(design: Design) -> Sheet:
    """The sheet of a design.  Raises DesignError."""
    from tailstack.design import compile_design
    from tailstack.scoring import provenance

    document, made = design.document, design.document.fiducials.manufacturing
    widths = () if made is None else np.broadcast_to(made.half_width_mm, 3)
    seats = [(name, getattr(document.interfaces, name)) for name in type(document.interfaces).model_fields]
    of_design = provenance(compile_design(design))
    stated = tuple(pointer for pointer in of_design.assumed if pointer.startswith(SECTIONS))
    return Sheet(
        schema="tailstack/sheet/1",
        datum=DATUM,
        beads=tuple(map(DrawnBead, design.fiducials.labels, design.fiducials.positions_mm)),
        diameter_mm=document.fiducials.diameter_mm,
        bead_tolerances=tuple(
            DrawnTolerance(axis, float(width), "mm", str(made.distribution), made.coverage_factor)
            for axis, width in zip("xyz", widths, strict=False)
            if made is not None
        ),
        seats=tuple(_seat(name, seat) for name, seat in seats if seat is not None),
        provenance=replace(of_design, assumed=stated, notes=(), not_included=()),
    )


def _seat(name: str, seat: Interface) -> DrawnSeat:
    parts = {} if seat.tolerances is None else seat.tolerances.components
    drawn = [
        DrawnTolerance(key, part.width, "deg" if key[0] == "r" else "mm", str(part.distribution), part.coverage_factor)
        for key, part in parts.items()
        if part is not None
    ]
    drawn += [
        DrawnTolerance(
            each.name, each.half_width_mm, "mm", str(each.distribution), each.coverage_factor, each.position_mm,
            each.normal,
        )
        for each in seat.locators or ()
    ]  # fmt: skip
    features = (DrawnFeature(each.name, each.words, each.position_mm, each.normal) for each in seat.features or ())
    joined = seat.tolerances is not None and bool(seat.tolerances.correlation or seat.tolerances.covariance_deg_mm)
    return DrawnSeat(name, seat.label, seat.pivot_mm, tuple(drawn), joined, tuple(features))


# --- as CSV, and as a document ------------------------------------------------------------------------------------


def sheet_csv(sheet: Sheet) -> str:
    """A line for each bead, every digit; a file of fiducials that gives the same beads again."""
    widths = [each.half_width for each in sheet.bead_tolerances]
    ball = [] if sheet.diameter_mm is None else [sheet.diameter_mm]
    header = ["label", "x_mm", "y_mm", "z_mm", *(["diameter_mm"] if ball else [])]
    header += [f"tolerance_{each.component}_mm" for each in sheet.bead_tolerances]
    return csv_text(header, ((plain_text(bead.label), *bead.position_mm, *ball, *widths) for bead in sheet.beads))


def sheet_document(sheet: Sheet, sha256: str) -> Document:
    """The sheet: a dimensioned view, then its beads and each of its seats."""
    made, places = sheet.provenance, np.array([bead.position_mm for bead in sheet.beads])
    pivots = [seat.pivot_mm for seat in sheet.seats]
    svg = draw_dimensions(places, pivots, sheet.diameter_mm, f"{made.design_name}: dimensions", "dimensions")
    caption = (
        "Dimensions: mm from the datum, to 0.01; the numbers of the beads are those of the table. Triangles are the "
        "pivots of the seats."
    )
    sections = [Section("Beads", (_beads_table(sheet),))]
    if sheet.seats:
        sections.append(Section("Seats", tuple(_seat_table(seat) for seat in sheet.seats)))
    if made.assumed:
        words = f"Nobody stated these values, which are a start: {', '.join(made.assumed)}."
        sections.append(Section("To be settled", (Paragraph(words),)))
    pairs = (
        ("Design", made.design_name),
        ("SHA-256 of the design", made.design_sha256 or "not known"),
        ("SHA-256 of this record", sha256),
        ("Made by", f"tailstack {made.tailstack_version}"),
    )
    return Document(
        kind="Sheet for the supplier",
        title=made.design_name,
        tone="neutral",
        status="as drawn",
        sentence=sheet.datum,
        numbers=tuple(_numbers(sheet)),
        figures=(Figure("dimensions", svg, caption),),
        sections=tuple(sections),
        provenance=Facts("Provenance", pairs),
        made=made,
        opening=(sheet.datum,),
        captions=True,
    )


def _numbers(sheet: Sheet) -> Iterator[KeyNumber]:
    yield KeyNumber("Beads", str(len(sheet.beads)))
    yield KeyNumber("Diameter", "not stated" if sheet.diameter_mm is None else f"{sheet.diameter_mm:g} mm")
    widths = list(dict.fromkeys(each.half_width for each in sheet.bead_tolerances))
    value = " / ".join(f"{width:g}" for width in widths)
    detail = f"along x, y and z, {_law(sheet.bead_tolerances[0])}" if widths else "no tolerance is declared"
    yield KeyNumber("Position of each", f"± {value} mm" if widths else "–", detail)


def _law(tolerance: DrawnTolerance) -> str:
    return say_law(tolerance.law, tolerance.coverage_factor)


def _beads_table(sheet: Sheet) -> Table:
    widths = [each.half_width for each in sheet.bead_tolerances]
    columns = (
        Column("No.", kind="whole"), Column("Bead"), *(Column(axis, "mm", "given") for axis in "xyz"),
        *([] if sheet.diameter_mm is None else [Column("Diameter", "mm", "given")]),
        *(Column(f"{each.component} ±", "mm", "given") for each in sheet.bead_tolerances),
    )  # fmt: skip
    ball = [] if sheet.diameter_mm is None else [sheet.diameter_mm]
    rows = (Row((k, bead.label, *bead.position_mm, *ball, *widths)) for k, bead in enumerate(sheet.beads, 1))
    note = "Each coordinate within its half-width of the nominal value."
    if not widths:
        note = "No tolerance of the beads is declared: agree on one."
    return Table("Beads", "Centres of the beads in the connector frame con", columns, tuple(rows), note, LONG_TABLE)


def _seat_table(seat: DrawnSeat) -> Table:
    located = any(each.position_mm is not None for each in seat.tolerances)
    columns = (
        Column("Contact" if located else "Component"), Column("±", "", "given"), Column("Unit", kind="unit"),
        Column("Law"), *((Column("Contact point", "mm"), Column("Normal")) if located else ()),
    )  # fmt: skip

    rows = tuple(
        Row((each.component, each.half_width, each.unit, _law(each),
             *([_say_point(each.position_mm), _say_point(each.normal)] if located else [])))
        for each in seat.tolerances
    )  # fmt: skip
    if seat.features:
        columns = (Column("Feature"), Column("As drawn, mm"), Column("Point", "mm"), Column("Axis or normal"))
        rows = tuple(
            Row((each.name, each.stated, _say_point(each.position_mm), _say_point(each.normal)))
            for each in seat.features
        )
    words = seat.name.replace("_", " to ")
    note = "Components go together as the design says: ask for its correlation." if seat.together else ""
    note = note if rows else "No tolerance is declared: the seat counts as perfect."
    return Table(seat.name, f"{seat.label or words}; pivot at {_say_point(seat.pivot_mm)} mm", columns, rows, note)


def _say_point(point: Point | None) -> str:
    return "" if point is None else ", ".join(f"{value:.12g}" for value in point)


# --- two elevations of the beads with ordinate dimensions from the datum ------------------------------

ELEVATIONS = (("Front", 0), ("Side", 1))  # each with z up: what it is called, and which axis runs across
HALF = WIDTH / 2  # of the page, for one view
LEFT, RIGHT, TOP, BOTTOM = 84.0, 16.0, 40.0, 78.0  # about what is drawn: room for numbers and the name of the view
HIGH = 320.0  # at most, of what is drawn
GAP, NEAR = 12.0, 26.0  # between two numbers; from what is drawn to the foot of the leaders
LEAST = 2.5  # radius of a bead, so that it is seen
PIVOTS: tuple[Kind, ...] = ("pivot 1", "pivot 2")


def draw_dimensions(beads_mm: Array, pivots: Sequence[Point], diameter_mm: float | None, title: str, name: str) -> str:
    """SVG.  beads_mm: (N, 3) in con; pivots: of the seats, mm, at most two; name: kebab-case, unique on the page."""
    shown = np.vstack([np.zeros(3), beads_mm, *([list(pivots)] if pivots else [])])
    low, high = shown.min(axis=0), shown.max(axis=0)
    spans = np.maximum(high - low, 1e-3)
    scale = min((HALF - LEFT - RIGHT) / spans[:2].max(), HIGH / spans[2])
    height = TOP + scale * spans[2] + BOTTOM
    parts: list[str] = []
    for k, (view, axis) in enumerate(ELEVATIONS):
        left = k * HALF + LEFT + (HALF - LEFT - RIGHT - scale * spans[axis]) / 2
        parts += _elevation(view, axis, beads_mm, pivots, diameter_mm, (left, TOP), scale, low, high)
    words = f"{len(beads_mm)} beads from the front and from the side, dimensioned in mm from the origin of con"
    return picture(name, title, words, height, parts)


def _elevation(
    view: str, axis: int, beads_mm: Array, pivots: Sequence[Point], diameter_mm: float | None,
    corner: tuple[float, float], scale: float, low: Array, high: Array,
) -> list[str]:  # fmt: skip
    """One view; ``corner``: where the least coordinate across and the greatest up stand on the page."""

    def place(point: Array | Point) -> tuple[float, float]:
        return corner[0] + scale * (point[axis] - low[axis]), corner[1] + scale * (high[2] - point[2])

    right, foot = corner[0] + scale * (high[axis] - low[axis]), corner[1] + scale * (high[2] - low[2])
    x0, y0 = place((0.0, 0.0, 0.0))
    parts = [
        text((corner[0] + right) / 2, 14, f"{view}: {'xy'[axis]} across, z up", anchor="middle", weight="bold"),
        line(x0, corner[1] - 10, x0, foot + NEAR, MUTED, 0.8, "10 3 2 3"),
        line(corner[0] - NEAR, y0, right + 10, y0, MUTED, 0.8, "10 3 2 3"),
        f'<circle cx="{trim(x0)}" cy="{trim(y0)}" r="5" fill="none" stroke="{INK}"/>',
    ]
    measured = np.round(np.vstack([np.zeros(3), beads_mm, *([list(pivots)] if pivots else [])]), 2)
    across, up = measured[:, axis], measured[:, 2]
    for value, at, aside in _ordinates(across, corner[0] - scale * low[axis], scale, HALF - LEFT):
        begin, end = foot + NEAR, foot + NEAR + 12
        lowest = corner[1] + scale * (high[2] - up[across == value].min())
        parts += [line(at, lowest, at, begin, FAINT, 0.5), line(at, begin, aside, end, FAINT, 0.5)]
        parts.append(_vertical_say_length(aside, end + 3, value))
    for value, at, aside in _ordinates(up, corner[1] + scale * high[2], -scale, foot - corner[1] + TOP):
        begin, end = corner[0] - NEAR, corner[0] - NEAR - 12
        leftmost = corner[0] + scale * (across[up == value].min() - low[axis])
        parts += [line(leftmost, at, begin, at, FAINT, 0.5), line(begin, at, end, aside, FAINT, 0.5)]
        parts.append(text(end - 3, aside + 4, _say_length(value), anchor="end", size=10))
    heaps: dict[tuple[float, float], list[str]] = {}
    for number, point in enumerate(beads_mm, 1):
        heaps.setdefault(tuple(round(c, 1) for c in place(point)), []).append(str(number))  # type: ignore[arg-type]
    radius = max(LEAST, scale * (diameter_mm or 0.0) / 2)
    parts += [f'<circle cx="{x}" cy="{y}" r="{trim(radius)}" fill="#ffffff" stroke="{BLUE}"/>' for x, y in heaps]
    parts += [shape(kind, *place(pivot)) for kind, pivot in zip(PIVOTS, pivots, strict=False)]
    marked = [MarkedPoint(x, y, ", ".join(numbers)) for (x, y), numbers in heaps.items()]
    frame = (corner[0] - 8, corner[1] - 12, right + 12, foot + 12)
    starts = label_places(marked, [], frame, 10)
    return parts + [text(x, y, each.text, size=10, colour=BLUE) for (x, y), each in zip(starts, marked, strict=True)]


def _ordinates(values: Array, zero: float, scale: float, room: float) -> list[tuple[float, float, float]]:
    """Each value once, its place on the page, and that of its number: as near as the others leave room.

    Where they are more than the room holds, the outermost and the datum alone.
    """
    distinct = np.unique(values + 0.0)
    if len(distinct) * GAP > room:
        distinct = np.unique([distinct[0], 0.0, distinct[-1]])
    at = zero + scale * distinct
    steps = np.sign(scale) * GAP * np.arange(len(at))
    apart = isotonic_regression(at - steps, increasing=scale > 0).x + steps
    return [(float(v), float(a), float(s)) for v, a, s in zip(distinct, at, apart, strict=True)]


def _say_length(value: float) -> str:
    return f"{value + 0.0:g}".replace("-", "−")


def _vertical_say_length(x: float, y: float, value: float) -> str:
    """A number below its leader, read from the right."""
    return (
        f'<text x="{trim(x + 3)}" y="{trim(y)}" font-size="10" text-anchor="end" '
        f'transform="rotate(-90 {trim(x + 3)} {trim(y)})">{_say_length(value)}</text>'
    )

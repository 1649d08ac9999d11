"""The layout as blocks: the scene in space, which a screen can turn, and what each view sees."""

from __future__ import annotations

from tailstack.design import Design, load_design
from tailstack.errors import TailstackError
from tailstack.results import Score, WorthyPlace
from tailstack.results.tables import LONG_TABLE, Column, Row, Table
from tailstack.scoring import score
from tailstack.tolerances import say_law

from ...rendering.document import Block, Figure
from ..images import draw_images
from ..scene import scene_json, scene_of
from ..scene_picture import draw_scene

Known = tuple[dict[str, object], Score]  # a design document and what was computed of it


def layout_blocks(
    now: Known, title: str, name: str = "layout", before: Known | None = None, called: str = "before", of: str = ""
) -> tuple[Block, ...]:
    """Pictures of a layout, drawn over another one if that is given.

    name: kebab-case, unique in the report.  called: what the other layout is called.  of: begins the captions, where
    one document shows several layouts.
    """
    design, old = load_inside(now[0]), None if before is None else (load_inside(before[0]), before[1])
    places = _find_worthy_places(design)
    scene = scene_of(design, now[1], title, old, called, places)
    caption = f"{of}The layout in the connector frame con, mm: nominal positions"
    if scene.magnification > 0:
        size = "to scale" if scene.magnification == 1 else f"{scene.magnification:g} times their size"
        caption += f"; ellipsoids that hold 95 % of a normal scatter, about target plus bias, {size}"
    caption += "; green: where fiducials tell most" if places else ""
    caption += "." if old is None else f". In grey: {called}."
    images = draw_images(design, f"{title}: what each view sees", f"{name}-images", None if old is None else old[0])
    seen = f"{of}What each view sees: as the structure sits with its known bias, no noise."
    return (
        Figure(name, draw_scene(scene, name), caption, scene=scene_json(scene)),
        Figure(f"{name}-images", images, seen),
    )


def _find_worthy_places(design: Design) -> tuple[WorthyPlace, ...]:
    """Where fiducials tell most; none without a section optimise."""
    if design.document.optimise is None:
        return ()
    from tailstack.optimisation.worth import worthy_places  # 0.2 s, of which a report without that has no use

    return worthy_places(design)


def score_if_determined(data: dict[str, object]) -> Known | None:
    """A design with its score, for its picture; None where it has none: its layout may not determine an answer."""
    try:
        return data, score(load_inside(data), losses=False)
    except TailstackError:
        return None


def beads_table(data: dict[str, object]) -> Table:
    """Where each bead is drawn, and how far from there it may be made."""
    design = load_inside(data)
    made = design.document.fiducials.manufacturing
    widths = None if made is None else made.half_width_mm
    each = widths if isinstance(widths, tuple) else (widths,) * 3
    columns = (Column("Bead"), *(Column(f"{axis}{end}", "mm", "given") for end in ("", " ±") for axis in "xyz"))
    law = "no tolerance is declared: every bead counts as exactly there"
    if made is not None:
        law = f"half-widths, {say_law(made.distribution, made.coverage_factor)}"
    size = design.document.fiducials.diameter_mm
    note = f"Tolerances: {law}." + ("" if size is None else f" Diameter {size:g} mm.")
    beads = zip(design.fiducials.labels, design.fiducials.positions_mm, strict=True)
    rows = tuple(Row((label, *position_mm, *each)) for label, position_mm in beads)
    return Table("Beads", "The beads as drawn, in the connector frame con", columns, rows, note, LONG_TABLE)


def load_inside(data: dict[str, object]) -> Design:
    return load_design(data, allow_files=False)

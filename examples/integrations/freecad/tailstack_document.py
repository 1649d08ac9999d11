"""Beads, tolerances and results in a FreeCAD document.  Runs without a screen; nothing here waits for a service.

The sheet called Tailstack holds what is asked, in columns A and B, and what was answered, from column D on:

    service     where the service is; empty: TAILSTACK_URL, or this machine's
    design      a design document beside the FreeCAD file, or example:NAME
    beads       which labels are beads, with * and ?
    frame       label of the object whose placement is the connector's frame; empty: the document's origin
    colour      losing, moving or off
    (a path)    any number of the design, views.*.fiducial_noise_px; the cell may hold an expression
"""

from __future__ import annotations

import fnmatch
import math
from dataclasses import dataclass
from typing import Any

import FreeCAD
import Part
from tailstack_http import Design, Refusal, find_places, pick_target, with_beads

SHEET = "Tailstack"
ROWS = (("service", ""), ("design", "example:first_carrier"), ("beads", "Bead*"), ("frame", ""), ("colour", "losing"))
OWN = tuple(name for name, _ in ROWS)
RESULTS = "DEFGHIJKLMNOPQ"  # the columns of the answer
WIDTHS_PX = {"A": 300, "B": 170, "C": 20, "D": 260, "E": 180, "F": 20, "G": 220, "J": 130, "K": 130, "L": 110, "M": 20,
             "O": 130, "P": 140}  # fmt: skip
ALIASES = {"E2": "p95_mm", "E3": "limit_mm", "E4": "verdict"}  # for expressions elsewhere: =Tailstack.p95_mm
BUDGET = ("contributor", "half-width", "unit", "share of variance", "P95 without, mm", "mm per unit")
SAME_MM = 1e-6  # one bead has one centre


@dataclass(frozen=True)
class Bead:
    """A sphere of the document: centre in the connector's frame, mm, and what is needed to put it elsewhere."""

    label: str  # in the design
    object: Any
    centre: Any  # in the coordinates of what holds the object
    position_mm: tuple[float, float, float]


@dataclass(frozen=True)
class Request:
    """What the document asks.  Two that are equal have the same answer."""

    address: str
    design_name: str
    folder: str
    beads: tuple[tuple[str, tuple[float, float, float]], ...]
    values: tuple[tuple[str, float], ...]  # path and number, in the order of the sheet

    def apply(self, base: Design) -> Design:
        """The design with the document's beads and numbers.  Raises Refusal."""
        design = with_beads(base, list(self.beads))
        for path, value in self.values:
            for node, key in find_places(design, path):
                node[key] = value
        return design


# --- reading --------------------------------------------------------------------------------------------


def find_sheet(document: Any) -> Any:
    """The sheet of the document, or None."""
    sheets = document.findObjects("Spreadsheet::Sheet")
    return next((sheet for sheet in sheets if SHEET in (sheet.Name, sheet.Label)), None)


def make_sheet(document: Any) -> Any:
    """The sheet, made with the rows to fill in where there is none."""
    sheet = find_sheet(document)
    if sheet is None:
        sheet = document.addObject("Spreadsheet::Sheet", SHEET)
        _write(sheet, "A1", "name or path")
        _write(sheet, "B1", "value")
        for row, (name, value) in enumerate(ROWS, 2):
            _write(sheet, f"A{row}", name)
            _write(sheet, f"B{row}", value)
        for column, width in WIDTHS_PX.items():
            sheet.setColumnWidth(column, width)
        sheet.recompute()
    return sheet


def read_request(document: Any) -> Request:
    """What the document asks now.  Raises Refusal."""
    own, values = read_rows(document)
    frame = _find_frame(document, own["frame"])
    beads = tuple((bead.label, bead.position_mm) for bead in find_beads(document, own["beads"], frame))
    folder = document.FileName.replace("\\", "/").rpartition("/")[0]
    return Request(own["service"], own["design"], folder, beads, tuple(values.items()))


def read_colour(document: Any) -> str:
    """By what beads are coloured: losing, moving or off."""
    colour = read_rows(document)[0]["colour"]
    return colour if colour in ("losing", "moving") else "off"


def has_beads(document: Any) -> bool:
    """Whether anything is called like a bead."""
    pattern = read_rows(document)[0]["beads"]
    return any(fnmatch.fnmatchcase(item.Label, pattern) for item in document.Objects)


def find_beads(document: Any, pattern: str, frame: Any) -> list[Bead]:
    """The spheres whose label fits.  Raises Refusal of one that fits and is no sphere."""
    beads = []
    for item in document.Objects:
        if not fnmatch.fnmatchcase(item.Label, pattern) or not hasattr(item, "Placement"):
            continue
        shape = Part.getShape(item)
        if shape.isNull():
            continue
        centre = _find_centre(item, shape)
        held = _placement_of_holder(item)
        at = frame.inverse().multVec(held.multVec(centre))
        beads.append(Bead(name_bead(item.Label, pattern), item, centre, (at.x, at.y, at.z)))
    if not beads:
        raise Refusal(f"no object of this document is called {pattern}: name the spheres so, or change the row beads")
    by_label: dict[str, Bead] = {}
    for bead in beads:
        other = by_label.setdefault(bead.label, bead)
        if other is not bead:
            both = f"{other.object.Label} and {bead.object.Label}"
            raise Refusal(f"{both} would both be {bead.label} in the design: rename one")
    return beads


def name_bead(label: str, pattern: str) -> str:
    """What an object's label is in the design: of ``Bead F1`` and the pattern ``Bead*`` it is F1."""
    before, star, after = pattern.partition("*")
    name = label[len(before) : len(label) - len(after)].strip(" _-.:") if star else ""
    return name or label


def _find_centre(item: Any, shape: Any) -> Any:
    surfaces = [face.Surface for face in shape.Faces]
    if not surfaces or any(not isinstance(surface, Part.Sphere) for surface in surfaces):
        raise Refusal(f"{item.Label} is called like a bead and is no sphere: rename it, or narrow the row beads")
    centre = surfaces[0].Center
    if any(surface.Center.distanceToPoint(centre) > SAME_MM for surface in surfaces):
        raise Refusal(f"{item.Label} has spheres about several centres: one object is one bead")
    return centre


def _placement_of_holder(item: Any) -> Any:
    """Placement of the part or body that an object lies in; exactly none where it lies in the document itself."""
    holder = item.getParentGeoFeatureGroup()
    return FreeCAD.Placement() if holder is None else holder.getGlobalPlacement()


def _find_frame(document: Any, label: str) -> Any:
    if not label:
        return FreeCAD.Placement()
    found = document.getObjectsByLabel(label)
    if not found:
        raise Refusal(f"no object of this document is called {label}, as the row frame says")
    return found[0].getGlobalPlacement()


def read_rows(document: Any) -> tuple[dict[str, str], dict[str, float]]:
    """The rows with names, and the numbers of paths."""
    sheet = find_sheet(document)
    if sheet is None:
        raise Refusal(f"this document has no sheet called {SHEET}: make one with the first button")
    own, values = dict(ROWS), {}
    row = 2
    while name := str(_read(sheet, f"A{row}") or "").strip():
        value = _read(sheet, f"B{row}")
        if name in OWN:
            own[name] = str(value if value is not None else "").strip()
        elif isinstance(value, (bool, str)) or value is None:
            raise Refusal(f"{SHEET}.B{row}, the value of {name}, is a number; got {value!r}")
        else:
            values[name] = _number(value)
        row += 1
    return own, values


def _read(sheet: Any, cell: str) -> Any:
    """Text or number of a cell, None of an empty one."""
    return sheet.get(cell) if sheet.getContents(cell) else None


def _number(value: Any) -> float:
    """A quantity with a unit is in FreeCAD's units inside: mm and degrees, as the design is."""
    return float(getattr(value, "Value", value))


# --- writing what was answered --------------------------------------------------------------------------


def write_score(document: Any, score: dict[str, Any]) -> None:
    """P95, limit, verdict and the budget of the target that decides."""
    target = pick_target(score)
    verdict = score.get("verdict") or {}
    lines = [
        ["result", "value"],
        [f"P95 at {target['name']}, mm", target["p95_mm"]],
        ["limit, mm", target.get("limit_mm")],
        ["verdict", verdict.get("status", "no requirement")],
        ["by", f"{verdict.get('basis', 'first order')}, {score['validity']['status']}"],
        *([f"P95 at {item['name']}, mm", item["p95_mm"]] for item in score["targets"] if item is not target),
        *_list_losses(score),
    ]
    budget: list[list[Any]] = [list(BUDGET)]
    for entry in sorted(target["contributors"], key=lambda entry: -(entry["variance_share"] or 0.0)):
        name = entry["label"] + ("" if entry["component"] == "all" else f" {entry['component']}")
        cells = ("half_width", "unit", "variance_share", "p95_without_mm", "dp95_per_unit")
        budget.append([name, *(entry[cell] for cell in cells)])
    _write_table(document, "D", 2, lines)
    _write_table(document, "G", 6, budget)


def _list_losses(score: dict[str, Any]) -> list[list[Any]]:
    """For each requirement, what is left of it without the worst bead and without the worst two."""
    lines = []
    for entry in score.get("losses", ()):
        for loss in (entry["single"], entry["double"]):
            if loss is not None:
                words = f"{entry['requirement'] or 'P95'} without {' and '.join(loss['lost'])}, {entry['unit']}"
                lines.append([words, "undetermined" if loss["value"] is None else loss["value"]])
    return lines


def write_costs(document: Any, costs: list[tuple[str, float, float]]) -> None:
    """What losing and moving each bead costs."""
    rows = [["bead", "P95 without it, mm", "mm per mm moved"]]
    _write_table(document, "N", 3, rows + [[label, *map(_say, numbers)] for label, *numbers in costs])


def write_remark(document: Any, sentence: str) -> None:
    """In place of results: why there are none.  Numbers of an earlier design do not stay."""
    _write_table(document, "D", 2, [["result", "value"], ["none", sentence]])
    for column, width in (("G", 6), ("N", 3)):
        _write_table(document, column, width, [])


def _say(number: float) -> Any:
    return number if math.isfinite(number) else "undetermined"


def _write_table(document: Any, column: str, width: int, rows: list[list[Any]]) -> None:
    """A table from row 1 on, and nothing of an earlier one below it."""
    sheet = find_sheet(document)
    first = RESULTS.index(column)
    row = 0
    while row < len(rows) or any(sheet.getContents(f"{RESULTS[first + k]}{row + 1}") for k in range(width)):
        for k in range(width):
            line = rows[row] if row < len(rows) else []
            _write(sheet, f"{RESULTS[first + k]}{row + 1}", line[k] if k < len(line) else None)
        row += 1
    for cell, alias in ALIASES.items():
        if column == "D" and sheet.getAlias(cell) != alias:
            sheet.setAlias(cell, alias)
    sheet.recompute()


def _write(sheet: Any, cell: str, value: Any) -> None:
    is_number = isinstance(value, (int, float))
    text = "" if value is None or value == "" else repr(float(value)) if is_number else f"'{value}"
    if _plain(sheet.getContents(cell)) != _plain(text):
        sheet.set(cell, text)


def _plain(contents: str) -> str:
    return contents.lstrip("'=")


# --- the optimiser's design into the document -----------------------------------------------------------


def move_beads(document: Any, before: Request, optimum: dict[str, Any]) -> str:
    """Put the optimiser's positions and half-widths into the document as one step that can be undone.

    Returns what was done, as a sentence.  Raises Refusal, and then the document is as it was.
    """
    now = read_request(document)
    if (now.beads, now.values, now.design_name) != (before.beads, before.values, before.design_name):
        raise Refusal("the document was changed while the optimiser worked: optimise again")
    own, values = read_rows(document)
    frame = _find_frame(document, own["frame"])
    beads = {bead.label: bead for bead in find_beads(document, own["beads"], frame)}
    points = {point["label"]: point["position_mm"] for point in optimum["design"]["fiducials"]["points"]}
    left_out = sorted(set(beads) - set(points))
    if left_out or set(points) - set(beads):
        raise Refusal(
            f"the optimiser changed how many beads there are; without {', '.join(left_out) or 'none'}: "
            "delete or add them in the document, then optimise again"
        )
    document.openTransaction("Tailstack: beads of the optimiser")
    try:
        for label, position in points.items():
            _move(beads[label], frame.multVec(FreeCAD.Vector(*position)))
        _write_tolerances(document, values, optimum)
        document.recompute()
        moved = {bead.label: bead.position_mm for bead in find_beads(document, own["beads"], frame)}
        off = [label for label, position in points.items() if math.dist(moved[label], position) > SAME_MM]
        if off:
            raise Refusal(
                f"{', '.join(off)} went back to where it was: its placement follows an expression or an attachment; "
                "remove that, then optimise again"
            )
    except BaseException:
        document.abortTransaction()
        document.recompute()
        raise
    document.commitTransaction()
    before_mm, after_mm = optimum["p95_before_mm"], optimum["p95_after_mm"]
    return f"{len(points)} beads moved: P95 {before_mm:.3f} mm before, {after_mm:.3f} after"


def _move(bead: Bead, point: Any) -> None:
    """Bring the centre of a bead to a point of the document."""
    target = _placement_of_holder(bead.object).inverse().multVec(point)
    placement = bead.object.Placement
    # Where the centre is the placement's base, as of a Part sphere, no difference of large numbers is taken
    placement.Base = target if bead.centre == placement.Base else placement.Base + target - bead.centre
    bead.object.Placement = placement
    bead.object.touch()  # an expression that holds it acts in the next recompute, not in one of the user's later on


def _write_tolerances(document: Any, values: dict[str, float], optimum: dict[str, Any]) -> None:
    """Half-widths that the optimiser changed: into the rows of their paths, new ones below the last."""
    sheet = find_sheet(document)
    rows = {str(_read(sheet, f"A{row}")): row for row in range(2, 2 + len(OWN) + len(values) + 1)}
    end = max(row for name, row in rows.items() if name != "None") + 1
    for path in _changed_numbers(optimum["design_before"], optimum["design"]):
        value = _value_at(optimum["design"], path)
        if path not in rows:
            rows[path], end = end, end + 1
            _write(sheet, f"A{rows[path]}", path)
        _write(sheet, f"B{rows[path]}", value)
    sheet.recompute()


def _changed_numbers(before: Any, after: Any, path: str = "") -> list[str]:
    """Paths of the numbers that differ, beads left out."""
    if isinstance(after, dict) and isinstance(before, dict):
        steps = [(f"{path}.{key}", before.get(key), after[key]) for key in after if key != "fiducials" or path]
    elif isinstance(after, list) and isinstance(before, list) and len(before) == len(after):
        steps = [(f"{path}.{key}", before[key], after[key]) for key in range(len(after))]
    else:
        is_number = isinstance(after, (int, float)) and not isinstance(after, bool)
        return [path] if is_number and after != before else []
    return [leaf for below, first, second in steps for leaf in _changed_numbers(first, second, below.lstrip("."))]


def _value_at(node: Any, path: str) -> Any:
    for step in path.split("."):
        node = node[int(step)] if isinstance(node, list) else node[step]
    return node


# --- beads of a design, and their colours ---------------------------------------------------------------


def draw_beads(document: Any, design: Design, diameter_mm: float = 3.0) -> list[Any]:
    """A sphere for each fiducial of a design, in the document's origin."""
    made = []
    for number, point in enumerate(design["fiducials"]["points"], 1):
        sphere = document.addObject("Part::Sphere", "Bead")
        sphere.Label = f"Bead {point.get('label') or f'F{number}'}"
        sphere.Radius = diameter_mm / 2
        sphere.Placement.Base = FreeCAD.Vector(*point["position_mm"])
        made.append(sphere)
    document.recompute()
    return made


def colour_of(cost: float, least: float, most: float) -> tuple[float, float, float]:
    """Green for the bead that costs least, over yellow, to red for the one that costs most; violet: undetermined."""
    if not math.isfinite(cost):
        return (0.6, 0.0, 0.8)
    share = 0.0 if most <= least else (cost - least) / (most - least)
    return (min(1.0, 2 * share), min(1.0, 2 * (1 - share)), 0.0)


def colour_beads(document: Any, costs: list[tuple[str, float, float]]) -> None:
    """Colour the beads by what losing or moving them costs, as the row colour says.  Needs a screen."""
    kind = read_colour(document)
    if kind == "off":
        return
    pattern = read_rows(document)[0]["beads"]
    by_label = {label: losing if kind == "losing" else moving for label, losing, moving in costs}
    finite = [cost for cost in by_label.values() if math.isfinite(cost)] or [0.0]
    for item in document.Objects:
        cost = by_label.get(name_bead(item.Label, pattern)) if fnmatch.fnmatchcase(item.Label, pattern) else None
        if cost is not None and hasattr(item.ViewObject, "ShapeColor"):
            item.ViewObject.ShapeColor = colour_of(cost, min(finite), max(finite))

"""Run by FreeCAD's own Python, without a screen: what somebody does in the workbench, and what came of it as JSON.

COURSE='{"url": ..., "folder": ..., "workbench": ...}' freecadcmd freecad_course.py
"""

from __future__ import annotations

import json
import os
import socket
import sys
import traceback
from pathlib import Path
from typing import Any

COURSE = json.loads(os.environ["COURSE"])
FOLDER = Path(COURSE["folder"])
sys.path.insert(0, COURSE["workbench"])

import FreeCAD  # noqa: E402
import Part  # noqa: E402
import tailstack_document as cad  # noqa: E402
import tailstack_session  # noqa: E402
from tailstack_http import Refusal  # noqa: E402

DESIGN = json.loads((FOLDER / "design.json").read_text(encoding="utf-8"))
POINTS = {point["label"]: point["position_mm"] for point in DESIGN["fiducials"]["points"]}
Vector, Rotation, Placement = FreeCAD.Vector, FreeCAD.Rotation, FreeCAD.Placement


def start(name: str) -> Any:
    """A document with the sheet filled in, and no beads."""
    document = FreeCAD.newDocument(name)
    document.UndoMode = 1
    sheet = cad.make_sheet(document)
    sheet.set("B2", f"'{COURSE['url']}")
    sheet.set("B3", f"'{FOLDER / 'design.json'}")
    sheet.recompute()
    return document


def positions_of(document: Any) -> dict[str, list[float]]:
    return {label: list(position) for label, position in cad.read_request(document).beads}


def score_of(document: Any) -> dict[str, Any]:
    session = tailstack_session.Session(document)
    session.refresh()
    session.finish()
    sheet = cad.find_sheet(document)
    return {
        "p95_mm": sheet.get("p95_mm") if session.score else None,
        "verdict": sheet.get("verdict") if session.score else None,
        "remark": session.remark,
        "cell": sheet.getContents("E2"),
        "costs": session.costs,
        "lines": {sheet.get(f"D{row}"): sheet.get(f"E{row}") for row in range(2, 12) if sheet.getContents(f"E{row}")},
    }


def hold() -> dict[str, Any]:
    """A bead that the design's section ``optimise`` fixes, by its label there."""
    held = {**DESIGN, "optimise": {**DESIGN["optimise"], "fixed": ["F8"]}}
    (FOLDER / "held.json").write_text(json.dumps(held), encoding="utf-8")
    document = start("held")
    cad.find_sheet(document).set("B3", "'held.json")
    cad.draw_beads(document, DESIGN)
    document.saveAs(str(FOLDER / "held.FCStd"))  # the name of the design is relative to it
    request = cad.read_request(document)
    cad.move_beads(document, request, tailstack_session.optimise(request))
    return positions_of(document)


def go_through() -> dict[str, Any]:
    """Draw, score, optimise, save, undo, save."""
    document = start("whole")
    cad.draw_beads(document, DESIGN)
    found: dict[str, Any] = {"score": score_of(document)}
    request = cad.read_request(document)
    found["optimum"] = tailstack_session.optimise(request)
    found["sentence"] = cad.move_beads(document, request, found["optimum"])
    found["steps"] = list(document.UndoNames)
    found["after"] = score_of(document)
    document.saveAs(str(FOLDER / "optimised.FCStd"))
    document.undo()
    found["after_undo"] = score_of(document)
    document.saveAs(str(FOLDER / "undone.FCStd"))
    FreeCAD.closeDocument(document.Name)
    reopened = FreeCAD.openDocument(str(FOLDER / "optimised.FCStd"))
    found["reopened"] = positions_of(reopened)
    found["reopened_score"] = score_of(reopened)["p95_mm"]
    FreeCAD.closeDocument(reopened.Name)
    return found


def nest(optimum: dict[str, Any]) -> dict[str, Any]:
    """Beads in a turned part, one of them drawn off its placement, in a connector frame that is turned too."""
    document = start("nested")
    frame = document.addObject("PartDesign::CoordinateSystem", "Connector")
    frame.Placement = Placement(Vector(100.0, -20.0, 7.0), Rotation(Vector(1, 2, 3), 50.0))
    holder = document.addObject("App::Part", "Carrier")
    holder.Placement = Placement(Vector(5.0, 6.0, 7.0), Rotation(Vector(0, 1, 1), -70.0))
    cad.find_sheet(document).set("B5", "'Connector")
    for number, (label, position) in enumerate(POINTS.items()):
        inside = holder.Placement.inverse().multVec(frame.Placement.multVec(Vector(*position)))
        if number % 2:
            item = document.addObject("Part::Feature", "solid")  # as an imported STEP file draws it
            item.Shape = Part.makeSphere(1.5, inside)
            item.Placement = Placement(Vector(0, 0, 0), Rotation())
        else:
            item = document.addObject("Part::Sphere", "sphere")
            item.Placement.Base = inside
        item.Label = f"Bead_{label}"
        holder.addObject(item)
    document.recompute()
    found: dict[str, Any] = {"before": positions_of(document)}
    request = cad.read_request(document)
    cad.move_beads(document, request, optimum)
    found["moved"] = positions_of(document)
    return found


def refuse(optimum: dict[str, Any]) -> dict[str, Any]:
    """What is said when something is not as it has to be; the document is as it was."""
    found: dict[str, Any] = {}
    document = start("refused")
    found["no beads"] = score_of(document)
    beads = {item.Label: item for item in cad.draw_beads(document, DESIGN)}
    beads["Bead F3"].Placement.Base = Vector(900.0, 0.0, 0.0)
    document.recompute()
    found["outside"] = score_of(document)
    beads["Bead F3"].Placement.Base = Vector(*POINTS["F3"])
    twin = document.addObject("Part::Sphere", "sphere")
    twin.Label = "Bead-F1"
    document.recompute()
    found["twin"] = score_of(document)
    document.removeObject(twin.Name)
    cube = document.addObject("Part::Box", "Box")
    cube.Label = "Bead box"
    document.recompute()
    found["box"] = score_of(document)
    document.removeObject(cube.Name)
    cad.find_sheet(document).set("A7", "'views.*.fiducial_noise_pix")
    cad.find_sheet(document).set("B7", "0.1")
    document.recompute()
    found["path"] = score_of(document)
    cad.find_sheet(document).set("A7", "'views.*.fiducial_noise_px")
    cad.find_sheet(document).set("B7", "=0.3 / 2")
    document.recompute()
    found["expression"] = score_of(document)
    beads["Bead F4"].setExpression("Placement.Base.x", "24")
    document.recompute()
    request = cad.read_request(document)
    try:
        cad.move_beads(document, request, optimum)
    except Refusal as refusal:
        found["driven"] = str(refusal)
    found["as it was"] = cad.read_request(document) == request and document.UndoNames == []
    with socket.create_server(("127.0.0.1", 0)) as silent:  # it takes the connection and says nothing
        cad.find_sheet(document).set("B2", f"'http://127.0.0.1:{silent.getsockname()[1]}")
        document.recompute()
        session = tailstack_session.Session(document)
        session.refresh()
        found["refreshed before it was answered"] = session.is_busy
    session.finish()
    found["no service"] = session.remark
    return found


def main() -> None:
    found: dict[str, Any] = {}
    try:
        found["whole"] = go_through()
        found["held"] = hold()
        optimum = found["whole"].pop("optimum")
        found["nested"] = nest(optimum)
        found["refused"] = refuse(optimum)
    except Exception:
        found["traceback"] = traceback.format_exc()
    (FOLDER / "found.json").write_text(json.dumps(found), encoding="utf-8")


main()

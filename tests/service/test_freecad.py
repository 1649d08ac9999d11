"""The FreeCAD workbench of the examples in FreeCAD itself, without a screen: CAD, score, optimise, CAD.

Expected values: the library's score of the same design, the optimiser's answer over HTTP, and what stands in the saved
document's XML, which is read here without FreeCAD.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import xml.etree.ElementTree as ElementTree
import zipfile
from pathlib import Path
from typing import Any

import httpx
import pytest
from postgres import go_without
from service_scenes import EXAMPLES, ROOT, client_with

from family import run_process
from tailstack import load_design, score
from tailstack_service.settings import Settings

WORKBENCH = EXAMPLES / "integrations" / "freecad"


@pytest.fixture(scope="module")
def freecad() -> str:
    """FreeCAD without a screen, or the tests are skipped and say so."""
    found = shutil.which("freecadcmd") or shutil.which("FreeCADCmd")
    if found is None:
        words = "FreeCAD is not installed (Debian: apt-get install --no-install-recommends freecad-python3)"
        go_without("freecad", words)
    return found


@pytest.fixture(scope="module")
def course(freecad: str, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What came of the course, run once; the folder with the saved documents is in it."""
    folder = tmp_path_factory.mktemp("freecad")
    with client_with(Settings(worker_processes=1, max_wait_seconds=600.0), worker=True) as client:
        design = client.get("/v1/examples/first_carrier").json()
        design["optimise"]["starts"] = 1  # quick
        (folder / "design.json").write_text(json.dumps(design), encoding="utf-8")
        told = {"url": str(client.base_url).rstrip("/"), "folder": str(folder), "workbench": str(WORKBENCH)}
        environment = {**os.environ, "COURSE": json.dumps(told), "HOME": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
        done = run_process(
            freecad, str(ROOT / "tests" / "service" / "freecad_course.py"), stdin=subprocess.DEVNULL, env=environment
        )
        assert (folder / "found.json").is_file(), done.stdout[-2000:] + done.stderr[-2000:]
        found: dict[str, Any] = json.loads((folder / "found.json").read_text(encoding="utf-8"))
        assert "traceback" not in found, found["traceback"]
        optimum = client.post("/v1/optimisations", json={"design": design}, headers={"Prefer": "wait=600"})
        assert optimum.status_code == httpx.codes.OK
    return {**found, "folder": folder, "design": design, "expected": optimum.json()}


def read_placements(document: Path) -> dict[str, list[float]]:
    """Label and position of every object of a FreeCAD document, from its XML."""
    root = ElementTree.fromstring(zipfile.ZipFile(document).read("Document.xml"))
    placements = {}
    for item in root.findall("./ObjectData/Object"):
        label = item.find("./Properties/Property[@name='Label']/String")
        placement = item.find("./Properties/Property[@name='Placement']/PropertyPlacement")
        if label is not None and placement is not None:
            placements[label.attrib["value"]] = [float(placement.attrib[f"P{axis}"]) for axis in "xyz"]
    return placements


def points_of(design: dict[str, Any], before: str = "") -> dict[str, list[float]]:
    return {before + point["label"]: point["position_mm"] for point in design["fiducials"]["points"]}


@pytest.mark.long
def test_the_sheet_shows_the_p95_of_the_library_to_the_last_digit(course: dict[str, Any]) -> None:
    expected = score(load_design(course["design"]))
    shown = course["whole"]["score"]
    assert shown["p95_mm"] == expected.targets[0].p95_mm
    assert (shown["verdict"], shown["remark"]) == ("fail", "")


def test_the_sheet_names_the_worst_loss_of_one_bead_and_of_two(course: dict[str, Any]) -> None:
    losses = score(load_design(course["design"]), losses=True).losses[0]
    for loss in (losses.single, losses.double):
        line = f"tip-accuracy without {' and '.join(loss.lost)}, mm"
        assert course["whole"]["score"]["lines"][line] == loss.value


def test_saved_positions_are_the_optimisers_and_an_undo_restores_them(course: dict[str, Any]) -> None:
    optimum = course["expected"]["design"]
    assert read_placements(course["folder"] / "optimised.FCStd") == points_of(optimum, "Bead ")
    assert course["whole"]["reopened"] == points_of(optimum)
    assert course["whole"]["steps"] == ["Tailstack: beads of the optimiser"]
    assert read_placements(course["folder"] / "undone.FCStd") == points_of(course["design"], "Bead ")


def test_after_the_optimiser_the_document_scores_as_its_design_also_when_reopened(course: dict[str, Any]) -> None:
    """So that the half-widths went into the sheet with the positions, and back with the undo."""
    whole, expected = course["whole"], course["expected"]
    assert whole["after"]["p95_mm"] == expected["p95_after_mm"] == whole["reopened_score"]
    assert whole["after_undo"]["p95_mm"] == whole["score"]["p95_mm"]
    assert f"{expected['p95_after_mm']:.3f} after" in whole["sentence"]


def test_losing_and_moving_a_bead_cost_what_the_library_says(course: dict[str, Any]) -> None:
    costs = course["whole"]["score"]["costs"]
    points = course["design"]["fiducials"]["points"]
    assert [label for label, _, _ in costs] == [point["label"] for point in points]

    def p95_mm(changed: list[Any]) -> float:
        fiducials = {**course["design"]["fiducials"], "points": changed}
        return score(load_design({**course["design"], "fiducials": fiducials})).targets[0].p95_mm

    for number in (0, 7):
        point = points[number]
        slopes = []
        for axis in range(3):
            ends = []
            for sign in (-1.0, 1.0):
                position = list(point["position_mm"])
                position[axis] += sign * 0.05
                ends.append(p95_mm([*points[:number], {**point, "position_mm": position}, *points[number + 1 :]]))
            slopes.append((ends[1] - ends[0]) / 0.1)
        assert costs[number][1] == pytest.approx(p95_mm(points[:number] + points[number + 1 :]), rel=1e-12)
        assert costs[number][2] == pytest.approx(math.hypot(*slopes), rel=0.02)  # one step there, two here


def test_beads_in_a_turned_part_are_read_and_moved_in_the_connectors_frame(course: dict[str, Any]) -> None:
    for shown, design in (("before", course["design"]), ("moved", course["expected"]["design"])):
        read, expected = course["nested"][shown], points_of(design)
        assert set(read) == set(expected)
        assert max(math.dist(read[label], expected[label]) for label in expected) < 1e-9


def test_what_is_fixed_or_held_by_an_expression_stays(course: dict[str, Any]) -> None:
    drawn = points_of(course["design"])
    assert [label for label, position in course["held"].items() if position == drawn[label]] == ["F8"]
    assert course["refused"]["driven"].startswith("F4 went back to where it was")
    assert course["refused"]["as it was"]
    quiet = load_design(course["design"])
    for view in ("AP", "LAT"):
        quiet = quiet.with_value(f"views.{view}.fiducial_noise_px", 0.15)
    assert course["refused"]["expression"]["p95_mm"] == score(quiet).targets[0].p95_mm


@pytest.mark.parametrize(
    ("case", "words"),
    [
        ("no beads", "no object of this document is called Bead*"),
        ("outside", "F3"),
        ("twin", "Bead F1 and Bead-F1 would both be F1 in the design"),
        ("box", "Bead box is called like a bead and is no sphere"),
        ("path", "views.*.fiducial_noise_pix leads nowhere"),
    ],
)
def test_what_cannot_be_scored_is_said_in_the_sheet(course: dict[str, Any], case: str, words: str) -> None:
    shown = course["refused"][case]
    assert words in shown["remark"]
    assert shown["p95_mm"] is None
    assert shown["remark"] in shown["cell"]  # in place of the number


def test_without_a_service_it_says_how_to_start_one_and_nothing_waits(course: dict[str, Any]) -> None:
    assert "start it with: tailstack serve" in course["refused"]["no service"]
    assert course["refused"]["refreshed before it was answered"]


def test_the_addon_names_its_workbench_and_what_it_needs() -> None:
    space = {"p": "https://wiki.freecad.org/Package_Metadata"}
    package = ElementTree.parse(WORKBENCH / "package.xml").getroot()
    assert package.findtext("p:content/p:workbench/p:classname", namespaces=space) == "TailstackWorkbench"
    assert "class TailstackWorkbench(" in (WORKBENCH / "InitGui.py").read_text(encoding="utf-8")
    assert package.findtext("p:freecadmin", namespaces=space) == "0.20.0"

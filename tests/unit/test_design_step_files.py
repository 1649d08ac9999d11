"""STEP files written by FreeCAD and by OpenCASCADE, read back; and what a stranger's damaged files may cost.

What is expected was known before any file was written (tests/data/step/scenes.py multiplies the placements); what
OpenCASCADE's own reader finds in the files is readings.json.
"""

from __future__ import annotations

import json
import runpy
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tailstack.design import StepReading, StepSelection, read_step
from tailstack.errors import DesignError
from waiting import LIMIT_SECONDS

FOLDER = Path(__file__).parents[1] / "data" / "step"
SCENES = runpy.run_path(str(FOLDER / "scenes.py"))
EXPECTED = {scene: SCENES["expect"](scene) for scene in SCENES["SCENES"]}
READINGS = json.loads((FOLDER / "readings.json").read_text(encoding="utf-8"))
MICROMETRE = 1e-3  # mm


def files() -> dict[str, bytes]:
    with zipfile.ZipFile(FOLDER / "files.zip") as archive:
        return {name: archive.read(name) for name in sorted(archive.namelist())}


FILES = files()


def read(file: str, **more: Any) -> StepReading:
    return read_step(FILES[file], file, StepSelection(**{**expected(file)["selection"], **more}))


def expected(name: str) -> dict[str, Any]:
    found: dict[str, Any] = EXPECTED[name.partition("_")[2].removesuffix(".step")]
    return found


def match(found: Any, wanted: Any) -> list[int]:
    """Which wanted point each found one is, all within a micrometre and each once."""
    distances = np.linalg.norm(np.array(found)[:, None] - np.array(wanted)[None], axis=2)
    nearest = distances.argmin(axis=1)
    assert distances.min(axis=1).max() < MICROMETRE
    assert sorted(nearest) == list(range(len(wanted)))
    return [int(each) for each in nearest]


def test_there_are_thirty_files_of_two_programs() -> None:
    assert len([name for name in FILES if name.startswith("freecad_")]) >= 15
    assert len([name for name in FILES if name.startswith("occ_")]) >= 15
    assert all(b"FreeCAD" in FILES[name][:600] for name in FILES if name.startswith("freecad_"))
    assert all(b"Open CASCADE STEP processor 8" in FILES[name][:600] for name in FILES if name.startswith("occ_"))


@pytest.mark.parametrize("name", FILES)
def test_balls_are_where_they_were_drawn(name: str) -> None:
    reading, wanted = read(name), expected(name)["balls"]
    order = match(reading.fiducials.positions_mm, [ball["position_mm"] for ball in wanted])
    taken = [body for body in reading.bodies if not body.reason]
    assert [body.diameter_mm for body in taken] == pytest.approx([wanted[k]["diameter_mm"] for k in order], abs=1e-6)
    names = [wanted[k]["label"] for k in order]
    if len(set(names)) == len(names):
        assert list(reading.fiducials.labels) == names
    else:
        assert len(set(reading.fiducials.labels)) == len(names)


@pytest.mark.parametrize(
    ("asked", "told"), [({"diameter_mm": 3.0, "tolerance_mm": 0.1}, True), ({"name": "P*"}, False)]
)
def test_balls_that_were_exported_as_free_form_surfaces_are_named(asked: dict[str, Any], told: bool) -> None:
    """oracle: two spheres of 3 mm and a box of FreeCAD 0.20, the spheres by ``toNurbs()`` before the export."""
    with pytest.raises(DesignError) as refused:
        read_step((FOLDER / "free_form.step").read_bytes(), "free_form.step", StepSelection(**asked))
    (problem,) = refused.value.problems
    assert ("2 (BEAD_1, BEAD_2) because its faces are free-form (NURBS) or revolved" in problem.detail) == told
    assert ("export analytic surfaces, not NURBS" in problem.hint) == told
    assert told or "1 (Plate) because it has no spherical face" in problem.detail


@pytest.mark.parametrize("name", FILES)
def test_another_reader_finds_the_same_balls(name: str) -> None:
    """independent: the kernel's own reader, by area and volume; in the file's own frame."""
    reading = read(name, frame=None, diameter_mm=3.0, tolerance_mm=1.5, name=None)
    others = [ball for ball in READINGS[name] if abs(ball["diameter_mm"] - 3.0) <= 1.5]
    match(reading.fiducials.positions_mm, [ball["position_mm"] for ball in others])


@pytest.mark.parametrize("name", [name for name in FILES if expected(name)["left"]])
def test_near_misses_are_left_and_the_reason_is_said(name: str) -> None:
    left = [body for body in read(name).bodies if body.reason]
    reasons = {(body.path.rpartition(" / ")[2], body.reason) for body in left}
    for own, words in expected(name)["left"]:
        assert any(called == own and words in reason for called, reason in reasons), own
    assert {called for called, _ in reasons} == {own for own, _ in expected(name)["left"]}


@pytest.mark.parametrize("name", [name for name in FILES if expected(name)["contacts"]])
def test_seats_and_pins_hold_where_they_were_drawn(name: str) -> None:
    wanted = {contact["name"]: contact for contact in expected(name)["contacts"]}
    contacts = {contact.name: contact for contact in read(name).contacts}
    assert sorted(contacts) == ["PIN1.u", "PIN1.v", "PIN2.v", "REST1", "REST2", "REST3"]
    for label, contact in contacts.items():
        own = wanted[label.partition(".")[0]]
        assert np.allclose(contact.position_mm, own["position_mm"], atol=MICROMETRE)
        along = abs(float(np.dot(contact.normal, own["axis"])))
        assert along == pytest.approx(0.0 if "." in label else 1.0, abs=1e-9)
    across = np.subtract(wanted["PIN2"]["position_mm"], wanted["PIN1"]["position_mm"])
    assert np.dot(contacts["PIN2.v"].normal, across) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.long
@pytest.mark.hostile
def test_two_thousand_damaged_files_are_read_or_refused_within_limits(run_seed: int) -> None:
    program = [sys.executable, str(Path(__file__).with_name("step_hostility.py")), str(run_seed), f"{LIMIT_SECONDS:g}"]
    run = subprocess.run(program, capture_output=True, text=True, check=True, timeout=3 * LIMIT_SECONDS)
    found = json.loads(run.stdout)
    print(found["outcomes"], found["memory_bytes"])
    assert found["failures"] == []
    assert sum(found["outcomes"].values()) > 2000
    assert found["outcomes"]["read"] > 100
    assert found["memory_bytes"] < 300_000_000

"""Points of a file in a frame of their own: carried to con by a transform, or by registration to named points."""

from __future__ import annotations

import copy
import json
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plain_data import DEMO, EVERY, problems_of, replaced
from tailstack import load_design, score
from tailstack.design import Design, design_to_data
from tailstack.geometry.arrays import Array
from tailstack_service.operations.revision import OutputFiles, _with_file

BEADS = np.array([each["position_mm"] for each in DEMO["fiducials"]["points"]], dtype=float)
LABELS = [each["label"] for each in DEMO["fiducials"]["points"]]
TURN, SHIFT = Rotation.from_euler("xyz", [10, -35, 120], degrees=True).as_matrix(), np.array([12.0, -340.0, 77.0])
THERE = (BEADS - SHIFT) @ TURN  # of the same beads in the file: con is TURN x + SHIFT


def of_file(folder: Path, points: Array = THERE, **section: Any) -> Design:
    """The demo with its beads in a file."""
    return load_design(data_of_file(folder, points, **section), base_directory=folder)


def data_of_file(folder: Path, points: Array = THERE, **section: Any) -> dict[str, Any]:
    rows = [f"{label},{x!r},{y!r},{z!r}\n" for label, (x, y, z) in zip(LABELS, points.tolist(), strict=True)]
    (folder / "beads.csv").write_text("".join(["label,x_mm,y_mm,z_mm\n", *rows]), encoding="utf-8")
    rest = {name: each for name, each in DEMO["fiducials"].items() if name != "points"}
    return copy.deepcopy(DEMO) | {"fiducials": {**rest, "file": "beads.csv", **section}}


def named(points: Array, count: int = 12) -> list[dict[str, Any]]:
    return [{"label": label, "position_mm": at} for label, at in zip(LABELS[:count], points.tolist(), strict=False)]


def test_a_transform_carries_the_points_of_a_file_to_con(tmp_path: Path) -> None:
    """closed_form: the design that has them there, to its hash."""
    found = of_file(tmp_path, T_con_file=POSE.tolist())
    assert found.sha256 == load_design(DEMO).sha256
    assert "beads.csv: its points were carried to con by T_con_file" in score(found).provenance.notes
    assert load_design(design_to_data(found)).sha256 == found.sha256


@pytest.mark.parametrize("count", [3, 5, 12])
def test_registration_is_the_least_squares_of_named_points(tmp_path: Path, count: int) -> None:
    """independent: SciPy's align_vectors, by another algorithm; positions in con, and what is left."""
    rng = np.random.default_rng([59, count])
    drawn = (BEADS + rng.normal(0, 0.2, BEADS.shape)).round(2)
    found = of_file(tmp_path, registered_to=named(drawn, count))
    own, wanted = THERE[:count], drawn[:count]
    turn, left = Rotation.align_vectors(wanted - wanted.mean(axis=0), own - own.mean(axis=0))
    expected = turn.apply(THERE - own.mean(axis=0)) + wanted.mean(axis=0)
    np.testing.assert_allclose(found.fiducials.positions_mm, expected, rtol=0, atol=1e-6)
    (note,) = found.fiducials.notes
    assert f"registration to {count} of them: {left / np.sqrt(count):.3g} mm are left" in note
    assert ("a file with an axis reversed would fit as well" in note) == (count == 3)
    worst = np.linalg.norm(expected[:count] - wanted, axis=1)
    assert f"most at {LABELS[int(worst.argmax())]}, {worst.max():.3g} mm" in note
    alone = load_design(design_to_data(found))
    assert alone.sha256 == found.sha256
    assert alone.fiducials.notes == found.fiducials.notes


@pytest.mark.parametrize(
    ("registered_to", "code", "word"),
    [
        ([*named(BEADS, 2), {"label": "F99", "position_mm": [0, 0, 0]}], "unknown-name", "F99"),
        (named(BEADS * [1, 1, -1]), "not-rigid", "mirror image"),
        (named(BEADS / 10), "not-rigid", "10 times as far"),
        (named(np.arange(12)[:, None] * [1.0, 2.0, 3.0]), "free-motion", "one line"),
        ([*named(BEADS, 3), named(BEADS, 1)[0]], "duplicate-name", "F1"),
    ],
)
def test_points_that_no_motion_brings_together_are_refused(tmp_path: Path, registered_to, code, word) -> None:
    problem = problems_of(of_file, tmp_path, registered_to=registered_to)[0]
    assert problem.pointer.startswith("/fiducials/registered_to")
    assert problem.code == code
    assert word in f"{problem.detail} {problem.hint}"


def test_points_of_the_document_are_in_con_already() -> None:
    turned = replaced(DEMO, ("fiducials", "T_con_file"), {"rotation_deg": [0, 0, 1]})
    (problem,) = problems_of(load_design, turned)
    assert (problem.pointer, problem.code) == ("/fiducials/T_con_file", "unused-field")


def test_an_optimum_that_leaves_the_beads_keeps_their_file_and_its_frame(tmp_path: Path) -> None:
    found = of_file(tmp_path, registered_to=named(BEADS))
    result: Any = SimpleNamespace(design=design_to_data(found))
    kept = _with_file(result, load_design(result.design), OutputFiles(tmp_path / "d.yaml", None), found)
    assert kept["fiducials"]["file"] == "beads.csv"
    assert load_design(kept, base_directory=tmp_path).sha256 == found.sha256


def markups(kind: str, points: list[tuple[str, Array]]) -> str:
    """A file of 3D Slicer, in RAS."""
    held = [{"label": label, "position": (at * [-1, -1, 1]).tolist()} for label, at in points]
    return json.dumps({"markups": [{"type": kind, "coordinateSystem": "RAS", "controlPoints": held}]})


POSE = np.eye(4)
POSE[:3, :3], POSE[:3, 3] = TURN, SHIFT
ENDS = np.array([[10.0, 5.0, 60.0], [4.0, 3.0, 85.0]])


def planned(folder: Path, *files: dict[str, Any]) -> Design:
    """The demo with its beads and what is planned in a scanner's frame."""
    there = (ENDS - SHIFT) @ TURN
    points = [("L-1", there[0]), ("L-2", there[1])]
    (folder / "line.mrk.json").write_text(markups("Line", points), encoding="utf-8")
    (folder / "one.mrk.json").write_text(markups("Line", points[:1]), encoding="utf-8")
    data = data_of_file(folder, registered_to=named(BEADS))
    return load_design(data | {"targets": [], "target_files": list(files)}, base_directory=folder)


@pytest.mark.parametrize(("how", "entry", "end"), [({"line": "L4"}, "L4 entry", "L4"), ({"pairs": True}, "L-1", "L-2")])
def test_a_line_of_the_scene_of_the_beads_is_a_trajectory_in_con(tmp_path: Path, how, entry, end) -> None:
    """closed_form: the design that states its two targets, to its hash."""
    found = planned(tmp_path, {"file": "line.mrk.json", **how, "corridor_mm": 1.5, "as_fiducials": True})
    first, last = ENDS.tolist()
    planned_there = {"name": end, "position_mm": last, "entry": entry, "corridor_mm": 1.5}
    stated = [planned_there, {"name": entry, "position_mm": first}]
    assert found.sha256 == load_design(DEMO | {"targets": stated}).sha256
    assert load_design(design_to_data(found)).sha256 == found.sha256
    said = [note for note in score(found).provenance.notes if note.startswith("line.mrk.json")]
    assert any("RAS" in note for note in said)
    assert any("registration to 12" in note for note in said)


def test_points_of_a_file_with_a_transform_of_its_own_are_targets_by_their_labels(tmp_path: Path) -> None:
    found = planned(tmp_path, {"file": "line.mrk.json", "T_con_file": POSE.tolist()})
    assert [each.name for each in found.document.targets] == ["L-1", "L-2"]
    np.testing.assert_allclose([each.position_mm for each in found.document.targets], ENDS, atol=1e-6)


STRETCHED, STILL = np.diag([2, 1, 1, 1]).tolist(), np.eye(4).tolist()


@pytest.mark.parametrize(
    ("file", "field", "code"),
    [
        ({"file": "none.csv"}, "file", "file-not-found"),
        ({"file": "one.mrk.json", "line": "L4"}, "line", "zero-direction"),
        ({"file": "line.mrk.json", "T_con_file": STRETCHED}, "T_con_file", "not-rigid"),
        ({"file": "line.mrk.json", "as_fiducials": True, "T_con_file": STILL}, "T_con_file", "one-of"),
        ({"file": "one.mrk.json", "pairs": True}, "pairs", "missing-point"),
        ({"file": "line.mrk.json", "pairs": True, "line": "L4"}, "pairs", "one-of"),
        ({"file": "line.mrk.json", "corridor_mm": 1.5}, "corridor_mm", "unused-field"),
    ],
)
def test_what_no_target_can_be_read_from_is_refused(tmp_path: Path, file, field, code) -> None:
    problem = problems_of(planned, tmp_path, file)[0]
    assert (problem.pointer, problem.code) == (f"/target_files/0/{field}", code)


def test_a_design_has_a_target_and_a_service_reads_no_file_of_them(tmp_path: Path) -> None:
    (none,) = problems_of(load_design, DEMO | {"targets": []})
    assert (none.pointer, none.code) == ("/targets", "too-short")
    files = {"targets": [], "target_files": [{"file": "line.mrk.json"}]}
    (unread,) = problems_of(load_design, DEMO | files, allow_files=False)
    assert (unread.pointer, unread.code) == ("/target_files/0/file", "file-refused")
    scene = {"targets": [], "target_files": [{"file": "line.mrk.json", "as_fiducials": True}]}
    (alone,) = problems_of(load_design, DEMO | scene)
    assert (alone.pointer, alone.code) == ("/target_files/0/as_fiducials", "unused-field")


def test_as_it_was_written_a_design_names_its_files(tmp_path: Path) -> None:
    file = {"file": "line.mrk.json", "line": "L4", "as_fiducials": True}
    found = planned(tmp_path, file)
    written = design_to_data(found, inline=False)
    assert (written["targets"], written["target_files"]) == ([], [file])
    assert load_design(written, base_directory=tmp_path).sha256 == found.sha256
    assert found.files == ["beads.csv", "line.mrk.json"]


SEAT = EVERY["locators_321"]["interfaces"]["structure_connector"]


def seated(folder: Path, contacts: Sequence[dict[str, Any]], **section: Any) -> Design:
    """The demo on contacts of two files in the frame of its beads, each with a law of its own."""
    files = []
    for index, law in enumerate(dict.fromkeys(json.dumps(each["law"]) for each in contacts)):
        own = [each for each in contacts if json.dumps(each["law"]) == law]
        rows = ((each["name"], np.array(each["position_mm"]), np.array(each["normal"])) for each in own)
        both = [point for name, at, normal in rows for point in ((name, at), (f"along {name}", at + 7 * normal))]
        there = [(name, (at - SHIFT) @ TURN) for name, at in both]
        (folder / f"{index}.mrk.json").write_text(markups("Fiducial", there), encoding="utf-8")
        files.append({"file": f"{index}.mrk.json", "T_con_file": POSE.tolist(), **json.loads(law)})
    seat = {"pivot_mm": SEAT["pivot_mm"], "locator_files": files, **section}
    assumed = ["/interfaces/structure_connector/locator_files/0/half_width_mm"]
    data = DEMO | {"interfaces": {"structure_connector": seat}, "optimise": None, "assumed": assumed}
    return load_design(data, base_directory=folder)


LAWS = ("half_width_mm", "distribution", "coverage_factor")
CONTACTS = [each | {"law": {name: each[name] for name in LAWS if name in each}} for each in SEAT["locators"]]


def test_contacts_of_files_hold_as_those_of_the_document(tmp_path: Path) -> None:
    """closed_form: the design that states its six locators, to every number; only lengths of normals differ."""
    found = seated(tmp_path, CONTACTS)
    stated = {"pivot_mm": SEAT["pivot_mm"], "locators": SEAT["locators"]}
    expected = load_design(DEMO | {"interfaces": {"structure_connector": stated}, "optimise": None})
    assert score(found).targets[0].p95_mm == pytest.approx(score(expected).targets[0].p95_mm, rel=1e-7)
    alone = load_design(design_to_data(found))
    assert alone.document.interfaces == found.document.interfaces
    assert alone.document.assumed == ["/interfaces/structure_connector/locators"]
    assert sum("carried to con by T_con_file" in note for note in score(alone).provenance.notes) == 3
    seat = design_to_data(found, inline=False)["interfaces"]["structure_connector"]
    assert seat.keys() == {"pivot_mm", "locator_files"}
    assert found.files == ["0.mrk.json", "1.mrk.json", "2.mrk.json"]


@pytest.mark.parametrize(
    ("contacts", "section", "code"),
    [
        (CONTACTS[:5], {}, "wrong-length"),
        ([*CONTACTS[:5], CONTACTS[5] | {"name": "A1"}], {}, "duplicate-name"),
        ([*CONTACTS[:5], CONTACTS[5] | {"normal": [0, 0, 0]}], {}, "zero-direction"),
        (CONTACTS, {"locators": SEAT["locators"]}, "one-of"),
    ],
)
def test_files_that_hold_no_seat_are_refused(tmp_path: Path, contacts, section, code) -> None:
    problem = problems_of(seated, tmp_path, contacts, **section)[0]
    assert problem.pointer.startswith("/interfaces/structure_connector/locator_files")
    assert problem.code == code

"""Seats that STEP files state (AP242 PMI), as the interfaces of designs: files of two writers, neither of them ours to
read with (``examples/integrations/step/write_ap242.py`` and Open CASCADE, tests/data/step/tolerances.zip)."""

from __future__ import annotations

import copy
import shutil
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation
from write_ap242 import EXAMPLES, Hole, Plate, write_plate

from plain_data import EXAMPLES as DESIGNS
from plain_data import problems_of
from tailstack import score
from tailstack.design import compile_design, design_to_data, load_design
from tailstack.integrations.conversion import convert
from tailstack.integrations.step import StepSelection
from tailstack.integrations.step.reading import open_assembly
from tailstack.integrations.step.seat import find_seat, read_drawn_seat
from tailstack.integrations.step.tolerances import read_tolerances

SEAT = DESIGNS / "gallery" / "seat_from_cad.yaml"
TURN = np.array([[2, -1, 2, 10], [2, 2, -1, -20], [-1, 2, 2, 5], [0, 0, 0, 3]]) / 3
HOLES = (Hole((-30, 5), 6, "H7"), Hole((30, 5), 8, "F8", position=0.05, modifier="(M)"))
PLATE = Plate((100, 60, 10), HOLES)
DEVIATIONS = tuple(replace(each, fit="", limits=(0.03, 0.01)) for each in HOLES)
OURS = {
    "plain": PLATE,
    "metres": replace(PLATE, unit="m"),
    "inches": replace(PLATE, unit="in", holes=DEVIATIONS),
    "turned": replace(PLATE, pose=TURN),
    "parallelism": replace(PLATE, form="PARALLELISM", zone=0.05, pose=TURN, unit="in"),
    "a third hole": replace(PLATE, holes=[*DEVIATIONS[::-1], Hole((0, 0), 20)], size=(80, 100, 30)),
}
with zipfile.ZipFile(Path(__file__).parents[1] / "data" / "step" / "tolerances.zip") as archive:
    THEIRS = {name: archive.read(name) for name in archive.namelist() if name.startswith("occ")}


def told(size: Any, zone: float, position: float, *holes: Any, angle: float = 0.0) -> Plate:
    """What Open CASCADE was told: turned about (1, 2, 3) and shifted by (10, -20, 30) mm, or neither.  Its grades are
    two too high."""
    pose = np.eye(4)
    if angle:
        pose[:3] = np.column_stack(
            [Rotation.from_rotvec(np.array([1, 2, 3]) * angle / 14**0.5).as_matrix(), [10, -20, 30]]
        )
    both: Any = {"position": position, "modifier": "(M)"}
    drilled = [
        Hole(at, d, size, **both) if isinstance(size, str) else Hole(at, d, limits=(size, 0), **both)
        for at, d, size in holes
    ]
    return Plate(size, drilled, zone=zone, pose=pose)


TOLD = {
    "deviations": told((60, 40, 10), 0.05, 0.1, ((-20, 5), 5, 0.012), ((20, 5), 5, 0.03)),
    "turned": told((80, 50, 8), 0.03, 0.05, ((-30, 0), 8, "G8"), ((30, 0), 8, "F10"), angle=0.7),
    "fits": told((60, 40, 10), 0.02, 0.05, ((-25, 0), 6, "G9"), ((25, 0), 6, "F9"), angle=-0.4),
    "upright": told((30, 90, 15), 0.015, 0.02, ((0, -35), 10, 0.015), ((0, 35), 12, 0.018), angle=2.1),
    "small": told((24, 16, 4), 0.008, 0.03, ((-8, 3), 2.5, 0.01), ((9, -2), 3, 0.014)),
}
EVERY = [(write_plate(plate), plate) for plate in OURS.values()]
EVERY += [(THEIRS[f"occ_plate_{name}.step"], plate) for name, plate in TOLD.items()]


@pytest.mark.parametrize(("content", "plate"), EVERY, ids=[*OURS, *(f"occ_{name}" for name in TOLD)])
def test_a_seat_is_what_its_writer_was_told(content: bytes, plate: Plate) -> None:
    """independent: the writers' own numbers, carried by the pose that they were given."""
    seat = read_drawn_seat(content, "plate.step", "g6")
    turn, at = plate.pose[:3, :3], plate.pose[:3, 3]
    face, *pins = seat.features
    assert seat.pivot_mm == pytest.approx(at, abs=1e-6)
    assert face[f"{plate.form.lower()}_mm"] == pytest.approx(plate.zone)
    assert face["size_mm"] == pytest.approx(sorted(plate.size[:2], reverse=True))
    along = np.eye(3)[int(plate.size[1] > plate.size[0])]
    assert np.abs(np.array(face["along"]) @ turn) == pytest.approx(along, abs=1e-8)
    first, second = (np.array([*hole.at, 0]) for hole in plate.holes if hole.fit or hole.limits)
    line = turn @ (second - first) / np.linalg.norm(second - first)
    line *= np.sign(line[np.abs(line).argmax()])
    toleranced = [hole for hole in plate.holes if hole.fit or hole.limits]
    drawn = sorted(toleranced, key=lambda hole: float(turn @ [*hole.at, 0] @ line))
    for feature, hole, kind in zip(pins, drawn, ("pin_in_hole", "pin_in_slot"), strict=True):
        assert feature["kind"] == kind
        assert feature["position_mm"] == pytest.approx(turn @ [*hole.at, 0] + at, abs=1e-6)
        assert np.abs(np.array(feature["normal"]) @ turn) == pytest.approx([0, 0, 1], abs=1e-8)
        assert feature["along"] == pytest.approx(line, abs=1e-8)
        assert feature["diameter_mm"] == pytest.approx(hole.diameter)
        assert feature.get("fit") == (f"{hole.fit}/g6" if hole.fit else None)
        assert feature.get("hole_mm") == (None if hole.limits is None else pytest.approx(hole.limits))
        assert feature.get("true_position_mm") == (None if hole.position is None else pytest.approx(hole.position))
        assert feature.get("at_maximum_material", False) == (hole.modifier == "(M)")


def test_a_diameter_that_contradicts_its_hole_is_refused() -> None:
    """Open CASCADE writes 6.35 mm of a hole as 6.35 in."""
    (problem,) = problems_of(lambda: read_drawn_seat(THEIRS["occ_plate_inch.step"], "inch.step", "g6"))
    assert (problem.code, problem.file) == ("wrong-size", "inch.step")
    assert "of a hole of 6.35 mm" in problem.detail


@pytest.mark.parametrize(
    ("plate", "pin_class", "code", "word"),
    [
        (replace(PLATE, form="PERPENDICULARITY"), "g6", "no-seat", "one plane face"),
        (replace(PLATE, holes=HOLES[:1]), "g6", "no-seat", "has 1: diameter 6 H7"),
        (replace(PLATE, holes=[*HOLES, Hole((0, 0), 5, "H7")]), "g6", "no-seat", "has 3: diameter 6 H7, diameter 8 F8"),
        (replace(PLATE, holes=DEVIATIONS), "k6", "unknown-fit", "of shafts d, e"),
        (PLATE, "k6", "unknown-fit", "of shafts d, e"),
        (PLATE, "m6", "interference", "larger than the hole"),
    ],
)
def test_what_states_no_seat_is_refused(tmp_path: Path, plate: Plate, pin_class: str, code: str, word: str) -> None:
    data = yaml.safe_load(SEAT.read_text())
    del data["interfaces"]["connector_flange"], data["optimise"]
    drawing = {"file": "seat.step", "pin_class": pin_class}
    data["interfaces"]["structure_connector"]["drawing"] = drawing
    (tmp_path / "seat.step").write_bytes(write_plate(plate))
    (problem, *_) = problems_of(lambda: load_design(data, base_directory=tmp_path))
    assert (problem.code, problem.pointer) == (code, "/interfaces/structure_connector/drawing")
    assert word in problem.detail


def test_two_seats_in_one_file_are_refused_with_where_they_are() -> None:
    read, _ = read_tolerances(*open_assembly(write_plate(PLATE), "both.step", None))
    flat = next(each for each in read if each.kind == "flatness")
    other = replace(flat, faces=(replace(flat.faces[0], number=-1, point_mm=np.array([0, 0, -50.0])),))
    (problem,) = problems_of(lambda: find_seat([*read, other], "g6", "both.step"))
    assert problem.detail.endswith("has 2: flatness 0.02 at [0.0, 0.0, 0.0]; flatness 0.02 at [0.0, 0.0, -50.0]")
    assert "one file for each seat" in problem.hint


def test_every_value_is_named_and_so_is_what_is_left() -> None:
    holes = [replace(HOLES[0], position=0.02, modifier="(L)"), HOLES[1], Hole((0, 20), 4)]
    remarks = read_drawn_seat(write_plate(replace(PLATE, holes=holes)), "plate.step", "g6").remarks
    assert remarks == [
        "the seat is flatness 0.02; diameter 6 H7; diameter 8 F8; position Ø0.05 (M) | A; pins g6",
        "not in the seat: position Ø0.02 (L) | A; diameter 4",
    ]


def test_the_example_has_no_half_width_and_its_files_are_those_of_their_writer() -> None:
    assert "half_width" not in SEAT.read_text()
    for name, plate in EXAMPLES.items():
        assert (SEAT.parent / name).read_bytes() == write_plate(plate, name.partition(".")[0])


def test_a_design_with_drawings_is_that_with_their_features_written_out(tmp_path: Path) -> None:
    design = load_design(SEAT)
    assert design.files == [*EXAMPLES]
    assert "drawing" in design_to_data(design, inline=False)["interfaces"]["structure_connector"]
    alone = design_to_data(design)
    assert [*alone["interfaces"]["structure_connector"]] == ["label", "pivot_mm", "features", "origin"]
    again = load_design(alone)
    assert again.sha256 == design.sha256
    assert score(again).targets[0].p95_mm == score(design).targets[0].p95_mm
    assert compile_design(again).notes == compile_design(design).notes
    stated = copy.deepcopy(alone)
    for interface in stated["interfaces"].values():
        del interface["origin"]
    assert load_design(stated).sha256 == design.sha256
    shutil.copytree(SEAT.parent, tmp_path, dirs_exist_ok=True)
    name, plate = next(iter(EXAMPLES.items()))
    (tmp_path / name).write_bytes(write_plate(replace(plate, zone=0.03)))
    assert load_design(tmp_path / SEAT.name).sha256 != design.sha256
    (tmp_path / name).unlink()
    (problem,) = problems_of(lambda: load_design(tmp_path / SEAT.name))
    assert (problem.code, problem.pointer) == ("file-not-found", "/interfaces/structure_connector/drawing")


def test_what_is_assumed_of_a_drawing_stays_so_when_its_features_are_written_out() -> None:
    pointer = "/interfaces/structure_connector"
    data = yaml.safe_load(SEAT.read_text()) | {"assumed": [f"{pointer}/drawing/pin_class"]}
    alone = design_to_data(load_design(data, base_directory=SEAT.parent))
    assert alone["assumed"] == [f"{pointer}/features"]
    assert load_design(alone).document.assumed == alone["assumed"]


@pytest.mark.parametrize("beads", [(), ((-20, -15, 30), (20, -15, 34), (-20, 15, 38))])
def test_convert_puts_the_seat_into_a_design(beads: Any) -> None:
    """A file without balls keeps those of the design."""
    content, base = write_plate(replace(PLATE, beads=beads)), load_design(DESIGNS / "demo.yaml")
    made = convert(content, "s.step", "d.json", base=base, selection=StepSelection(pin_class="g6"))
    interface = yaml.safe_load(made.text)["interfaces"]["structure_connector"]
    assert [feature["name"] for feature in interface["features"]] == ["face", "pin 1", "pin 2"]
    assert "tolerances" not in interface
    assert made.fiducials.positions_mm == (beads or base.fiducials.positions_mm)
    assert any("the seat is flatness 0.02" in note for note in made.notes)
    if not beads:
        (problem,) = problems_of(lambda: convert(content, "s.step", "d.csv", selection=StepSelection(pin_class="g6")))
        assert problem.code == "no-ball"

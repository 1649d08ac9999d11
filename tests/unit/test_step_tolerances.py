"""Tolerances that STEP files state (AP242): files of two origins, tests/data/step/tolerances.zip.

``nist_*``: models with PMI of the NIST MBE PMI Validation and Conformance Testing project, exported by several CAD
systems (works of the United States government, not subject to copyright), as kept in the repository
tsun7170/STEPswiftcode at 1da6b408; what is only drawn was left out, the numbers of instances are theirs.
``occ_*``: plates with two holes that OpenCASCADE (cadquery-ocp 8.0) was told to write; what it was told is below and in
``test_drawn_seat``.
"""

from __future__ import annotations

import random
import re
import zipfile
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from step_hostility import damage
from write_ap242 import EXAMPLES, write_plate

from tailstack.errors import TailstackError
from tailstack.integrations.conversion import convert
from tailstack.integrations.step.assembly import WANTED, Assembly
from tailstack.integrations.step.part21 import Part21
from tailstack.integrations.step.seat import read_drawn_seat
from tailstack.integrations.step.tolerances import (
    FORMS,
    WANTED_TOLERANCES,
    StepTolerance,
    read_tolerances,
)

with zipfile.ZipFile(Path(__file__).parents[1] / "data" / "step" / "tolerances.zip") as archive:
    FILES = {name: archive.read(name) for name in sorted(archive.namelist())}
NIST = [name for name in FILES if name.startswith("nist")]
ROUNDED_MM = 0.02  # drawings in inches state a fraction with three decimals


@cache
def read(name: str, content: bytes | None = None) -> tuple[tuple[StepTolerance, ...], tuple[str, ...]]:
    file = Part21(FILES[name] if content is None else content, name, (*WANTED, *WANTED_TOLERANCES))
    return read_tolerances(Assembly(file), np.eye(4))


def test_every_tolerance_of_the_first_model_is_as_on_its_drawing() -> None:
    """published: NIST CTC-01, test case drawing and its file."""
    found, left = read("nist_ctc_01_asme1_ap242-e1.stp")
    assert left == ()
    assert sorted(each.text for each in found) == sorted([
        *["position 0.75 | A | B | C"] * 2, "surface profile 1.25 | A | B | C", "surface profile 0.5 | A",
        "perpendicularity 1.5 | A", "flatness 0.2", "angle 60° +0.5 -0.5", *["linear distance"] * 2, *["diameter"] * 2,
        "diameter 35 +0 -0.2", "diameter 35 +0.2 +0", "diameter 20 +0.05 -0.1", "diameter 20 +0.1 -0.05",
        *["diameter 35 +0.2 -0.2"] * 2, "diameter 25 +0.15 -0.15",
    ])  # fmt: skip
    (flat,) = (each.faces for each in found if each.kind == "flatness")
    assert [(face.surface, *face.extents_mm) for face in flat] == [
        ("plane", pytest.approx(800.0), pytest.approx(450.0))
    ]


@pytest.mark.parametrize("name", NIST)
def test_no_tolerance_of_a_file_is_lost(name: str) -> None:
    """independent: keywords counted in the text, whose datums are letters that it declares."""
    text = re.sub(r"'[^']*'", "''", FILES[name].decode("latin-1"))
    kinds = re.findall(rf"\b({'|'.join(FORMS)})_TOLERANCE\(", text)
    sizes = re.findall(r"\b(?:DIMENSIONAL|ANGULAR)_(?:SIZE|LOCATION)\(", text)
    found, left = read(name)
    geometric = [each.kind for each in found if each.kind.upper().replace(" ", "_") in FORMS]
    assert left == ()
    assert sorted(geometric) == sorted(kind.lower().replace("_", " ") for kind in kinds)
    assert len(found) - len(geometric) == len(sizes) > 0
    letters = set(re.findall(r"\.[TF]\.,\s*'([A-Z])'\s*\)", FILES[name].decode("latin-1")))
    used = {letter for each in found for datum in each.datums for letter in re.findall(r"\b[A-Z]\b(?!\))", datum)}
    assert used
    assert used <= letters


def test_stated_diameters_are_those_of_their_faces() -> None:
    """independent: sizes come from measures with units, radii from surfaces with the unit of the shape; parts in mm
    and in inches."""
    compared = 0
    for name in NIST:
        for each in read(name)[0]:
            times = {"diameter": 2, "radius": 1}.get(each.kind)
            for face in each.faces if times and each.value is not None else ():
                if face.surface == "cylinder":
                    assert each.value == pytest.approx(times * face.radius_mm, abs=ROUNDED_MM)
                    compared += 1
    assert compared > 60


def test_inches_modifiers_and_common_datums_are_read() -> None:
    """published: callouts of NIST CTC-03 (inches), CTC-05 and FTC-08."""
    texts = {each.text for name in NIST for each in read(name)[0]}
    assert texts >= {
        "position Ø1.27 (M) | A | B (M) | C (M)", "circular runout 0.635 | A-B",
        "position Ø0.508 (M) free state | A | B",
    }  # fmt: skip


def test_what_another_program_was_told_to_write_is_read() -> None:
    """independent: OpenCASCADE's writer."""
    found, left = read("occ_plate_deviations.step")
    assert left == ()
    assert sorted(each.text for each in found) == sorted([
        "diameter 5 +0.012 -0", "diameter 5 +0.03 -0", "linear distance 40 +0.05 -0.05", "flatness 0.05",
        *["position Ø0.1 (M)"] * 2,
    ])  # fmt: skip
    (distance,) = (each for each in found if each.kind == "linear distance")
    first, second = (face.point_mm for face in distance.faces)
    assert np.linalg.norm(first - second) == pytest.approx(40.0, abs=1e-9)
    assert [face.extents_mm for face in distance.faces] == [(pytest.approx(10.0), 0.0)] * 2
    (flat,) = (each.faces[0] for each in found if each.kind == "flatness")
    assert flat.extents_mm == pytest.approx((60.0, 40.0))
    assert abs(flat.axis @ [0, 0, 1]) == pytest.approx(1.0)
    assert abs(flat.along @ [1, 0, 0]) == pytest.approx(1.0)


def test_a_turned_part_is_read_where_it_is_and_doubtful_grades_are_named() -> None:
    """closed form: the plate was turned by 0.7 rad about (1, 2, 3) and shifted by (10, -20, 30) mm; it was told G6 and
    F8, and wrote G8 and F10."""
    found, left = read("occ_plate_turned.step")
    axis, angle = np.array([1.0, 2.0, 3.0]) / np.sqrt(14), 0.7
    cross = np.cross(np.eye(3), axis)
    turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    (flat,) = (each.faces[0] for each in found if each.kind == "flatness")
    assert flat.point_mm == pytest.approx([10.0, -20.0, 30.0], abs=1e-6)
    assert abs(flat.axis @ turn[:, 2]) == pytest.approx(1.0)
    assert {each.fit for each in found} == {"G8", "F10", ""}
    assert len(left) == 1
    assert left[0].endswith("check F10, G8")


def test_a_size_that_contradicts_its_face_is_doubted() -> None:
    """The writer states 6.35 in of a hole of 6.35 mm."""
    _, left = read("occ_plate_inch.step")
    assert sum("says diameter 161.29 mm, its face has 6.35 mm" in each for each in left) == 2


def test_convert_tells_them_and_keeps_the_rest() -> None:
    made = convert(FILES["occ_plate_deviations.step"], "plate.step", "beads.csv")
    assert len(made.fiducials.labels) == 6
    assert [each.text for each in made.tolerances] == [each.text for each in read("occ_plate_deviations.step")[0]]


def test_what_cannot_be_read_is_named_and_the_others_are_read() -> None:
    content = FILES["occ_plate_deviations.step"]
    broken = re.sub(rb"FLATNESS_TOLERANCE\('[^']*',\s*'[^']*',\s*#\d+", b"FLATNESS_TOLERANCE('','',$", content)
    assert broken != content
    found, left = read("occ_plate_deviations.step", broken)
    assert len(found) == 5
    assert len(left) == 1
    assert "FLATNESS_TOLERANCE was not read" in left[0]


@pytest.mark.hostile
@pytest.mark.parametrize("count", [120, pytest.param(2000, marks=pytest.mark.long)])
def test_damaged_files_are_read_or_refused(run_seed: int, count: int) -> None:
    """No other exception than one of ours, in 120 files, or 2,000; of those that are read the seat, too."""
    draw, read_ones, seats = random.Random(run_seed), 0, 0
    small = [content for content in FILES.values() if len(content) < 60_000]
    small += [write_plate(plate) for plate in EXAMPLES.values()]
    for _ in range(count):
        content = damage(draw.choice(small), draw)
        with suppress(TailstackError):
            read.__wrapped__("mutant.step", content)
            read_ones += 1
            read_drawn_seat(content, "mutant.step", "g6")
            seats += 1
    assert read_ones > count / 10
    assert seats > count / 20

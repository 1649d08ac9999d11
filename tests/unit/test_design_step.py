"""STEP files, written here by hand, by FreeCAD and by OpenCASCADE: units, placements, names, and files that lie.

What is expected of the files of programs was known before any was written (tests/data/step/scenes.py multiplies the
placements); what OpenCASCADE's own reader finds in them is readings.json.
"""

from __future__ import annotations

import json
import math
import re
import runpy
import sys
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from family import run_process
from plain_data import problems_of, read_cases
from tailstack.design import load_design
from tailstack.errors import DesignError, StepError, TailstackError
from tailstack.integrations.conversion import convert
from tailstack.integrations.step import StepReading, StepSelection, read_step
from waiting import LIMIT_SECONDS

MM = "#1=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));"
METRE = "#1=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT($,.METRE.));"
INCH = (
    "#1=(CONVERSION_BASED_UNIT('INCH',#3)LENGTH_UNIT()NAMED_UNIT(#5));\n#3=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#4);\n"
    "#4=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));\n#5=DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.);"
)


def text_of(data: str, *, unit: str = MM, schema: str = "AUTOMOTIVE_DESIGN") -> bytes:
    """A whole file; instances #1 to #9 are its unit and context."""
    return (
        f"ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\n"
        f"FILE_SCHEMA(('{schema}'));\nENDSEC;\nDATA;\n{unit}\n"
        "#2=(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNIT_ASSIGNED_CONTEXT((#1))REPRESENTATION_CONTEXT('',''));\n"
        f"{data}\nENDSEC;\nEND-ISO-10303-21;\n"
    ).encode()


def product(at: int, name: str, items: Sequence[int], *, shape: int | None = None) -> str:
    """A product with a representation of these items: the product is #at, its representation #at+3."""
    listed = ",".join(f"#{item}" for item in items)
    return (
        f"#{at}=PRODUCT_DEFINITION('design','',#{at + 1},$);\n"
        f"#{at + 1}=PRODUCT_DEFINITION_FORMATION('','',#{at + 2});\n"
        f"#{at + 2}=PRODUCT('{name}','{name}','',$);\n#{at + 3}=SHAPE_REPRESENTATION('',({listed}),#2);\n"
        f"#{at + 4}=PRODUCT_DEFINITION_SHAPE('','',#{at});\n"
        f"#{at + 5}=SHAPE_DEFINITION_REPRESENTATION(#{at + 4},#{at + 3});\n"
    )


def ball(at: int, centre: Sequence[float], radius: float, name: str = "") -> str:
    """A solid of one spherical face, #at."""
    x, y, z = centre
    return (
        f"#{at}=MANIFOLD_SOLID_BREP('{name}',#{at + 1});\n#{at + 1}=CLOSED_SHELL('',(#{at + 2}));\n"
        f"#{at + 2}=ADVANCED_FACE('',(#{at + 3}),#{at + 4},.T.);\n#{at + 3}=FACE_BOUND('',#{at + 7},.T.);\n"
        f"#{at + 4}=SPHERICAL_SURFACE('',#{at + 5},{radius!r});\n#{at + 5}=AXIS2_PLACEMENT_3D('',#{at + 6},$,$);\n"
        f"#{at + 6}=CARTESIAN_POINT('',({x!r},{y!r},{z!r}));\n#{at + 7}=VERTEX_LOOP('',#{at + 8});\n"
        f"#{at + 8}=VERTEX_POINT('',#{at + 9});\n#{at + 9}=CARTESIAN_POINT('',({x!r},{y!r},{z - radius!r}));\n"
    )


def placement(at: int, origin: Sequence[float], z: Sequence[float], x: Sequence[float], name: str = "") -> str:
    """A coordinate system, #at."""
    texts = [",".join(repr(float(value)) for value in vector) for vector in (origin, z, x)]
    return (
        f"#{at}=AXIS2_PLACEMENT_3D('{name}',#{at + 1},#{at + 2},#{at + 3});\n"
        f"#{at + 1}=CARTESIAN_POINT('',({texts[0]}));\n"
        f"#{at + 2}=DIRECTION('',({texts[1]}));\n#{at + 3}=DIRECTION('',({texts[2]}));\n"
    )


def instance(at: int, name: str, parent: int, child: int, start: int, target: int) -> str:
    """A product in another one: from coordinate system #start of the child to #target of the parent."""
    return (
        f"#{at}=NEXT_ASSEMBLY_USAGE_OCCURRENCE('1','{name}','',#{parent},#{child},$);\n"
        f"#{at + 1}=PRODUCT_DEFINITION_SHAPE('','',#{at});\n"
        f"#{at + 2}=CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(#{at + 3},#{at + 1});\n"
        f"#{at + 3}=(REPRESENTATION_RELATIONSHIP('','',#{child + 3},#{parent + 3})"
        f"REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION(#{at + 4})SHAPE_REPRESENTATION_RELATIONSHIP());\n"
        f"#{at + 4}=ITEM_DEFINED_TRANSFORMATION('','',#{start},#{target});\n"
    )


ONE = product(10, "BEAD1", [20]) + ball(20, (10.0, 20.0, 30.0), 1.5)
ORIGIN = placement(60, (0, 0, 0), (0, 0, 1), (1, 0, 0))
TARGET = placement(70, (100.0, 0.0, 5.0), (0, 0, 1), (0, 1, 0))  # a quarter turn about z, then a shift
ASSEMBLY = (
    product(10, "bead", [20, 60]) + ball(20, (1.0, 2.0, 3.0), 1.5) + product(40, "carrier", [70, 80]) + ORIGIN + TARGET
    + placement(80, (0.0, 50.0, 0.0), (0, 0, -1), (1, 0, 0)) + instance(100, "B1", 40, 10, 60, 70)
    + instance(110, "B2", 40, 10, 60, 80)
)  # fmt: skip


def read(content: bytes, **selection: object) -> StepReading:
    return read_step(content, "part.step", StepSelection(**selection))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("unit", "factor", "symbol", "note"),
    [(MM, 1.0, "mm", ""), (METRE, 1000.0, "m", "1000"), (INCH, 25.4, "in", "25.4")],
)
def test_the_unit_is_that_of_the_file_and_noted(unit: str, factor: float, symbol: str, note: str) -> None:
    reading = read(text_of(ONE, unit=unit))
    assert np.allclose(reading.fiducials.positions_mm, [[10 * factor, 20 * factor, 30 * factor]], rtol=1e-14)
    assert reading.bodies[0].diameter_mm == pytest.approx(3 * factor)
    assert reading.fiducials.origin.coordinate_unit == symbol
    assert note in " ".join(reading.notes)


def test_a_relationship_written_the_wrong_way_round_is_read_alike() -> None:
    turned = ASSEMBLY.replace("('','',#13,#43)", "('','',#43,#13)")
    turned = re.sub(r"(ITEM_DEFINED_TRANSFORMATION\('','',)(#\d+),(#\d+)", r"\1\3,\2", turned)
    assert read(text_of(turned)).fiducials.positions_mm == read(text_of(ASSEMBLY)).fiducials.positions_mm


def test_a_mapped_item_can_mirror() -> None:
    operator = (
        "#90=CARTESIAN_TRANSFORMATION_OPERATOR_3D('','','',#91,#92,#93,1.,#94);\n#91=DIRECTION('',(1.,0.,0.));\n"
        "#92=DIRECTION('',(0.,-1.,0.));\n#93=CARTESIAN_POINT('',(0.,0.,7.));\n#94=DIRECTION('',(0.,0.,1.));\n"
        "#95=MAPPED_ITEM('',#96,#90);\n#96=REPRESENTATION_MAP(#60,#97);\n#97=SHAPE_REPRESENTATION('',(#20,#60),#2);\n"
    )
    data = product(40, "carrier", [95]) + ORIGIN + ball(20, (1.0, 2.0, 3.0), 1.5) + operator
    assert np.allclose(read(text_of(data)).fiducials.positions_mm, [[1.0, -2.0, 10.0]])


def test_a_named_frame_becomes_con() -> None:
    data = ASSEMBLY.replace("AXIS2_PLACEMENT_3D('',#81", "AXIS2_PLACEMENT_3D('CON',#81")
    expected = [[98.0, 49.0, -8.0], [1.0, 2.0, 3.0]]  # closed_form: of (98, 1, 8) and the second bead's own frame
    assert np.allclose(read(text_of(data), frame="CON").fiducials.positions_mm, expected)
    assert np.allclose(read(text_of(data), frame="B2").fiducials.positions_mm, expected)
    with pytest.raises(StepError, match="did you mean CON"):
        read(text_of(data), frame="Con")
    with pytest.raises(StepError, match="2 coordinate systems, parts or instances"):
        read(text_of(data), frame="bead")


@pytest.mark.parametrize(
    ("written", "label"),
    [("K\\X2\\00FC\\X0\\gel", "Kügel"), ("a''b", "a'b"), ("\\X\\E9t\\S\\i", "été"), ("\\X4\\0001F600\\X0\\", "😀"),
     ("", "F1"), ("Open CASCADE STEP translator 7.6 1", "F1"), ("a\\\\b", "a\\b"), ("Träger", "Träger")],
)  # fmt: skip
def test_names_are_those_that_somebody_gave(written: str, label: str) -> None:
    assert read(text_of(ONE.replace("BEAD1", written))).fiducials.labels == (label,)


def test_bodies_of_one_part_have_their_own_names_and_numbers() -> None:
    names = ["A", "A", "", "B"]
    data = product(10, "beads", [20, 30, 40, 50]) + "".join(
        ball(20 + 10 * k, (10.0 * k, 0.0, 0.0), 1.5, name) for k, name in enumerate(names)
    )
    assert read(text_of(data)).fiducials.labels == ("A.1", "A.2", "F1", "B")
    assert read(text_of(data), name="A*").fiducials.positions_mm == ((0.0, 0.0, 0.0), (10.0, 0.0, 0.0))
    assert [body.reason for body in read(text_of(data), name="B").bodies][1:] == ["no name of it matches B"] * 3


def test_two_diameters_have_to_be_told_apart() -> None:
    data = product(10, "beads", [20, 30]) + ball(20, (0.0, 0.0, 0.0), 1.5) + ball(30, (9.0, 0.0, 0.0), 2.0)
    with pytest.raises(StepError, match=r"1 of 3 mm, 1 of 4 mm.*--sphere-diameter 3"):
        read(text_of(data))
    reading = read(text_of(data), diameter_mm=3.1, tolerance_mm=0.1)
    assert reading.fiducials.positions_mm == ((0.0, 0.0, 0.0),)
    assert reading.bodies[1].reason == "its diameter is not 3.1 ± 0.1 mm"
    with pytest.raises(StepError, match=r"no ball of diameter 5 ± 0.01 mm.*its balls: 1 of 3 mm, 1 of 4 mm"):
        read(text_of(data), diameter_mm=5.0)


def turned(at: int, axis: Sequence[float] = (0, 0, 1), off: float = 0.0, curve: str = "") -> str:
    """A solid of radius 1.5 about (10, 20, 30): a circle in the plane of x and z, turned about an axis, #at."""
    return (
        f"#{at}=MANIFOLD_SOLID_BREP('',#{at + 1});\n#{at + 1}=CLOSED_SHELL('',(#{at + 2}));\n"
        f"#{at + 2}=ADVANCED_FACE('',(#{at + 3}),#{at + 4},.T.);\n#{at + 3}=FACE_OUTER_BOUND('',#{at + 5},.T.);\n"
        f"#{at + 4}=SURFACE_OF_REVOLUTION('',#{at + 19 if curve else at + 9},#{at + 10});\n"
        f"#{at + 5}=EDGE_LOOP('',(#{at + 6},#{at + 7}));\n#{at + 6}=ORIENTED_EDGE('',*,*,#{at + 8},.T.);\n"
        f"#{at + 7}=ORIENTED_EDGE('',*,*,#{at + 8},.F.);\n"
        f"#{at + 8}=EDGE_CURVE('',#{at + 13},#{at + 15},#{at + 9},.T.);\n"
        f"#{at + 9}=CIRCLE('',#{at + 30},1.5);\n#{at + 10}=AXIS1_PLACEMENT('',#{at + 11},#{at + 12});\n"
        f"#{at + 11}=CARTESIAN_POINT('',({10.0 + off!r},20.,7.));\n#{at + 12}=DIRECTION('',{(*map(float, axis),)!r});\n"
        f"#{at + 13}=VERTEX_POINT('',#{at + 14});\n#{at + 14}=CARTESIAN_POINT('',(10.,20.,28.5));\n"
        f"#{at + 15}=VERTEX_POINT('',#{at + 16});\n#{at + 16}=CARTESIAN_POINT('',(10.,20.,31.5));\n"
        + (f"#{at + 19}={curve.format(circle=at + 9, low=at + 14, high=at + 16)};\n" if curve else "")
        + placement(at + 30, (10, 20, 30), (0, -1, 0), (1, 0, 0))
    )


TRIMMED = "TRIMMED_CURVE('',#{circle},(#{low}),(#{high}),.T.,.CARTESIAN.)"
SPLINE = "BEZIER_CURVE('',2,(#{low},#{high}),.UNSPECIFIED.,.F.,.F.)"


@pytest.mark.parametrize("curve", ["", TRIMMED])
def test_a_circle_turned_about_its_diameter_is_a_ball(curve: str) -> None:
    reading = read(text_of(product(10, "BEAD1", [100]) + turned(100, curve=curve)))
    assert reading.fiducials.positions_mm == ((10.0, 20.0, 30.0),)
    assert [body.diameter_mm for body in reading.bodies] == [3.0]


@pytest.mark.parametrize("other", [
    turned(100, off=0.5), turned(100, axis=(0, 1, 1)), turned(100, curve=SPLINE),
])  # fmt: skip
def test_what_is_turned_otherwise_is_left_by_name(other: str) -> None:
    """A ring, a spindle and a free-form curve, beside a ball."""
    reading = read(text_of(ONE + product(80, "TURNED", [100]) + other))
    assert [(body.label, body.reason[:32]) for body in reading.bodies] == [
        ("BEAD1", ""), ("TURNED", "its faces are free-form (NURBS) ")
    ]  # fmt: skip


def test_a_turned_circle_is_a_ball_where_it_closes_and_one_given_twice_is_taken_once() -> None:
    data = product(10, "beads", [20, 30]) + ball(20, (0.0, 0.0, 0.0), 1.5) + ball(30, (0.0, 1e-4, 0.0), 1.5)
    reading = read(text_of(data))
    assert reading.fiducials.positions_mm == ((0.0, 0.0, 0.0),)
    assert "twice at one place" in reading.notes[0]
    half = product(80, "HALF", [100]) + turned(100).replace("(#106,#107)", "(#106)")
    assert [body.reason for body in read(text_of(ONE + half)).bodies] == ["", "its faces do not close"]
    value = math.pi * 10
    data = product(10, "B", [20]) + ball(20, (value, -value / 3, value / 7), 1.5)
    assert read(text_of(data)).fiducials.positions_mm == ((value, -value / 3, value / 7),)


@pytest.mark.parametrize(("old", "new", "line", "words"), read_cases("tables", "step"))
def test_a_file_that_lies_is_refused_at_its_line(old: str, new: str, line: int, words: str) -> None:
    text = text_of(ONE).decode()
    if not words:
        assert read(text.replace("#20=", "/* #20=';( */ #20 = ").encode()).fiducials.labels == ("BEAD1",)
        return
    assert old in text
    (problem,) = problems_of(read, text.replace(old, new, 1).encode(), error=StepError)
    assert words in problem.detail
    if line:
        assert problem.line == line, problem


@pytest.mark.parametrize(
    "kind",
    [
        "'of UNIT and SHAPE_REPRESENTATION_RELATIONSHIP(3)'", "''/* SHAPE_REPRESENTATION_RELATIONSHIP() */",
        "'(REPRESENTATION_RELATIONSHIP)NEXT_ASSEMBLY_USAGE_OCCURRENCE()'", ".SHAPE_REPRESENTATION_RELATIONSHIP.",
        "SHAPE_REPRESENTATION_RELATIONSHIP(3.)",
    ],
)  # fmt: skip
def test_what_is_only_called_like_a_relationship_is_none(kind: str) -> None:
    text = text_of(ONE).decode()
    assert text.count("REPRESENTATION_CONTEXT('','')") == 1
    named = text.replace("REPRESENTATION_CONTEXT('','')", f"REPRESENTATION_CONTEXT('',{kind})")
    assert read(named.encode()).fiducials.positions_mm == read(text.encode()).fiducials.positions_mm


def test_an_inch_of_another_length_and_seats_that_make_no_six_locators_are_refused() -> None:
    with pytest.raises(StepError, match=r"INCH is 25.4 mm; #1 makes it 2.54 mm"):
        read(text_of(ONE, unit=INCH.replace("25.4", "2.54")))
    with pytest.raises(StepError, match=r"2 seats and 2 pins .* make 5 contacts"):
        read(carrier(), seats="S[12]", pins="P*")


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"PK\x03\x04", "ZIP"), (b"solid a", "STL"), (b"<?xml version='1.0'?>", "XML"), (b"", "begins with"),
     (text_of(ONE, schema="IFC4"), "AP203, AP214 and AP242"), (text_of(""), "no product")],
)  # fmt: skip
def test_what_is_no_step_file_of_parts_is_said(content: bytes, words: str) -> None:
    with pytest.raises(StepError, match=words):
        read(content)


def test_a_part_of_itself_is_refused() -> None:
    data = ASSEMBLY + instance(120, "loop", 10, 40, 70, 60)
    with pytest.raises(StepError, match="every product is part of another"):
        read(text_of(data))
    data += product(150, "all", [160]) + placement(160, (0, 0, 0), (0, 0, 1), (1, 0, 0))
    with pytest.raises(StepError, match="is a part of itself"):
        read(text_of(data + instance(170, "it", 150, 40, 70, 160)))


def test_an_assembly_that_doubles_at_every_level_is_refused() -> None:
    data = product(10, "bead", [20, 60]) + ball(20, (0.0, 0.0, 0.0), 1.5) + ORIGIN
    for level in range(1, 20):
        at = 1000 * level
        data += product(at, f"level {level}", [60])
        child = at - 1000 if level > 1 else 10
        data += instance(at + 100, "a", at, child, 60, 60) + instance(at + 200, "b", at, child, 60, 60)
    with pytest.raises(TailstackError, match="more than 50000 instances"):
        read(text_of(data))


@pytest.mark.long
def test_one_long_list_that_everything_names_is_refused() -> None:
    """Each of 3000 parts names one representation of 20,000 items: 1.2 GB to be read in a file of 1 MB."""
    items = ",".join(["#60"] * 20_000)
    data = ORIGIN + ball(20, (0.0, 0.0, 0.0), 1.5) + f"#90=SHAPE_REPRESENTATION('',(#20,{items}),#2);\n"
    data += "".join(product(at, "part", [60]).replace(f"#{at + 4},#{at + 3})", f"#{at + 4},#90)")
                    for at in range(1000, 31_000, 10))  # fmt: skip
    with pytest.raises(TailstackError, match="many times longer than the file itself"):
        read(text_of(data))


def test_a_ball_without_a_place_is_left() -> None:
    placed = "".join(line for line in ASSEMBLY.splitlines(True) if not line.startswith(("#112=", "#113=")))
    data = placed + ball(200, (0.0, 0.0, 0.0), 1.5)
    reading = read(text_of(data))
    assert reading.fiducials.labels == ("B1",)
    assert [body.reason for body in reading.bodies] == ["", "nothing says where in the assembly it is"]


SEATS = {"S1": (0.0, 40.0, -90.0), "S2": (-35.0, -20.0, -90.0), "S3": (35.0, -20.0, -90.0)}
PINS = {"P1": (-30.0, 0.0, -95.0), "P2": (30.0, 0.0, -95.0)}


def carrier() -> bytes:
    """Eight balls, and coordinate systems for three seats and two pins along z."""
    data, items = "", []
    for index in range(8):
        x, y, z = (40.0 if index & bit else -38.0 for bit in (1, 2, 4))
        data += ball(1000 + 10 * index, (x, y + index, z), 1.5, f"BEAD{index + 1}")
        items.append(1000 + 10 * index)
    for index, (name, origin) in enumerate({**SEATS, **PINS}.items()):
        data += placement(2000 + 10 * index, origin, (0, 0, 1), (1, 0, 0), name)
        items.append(2000 + 10 * index)
    return text_of(product(10, "carrier", items) + data)


def test_a_base_keeps_everything_but_the_fiducials() -> None:
    base = load_design(convert(carrier(), "a.step", "b.json").text.replace("{", _design_head(), 1))
    shifted = carrier().replace(b"-38.0", b"-39.0")
    made = convert(shifted, "a.step", "b.yaml", base=base, selection=StepSelection(seats="S*", pins="P*"))
    design = load_design(made.text)
    assert design.document.targets == base.document.targets
    assert min(x for x, _, _ in design.fiducials.positions_mm) == -39.0
    seat = design.document.interfaces.structure_connector
    assert [locator.name for locator in seat.locators or ()] == ["S1", "S2", "S3", "P1.u", "P1.v", "P2.v"]
    assert any("half-width 0.02 mm" in note for note in made.notes)
    again = convert(shifted, "a.step", "b.yaml", base=design, selection=StepSelection(seats="S*", pins="P*"))
    assert load_design(again.text).sha256 == design.sha256
    assert not any("half-width" in note for note in again.notes)


def _design_head() -> str:
    view = '"preset": "generic-mobile-c-arm", "fiducial_noise_px": 0.3, "target_noise_px": 0.3'
    return (
        '{"schema": "tailstack/design/1", "name": "carrier", "targets": [{"name": "tip", "position_mm": [0, 0, 90]}], '
        f'"views": [{{"name": "AP", "orientation": "AP", {view}}}, {{"name": "LAT", "orientation": "LAT", {view}}}],'
    )


FOLDER = Path(__file__).parents[1] / "data" / "step"
SCENES = runpy.run_path(str(FOLDER / "scenes.py"))
EXPECTED = {scene: SCENES["expect"](scene) for scene in SCENES["SCENES"]}
READINGS = json.loads((FOLDER / "readings.json").read_text(encoding="utf-8"))
MICROMETRE = 1e-3  # mm


with zipfile.ZipFile(FOLDER / "files.zip") as archive:
    FILES = {each: archive.read(each) for each in sorted(archive.namelist())}


def read_file(file: str, **more: Any) -> StepReading:
    return read_step(FILES[file], file, StepSelection(**{**expected(file)["selection"], **more}))


def expected(name: str) -> dict[str, Any]:
    return EXPECTED[name.partition("_")[2].removesuffix(".step")]


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
    reading, wanted = read_file(name), expected(name)["balls"]
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
    content = (FOLDER / "free_form.step").read_bytes()
    (problem,) = problems_of(read_step, content, "free_form.step", StepSelection(**asked), error=DesignError)
    assert ("2 (BEAD_1, BEAD_2) because its faces are free-form (NURBS) or revolved" in problem.detail) == told
    assert ("export analytic surfaces, not NURBS" in problem.hint) == told
    assert told or "1 (Plate) because it has no spherical face" in problem.detail


@pytest.mark.parametrize("name", FILES)
def test_another_reader_finds_the_same_balls(name: str) -> None:
    """independent: the kernel's own reader, by area and volume; in the file's own frame."""
    reading = read_file(name, frame=None, diameter_mm=3.0, tolerance_mm=1.5, name=None)
    others = [ball for ball in READINGS[name] if abs(ball["diameter_mm"] - 3.0) <= 1.5]
    match(reading.fiducials.positions_mm, [ball["position_mm"] for ball in others])


@pytest.mark.parametrize("name", [name for name in FILES if expected(name)["left"]])
def test_near_misses_are_left_and_the_reason_is_said(name: str) -> None:
    left = [body for body in read_file(name).bodies if body.reason]
    reasons = {(body.path.rpartition(" / ")[2], body.reason) for body in left}
    for own, words in expected(name)["left"]:
        assert any(called == own and words in reason for called, reason in reasons), own
    assert {called for called, _ in reasons} == {own for own, _ in expected(name)["left"]}


@pytest.mark.parametrize("name", [name for name in FILES if expected(name)["contacts"]])
def test_seats_and_pins_hold_where_they_were_drawn(name: str) -> None:
    wanted = {contact["name"]: contact for contact in expected(name)["contacts"]}
    contacts = {contact.name: contact for contact in read_file(name).contacts}
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
    found = json.loads(run_process(*program, env=None, check=True, timeout=3 * LIMIT_SECONDS).stdout)
    print(found["outcomes"], found["memory_bytes"])
    assert found["failures"] == []
    assert sum(found["outcomes"].values()) > 2000
    assert found["outcomes"]["read"] > 100
    assert found["memory_bytes"] < 300_000_000

"""Write STEP files (AP242) of plates with two holes and beads, and what their drawing says of them: by plain text.

Nothing of the reader has a part in it.  Instances are those that the CAx Implementor Forum's recommended practices for
PMI name; edges are lines and circles, without curves in parameters.  Run as a program with a folder, it writes the
files of examples/gallery.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

HEAD = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION(('a plate with PMI'),'2;1');
FILE_NAME('{name}','2026-11-29T00:00:00',(''),(''),'write_ap242.py of tailstack','','');
FILE_SCHEMA(('AP242_MANAGED_MODEL_BASED_3D_ENGINEERING_MIM_LF {{1 0 10303 442 1 1 4 }}'));
ENDSEC;
DATA;
"""
MM = {"mm": 1.0, "m": 1000.0, "in": 25.4}
SI = "( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(%s,.METRE.) )"
BEAD_RADIUS_MM = 1.5
NO_TEXT = "''"
X, Y, Z = np.eye(3)


@dataclass
class Hole:
    """A hole through the plate, mm."""

    at: tuple[float, float]
    diameter: float
    fit: str = ""  # such as H7
    limits: tuple[float, float] | None = None  # upper and lower deviation
    position: float | None = None  # diameter of the zone of its axis
    modifier: str = ""  # (M) or (L)


@dataclass
class Plate:
    """A block whose lower face is at z = 0 and the seat, mm."""

    size: tuple[float, float, float]
    holes: Sequence[Hole]
    form: str = "FLATNESS"
    zone: float = 0.02
    beads: Sequence[tuple[float, float, float]] = ()
    unit: str = "mm"
    pose: Any = field(default_factory=lambda: np.eye(4))  # (4, 4) of what is written


class Writer:
    """Instances, one a line, and the number of each."""

    def __init__(self, plate: Plate) -> None:
        self.lines: list[str] = []
        self.pose, self.scale = plate.pose, 1 / MM[plate.unit]

    def write(self, text: str) -> str:
        self.lines.append(f"#{len(self.lines) + 1}={text};")
        return f"#{len(self.lines)}"

    def add(self, keyword: str, *values: Any) -> str:
        """Lists are lists, truths are truths, numbers are lengths in mm."""
        return self.write(f"{keyword}({','.join(map(self.say, values))})")

    def say(self, value: Any) -> str:
        if isinstance(value, bool):
            return ".T." if value else ".F."
        if isinstance(value, int | float):
            return f"{value * self.scale:.12E}"
        return f"({','.join(map(self.say, value))})" if isinstance(value, list) else str(value)

    def point(self, place: Any) -> str:
        return self.add("CARTESIAN_POINT", NO_TEXT, (self.pose[:3, :3] @ np.array(place) + self.pose[:3, 3]).tolist())

    def direction(self, way: Any) -> str:
        turned = ",".join(f"{value:.15E}" for value in self.pose[:3, :3] @ np.array(way))
        return self.add("DIRECTION", NO_TEXT, f"({turned})")

    def vertex(self, place: Any) -> str:
        return self.add("VERTEX_POINT", NO_TEXT, self.point(place))

    def surface(self, keyword: str, place: Any, z: Any, x: Any, *radius: float) -> str:
        frame = self.add("AXIS2_PLACEMENT_3D", NO_TEXT, self.point(place), self.direction(z), self.direction(x))
        return self.add(keyword, NO_TEXT, frame, *radius)

    def edge(self, start: Any, end: Any, vertices: Sequence[str]) -> str:
        way = np.subtract(end, start) / np.linalg.norm(np.subtract(end, start))
        vector = self.add("VECTOR", NO_TEXT, self.direction(way), "1.")
        line = self.add("LINE", NO_TEXT, self.point(start), vector)
        return self.add("EDGE_CURVE", NO_TEXT, *vertices, line, True)

    def face(self, surface: str, *loops: Sequence[tuple[str, bool]], outward: bool = True) -> str:
        bounds = []
        for edges in loops:
            turned = [self.add("ORIENTED_EDGE", NO_TEXT, "*", "*", edge, way) for edge, way in edges]
            bounds.append(self.add("FACE_BOUND", NO_TEXT, self.add("EDGE_LOOP", NO_TEXT, turned), True))
        return self.add("ADVANCED_FACE", NO_TEXT, bounds, surface, outward)


def write_plate(plate: Plate, name: str = "plate") -> bytes:
    """The text of a file."""
    to = Writer(plate)
    faces, solid = _write_block(to, plate)
    solids = [solid]
    for k, bead in enumerate(plate.beads, 1):
        pole = to.add("VERTEX_LOOP", NO_TEXT, to.vertex(np.subtract(bead, (0, 0, BEAD_RADIUS_MM))))
        ball = to.surface("SPHERICAL_SURFACE", bead, Z, X, BEAD_RADIUS_MM)
        skin = to.add("ADVANCED_FACE", NO_TEXT, [to.add("FACE_BOUND", NO_TEXT, pole, True)], ball, True)
        solids.append(to.add("MANIFOLD_SOLID_BREP", f"'BEAD{k}'", to.add("CLOSED_SHELL", NO_TEXT, [skin])))
    length = to.write(SI % ("$" if plate.unit == "m" else ".MILLI."))
    if plate.unit == "in":
        exponents = to.write("DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.)")
        inch = to.write(f"LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),{length})")
        length = to.write(f"( CONVERSION_BASED_UNIT('INCH',{inch}) LENGTH_UNIT() NAMED_UNIT({exponents}) )")
    angle = to.write("( NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.) )")
    units = f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle}))"
    context = to.write(f"( GEOMETRIC_REPRESENTATION_CONTEXT(3) {units} REPRESENTATION_CONTEXT('','') )")
    application = to.add("APPLICATION_CONTEXT", "'managed model based 3d engineering'")
    kind = to.add("PRODUCT_CONTEXT", NO_TEXT, application, "'mechanical'")
    product = to.add("PRODUCT", f"'{name}'", f"'{name}'", NO_TEXT, [kind])
    form = to.add("PRODUCT_DEFINITION_FORMATION", NO_TEXT, NO_TEXT, product)
    view = to.add("PRODUCT_DEFINITION_CONTEXT", "'part definition'", application, "'design'")
    definition = to.add("PRODUCT_DEFINITION", "'design'", NO_TEXT, form, view)
    part = to.add("PRODUCT_DEFINITION_SHAPE", NO_TEXT, NO_TEXT, definition)
    shape = to.add("ADVANCED_BREP_SHAPE_REPRESENTATION", NO_TEXT, solids, context)
    to.add("SHAPE_DEFINITION_REPRESENTATION", part, shape)
    _write_pmi(to, plate, faces, (part, shape, length, context))
    return (HEAD.format(name=name) + "\n".join(to.lines) + "\nENDSEC;\nEND-ISO-10303-21;\n").encode()


def _write_block(to: Writer, plate: Plate) -> tuple[list[str], str]:
    """The face of the seat and those of the holes, and the solid."""
    a, b, c = plate.size
    around = [(-a / 2, -b / 2), (a / 2, -b / 2), (a / 2, b / 2), (-a / 2, b / 2)]
    corners = [np.array([x, y, z]) for z in (0, c) for x, y in around]
    vertices = [to.vertex(corner) for corner in corners]
    pairs = [(i + s, (i + 1) % 4 + s) for s in (0, 4) for i in range(4)] + [(i, i + 4) for i in range(4)]
    edges = [to.edge(corners[i], corners[j], (vertices[i], vertices[j])) for i, j in pairs]
    below, above, upright = edges[:4], edges[4:8], edges[8:]
    bores, rings = [], []
    for hole in plate.holes:
        x, y, r = *hole.at, hole.diameter / 2
        ends = [to.vertex((x + r, y, z)) for z in (0, c)]
        circles = [to.surface("CIRCLE", (x, y, z), Z, X, r) for z in (0, c)]
        low, high = (to.add("EDGE_CURVE", NO_TEXT, e, e, o, True) for e, o in zip(ends, circles, strict=True))
        seam = to.edge((x + r, y, 0), (x + r, y, c), ends)
        wall = to.surface("CYLINDRICAL_SURFACE", (x, y, 0), Z, X, r)
        bores.append(to.face(wall, [(low, True), (seam, True), (high, False), (seam, False)], outward=False))
        rings.append((low, high))
    bottom, lid = to.surface("PLANE", (0, 0, 0), -Z, X), to.surface("PLANE", (0, 0, c), Z, X)
    seat = to.face(bottom, [(each, False) for each in reversed(below)], *([(low, True)] for low, _ in rings))
    top = to.face(lid, [(each, True) for each in above], *([(high, False)] for _, high in rings))
    sides = []
    for i, out in enumerate((-Y, X, Y, -X)):
        loop = [(below[i], True), (upright[(i + 1) % 4], True), (above[i], False), (upright[i], False)]
        sides.append(to.face(to.surface("PLANE", corners[i], out, Z), loop))
    shell = to.add("CLOSED_SHELL", NO_TEXT, [seat, top, *sides, *bores])
    return [seat, *bores], to.add("MANIFOLD_SOLID_BREP", "'PLATE'", shell)


def _write_pmi(to: Writer, plate: Plate, faces: Sequence[str], of: tuple[str, str, str, str]) -> None:
    part, shape, length, context = of
    aspects = []
    for face in faces:
        aspects.append(to.add("SHAPE_ASPECT", NO_TEXT, NO_TEXT, part, True))
        to.add("GEOMETRIC_ITEM_SPECIFIC_USAGE", NO_TEXT, NO_TEXT, aspects[-1], shape, face)
    seat, *bores = aspects
    datum = to.add("DATUM", NO_TEXT, NO_TEXT, part, False, "'A'")
    to.add("SHAPE_ASPECT_RELATIONSHIP", NO_TEXT, NO_TEXT, seat, datum)

    def tolerance(form: str, zone: float, of: str, *, modifier: str = "", to_datum: bool = True) -> str:
        value = to.write(f"LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE({to.say(zone)}),{length})")
        parts = [f"GEOMETRIC_TOLERANCE('','',{value},{of})"]
        if to_datum:
            used = to.add("DATUM_REFERENCE_COMPARTMENT", NO_TEXT, NO_TEXT, part, False, datum, "$")
            system = to.add("DATUM_SYSTEM", NO_TEXT, NO_TEXT, part, False, [used])
            parts.append(f"GEOMETRIC_TOLERANCE_WITH_DATUM_REFERENCE(({system}))")
        if modifier:
            word = {"(M)": "MAXIMUM", "(L)": "LEAST"}[modifier]
            parts.append(f"GEOMETRIC_TOLERANCE_WITH_MODIFIERS((.{word}_MATERIAL_REQUIREMENT.))")
        return to.write(f"( {' '.join(parts)} {form}_TOLERANCE() )")

    tolerance(plate.form, plate.zone, seat, to_datum=plate.form != "FLATNESS")
    for hole, bore in zip(plate.holes, bores, strict=True):
        size = to.add("DIMENSIONAL_SIZE", bore, "'diameter'")
        measure = f"MEASURE_WITH_UNIT(POSITIVE_LENGTH_MEASURE({to.say(hole.diameter)}),{length})"
        value = to.write(f"( LENGTH_MEASURE_WITH_UNIT() MEASURE_REPRESENTATION_ITEM() {measure} "
                         "REPRESENTATION_ITEM('nominal value') )")  # fmt: skip
        items = to.add("SHAPE_DIMENSION_REPRESENTATION", NO_TEXT, [value], context)
        to.add("DIMENSIONAL_CHARACTERISTIC_REPRESENTATION", size, items)
        if hole.fit:
            letter = hole.fit.rstrip("0123456789")
            grade = hole.fit.removeprefix(letter)
            fit = to.add("LIMITS_AND_FITS", f"'{letter}'", "'hole'", f"'{grade}'", NO_TEXT)
            to.add("PLUS_MINUS_TOLERANCE", fit, size)
        if hole.limits is not None:
            ends = (f"MEASURE_WITH_UNIT(LENGTH_MEASURE({to.say(each)}),{length})" for each in reversed(hole.limits))
            to.add("PLUS_MINUS_TOLERANCE", to.add("TOLERANCE_VALUE", *map(to.write, ends)), size)
        if hole.position is not None:
            zone = tolerance("POSITION", hole.position, bore, modifier=hole.modifier)
            form = to.add("TOLERANCE_ZONE_FORM", "'cylindrical or circular'")
            to.add("TOLERANCE_ZONE", NO_TEXT, NO_TEXT, part, False, [zone], form)


def shift(z: float) -> Any:
    pose = np.eye(4)
    pose[2, 3] = z
    return pose


EXAMPLES = {
    "seat_from_cad_carrier.step": Plate(
        (80, 60, 12), [Hole((-30, 0), 6, "H7"), Hole((30, 0), 6, "H7", None, 0.02, "(M)")], pose=shift(-95)
    ),
    "seat_from_cad_connector.step": Plate(
        (60, 60, 20), [Hole((x, 0), 8, limits=(0.015, 0.0)) for x in (-22, 22)], "PARALLELISM", 0.03, pose=shift(-145)
    ),
}

if __name__ == "__main__":
    for name, plate in EXAMPLES.items():
        (Path(sys.argv[1]) / name).write_bytes(write_plate(plate, name.partition(".")[0]))

"""Calibration cages of XMALab: a frame specification (``.csv``) and its references (``.ref``).

The frame specification has one line that XMALab does not read, then a bead in each: x, y, z and, if it likes, a name,
with commas between.  It states no unit; XROMM laboratories use mm or cm.  A first line of at least four fields, the
first three like ``s10``, multiplies the axes.  The references name the beads that are marked with shapes of lead, four
of them or more, as the number of the bead (from 1), a space, and the name of the shape.
"""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass
from typing import Literal

from ..design.fiducial_files import FiducialList, FiducialTable, make_list, read_number, refuse
from ..design.reading import Limits, decode, show
from ..errors import DesignError, Problem
from ..people_tables import decode_people_text

CageUnit = Literal["mm", "cm"]
UNITS: dict[str, float] = {"mm": 1.0, "cm": 10.0}
REFERENCES = 4  # XMALab takes the pose of a cage from the first four
_NEEDED = f"XMALab takes the pose of a cage from {REFERENCES} references"


@dataclass(frozen=True, slots=True)
class CageForm:
    """That a ``.csv`` is, or becomes, a frame specification."""

    unit: CageUnit  # of its numbers, which the file does not state
    references: tuple[bytes, str] | None = None  # content and name of the .ref beside one that is read


_SCALE = re.compile(r"\s*s([0-9]+\.?[0-9]*)\s*")
_SHAPE = re.compile(r"[0-9A-Za-z ]{1,20}")


def read_cage(content: bytes, name: str, form: CageForm, limits: Limits) -> FiducialList:
    """The beads of a frame specification, whose coordinates are con's.

    A bead is called by its name in the frame specification, else by the shape that marks it, else F and its number.
    Raises DesignError with file and line, LimitError.
    """
    text, encoding = decode_people_text(content, name, DesignError)
    header, *body = text.splitlines() or [""]
    scales = _read_scales(header, name)
    beads = [_read_bead(line, name, number, scales) for number, line in enumerate(body, 2) if line.strip()]
    shapes = {} if form.references is None else read_references(*form.references, len(beads))
    rows = [(label or shapes.get(number, ""), xyz) for number, (label, xyz) in enumerate(beads, 1)]
    remarks = [f"it is no UTF-8 and was read as {encoding}: look at its names"] if encoding else []
    return make_list(FiducialTable(rows, form.unit, "LPS", remarks=remarks), content, name, limits)


def _read_scales(header: str, name: str) -> tuple[float, float, float]:
    """What the first line multiplies the axes by."""
    cells = header.split(",")
    words = re.split(r"[,;\t ]+", header.strip())
    if all(re.fullmatch(r"\s*[-+]?[0-9.]+([eE][-+]?[0-9]+)?\s*", word) for word in words):
        detail = f"XMALab does not read the first line, and here it is a bead: {show(header)}"
        raise refuse(name, 1, "cage-header", detail, "put a line like x,y,z above it")
    matches = [_SCALE.fullmatch(cell) for cell in cells[:3]]
    if len(cells) == 3 and all(matches):
        detail = f"XMALab multiplies only when a fourth field follows; got {show(header)}"
        raise refuse(name, 1, "cage-header", detail, f"write {header.strip()},black to multiply, or x,y,z not to")
    if len(cells) < 4 or not all(matches):
        return 1.0, 1.0, 1.0
    x, y, z = (float(scale[1]) for scale in matches if scale)
    return x, y, z


def _read_bead(line: str, name: str, number: int, scales: tuple[float, float, float]) -> tuple[str, list[float]]:
    cells = line.split(",")  # as XMALab does, in quotes too
    if len(cells) not in (3, 4) or any(re.search(r"\S[;\s]+\S", cell) for cell in cells[:3]):
        detail = f"a bead is x,y,z, or x,y,z,name, with commas between; got {show(line)}"
        hint = "save it with commas between the cells, not semicolons, tabs or spaces, and with points in the decimals"
        raise refuse(name, number, "cage-row", detail, hint)
    xyz = [read_number(cell, name, number, axis) for axis, cell in zip("xyz", cells, strict=False)]
    label = cells[3].strip() if len(cells) == 4 else ""
    return label, [scale * value for scale, value in zip(scales, xyz, strict=True)]


def read_references(content: bytes, name: str, beads: int) -> dict[int, str]:
    """Shapes of lead by the number of the bead that they mark.  Raises DesignError."""
    shapes: dict[int, str] = {}
    for number, line in enumerate(decode(content, name).removeprefix("\ufeff").splitlines(), 1):
        if not line.strip():
            continue
        match = re.fullmatch(r"\s*([0-9]+)[ \t]+(.*\S)\s*", line)
        if match is None or not _SHAPE.fullmatch(match[2]):
            detail = f"a reference is the number of a bead, a space, and a name of at most 20 letters; got {show(line)}"
            hint = "write it like: 1 circle. XMALab passes over a line with a comma, and crashes when it calibrates"
            raise refuse(name, number, "reference-row", detail, hint)
        bead = int(match[1])
        if not 1 <= bead <= beads or bead in shapes:
            problem = "is marked twice" if bead in shapes else f"is none of the {beads} in the frame specification"
            raise refuse(name, number, "reference-row", f"bead {bead} {problem}", "the first bead has number 1")
        shapes[bead] = match[2]
    if len(shapes) < REFERENCES:
        detail = f"{_NEEDED}; {name} has {len(shapes)}"
        raise refuse(name, None, "too-few-references", detail, "mark beads that are not all in one plane")
    return shapes


def write_cage(fiducials: FiducialList, unit: CageUnit) -> str:
    """A frame specification.  Its first line states the unit, for people and for tailstack; XMALab passes over it."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow([f"x_{unit}", f"y_{unit}", f"z_{unit}", "label"])
    for label, position in zip(fiducials.labels, fiducials.positions_mm, strict=True):
        if "," in label or '"' in label:
            detail = f"XMALab splits at every comma, also in quotes; got the label {show(label)}"
            raise DesignError(Problem("", "bad-label", detail, "rename the bead"))
        writer.writerow([*(repr(value / UNITS[unit]) for value in position), label])
    return stream.getvalue()


def write_references(fiducials: FiducialList, marked: tuple[str, ...], name: str) -> str:
    """The references of a cage: labels of the beads that are marked with shapes, the first four for the pose."""
    if len(marked) < REFERENCES or len(set(marked)) < len(marked):
        detail = f"{_NEEDED}, each another bead; got {', '.join(marked)}"
        raise DesignError(Problem("", "too-few-references", detail, "name four beads that are not all in one plane"))
    lines = []
    for label in marked:
        if label not in fiducials.labels:
            detail = f"no bead is called {label!r}"
            raise DesignError(Problem("", "unknown-label", detail, "labels are as in the design"))
        if not _SHAPE.fullmatch(label):
            detail = f"{name} takes names of at most 20 letters, digits and spaces; got {label!r}"
            raise DesignError(Problem("", "bad-label", detail, "rename the bead"))
        lines.append(f"{fiducials.labels.index(label) + 1} {label}\n")
    return "".join(lines)

"""The seat that a STEP file states (AP242): its flat face and its two dowel holes, as features of an interface."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np

from ...design.iso286 import find_deviations
from ...errors import Problem, StepError
from ...geometry.arrays import Array
from .reading import open_assembly, turn_positive
from .tolerances import LIKE, StepFace, StepTolerance, read_tolerances

ALIKE = 1e-3  # sine of an angle between directions, and mm between axes, that are the same
REMARK, MOST_REMARKS = 380, 10  # characters of a remark, and such about what was left


class StepSeat(NamedTuple):
    """What a file says of a seat."""

    pivot_mm: list[float]  # (3,) the middle of its face, con
    features: list[dict[str, Any]]  # as ``interfaces.*.features`` has them
    remarks: list[str]  # sentences: every value that was read, and what was left


def read_drawn_seat(content: bytes, name: str, pin_class: str, frame: str | None = None) -> StepSeat:
    """The seat of a file whose pins have a class of ISO 286 such as ``g6``; ``frame`` as for ``StepSelection``.

    Raises StepError where the file does not say which face and which holes are meant or contradicts itself; LimitError.
    """
    tolerances, doubts = read_tolerances(*open_assembly(content, name, frame))
    seat = find_seat(tolerances, pin_class, name)
    return seat._replace(remarks=[*seat.remarks, *(each.removeprefix(f"{name}: ") for each in doubts)])


def find_seat(tolerances: Sequence[StepTolerance], pin_class: str, name: str) -> StepSeat:
    """The only face with a flatness or parallelism, and two pins in the toleranced holes along its normal.

    The hole that comes first along the line through both (in the con axis that runs most along it) holds both ways, the
    other one only across that line, as a slot does.  Raises StepError.
    """
    flats = [each for each in tolerances if each.kind in ("flatness", "parallelism") and each.value is not None]
    faces = {face.number: (face, each) for each in flats for face in each.faces if face.surface == "plane"}
    if len(faces) != 1:
        listed = "; ".join(f"{flat.text} at {_list(face.point_mm)}" for face, flat in faces.values())
        detail = f"one plane face with a flatness or parallelism is the seat; {name} has {len(faces)}"
        cure = "export that tolerance of the seat's face as AP242 PMI"
        if faces:
            detail, cure = f"{detail}: {listed:.300}", "one file for each seat with its tolerances, or its features"
        raise StepError(Problem("", "no-seat", detail, cure, name))
    ((face, flat),) = faces.values()
    holes = _list_holes(tolerances, face)
    if len(holes) != 2:
        listed = f": {', '.join(size.text for _, size in holes)}" if holes else ""
        detail = "two holes along the normal of that face, their diameters with a fit or deviations, hold the seat; "
        cure = "export the tolerances of the diameters of the two dowel holes, and of no others, as AP242 PMI"
        raise StepError(Problem("", "no-seat", f"{detail}{name} has {len(holes)}{listed}", cure, name))
    for hole, size in holes:
        if abs(2 * hole.radius_mm / (size.value or 1.0) - 1) > LIKE:
            detail = f"{size.text} is of a hole of {2 * hole.radius_mm:g} mm in {name}"
            cure = "check the units that its writer gave the tolerances"
            raise StepError(Problem("", "wrong-size", detail, cure, name))
    up, away = face.axis, holes[1][0].point_mm - holes[0][0].point_mm
    line = turn_positive(away - up * (up @ away))
    pad = {"name": "face", "kind": "pad", "position_mm": _list(face.point_mm), "normal": _list(up)}
    pad |= {"along": _list(turn_positive(face.along)), "size_mm": _list(np.array(face.extents_mm))}
    features: list[dict[str, Any]] = [pad | {f"{flat.kind}_mm": flat.value}]
    used = [flat]
    for hole, size in sorted(holes, key=lambda item: float(item[0].point_mm @ line)):
        place, number = hole.point_mm - up * (up @ (hole.point_mm - face.point_mm)), len(features)
        own: dict[str, Any] = {"name": f"pin {number}", "kind": ("", "pin_in_hole", "pin_in_slot")[number]}
        own |= {"position_mm": _list(place), "normal": _list(up), "along": _list(line), "diameter_mm": size.value}
        try:
            pin = find_deviations(pin_class, size.value or 0.0)
        except ValueError as error:
            raise StepError(Problem("", "unknown-fit", str(error), "name a class of it for the pins", name)) from None
        limits = {"hole_mm": [size.upper, size.lower], "pin_mm": [*pin]}
        own |= {"fit": f"{size.fit}/{pin_class}"} if size.fit else limits
        position = next((each for each in tolerances if _is_position(each, hole)), None)
        if position is not None:
            own |= {"true_position_mm": position.value, "at_maximum_material": bool(position.modifiers)}
        features.append(own)
        used += [size] if position is None else [size, position]
    left = "; ".join(each.text for each in tolerances if not any(each is other for other in used))
    said = [f"the seat is {'; '.join(each.text for each in used)}; pins {pin_class}"]
    said += [f"not in the seat: {part}" for part in wrap(left, REMARK)[:MOST_REMARKS]]
    if shifting := sorted({datum for each in used for datum in each.datums if "(" in datum}):
        said.append(f"a shift of the datum {', '.join(shifting)} is not counted")
    return StepSeat(_list(face.point_mm), features, said)


def _list_holes(tolerances: Sequence[StepTolerance], seat: StepFace) -> list[tuple[StepFace, StepTolerance]]:
    """A face of each hole along the normal of the seat, and the size of it."""
    found: list[tuple[StepFace, StepTolerance]] = []
    for each in tolerances:
        if each.kind == "diameter" and each.value is not None and (each.fit or each.upper is not None):
            for face in each.faces:
                parallel = face.surface == "cylinder" and np.linalg.norm(np.cross(face.axis, seat.axis)) < ALIKE
                if parallel and not any(_share_axis(face, other) for other, _ in found):
                    found.append((face, each))
    return found


def _share_axis(face: StepFace, other: StepFace) -> bool:
    away = face.point_mm - other.point_mm
    return float(np.linalg.norm(away - other.axis * (other.axis @ away))) < ALIKE


def _is_position(each: StepTolerance, hole: StepFace) -> bool:
    """Whether it is the zone of the axis of a hole, as it is or at maximum material."""
    counted = each.kind == "position" and each.across and each.value is not None and {*each.modifiers} <= {"(M)"}
    return counted and any(face.surface == "cylinder" and _share_axis(face, hole) for face in each.faces)


def _list(vector: Array) -> list[float]:
    return [round(float(value), 9) + 0.0 for value in vector]

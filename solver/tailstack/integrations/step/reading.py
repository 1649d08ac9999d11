"""Balls in a STEP file (AP203, AP214, AP242): where each is in the assembly, how large it is, and what is none.

A ball is a solid whose only shell has spherical faces about one centre, with one radius, that cover the sphere: every
edge is used once in each direction.  A circle that is turned about its diameter is a sphere, too.  Everything else with
a spherical face is left, and the reason is said.  Placements of instances (NEXT_ASSEMBLY_USAGE_OCCURRENCE, MAPPED_ITEM)
and units are those of the file; nothing is assumed where the file says nothing.
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from ...cures import ask_label
from ...design.document import FiducialOrigin
from ...design.fiducial_files import FiducialList
from ...design.reading import DEFAULT_LIMITS, Limits
from ...errors import LimitError, Problem, StepError
from ...geometry.arrays import Array
from .assembly import SOLIDS, WANTED, Assembly
from .part21 import Part21, decode_text
from .shapes import invert
from .tolerances import WANTED_TOLERANCES, StepTolerance, read_tolerances

TOLERANCE_MM = 0.01  # about a diameter that is asked for without one
FREE_FORM = "its faces are free-form (NURBS) or revolved surfaces, of which no sphere is known"
MOST_LISTED = 500  # bodies that were left
SAME_PLACE_MM = 1e-3

_SCHEMAS = ("CONFIG_CONTROL", "AUTOMOTIVE_DESIGN", "AP203", "AP214", "AP242")


@dataclass(frozen=True, slots=True)
class StepSelection:
    """What of a STEP file is wanted.  Patterns are those of a shell: ``*`` is any text, ``?`` any character."""

    diameter_mm: float | None = None  # of a ball; None: all balls, if they have one diameter
    tolerance_mm: float = TOLERANCE_MM  # how far a diameter may be from that
    name: str | None = None  # pattern of the name of a ball: its own, or that of its part or instance
    frame: str | None = None  # name of the coordinate system or part whose frame becomes con
    seats: str | None = None  # pattern of names of cylinders and coordinate systems: contacts along their axis
    pins: str | None = None  # pattern of names of cylinders and coordinate systems: contacts across their axis
    pin_class: str | None = None  # ISO 286 class of the pins of a seat that the tolerances state; balls may lack then


@dataclass(frozen=True, slots=True)
class StepBody:
    """A body with a spherical face, or with the name of a ball that is asked for."""

    label: str  # of the fiducial that it became; if it was left, its name, which may be empty
    path: str  # names of assembly, instances and body
    position_mm: tuple[float, float, float] | None  # centre of the sphere, con; None: it has none, or no place
    diameter_mm: float | None  # of the sphere; None: it has none, or no place
    reason: str  # why it was left; empty: it was taken


@dataclass(frozen=True, slots=True)
class StepContact:
    """A point contact of a seat or pin."""

    name: str  # of the locator that it becomes
    position_mm: tuple[float, float, float]  # con
    normal: tuple[float, float, float]  # con


@dataclass(frozen=True, slots=True)
class StepReading:
    """What was read of a STEP file."""

    fiducials: FiducialList  # in con, and which file they are from
    bodies: tuple[StepBody, ...]  # first those that were taken
    contacts: tuple[StepContact, ...]  # six, or none
    notes: tuple[str, ...]  # sentences: what was done to the numbers, and what stands twice
    tolerances: tuple[StepTolerance, ...] = ()  # con; tolerances and dimensions that the file states as such


def read_step(
    content: bytes, name: str, selection: StepSelection | None = None, limits: Limits = DEFAULT_LIMITS
) -> StepReading:
    """The balls of a STEP file as fiducials, and what was left.

    Raises StepError with the line for a file that contradicts itself or leaves out what is needed, and when nothing
    or more than one thing can be meant by the selection; LimitError.
    """
    selection = selection or StepSelection()
    assembly, to_con = open_assembly(content, name, selection.frame)
    file = assembly.file
    candidates = [*_find_bodies(assembly, selection, to_con)]
    if selection.diameter_mm is None:
        _refuse_several_diameters(candidates, name)
    taken, notes = _drop_repeated([body for body in candidates if not body.reason], name)
    if encoding := file.describe_encoding():
        notes.append(f"{name}: {encoding}")
    left = [body for body in candidates if body.reason]
    if not taken and selection.pin_class is None:
        raise _nothing_found(left, selection, name, encoding)
    if len(taken) > limits.fiducials:
        detail = f"{name} holds {len(taken)} such balls; a design has at most {limits.fiducials} fiducials"
        raise LimitError(Problem("", "too-many", detail, "name them, or state their diameter", name))
    if len(left) > MOST_LISTED:
        notes.append(f"{name}: {len(left) - MOST_LISTED} more bodies were left than are listed")
    labels = _label([body.label for body in taken])
    bodies = [replace(body, label=label) for label, body in zip(labels, taken, strict=True)] + left[:MOST_LISTED]
    unit, factor = assembly.unit
    stated: dict[str, Any] = {"coordinate_unit": unit} if unit not in ("mm", "") else {}
    if not unit:
        notes.append(f"{name}: coordinates were converted to mm (factor {factor:g})")
    digest = hashlib.sha256(content).hexdigest()
    origin = FiducialOrigin(file=name[-400:], sha256=digest, coordinate_system="LPS", **stated)
    positions = tuple(body.position_mm for body in taken if body.position_mm is not None)
    fiducials = FiducialList(tuple(labels), positions, origin)
    tolerances, doubts = read_tolerances(assembly, to_con)
    contacts = _contacts(assembly, selection, to_con)
    return StepReading(fiducials, tuple(bodies), contacts, (*fiducials.notes, *notes, *doubts), tolerances)


def open_assembly(content: bytes, name: str, frame: str | None) -> tuple[Assembly, Array]:
    """The assembly of a STEP file, and the matrix (4, 4) from its own frame, mm, to the one that is asked for.

    Raises StepError, LimitError.
    """
    file = Part21(content, name, (*WANTED, *WANTED_TOLERANCES))
    if not any(schema.strip().upper().startswith(_SCHEMAS) for schema in file.schemas):
        schema = ", ".join(file.schemas)[:80] or "no schema"
        detail = f"AP203, AP214 and AP242 are read; {name} states {schema}"
        raise StepError(Problem("", "unknown-format", detail, "export it as STEP AP214 or AP242", name))
    assembly = Assembly(file)
    return assembly, _find_frame(assembly, frame)


# --- what is asked for ------------------------------------------------------------------------------------


def _find_bodies(assembly: Assembly, selection: StepSelection, to_con: Array) -> Iterator[StepBody]:
    """Every ball and near miss: taken without a reason, or left with one."""
    for body in assembly.bodies:
        named = selection.name is None or any(fnmatchcase(each, selection.name) for each in body.names)
        label = body.names[0] if body.names else ""
        spheres = assembly.spheres(body.number)
        for sphere in spheres:
            matrix = to_con @ body.matrix
            scale = float(np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))
            diameter = 2 * sphere.radius * scale
            reason = sphere.reason
            if not reason and not named:
                reason = f"no name of it matches {selection.name}"
            if not reason and selection.diameter_mm is not None:
                away = abs(diameter - selection.diameter_mm) - selection.tolerance_mm
                if away > 1e-9 * diameter:
                    reason = f"its diameter is not {selection.diameter_mm:g} ± {selection.tolerance_mm:g} mm"
            yield StepBody(label, body.path, _point(matrix, sphere.centre), diameter, reason)
        if not spheres and named:
            if assembly.is_free_form(body.number):
                yield StepBody(label, body.path, None, None, FREE_FORM)
            elif selection.name is not None:
                yield StepBody(label, body.path, None, None, "it has no spherical face")
    reached = {body.number for body in assembly.bodies}
    for keyword in SOLIDS:
        for number in assembly.file.list_numbers(keyword):
            if number not in reached and (spheres := assembly.spheres(number)):
                path = decode_text(assembly.file.read(number).parts[keyword][0]) or f"#{number}"
                yield StepBody("", path, None, None, "nothing says where in the assembly it is")


def _refuse_several_diameters(bodies: Sequence[StepBody], name: str) -> None:
    counts = _count_diameters([body for body in bodies if not body.reason])
    if len(counts) > 1:
        detail = f"{name} holds balls of several diameters: {_list_diameters(counts)}"
        hint = f"say which are fiducials: --sphere-diameter {next(iter(counts)):g} (sphere_diameter_mm), or their name"
        raise StepError(Problem("", "several-diameters", detail, hint, name))


def _count_diameters(bodies: Sequence[StepBody]) -> Counter[float]:
    return Counter(round(body.diameter_mm or 0.0, 3) for body in bodies)


def _list_diameters(counts: Counter[float]) -> str:
    listed = [f"{count} of {diameter:g} mm" for diameter, count in counts.most_common(6)]
    return ", ".join(listed) + (", ..." if len(counts) > 6 else "")


def _nothing_found(left: Sequence[StepBody], selection: StepSelection, name: str, encoding: str) -> StepError:
    asked = [] if selection.name is None else [f"with a name that matches {selection.name}"]
    if selection.diameter_mm is not None:
        asked.append(f"of diameter {selection.diameter_mm:g} ± {selection.tolerance_mm:g} mm")
    detail = f"{name} holds no ball {' '.join(asked)}".rstrip()
    near = Counter(body.reason for body in left).most_common(4)
    if near:
        detail += "; left: " + "; ".join(f"{_list_names(left, reason)} because {reason}" for reason, _ in near)
    whole = [body for body in left if body.diameter_mm is not None and body.reason.startswith(("its dia", "no name"))]
    hint = "a fiducial is a solid ball: a body or part of its own"
    if any(body.reason == FREE_FORM for body in left):
        hint += "; export analytic surfaces, not NURBS"
    if whole:
        hint = f"its balls: {_list_diameters(_count_diameters(whole))}"
        hint += "; called " + ", ".join(sorted({body.label or "(no name)" for body in whole})[:6])
    if encoding:
        hint += "; " + encoding
    return StepError(Problem("", "no-ball", detail, hint, name))


def _list_names(left: Sequence[StepBody], reason: str) -> str:
    """How many bodies were left for a reason, and what the first of them are called."""
    names = [body.label or body.path or "(no name)" for body in left if body.reason == reason]
    return f"{len(names)} ({', '.join(names[:6])}{', ...' if len(names) > 6 else ''})"


def _drop_repeated(taken: list[StepBody], name: str) -> tuple[list[StepBody], list[str]]:
    """Without balls that the file gives twice at one place."""
    once: list[StepBody] = []
    notes: list[str] = []
    cells: dict[tuple[int, ...], list[StepBody]] = defaultdict(list)
    for body in taken:
        position = np.array(body.position_mm)
        cell = np.floor(position / (2 * SAME_PLACE_MM)).astype(int)
        near = [other for shift in np.ndindex(3, 3, 3) for other in cells.get(tuple(cell + np.array(shift) - 1), ())]
        if any(np.linalg.norm(position - np.array(other.position_mm)) < SAME_PLACE_MM for other in near):
            notes.append(f"{name}: {body.path} stands twice at one place; it was taken once")
            continue
        cells[tuple(cell)].append(body)
        once.append(body)
    return once, notes[:20]


def _label(names: Sequence[str]) -> list[str]:
    """A label for each of what has these names: its own, numbered where several have it; F1, F2, ... without one."""
    counts = Counter(names)
    used = {label for label, count in counts.items() if count == 1}
    numbers: Counter[str] = Counter()
    labels = []
    for name in names:
        label = name
        while not label or (label not in used if counts[label] == 1 else label == name or label in used):
            numbers[name] += 1
            label = f"{name}.{numbers[name]}" if name else f"F{numbers['']}"
        labels.append(label)
    return labels


def _point(matrix: Array, position: Array) -> tuple[float, float, float]:
    x, y, z = (float(value) + 0.0 for value in matrix[:3, :3] @ position + matrix[:3, 3])
    return x, y, z


def _find_frame(assembly: Assembly, name: str | None) -> Array:
    """The matrix from the file's own frame to con."""
    if name is None:
        return np.eye(4)
    frames = [frame for each, frame in assembly.frames if each == name]
    if not frames:
        known = sorted({each for each, _ in assembly.frames})
        hint = ask_label(name, known, "there is " + ", ".join(known[:8]) if known else "leave --frame out")
        detail = f"{assembly.file.name} holds no coordinate system, part or instance called {name[:80]!r}"
        raise StepError(Problem("", "no-frame", detail, hint, assembly.file.name))
    if any(np.abs(other - frames[0]).max() > 1e-6 for other in frames[1:]):
        detail = f"{len(frames)} coordinate systems, parts or instances are called {name[:80]!r}, at different places"
        raise StepError(Problem("", "several-frames", detail, "give one of them a name of its own", assembly.file.name))
    if np.abs(frames[0][:3, :3].T @ frames[0][:3, :3] - np.eye(3)).max() > 1e-6 or np.linalg.det(frames[0]) < 0:
        detail = f"{name[:80]!r} is placed mirrored or scaled, so that it is no frame"
        raise StepError(Problem("", "mirrored-frame", detail, "name another one", assembly.file.name))
    return invert(frames[0])


# --- seats and pins ---------------------------------------------------------------------------------------


def _contacts(assembly: Assembly, selection: StepSelection, to_con: Array) -> tuple[StepContact, ...]:
    """Six point contacts.  Where along its normal a contact lies changes nothing, so a seat is its axis.

    A pin holds across its axis, in the middle of its length: the first both ways, every other only across the line to
    the first, as a diamond pin or a slot does.  Raises StepError unless they are six.
    """
    if selection.seats is None and selection.pins is None:
        return ()
    name = assembly.file.name
    seats, pins = (_find_axes(assembly, pattern, to_con) for pattern in (selection.seats, selection.pins))
    contacts = [StepContact(label, _tuple(point), _tuple(axis)) for label, point, axis in seats]
    for index, (label, point, axis) in enumerate(pins):
        other = pins[1 - min(index, 1)][1] - point if len(pins) > 1 else np.eye(3)[np.argmin(np.abs(axis))]
        other = other - axis * (axis @ other)
        if np.linalg.norm(other) < 1e-6:
            detail = f"pins {pins[0][0]} and {label} lie on one line along their axis"
            raise StepError(Problem("", "pins-on-a-line", detail, "name two pins that are apart", name))
        along = other / np.linalg.norm(other)
        if index == 0:
            contacts.append(StepContact(f"{label}.u"[-80:], _tuple(point), _tuple(turn_positive(along))))
        contacts.append(StepContact(f"{label}.v"[-80:], _tuple(point), _tuple(turn_positive(np.cross(axis, along)))))
    if len(contacts) != 6:
        pieces = f"{len(seats)} seats and {len(pins)} pins ({', '.join(each[0] for each in [*seats, *pins][:9])})"
        detail = f"{pieces} make {len(contacts)} contacts; a part is located by six"
        hint = "three seats and two pins do, or six seats: --seats and --pins are patterns of their names"
        raise StepError(Problem("", "not-six-contacts", detail, hint, name))
    return tuple(contacts)


def _tuple(vector: Array) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 12) + 0.0 for value in vector)
    return x, y, z


def _find_axes(assembly: Assembly, pattern: str | None, to_con: Array) -> list[tuple[str, Array, Array]]:
    """Label, point and direction of the named cylinders and coordinate systems, in the order of their labels."""
    if pattern is None:
        return []
    axes = []
    for body in assembly.bodies:
        if not any(fnmatchcase(each, pattern) for each in body.names):
            continue
        axis = assembly.axis(body.number)
        if axis is None:
            detail = f"{body.path} is called like a seat or pin, but has no cylindrical faces about one axis"
            hint = f"name a coordinate system whose z is its axis {pattern!r} instead, or narrow the pattern"
            raise assembly.file.refuse(body.number, "no-axis", detail, hint)
        matrix = to_con @ body.matrix
        axes.append((body.names[0], matrix[:3, :3] @ axis[0] + matrix[:3, 3], turn_positive(matrix[:3, :3] @ axis[1])))
    taken = {label for label, _, _ in axes}
    for label, frame in assembly.frames:
        if fnmatchcase(label, pattern) and label not in taken:  # of a part, its body comes first
            matrix = to_con @ frame
            axes.append((label, matrix[:3, 3], turn_positive(matrix[:3, 2])))
    labels = _label([label for label, _, _ in axes])
    named = [(label, point, axis) for label, (_, point, axis) in zip(labels, axes, strict=True)]
    return sorted(named, key=lambda each: [part.zfill(9) for part in re.split(r"(\d+)", each[0])])


def turn_positive(axis: Array) -> Array:
    """An axis as a unit vector whose largest component is positive: which way it points means nothing here."""
    size = float(np.linalg.norm(axis))
    unit = axis / size if size > 0 else axis
    return unit if axis[np.argmax(np.abs(axis))] >= 0 else -unit

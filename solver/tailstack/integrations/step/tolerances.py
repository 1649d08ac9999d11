"""Tolerances, dimensions and datums of a STEP file (AP242: semantic PMI), each with the faces that it is of.

Instances as in ISO 10303-47 and -242; which entity says what is written down in the CAx Implementor Forum's recommended
practices for the representation and presentation of PMI.  What is drawn only (text on an annotation plane) says
nothing here.  An instance that cannot be read is named with the reason, and the others are read.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import degrees
from typing import Any, Literal

import numpy as np

from ...errors import DesignError
from ...geometry.arrays import Array
from .assembly import Assembly
from .part21 import Instance, Part21, Reference, Typed, decode_text
from .shapes import reference_of

Unit = Literal["mm", "deg"]
FORMS = (
    "FLATNESS", "STRAIGHTNESS", "ROUNDNESS", "CYLINDRICITY", "LINE_PROFILE", "SURFACE_PROFILE", "ANGULARITY",
    "PERPENDICULARITY", "PARALLELISM", "POSITION", "CONCENTRICITY", "COAXIALITY", "SYMMETRY", "CIRCULAR_RUNOUT",
    "TOTAL_RUNOUT",
)  # fmt: skip
_TOLERANCES = tuple(f"{form}_TOLERANCE" for form in FORMS)
_SIZES = ("DIMENSIONAL_SIZE", "ANGULAR_SIZE")  # of one feature; the others are between two
_DIMENSIONS = (*_SIZES, "DIMENSIONAL_LOCATION", "ANGULAR_LOCATION")
_USAGES = ("GEOMETRIC_ITEM_SPECIFIC_USAGE", "ITEM_IDENTIFIED_REPRESENTATION_USAGE")
_RANGES = ("PLUS_MINUS_TOLERANCE", "DIMENSIONAL_CHARACTERISTIC_REPRESENTATION", "TOLERANCE_ZONE")
WANTED_TOLERANCES = ("GEOMETRIC_TOLERANCE", *_TOLERANCES, *_DIMENSIONS, *_USAGES, *_RANGES, "SHAPE_ASPECT_RELATIONSHIP")
_MODIFIERS = {"MAXIMUM_MATERIAL_REQUIREMENT": "(M)", "LEAST_MATERIAL_REQUIREMENT": "(L)"}
MOST_FACES = 200  # of one tolerance
MOST_DATUMS = 20  # that are one together
MOST_LEVELS = 4  # of datums that are made of others
MOST_SAID = 20  # sentences of a kind
LIKE = 0.01  # relative: a fraction of an inch is written with three decimals


@dataclass(frozen=True, slots=True, eq=False)
class StepFace:
    """A face that a tolerance is of, con."""

    number: int  # of its instance
    surface: str  # "plane", "cylinder", or the keyword of another surface
    point_mm: Array  # (3,) the middle of its vertices: of a plane in it, of a cylinder on its axis
    axis: Array  # (3,) unit: the normal, or the axis; zeros of another surface
    radius_mm: float  # of a cylinder, else 0
    extents_mm: tuple[float, float]  # of a plane's face, the longer side first; of a cylinder its length and 0
    along: Array  # (3,) unit: which way the longer side goes

    @property
    def place(self) -> tuple[float, float, float]:
        """``point_mm``, for a record."""
        x, y, z = (float(value) + 0.0 for value in self.point_mm)
        return x, y, z


@dataclass(frozen=True, slots=True, eq=False)
class StepTolerance:
    """One tolerance or dimension, as the drawing has it."""

    number: int  # of its instance
    name: str  # that somebody gave it; may be empty
    kind: str  # "flatness", "position", "diameter", "linear distance", ...
    unit: Unit
    value: float | None  # of a tolerance its zone, of a dimension its nominal value
    lower: float | None = None  # of a dimension, beside the nominal value
    upper: float | None = None
    fit: str = ""  # ISO 286 class of a dimension, such as H7
    across: bool = False  # whether the zone is a cylinder or a sphere, so that the value is a diameter
    modifiers: tuple[str, ...] = ()
    datums: tuple[str, ...] = ()  # letters in their order
    faces: tuple[StepFace, ...] = ()

    @property
    def text(self) -> str:
        """As on a drawing: ``position Ø0.75 (M) | A | B | C``, ``diameter 35 +0.2 -0.1``, ``diameter 6 H7``."""
        value = "" if self.value is None else f"{'Ø' if self.across else ''}{self.value:g}"
        value += "°" if self.unit == "deg" and value else ""
        range_ = "" if self.lower is None or self.upper is None else f"{self.upper:+g} {self.lower:+g}"
        first = " ".join(part for part in (self.kind, value, self.fit, range_, *self.modifiers) if part)
        return " | ".join((first, *self.datums))


def read_tolerances(assembly: Assembly, to_con: Array) -> tuple[tuple[StepTolerance, ...], tuple[str, ...]]:
    """What the file tolerates and dimensions, in the order of the file, and what could not be read, in sentences.

    to_con (4, 4): from the file's own frame, mm, to that of the answer.

    Raises LimitError for a file that asks for too much.
    """
    file = assembly.file
    keywords = ("GEOMETRIC_TOLERANCE", *_TOLERANCES, *_DIMENSIONS)
    numbers = sorted({number for keyword in keywords for number in file.list_numbers(keyword)})
    if not numbers:
        return (), ()
    reader = _Reader(assembly, to_con)
    found: list[StepTolerance] = []
    left: list[str] = []
    for number in numbers:
        try:
            found.append(reader.read(number))
        except DesignError as error:
            words = file.keyword_of(Reference(number), None) or "a tolerance"
            left.append(f"{file.name}: #{number} {words} was not read: {error.problems[0].detail}")
    return tuple(found), (*left[:MOST_SAID], *_doubt_sizes(found, file.name)[:MOST_SAID], *_doubt_fits(found, file))


def _doubt_sizes(found: Sequence[StepTolerance], name: str) -> list[str]:
    """Diameters and radii that contradict the faces they are of: some writers state inches as mm, or mm as inches."""
    said = []
    for each in found:
        own = [face.radius_mm for face in each.faces if face.surface == "cylinder"]
        times = {"diameter": 2.0, "radius": 1.0}.get(each.kind, 0.0)
        if own and times and each.value is not None and abs(times * own[0] - each.value) > LIKE * abs(each.value):
            stated = f"{name}: #{each.number} says {each.kind} {each.value:g} mm"
            said.append(f"{stated}, its face has {times * own[0]:g} mm: check units and tolerances")
    return said


def _doubt_fits(found: Sequence[StepTolerance], file: Part21) -> Iterator[str]:
    """Open CASCADE 8.0 writes IT7 as 9 (measured on files of its own): grades from there are named."""
    if file.is_by("Open CASCADE") and (fits := sorted({each.fit for each in found if each.fit})):
        doubt = "Open CASCADE wrote it, some versions of which put grades two too high"
        yield f"{file.name}: {doubt}: check {', '.join(fits)}"


class _Reader:
    """The relations between tolerances, features and faces, looked up once."""

    def __init__(self, assembly: Assembly, to_con: Array) -> None:
        self.assembly, self.file = assembly, assembly.file
        self.items = self._collect(_USAGES, 5, 2, 4)  # by feature: faces, or sets of them
        self.parts = self._collect(("SHAPE_ASPECT_RELATIONSHIP",), 4, 2, 3)  # by feature: those that make it up
        self.ranges = self._collect(("PLUS_MINUS_TOLERANCE",), 2, 1, 0)
        self.values = self._collect(("DIMENSIONAL_CHARACTERISTIC_REPRESENTATION",), 2, 0, 1)
        self.zones = self._collect(("TOLERANCE_ZONE",), 6, 4, 5)
        self.matrices: dict[int, Array] = {}  # by face
        for body in assembly.bodies:
            for face in assembly.face_numbers(body.number):
                self.matrices.setdefault(face, to_con @ body.matrix)

    def _collect(self, keywords: Sequence[str], count: int, key: int, value: int) -> dict[int, list[Any]]:
        """One value of each instance by another one, or by each of a list."""
        found: dict[int, list[Any]] = defaultdict(list)
        for keyword in keywords:
            for number in self.file.list_numbers(keyword):
                values = self.file.read(number).parts.get(keyword, [])
                if len(values) == count:
                    for each in _list(values[key]) or [values[key]]:
                        if isinstance(each, Reference):
                            found[each].append(values[value])
        return found

    def read(self, number: int) -> StepTolerance:
        """One of them.  Raises StepError."""
        instance = self.file.read(number)
        keyword = next((each for each in (*_TOLERANCES, *_DIMENSIONS) if each in instance.parts), "")
        if not keyword:
            detail = "it is no kind of tolerance that is known"
            raise self.file.refuse(number, "unknown-tolerance", detail, f"known: {', '.join(FORMS).lower()}")
        return (self._tolerance if keyword in _TOLERANCES else self._dimension)(instance, keyword)

    # --- geometric tolerances ------------------------------------------------------------------------------

    def _tolerance(self, instance: Instance, keyword: str) -> StepTolerance:
        parts, number = instance.parts, instance.number
        values = [*parts.get("GEOMETRIC_TOLERANCE", []), *parts[keyword]]
        systems = [*values[4:5], *parts.get("GEOMETRIC_TOLERANCE_WITH_DATUM_REFERENCE", [])]
        if len(values) < 4:
            raise self.file.refuse(number, "wrong-count", f"#{number} has no value or no feature", "export it anew")
        value, unit = self._measure(values[2], number)
        zones = [decode_text(self._first(form, number)) for form in self.zones[number] if form is not None]
        stated = parts.get("GEOMETRIC_TOLERANCE_WITH_MODIFIERS", [])
        modifiers = (str(word) for words in stated for word in _list(words))
        return StepTolerance(
            number,
            decode_text(values[0]),
            keyword.removesuffix("_TOLERANCE").replace("_", " ").lower(),
            unit,
            value,
            across=any(zone.startswith(("cylindrical", "spherical")) for zone in zones),
            modifiers=tuple(_MODIFIERS.get(word, word.replace("_", " ").lower()) for word in modifiers),
            datums=tuple(letters for system in systems for letters in self._datums(system, number)),
            faces=self._faces([values[3]], number),
        )

    def _datums(self, systems: Any, referrer: int) -> Iterator[str]:
        """Letters of the datums of systems (or of references as before AP242), each with what modifies it."""
        for system in self.file.references(systems, referrer):
            instance = self.file.read(system, referrer)
            if "DATUM_SYSTEM" not in instance.parts:
                yield self._letters(self.file.part(instance, "DATUM_REFERENCE", 2)[1], system)
                continue
            for each in self.file.references(self.file.part(instance, "DATUM_SYSTEM", 5)[4], system):
                yield self._letters(each, system)

    def _letters(self, base: Any, referrer: int, depth: int = 0) -> str:
        """Of a datum, of what refers to one with modifiers, or of several that are one: ``A``, ``A (M)``, ``A-B``."""
        if depth > MOST_LEVELS:
            raise self.file.refuse(referrer, "too-deep", f"its datums are made of others more than {MOST_LEVELS} deep")
        if isinstance(base, Typed | list):
            inner = base.values if isinstance(base, Typed) else base
            return "-".join(self._letters(each, referrer, depth + 1) for each in inner[:MOST_DATUMS])
        instance = self.file.read(reference_of(self.file, base, referrer), referrer)
        for keyword in ("DATUM_REFERENCE_COMPARTMENT", "DATUM_REFERENCE_ELEMENT"):
            if keyword in instance.parts:
                _, _, _, _, inner, modifiers = self.file.part(instance, keyword, 6)
                words = [str(item.values[0]) for item in _list(modifiers) if isinstance(item, Typed) and item.values]
                said = (_MODIFIERS.get(word, word.lower()) for word in words)
                return " ".join((self._letters(inner, base, depth + 1), *said))
        keyword = "DATUM" if "DATUM" in instance.parts else "COMMON_DATUM"
        return decode_text(self.file.part(instance, keyword, 5)[4])

    # --- dimensions ----------------------------------------------------------------------------------------

    def _dimension(self, instance: Instance, keyword: str) -> StepTolerance:
        number, values = instance.number, instance.parts[keyword]
        size = keyword in _SIZES
        if len(values) < (2 if size else 4):
            raise self.file.refuse(number, "wrong-count", f"#{number} has no feature", "export it anew")
        kind, features = (values[1], values[:1]) if size else (values[0], values[2:4])
        measures: dict[str, tuple[float, Unit]] = {}
        for shape in self.values[number]:
            items = self.file.values(shape, "SHAPE_DIMENSION_REPRESENTATION", 3, number)[1]
            for item in self.file.references(items, number):
                if "MEASURE_REPRESENTATION_ITEM" in self.file.read(item, number).parts:
                    name = self.file.read(item).parts.get("REPRESENTATION_ITEM", [b""])[0]
                    measures[decode_text(name)] = self._measure(item, number)
        nominal = measures.get("nominal value") or next(iter(measures.values()), None)
        value, unit = nominal or (None, "deg" if keyword.startswith("ANGULAR") else "mm")
        ends = [measures[f"{end} limit"][0] for end in ("lower", "upper") if f"{end} limit" in measures]
        lower, upper = (end - value for end in ends) if len(ends) == 2 and value is not None else (None, None)
        fit = ""
        for stated in self.ranges[number]:
            part = self.file.read(reference_of(self.file, stated, number), number)
            if "LIMITS_AND_FITS" in part.parts:
                form, _, grade, _ = (decode_text(each) for each in self.file.part(part, "LIMITS_AND_FITS", 4))
                fit = form + grade
            else:
                low, high = self.file.part(part, "TOLERANCE_VALUE", 2)
                lower, upper = self._measure(low, stated)[0], self._measure(high, stated)[0]
        faces = self._faces(features, number)
        return StepTolerance(number, "", decode_text(kind), unit, value, lower, upper, fit, faces=faces)

    def _measure(self, number: Any, referrer: int) -> tuple[float, Unit]:
        """A value in mm or degrees, and which.  Raises StepError."""
        value, unit = self.assembly.measure(number, referrer)
        if "PLANE_ANGLE_UNIT" not in unit.parts:
            return round(value * self.assembly.millimetres(unit), 12), "mm"
        if "SI_UNIT" in unit.parts:
            return round(degrees(value), 12), "deg"
        if decode_text(self.file.part(unit, "CONVERSION_BASED_UNIT", 2)[0]).upper() in ("DEGREE", "DEGREES"):
            return value, "deg"
        raise self.file.refuse(unit.number, "unknown-unit", f"#{unit.number} is no unit of angle that is known")

    def _first(self, number: Any, referrer: int) -> Any:
        return next(iter(self.file.read(reference_of(self.file, number, referrer), referrer).parts.values()), [None])[0]

    # --- faces ---------------------------------------------------------------------------------------------

    def _faces(self, features: Sequence[Any], referrer: int) -> tuple[StepFace, ...]:
        """Those of features, and of the features that make them up."""
        seen: set[int] = set()
        faces: dict[int, StepFace] = {}
        waiting = [each for each in features if isinstance(each, Reference)]
        while waiting and len(faces) < MOST_FACES:
            feature = waiting.pop()
            if feature in seen or self.file.keyword_of(feature, referrer) == "DATUM":
                continue
            seen.add(feature)
            waiting += [each for each in self.parts[feature] if isinstance(each, Reference)]
            for item in self.items[feature]:
                for number in _references(item):
                    if number in self.matrices and number not in faces:
                        faces[number] = self._face(number)
        return tuple(faces[number] for number in sorted(faces))

    def _face(self, number: Reference) -> StepFace:
        surface, frame, radius, vertices = self.assembly.describe_face(number)
        matrix = self.matrices[number]
        scale = float(np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))
        nothing = np.zeros(3)
        if frame is None:
            middle = vertices.mean(axis=0) if len(vertices) else nothing
            return StepFace(number, surface, _place(matrix, middle), nothing, 0.0, (0.0, 0.0), nothing)
        axis, away = frame[:3, 2], vertices - frame[:3, 3]
        heights = away @ axis if len(away) else np.zeros(1)
        if surface == "cylinder":
            middle = frame[:3, 3] + axis * (heights.min() + heights.max()) / 2
            extents, along = (float(np.ptp(heights)) * scale, 0.0), frame[:3, 0]
        else:
            middle, extents, along = _span(frame, vertices, scale)
        turn = matrix[:3, :3] / scale
        return StepFace(number, surface, _place(matrix, middle), turn @ axis, radius * scale, extents, turn @ along)


def _span(frame: Array, vertices: Array, scale: float) -> tuple[Array, tuple[float, float], Array]:
    """Middle, sides in mm and direction of the longer one, of the smallest rectangle along an edge about points."""
    flat = (vertices - frame[:3, 3]) @ frame[:3, :2]
    steps = np.roll(flat, -1, axis=0) - flat
    best: tuple[float, Array, Array, Array] | None = None
    for step in steps[np.linalg.norm(steps, axis=1) > 1e-9][:MOST_FACES]:
        u = step / np.linalg.norm(step)
        turn = np.array([u, [-u[1], u[0]]])
        low, high = (flat @ turn.T).min(axis=0), (flat @ turn.T).max(axis=0)
        area = float(np.prod(high - low))
        if best is None or area < best[0] * (1 - 1e-9):
            best = area, turn, low, high
    if best is None:
        return frame[:3, 3], (0.0, 0.0), frame[:3, 0]
    _, turn, low, high = best
    longer = int(high[1] - low[1] > high[0] - low[0])
    middle = frame[:3, 3] + frame[:3, :2] @ (turn.T @ (low + high) / 2)
    sides = (high - low) * scale
    return middle, (float(sides[longer]), float(sides[1 - longer])), frame[:3, :2] @ turn[longer]


def _place(matrix: Array, point: Array) -> Array:
    return np.asarray(matrix[:3, :3] @ point + matrix[:3, 3])


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _references(item: Any) -> Iterator[Reference]:
    """A reference, or those of a set of them."""
    if isinstance(item, Reference):
        yield item
    elif isinstance(item, Typed | list):
        for each in item.values if isinstance(item, Typed) else item:
            yield from _references(each)

"""What anybody means by a number of the design document: beside its field stand the least and the most of it.

Domains of fields are wide, so that no honest design is refused; a range is narrower and refuses nothing.  A field
carries it as an annotation, its own or that of its type; on a field that holds records it stands for all numbers in its
unit below.  ``design.plausibility`` doubts by it, the JSON Schema has it as ``x-plausible``, docs/design.md as a table.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from math import pi
from typing import Any, NamedTuple, get_args

from pydantic import BaseModel

from .units import OTHER_LENGTHS

# What a number may have been written in, by the unit of its field, and how many of that unit one is; commonest first
SLIPS: Mapping[str, Mapping[str, float]] = {
    "mm": {unit: OTHER_LENGTHS[unit] for unit in ("metres", "micrometres", "centimetres", "inches")},
    "deg": {"radians": 180 / pi, "arcminutes": 1 / 60, "milliradians": 0.18 / pi, "arcseconds": 1 / 3600},
    "N": {"kilonewtons": 1000.0, "kilograms": 9.80665, "grams": 0.00980665, "millinewtons": 1e-3},
    "mm/N": {"m/N": 1000.0, "um/N": 1e-3},
    "um/(m K)": {"1/K": 1e6, "per cent/K": 1e4},
    "of 1": {"per cent": 0.01},
    "px": {},  # one mm is as many as the pixel says
    "K": {},
    "": {},
}


@dataclass(frozen=True, slots=True)
class Meant:
    """The least and the most that anybody means, in size, each with the reason why not less, or more."""

    what: str
    unit: str  # a key of ``SLIPS``
    least: float
    low: str  # what less would be, and where that is from
    most: float
    high: str
    below: str = "value-too-small"  # the rules of what is remarked
    above: str = "value-too-large"
    zero: str | None = ""  # what 0 says; None: it is doubted too
    together: bool = False  # numbers of one vector: the largest of them is not below ``least``
    by: str = ""  # the rule that judges it by these numbers, beside others of the design

    def __get_pydantic_json_schema__(self, core_schema: Any, handler: Any) -> dict[str, Any]:
        schema: dict[str, Any] = handler(core_schema)
        return schema if "$ref" in schema else {**schema, "x-plausible": [self.least, self.most]}


@dataclass(frozen=True, slots=True)
class AnySize:
    """No range is plausible, because ...; of a field that holds records: of the numbers in this unit below."""

    because: str
    unit: str = ""


Range = Meant | AnySize


class Number(NamedTuple):
    """A number of a document, or those of a vector or matrix, with its range."""

    pointer: str
    name: str  # as a person calls it: structure_connector rx half_width_deg
    value: Any  # float, or tuples of them
    largest: float  # in size, of all that are judged together with it
    meant: Meant


def find_ranges(annotation: Any, metadata: Any = ()) -> tuple[Range, ...]:
    """The ranges of a type, the nearest to the field last: those that stand outermost in it."""
    notes = [*getattr(annotation, "__metadata__", ()), *metadata]
    own = tuple(note for note in notes if isinstance(note, Meant | AnySize))
    return own or next(filter(None, map(find_ranges, get_args(annotation))), ())


def holds_records(annotation: Any) -> bool:
    """Whether values of this type are records, or lists of them."""
    own = isinstance(annotation, type) and issubclass(annotation, BaseModel)
    return own or any(map(holds_records, get_args(annotation)))


@cache
def list_ranges(record: type[BaseModel]) -> tuple[tuple[str, tuple[Range, ...], bool], ...]:
    """(field, its ranges, whether it holds records) of each field of a record that leads to numbers."""
    fields = [
        (name, find_ranges(field.annotation, field.metadata), holds_records(field.annotation))
        for name, field in record.model_fields.items()
    ]
    return tuple(each for each in fields if each[1] or each[2])


_SECTIONS = ("interfaces", "transforms", "execution", "tolerances", "rotation_deg", "views", "targets", "points")


def list_numbers(
    value: Any, told: Mapping[str, Range] | None = None, pointer: str = "", name: str = ""
) -> Iterator[Number]:
    """Every number of a record that has a plausible range.  ``told``: ranges that records above it state, by unit."""
    told = told or {}
    if isinstance(value, list):
        for index, each in enumerate(value):
            own = getattr(each, "name", None) or getattr(each, "label", None) or str(index + 1)
            yield from list_numbers(each, told, f"{pointer}/{index}", f"{name} {own}".strip())
        return
    if not isinstance(value, BaseModel):
        return
    plain: list[tuple[str, Any, Meant]] = []
    for field, found, deep in list_ranges(type(value)):
        below = getattr(value, field)
        if below is None:
            continue
        if deep and isinstance(below, BaseModel | list):
            inner = {each.unit: each for each in found} | dict(told)
            known = name if field in _SECTIONS else f"{name} {field}".strip()
            yield from list_numbers(below, inner, f"{pointer}/{field}", known)
        elif found:
            meant = told.get(found[-1].unit, found[-1]) if found[-1].unit else found[-1]
            if isinstance(meant, Meant):
                plain.append((field, below, meant))
    for field, below, meant in plain:
        at, called = f"{pointer}/{field}", f"{name} {field}".strip()
        if isinstance(below, list) or (isinstance(below, tuple) and not meant.together):
            for index, each in enumerate(below):
                yield Number(f"{at}/{index}", f"{called} {index + 1}", each, abs(each), meant)
            continue
        alike = [other for _, other, same in plain if same is meant] if meant.together else [below]
        yield Number(at, called, below, max(map(_largest, alike)), meant)


def _largest(value: Any) -> float:
    """In size; of a transform (4, 4), that of its translation."""
    if not isinstance(value, tuple):
        return abs(float(value))
    if len(value) == 4 and isinstance(value[0], tuple):
        value = tuple(row[3] for row in value[:3])
    return max(_largest(each) for each in value)


# --- ranges that several fields share -------------------------------------------------------------------

_FINE, _WIDE = "half-width-too-fine", "half-width-too-wide"
_SHORT, _LONG = "length-too-small", "length-too-large"
_STILL = "it does not vary at all"

SEAT_DEG = Meant(
    "half-width of a seat", "deg", 0.002, "finer than a kinematic coupling repeats (a judgement from its 0.1 um)",
    1.0, "wider than the play of a clip-on seat (0.5 mm at pins 50 mm apart)", _FINE, _WIDE, _STILL,
)  # fmt: skip
SEAT_MM = Meant(
    "half-width of a seat", "mm", 1e-4, "finer than a kinematic coupling repeats (0.1 um, Schouten 1997)",
    1.0, "wider than the play of a clip-on seat (0.5 mm)", _FINE, _WIDE, _STILL,
)  # fmt: skip
BEAD_PLACE_MM = Meant(
    "half-width of a bead's place", "mm", 5e-4, "finer than a coordinate measuring machine measures (0.5 um)",
    1.0, "ten times what is asked of the beads of a calibration object (0.1 mm, XMALab), and more",
    _FINE, _WIDE, _STILL,
)  # fmt: skip
HAND_EYE_DEG = Meant(
    "half-width of a hand-eye calibration", "deg", 0.005, "finer than any calibration of hand to eye (some 0.02 deg)",
    5.0, "wider than any calibration of hand to eye (some 1 deg)", _FINE, _WIDE, _STILL,
)  # fmt: skip
HAND_EYE_MM = Meant(
    "half-width of a hand-eye calibration", "mm", 0.002, "finer than any calibration of hand to eye (some 0.02 mm)",
    5.0, "wider than any calibration of hand to eye (0.65 mm standard deviation, arXiv 2404.05884)",
    _FINE, _WIDE, _STILL,
)  # fmt: skip
MOTION_DEG = Meant(
    "half-width of a motion", "deg", 0.0005, "finer than anything stays that is not one part", 10.0,
    "wider than a part turns between two shots", _FINE, _WIDE, _STILL,
)  # fmt: skip
MOTION_MM = Meant(
    "half-width of a motion", "mm", 0.0005, "finer than anything stays that is not one part", 50.0,
    "wider than breathing moves (some 30 mm)", _FINE, _WIDE, _STILL,
)  # fmt: skip
TILT_DEG = Meant(
    "tilt of a detector", "deg", 0.005, "finer than a tilt is measured from images (some 0.01 deg)", 1.0,
    "more than is taken to first order", _FINE, _WIDE, _STILL,
)  # fmt: skip
KNOWN_DEG = Meant(
    "known turn of a seat", "deg", 0.004, "less than is measured of a seat (2 um over 30 mm)", 20.0,
    "more than anybody leaves a known error", together=True,
)  # fmt: skip
KNOWN_MM = Meant(
    "known shift of a seat", "mm", 0.001, "less than a coordinate measuring machine measures (1 um)", 20.0,
    "more than anybody leaves a known error", together=True,
)  # fmt: skip
KNOWN_HAND_EYE_DEG = Meant(
    "known turn of a hand-eye calibration", "deg", 0.01, "less than is measured of it (some 0.02 deg)", 10.0,
    "more than anybody leaves a known error", together=True,
)  # fmt: skip
KNOWN_HAND_EYE_MM = Meant(
    "known shift of a hand-eye calibration", "mm", 0.003, "less than is measured of it (some 0.02 mm)", 20.0,
    "more than anybody leaves a known error", together=True,
)  # fmt: skip
PLACE_MM = Meant(
    "place of a seat, or shift of a frame", "mm", 0.5, "a place of its own that nobody can tell from the origin",
    3000.0, "further away than a robot reaches", _SHORT, _LONG, together=True,
)  # fmt: skip
TARGET_MM = Meant(
    "place of a target, an isocentre or a region", "mm", 0.2,
    "a place of its own that nobody can tell from the origin", 3000.0, "further away than a C-arm reaches",
    _SHORT, _LONG, together=True,
)  # fmt: skip
EXTENT_MM = Meant(
    "size of a region", "mm", 0.1, "smaller than an image resolves", 1000.0, "larger than any C-arm shows",
    _SHORT, _LONG, together=True,
)  # fmt: skip
SPACING_MM = Meant(
    "distance that is kept", "mm", 0.3, "less than the smallest bead", 200.0, "as far as a structure is wide",
    _SHORT, _LONG,
)  # fmt: skip
LIMIT_MM = Meant(
    "limit", "mm", 0.01, "less than robots of a data sheet repeat", 20.0,
    "wider than any anatomy a robot is asked to keep clear of (2 to 4 mm, at most some 10)", above="limit-too-wide",
)  # fmt: skip
SHARE = Meant(
    "part of one", "of 1", 2e-5, "less than anybody knows it", 0.2,
    "which is as many hundred per cent (errors of the focal length up to 0.14 were tried, arXiv 2603.14031)",
    above="share-in-percent",
)  # fmt: skip
NOISE_PX = Meant(
    "noise of an image", "px", 0.015,
    "less than the best that was measured (0.015 to 0.05 px, Zhang 2015): the error comes out too small. Write 0.05 "
    "for the best, 0.3 for typical, 0.5 for clinical images", 5.0,
    "more than that of a bead clicked by hand (1 to 2 px). It is a standard deviation, in pixels",
    "noise-too-small", "noise-too-large", None,
)  # fmt: skip
DISTANCE_PX = Meant(
    "distance in an image", "px", 1.0, "less than images are told apart by", 1000.0, "as far as an image is wide"
)
TURN_DEG = Meant(
    "turn of a frame", "deg", 0.01, "less than anybody turns a frame on purpose", 360.0, "more than one turn",
    together=True,
)  # fmt: skip
CONE_DEG = Meant(
    "turn of a beam", "deg", 1.0, "less than a C-arm is set to", 90.0, "all directions there are",
)  # fmt: skip
COVERAGE = Meant(
    "coverage factor", "", 1.0, "a confidence, perhaps: it counts standard deviations, 2 for 95 %", 6.0,
    "more than six sigma",
)  # fmt: skip
COUNT = AnySize("it is a number of things, and its domain says how many")
MONEY = AnySize("it is in a currency of your own")
DIRECTION = AnySize("a direction has any length")
MATRIX = AnySize("it is held to what it is: a rotation has norm 1, a projection any scale and sign")
LEVEL = AnySize("a probability: its domain is what anybody means")

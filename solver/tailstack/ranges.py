"""What anybody means by a number of the design document: beside its field stands a range, the least and the most of it.

Domains of fields are wide, so that no honest design is refused; a range is narrower and refuses nothing.  The ranges
are a table, ``tables/ranges.json``.  A field carries one as an annotation, its own or that of its type; on a field that
holds records it stands for all numbers in its unit below.  ``design.plausibility`` doubts by it, the JSON Schema has it
as ``x-plausible``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from math import pi
from typing import Any, NamedTuple, get_args

from pydantic import BaseModel

from .tables import read_table
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


_RANGES = {name: Meant(**given) for name, given in read_table("ranges").items()}


def __getattr__(name: str) -> Meant:
    """A range by its name in ``tables/ranges.json``, to be imported as if it stood here."""
    if name in _RANGES:
        return _RANGES[name]
    raise AttributeError(f"no range is called {name}")


COUNT = AnySize("it is a number of things, and its domain says how many")
MONEY = AnySize("it is in a currency of your own")
DIRECTION = AnySize("a direction has any length")
MATRIX = AnySize("it is held to what it is: a rotation has norm 1, a projection any scale and sign")
LEVEL = AnySize("a probability: its domain is what anybody means")

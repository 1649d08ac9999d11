"""What anybody means by a number of the design document: beside its field stands a range, the least and the most of it.

Domains of fields are wide, so that no honest design is refused; a range is narrower and refuses nothing.  The ranges
are a table, ``tables/ranges.json``.  A field carries one as an annotation, its own or that of its type; on a field that
holds records it stands for all numbers in its unit below.  ``design.plausibility`` doubts by it, the JSON Schema has it
as ``x-plausible``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from typing import Any

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

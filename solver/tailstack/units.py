"""Units as people write them in names, what each measures, and how many of ours one is: the only table of them.

Ours are mm, deg, N, K, px, s and byte; a share has 1.  ``read_unit`` reads compounds too: ``um_per_m_k``, ``mm2``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import pi
from typing import NamedTuple

_TABLE = {  # dimension: how many of ours a unit is, by every way to write it
    "length": {
        "m metre metres meter meters": 1e3, "dm": 100.0, "cm centimetre centimetres centimeter centimeters": 10.0,
        "mm millimetre millimetres millimeter millimeters": 1.0, "km": 1e6,
        "um \N{MICRO SIGN}m micron microns micrometre micrometres micrometer micrometers": 1e-3,
        "nm nanometre nanometres nanometer nanometers": 1e-6, "in inch inches": 25.4, "mil mils thou": 0.0254,
        "ft foot feet": 304.8, "yd yard yards": 914.4, "angstrom angstroms": 1e-7,
    },
    "angle": {
        "deg degree degrees \N{DEGREE SIGN}": 1.0, "rad radian radians": 180 / pi,
        "mrad milliradian milliradians": 0.18 / pi, "nrad": 1.8e-7 / pi, "mdeg": 1e-3,
        "urad \N{MICRO SIGN}rad microrad microradian microradians": 1.8e-4 / pi,
        "arcmin arcmins arcminute arcminutes moa": 1 / 60,
        "arcsec arcsecs arcsecond arcseconds": 1 / 3600, "gon grad grads gradian gradians": 0.9, "mgon": 9e-4,
        "rev revs revolution revolutions turn turns": 360.0,
    },
    "force": {
        "n newton newtons": 1.0, "kn kilonewton kilonewtons": 1e3, "mn millinewton millinewtons": 1e-3,
        "un micronewton": 1e-6, "meganewton": 1e6, "dan": 10.0, "lbf lb lbs pound pounds": 4.4482216152605,
        "ozf oz ounce ounces": 0.27801385095378125, "kgf kg kp kilogram kilograms": 9.80665,
        "gf g gram grams": 9.80665e-3, "dyn dyne dynes": 1e-5,
    },
    "temperature": {
        "k kelvin kelvins": 1.0, "mk millikelvin": 1e-3, "c degc celsius centigrade": 1.0,
        "f degf fahrenheit r rankine": 5 / 9,
    },
    "image": {"px pix pixel pixels": 1.0},
    "share": {"percent pct pc %": 0.01, "permille permil": 1e-3, "ppm": 1e-6, "ppb": 1e-9, "rel relative": 1.0},
    "time": {
        "s sec secs second seconds": 1.0, "ms millisecond milliseconds": 1e-3, "us \N{MICRO SIGN}s": 1e-6,
        "min mins minute minutes": 60.0, "h hr hrs hour hours": 3600.0, "d day days": 86400.0,
        "week weeks": 604800.0, "year years": 31557600.0,
    },
    "rate": {"hz fps": 1.0, "khz": 1e3, "mhz": 1e6, "rpm": 1 / 60},
    "memory": {
        "byte bytes b": 1.0, "kb kilobyte kilobytes": 1e3, "mb megabyte megabytes": 1e6, "gb gigabyte gigabytes": 1e9,
        "kib": 1024.0, "mib": 1048576.0, "gib": 1073741824.0,
    },
}  # fmt: skip
_SIMPLE = {
    word: (dimension, factor) for dimension, units in _TABLE.items() for words, factor in units.items()
    for word in words.casefold().split()
}  # fmt: skip
LENGTHS_MM = {
    unit: _SIMPLE[unit.casefold()][1] for unit in ("um", "\N{MICRO SIGN}m", "mm", "cm", "m", "in")
}  # of tables
OTHER_LENGTHS = {unit: _SIMPLE[unit][1] for unit in ("centimetres", "inches", "metres", "micrometres")}
_LABELS = {
    "_mm_per_n": "mm/N",
    "_um_per_m_k": "um/(m K)",
    "_deg": "deg",
    "_mm": "mm",
    "_px": "px",
    "_n": "N",
    "_k": "K",
}


class Unit(NamedTuple):
    """What a number is counted in."""

    words: tuple[str, ...]  # as they stand in the name
    factor: float  # how many of ours one is
    powers: tuple[tuple[str, int], ...]  # of the dimensions, those of 0 left out

    def __str__(self) -> str:
        above, below = split_per([word.upper() if word in "nkcf" else word for word in self.words])
        under = f"({' '.join(below)})" if len(below) > 1 else "".join(below)
        return f"{' '.join(above) or 1}/{under}" if under else " ".join(above)

    @property
    def dimension(self) -> str:
        """What it measures, in a word; empty for a compound."""
        return self.powers[0][0] if len(self.powers) == 1 and self.powers[0][1] == 1 else ""

    def invert(self) -> Unit:
        """The unit of one over a number in this one."""
        above, below = split_per(self.words)
        words = (*below, *(("per", *above) if above else ()))
        return Unit(words, 1 / self.factor, tuple((each, -power) for each, power in self.powers))


def split_per(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """The words before the first ``per``, and those that stand below it."""
    at = words.index("per") if "per" in words else len(words)
    return [word for word in words[:at] if word != "1"], [word for word in words[at + 1 :] if word != "per"]


def read_unit(words: Sequence[str]) -> Unit | None:
    """The unit that words are: one word, or ``per`` and those that one is divided by; None of anything else."""
    above, below = split_per(words)
    if len(above) > 1 or not (above or below) or ("per" in words and not below):
        return None
    powers: dict[str, int] = {}
    factor = 1.0
    for word, sign in (*((word, 1) for word in above), *((word, -1) for word in below)):
        match = re.fullmatch(r"([^\W\d]+|[%\N{DEGREE SIGN}])\^?([1-3])?", word)
        if match is None or match[1] not in _SIMPLE:
            return None
        dimension, size = _SIMPLE[match[1]]
        power = sign * int(match[2] or 1)
        powers[dimension], factor = powers.get(dimension, 0) + power, factor * size**power
    powers.pop("share", None)
    return Unit(tuple(words), factor, tuple(sorted((each, power) for each, power in powers.items() if power)))


def unit_label(field: str) -> str:
    """The unit of a field of a design, as it is written behind a number; empty: it has none."""
    return next((label for ending, label in _LABELS.items() if field.endswith(ending)), "")

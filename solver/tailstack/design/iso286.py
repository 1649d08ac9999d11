"""Limits and fits of ISO 286 for what seats a part: which deviations from a nominal diameter ``H7`` and ``g6`` are.

Widths are Table 1 of ISO 286-1 (IT5 to IT11, to 500 mm).  They come from the standard tolerance factor
``i = 0.45 D^(1/3) + 0.001 D`` um, D the geometric mean of a step of diameters in mm: 7, 10, 16, 25, 40, 64 and 100 i,
rounded by the standard's committee so that the table, not the formula, has the word (15 um for IT7 of 6 to 10 mm where
16 i is 14.4).  Deviations d, e, f, g of shafts likewise: ``-16 D^0.44``, ``-11 D^0.41``, ``-5.5 D^0.41``,
``-2.5 D^0.34``; h is 0, js is +-IT/2, m is ``IT7 - IT6`` above (dowel pins).  Holes D to H are those mirrored, JS too.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Iterable
from typing import NamedTuple

STEPS_MM = (3, 6, 10, 18, 30, 50, 80, 120, 180, 250, 315, 400, 500)  # a step is above the one before, and to this
WIDTHS_UM = {
    5: (4, 5, 6, 8, 9, 11, 13, 15, 18, 20, 23, 25, 27),
    6: (6, 8, 9, 11, 13, 16, 19, 22, 25, 29, 32, 36, 40),
    7: (10, 12, 15, 18, 21, 25, 30, 35, 40, 46, 52, 57, 63),
    8: (14, 18, 22, 27, 33, 39, 46, 54, 63, 72, 81, 89, 97),
    9: (25, 30, 36, 43, 52, 62, 74, 87, 100, 115, 130, 140, 155),
    10: (40, 48, 58, 70, 84, 100, 120, 140, 160, 185, 210, 230, 250),
    11: (60, 75, 90, 110, 130, 160, 190, 220, 250, 290, 320, 360, 400),
}
BELOW_UM = {  # upper deviations of shafts, all below the nominal size
    "d": (20, 30, 40, 50, 65, 80, 100, 120, 145, 170, 190, 210, 230),
    "e": (14, 20, 25, 32, 40, 50, 60, 72, 85, 100, 110, 125, 135),
    "f": (6, 10, 13, 16, 20, 25, 30, 36, 43, 50, 56, 62, 68),
    "g": (2, 4, 5, 6, 7, 9, 10, 12, 14, 15, 17, 18, 20),
    "h": (0,) * len(STEPS_MM),
}
M_UM = (2, 4, 6, 7, 8, 9, 11, 13, 15, 17, 20, 21, 23)  # lower deviations of shafts m
SHAFTS, HOLES = (*BELOW_UM, "js", "m"), (*(letter.upper() for letter in BELOW_UM), "JS")


class Deviations(NamedTuple):
    """Limits of a size, mm from the nominal one."""

    upper: float
    lower: float

    @property
    def middle(self) -> float:
        """mm"""
        return (self.upper + self.lower) / 2

    @property
    def width(self) -> float:
        """mm: of the zone."""
        return self.upper - self.lower

    def __str__(self) -> str:
        return f"{self.upper:+.4g}/{self.lower:+.4g}"


def find_deviations(tolerance_class: str, diameter_mm: float) -> Deviations:
    """Of a class such as ``H7`` (hole) or ``g6`` (shaft).  Raises ValueError that says what is known."""
    match = re.fullmatch(r"([A-Za-z]{1,2})(\d{1,2})", tolerance_class.strip())
    if match is None:
        raise ValueError(f"{tolerance_class!r} is no tolerance class: a letter and a grade, as H7 or g6")
    letter, grade = match[1], int(match[2])
    if letter not in (*SHAFTS, *HOLES):
        known = f"of shafts {', '.join(SHAFTS)}, of holes {', '.join(HOLES)}"
        raise ValueError(f"the letter {letter} is not known here: {known}")
    if grade not in WIDTHS_UM:
        raise ValueError(f"grade {grade} is not known here: {min(WIDTHS_UM)} to {max(WIDTHS_UM)} are")
    if not 0 < diameter_mm <= STEPS_MM[-1]:
        raise ValueError(f"fits are known up to {STEPS_MM[-1]} mm; the diameter is {diameter_mm:g} mm")
    step = bisect_left(STEPS_MM, diameter_mm)
    width = WIDTHS_UM[grade][step]
    if letter.lower() == "js":
        lower = -width / 2
    elif letter == "m":
        lower = float(M_UM[step])
    elif letter in BELOW_UM:
        lower = float(-BELOW_UM[letter][step] - width)
    else:
        lower = float(BELOW_UM[letter.lower()][step])
    return Deviations((lower + width) / 1000, lower / 1000)


def find_grade(width_mm: float, size_mm: float, among: Iterable[int]) -> int | None:
    """The coarsest of these grades whose zone is no wider, for a size up to 500 mm; None: it is finer than all."""
    step = bisect_left(STEPS_MM[:-1], size_mm)
    return max((grade for grade in among if WIDTHS_UM[grade][step] <= 1000 * width_mm * (1 + 1e-9)), default=None)


def read_fit(fit: str, diameter_mm: float) -> tuple[Deviations, Deviations]:
    """Hole and shaft of a fit such as ``H7/g6``.  Raises ValueError."""
    match = re.fullmatch(r"\s*([A-Z]{1,2}\d+)\s*/\s*([a-z]{1,2}\d+)\s*", fit)
    if match is None:
        raise ValueError(f"{fit!r} is no fit: the class of the hole, a stroke, the class of the pin, as H7/g6")
    return find_deviations(match[1], diameter_mm), find_deviations(match[2], diameter_mm)

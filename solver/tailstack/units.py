"""Units as people write them in names, what each measures, and how many of ours one is: ``tables/words.json``.

Ours are mm, deg, N, Nm, K, px, s and byte; a share has 1.  ``read_unit`` reads compounds too: ``um_per_m_k``, ``mm2``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from .tables import read_table

_SIMPLE: dict[str, tuple[str, float]] = {
    word: (dimension, factor)
    for dimension, units in read_table("words")["units"].items()
    for words, factor in units.items()
    for word in words.casefold().split()
}
# Of tables
LENGTHS_MM = {unit: _SIMPLE[unit.casefold()][1] for unit in ("um", "\N{MICRO SIGN}m", "mm", "cm", "m", "in")}
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
_MOMENTS = {"nm": "Nm", "knm": "kNm", "nmm": "Nmm"}  # as they are written


class Unit(NamedTuple):
    """What a number is counted in."""

    words: tuple[str, ...]  # as they stand in the name
    factor: float  # how many of ours one is
    powers: tuple[tuple[str, int], ...]  # of the dimensions, those of 0 left out

    def __str__(self) -> str:
        spelt = _MOMENTS if "moment" in dict(self.powers) else {}
        above, below = split_per([word.upper() if word in "nkcf" else spelt.get(word, word) for word in self.words])
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
    if above == ["nm"] and any(_SIMPLE.get(word, ("",))[0] == "angle" for word in below):
        above = ["newtonmetre"]  # of a stiffness in turning: nothing is nanometres per degree
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

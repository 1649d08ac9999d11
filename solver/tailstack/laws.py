"""How a source is drawn: by which law, and how often.

Each law is a row.  Everything asks the row: document, score, simulation, optimiser.  To add one: its member and its row
(docs/adding/estimator.md).

A reading of one unit, or of one mounting, holds fixed what is drawn with it or more rarely, and draws the rest again:
a comparison of two levels is all that scores, simulations and the optimiser ask.  One level more is one value here.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from math import sqrt
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


class Distribution(StrEnum):
    """Law of a tolerance of half-width h."""

    NORMAL = "normal"
    UNIFORM = "uniform"
    TRIANGULAR = "triangular"
    BOUNDED = "bounded"  # anywhere within +-h: it has no law, and only its worst case counts


Law = Distribution  # as the core calls it


class LawTraits(NamedTuple):
    """What is said of a law, and what it is made of."""

    words: str  # in the descriptions of a document
    parts: tuple[float, float] | None = None
    """Half-widths, in its own, of two independent uniform deviates that it is the sum of, the wider first: their sum
    is 1.  None: it is no such sum."""


LAWS = {
    Law.NORMAL: LawTraits("standard deviation h / coverage_factor"),
    Law.UNIFORM: LawTraits("anything in +-h alike", (1.0, 0.0)),
    Law.TRIANGULAR: LawTraits("most often near zero", (0.5, 0.5)),
    Law.BOUNDED: LawTraits("no law is claimed, only the worst case over +-h counts"),
}
RANDOM = tuple(law for law in Law if law is not Law.BOUNDED)
PARTS = {law: row.parts for law in Law if (row := LAWS[law]).parts is not None}
SUMS = tuple(PARTS)  # a law's place here is its number in compiled code
NORMAL, BOUNDED = -1, -2  # the numbers of the others there, which have no columns in a law
KIND = {Law.NORMAL: NORMAL, Law.BOUNDED: BOUNDED} | {law: kind for kind, law in enumerate(SUMS)}


def count_sigmas(law: Law) -> float:
    """Standard deviations in a half-width of a law that is a sum."""
    wide, narrow = PARTS[law]
    return sqrt(3 / (wide * wide + narrow * narrow))


def find_size(law: Law, probability: Array) -> Array:
    """The size in half-widths that a deviate of a law that is a sum exceeds, either way, with these probabilities:
    ``(1 - x)^2 / (4 wide narrow)`` where the narrow part is felt, ``1 - x / wide`` within."""
    import numpy as np  # here: who only reads documents waits for no arrays

    wide, narrow = PARTS[law]
    felt = probability * wide <= narrow
    return np.where(felt, 1 - np.sqrt(4 * wide * narrow * probability), wide * (1 - probability))


def shape_deviates(u: Array, kinds: Sequence[int] | NDArray[np.int64]) -> Array:
    """Deviates (n, K) of laws that are sums, by their places in SUMS (K,), of uniform ones on (-1, 1); half-widths."""
    import numpy as np

    for kind in {int(each) for each in kinds}:
        if PARTS[SUMS[kind]][1] > 0:  # of one part alone they are what they were
            u = np.where(np.asarray(kinds) == kind, np.sign(u) * find_size(SUMS[kind], 1.0 - np.abs(u)), u)
    return u


# --- how often, and what a requirement therefore reads by itself ------------------------------------------


class Drawn(StrEnum):
    """How often sources take new values, the rarest first: a unit is mounted many times, a mounting has many shots."""

    UNIT = "unit"  # once per installed unit
    MOUNTING = "mounting"  # each time that the structure is mounted: once per procedure
    SHOT = "shot"

    @property
    def rank(self) -> int:
        """Its place among all, from 0."""
        return _RANKS[self]

    def is_held(self, level: Drawn) -> bool:
        """Whether what is drawn so stays what it is throughout one ``level``."""
        return self.rank <= level.rank

    @property
    def plural(self) -> str:
        """Many of them, in words."""
        return f"{self}s"

    @property
    def all_of_them(self) -> str:
        """The same, where one reads of them for the first time."""
        return "installed units" if self is Drawn.UNIT else self.plural


_RANKS = {level: rank for rank, level in enumerate(Drawn)}

BETWEEN_SHOTS = [level for level in Drawn if level is not Drawn.SHOT][-1]
"""What is held from one shot to the next, when nothing but the shot is drawn again."""

RISKS = ("pooled", *(f"per_{level}" for level in Drawn if level is not Drawn.SHOT))


def level_of(risk: str) -> Drawn | None:
    """What is read by itself: of per_unit each unit, of per_mounting each mounting; of pooled nothing."""
    return None if risk == "pooled" else Drawn(risk.removeprefix("per_"))

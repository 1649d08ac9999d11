"""The laws of a tolerance, each a row.  Everything asks the row: document, score, simulation, optimiser.

To add one: its member and its row (docs/adding/estimator.md).
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

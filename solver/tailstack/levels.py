"""How often something is drawn, and what a requirement therefore reads by itself.

A reading of one unit, or of one mounting, holds fixed what is drawn with it or more rarely, and draws the rest again:
a comparison of two levels is all that scores, simulations and the optimiser ask.  One level more is one value here.
"""

from __future__ import annotations

from enum import StrEnum


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

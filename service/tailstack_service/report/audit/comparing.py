"""Two records value by value."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import isclose
from typing import Any

from tailstack.design.refusals import escape

CLOSE = 1e-9  # relative: what another processor may leave of the last digits of first order
NONE = 1e-12  # of numbers about zero
ABSENT = "(absent)"


@dataclass(frozen=True, slots=True)
class Value:
    """A value of a record, and of the record that was computed anew."""

    pointer: str
    recorded: Any
    computed: Any

    @property
    def same(self) -> bool:
        """To the last digit."""
        return type(self.recorded) is type(self.computed) and self.recorded == self.computed

    @property
    def close(self) -> bool:
        """The same up to the last digits of a number."""
        pair = (self.recorded, self.computed)
        if not all(isinstance(value, int | float) and not isinstance(value, bool) for value in pair):
            return self.same
        return isclose(*pair, rel_tol=CLOSE, abs_tol=NONE)

    @property
    def words(self) -> str:
        return f"{self.pointer}: recorded {_short(self.recorded)}, computed {_short(self.computed)}"


def _short(value: Any) -> str:
    text = repr(value) if not isinstance(value, str) or value != ABSENT else value
    return text if len(text) <= 90 else f"{text[:89]}…"


def values(recorded: Any, computed: Any, at: str = "") -> Iterator[Value]:
    """Every value of either, from plain data."""
    if isinstance(recorded, dict) and isinstance(computed, dict):
        for key in dict.fromkeys([*computed, *recorded]):
            yield from values(recorded.get(key, ABSENT), computed.get(key, ABSENT), f"{at}/{escape(key)}")
    elif isinstance(recorded, list | tuple) and isinstance(computed, list | tuple):
        if len(recorded) != len(computed):
            yield Value(at, f"{len(recorded)} entries", f"{len(computed)} entries")
        for index, pair in enumerate(zip(recorded, computed, strict=False)):
            yield from values(*pair, f"{at}/{index}")
    else:
        yield Value(at, recorded, computed)

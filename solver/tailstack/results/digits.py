"""How many decimals a length gets and how a share is written: one rule for every output.

The last digit of a length is of the decade of its error, taken at the limit that it is held against: an estimate good
to 1 % and held against 0.8 mm has three decimals, against 1 mm two; a simulation that knows P95 to 0.3 % has three.
All lengths of one answer have as many decimals as its finest requirement asks for, so that they can be compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from math import floor, isfinite, log10
from typing import Protocol

ESTIMATE = 0.01  # relative error of an estimate that holds; whatever is less well known is written as if it were it
FINEST = 6  # decimals of a millimetre
RESOLUTION_MM = 10.0**-FINEST  # of two lengths below it no ratio is told: they are rounding, or nothing
ROUNDING = 1.02  # 0.998 % is 1 %


class JudgedValue(Protocol):
    """A value, where it may lie, and its limit."""

    @property
    def value(self) -> float: ...
    @property
    def interval(self) -> tuple[float, float | None]: ...
    @property
    def limit(self) -> float: ...


def count_decimals(size_mm: float, error: float = ESTIMATE) -> int:
    """Decimals of a length of this size, mm, that is known to a relative ``error``."""
    worth = ROUNDING * abs(size_mm) * min(error, ESTIMATE)
    return min(max(-floor(log10(worth)), 0), FINEST) if isfinite(worth) and worth > 0 else 3


def decimals_of(checks: Sequence[JudgedValue], otherwise_mm: float = 1.0, error: float = ESTIMATE) -> int:
    """Decimals of every length of an answer, by its checks; without any by the largest value and its relative error."""
    asked = [count_decimals(check.limit, _error_of(check)) for check in checks]
    return max(asked, default=count_decimals(otherwise_mm, error))


def _error_of(check: JudgedValue) -> float:
    low, high = check.interval
    wide = ESTIMATE if high is None or check.value <= 0 else (high - low) / 2 / check.value
    return wide or ESTIMATE


def exact(value: float, decimals: int) -> str:
    """A number that somebody stated, which is never rounded: with as many decimals, or with all that it has."""
    text = f"{value:.{decimals}f}"
    return text if float(text) == value else f"{value:.12g}"


def length(value_mm: float, decimals: int) -> str:
    """A length in a sentence: with two digits where its decimals would show nothing of what is not nothing."""
    if 0 < abs(value_mm) < RESOLUTION_MM:
        return f"<{RESOLUTION_MM:.{FINEST}f}"
    text = f"{value_mm:.{decimals}f}"
    return text if float(text) or not value_mm else f"{value_mm:.{min(1 - floor(log10(abs(value_mm))), FINEST)}f}"


def at_least(value: float, digits: int = 4) -> str:
    """The smallest number with so many significant digits that is not below a value: what a hint asks for is enough."""
    return _round_out(value, digits, ROUND_CEILING)


def at_most(value: float, digits: int = 4) -> str:
    """The largest number with so many significant digits that is not above a value."""
    return _round_out(value, digits, ROUND_FLOOR)


def _round_out(value: float, digits: int, rounding: str) -> str:
    if not value:
        return "0"
    known = Context(12).plus(Decimal(value))  # 0.3 stays 0.3, whichever side of it a float lies
    return f"{Context(digits, rounding).plus(known).normalize():f}"


def in_percent(fraction: float, decimals: int = 0) -> str:
    """A share in words, ``39 %``: what is not nothing is never 0, and what is not all never 100."""
    least = 10.0**-decimals
    if 0 < 100 * fraction < least / 2:
        return f"< {least:g} %"
    if 100 - least / 2 <= 100 * fraction < 100:
        return f"> {100 - least:g} %"
    return f"{100 * fraction:.{decimals}f} %"


def percent_change(before: float, after: float) -> str:
    """How much more or less, ``+71 %``, with a sign; as a factor where per cents say nothing."""
    ratio = after / before
    if not 0.01 < ratio < 10:
        return f"{ratio:.3g} times" if ratio >= 10 else f"a {1 / ratio:.3g}th of it" if ratio > 0 else "to nothing"
    change = 100 * (ratio - 1)
    return f"{change:+.0f} %" if abs(change) >= 9.5 else f"{change:+.2g} %"


# --- numbers as text: ``-`` for what is not there ----------------------------------------------------------


def number(value: float | None, digits: int = 4) -> str:
    """A number with ``digits`` significant digits and no exponent where a person would write none."""
    if value is None:
        return "-"
    if value == 0:
        return "0"
    if not isfinite(value):
        return str(value)
    if 10**digits <= abs(value) < 1e7:
        return f"{float(f'{value:.{digits}g}'):.0f}"
    text = f"{value:#.{digits}g}" if 1e-3 <= abs(value) < 10**digits else f"{value:.{digits}g}"
    return text.rstrip(".")


def decimal(value: float | None, decimals: int) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"


def signed_decimal(value: float | None, decimals: int = 3) -> str:
    """A number with its sign, which it keeps where its digits are all zeros: a margin of -0.000 is a limit missed."""
    return "-" if value is None else f"{value:+.{decimals}f}"


def saving(value_mm: float | None, decimals: int) -> str:
    """What a change saves, with two digits; ``<0.001`` for what none of the decimals of the answer shows."""
    if value_mm is None:
        return "-"
    least = 10.0**-decimals
    if 0 < value_mm < least / 10:
        return f"<{least / 10:.{decimals + 1}f}"
    return f"{value_mm:.{decimals + 1}f}"


def percent(fraction: float | None, decimals: int = 1) -> str:
    """A fraction as percent, ``<0.1`` for what would print as nothing."""
    if fraction is None:
        return "-"
    smallest = 10.0**-decimals
    if 0 < 100 * fraction < smallest / 2:
        return f"<{smallest:g}"
    return f"{100 * fraction:.{decimals}f}"

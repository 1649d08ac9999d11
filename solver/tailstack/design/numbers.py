"""Numbers that a caller of the library hands over: read as they are, or refused, and never taken for others.

NumPy by itself reads what lies below a mask, True as 1 and a duration as a count of its own unit, and drops imaginary
parts and the units of quantities.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date, timedelta
from typing import Any, NamedTuple

import numpy as np

from ..errors import DesignError, Problem, TailstackError
from ..geometry.arrays import Array

_ORDINARY = (float, int, np.floating, np.integer)


def read_numbers(values: Any, where: str, refusal: type[TailstackError]) -> Array:
    """(n,) numbers of a list, an array, or a column of pandas, polars or Arrow; NaN and infinity are passed on.

    Raises the refusal, which points at ``where``, for anything else: missing values, truth values, texts, complex
    numbers, durations and dates, quantities with a unit, generators, other objects, more than one dimension.
    """
    if reason := _find_reason(values):
        at = where if reason.place is None else f"{where}/{reason.place}"
        raise refusal(Problem(at, "wrong-type", f"a list of numbers is wanted; got {reason.got}", reason.hint))
    try:
        return np.array(values, dtype=np.float64)
    except OverflowError:
        raise refusal(Problem(where, "out-of-range", "a number of the list is too large")) from None


def plain_array(values: Any, pointer: str) -> Any:
    """An array or scalar of NumPy in a document, as Python's own lists and numbers.  Raises DesignError."""
    numeric = values.dtype.kind in "biufUO"
    if reason := _unit_reason(values) or _mask_reason(values) or (None if numeric else _word(values.ravel()[:1])):
        raise DesignError(Problem(pointer, "unsupported-value", f"expected numbers; got {reason.got}", reason.hint))
    return values.tolist()


class _Reason(NamedTuple):
    got: str
    hint: str
    place: int | None = None  # in the list


def _find_reason(values: Any) -> _Reason | None:
    """Why these are no numbers; None: they are."""
    if isinstance(values, list | tuple):
        kinds = set(map(type, values))
        if kinds <= {float, int}:
            return None
        return next((why for k, value in enumerate(values) if (why := _scalar_reason(value, k))), None)
    if isinstance(values, str | bytes) or not hasattr(values, "__array__"):
        hint = "hand over a list of numbers" + (": list(...) of it" if hasattr(values, "__next__") else "")
        return _Reason(_describe(values), hint)
    if reason := _unit_reason(values) or _mask_reason(values):
        return reason
    array = np.asarray(values)
    if array.ndim != 1:
        return _Reason(f"an array of shape {array.shape}", "one number for each row, in one dimension")
    if array.dtype.kind == "O":
        return _find_reason(array.tolist())
    return None if array.dtype.kind in "iuf" else _word(array)


def _scalar_reason(value: Any, place: int) -> _Reason | None:
    if isinstance(value, bool | np.timedelta64) or not isinstance(value, _ORDINARY):
        return (_unit_reason(value) or _word(value))._replace(place=place)
    return None


def _unit_reason(values: Any) -> _Reason | None:
    """Of a quantity of pint or astropy, whose unit would be lost."""
    for unit, magnitude in (("units", "magnitude"), ("unit", "value")):
        if hasattr(type(values), unit) and hasattr(type(values), magnitude):
            hint = f"convert it to the unit of the field, and hand over its .{magnitude}"
            return _Reason(f"a quantity in {getattr(values, unit)}", hint)
    return None


def _mask_reason(values: Any) -> _Reason | None:
    """Of a column in which values are missing: masked, NA or null.  NaN is no missing value, it is no finite number."""
    missing: Any = None
    if isinstance(values, np.ma.MaskedArray):
        missing = np.ma.getmaskarray(values)
    elif hasattr(values, "null_count"):  # polars, Arrow
        count = values.null_count() if callable(values.null_count) else values.null_count
        missing = np.asarray(values.is_null()) if count else None
    elif hasattr(values, "isna") and not isinstance(values.dtype, np.dtype):  # a nullable type of pandas
        missing = np.asarray(values.isna())
    if missing is None or not missing.any():
        return None
    return _Reason("a missing value", "leave out the rows without a value", int(np.flatnonzero(missing)[0]))


_OTHERS: Sequence[tuple[tuple[type, ...], str, _Reason]] = (  # types, kinds of arrays
    ((bool, np.bool_), "b", _Reason("a truth value", "write 1 or 0 if a number is meant")),
    ((timedelta, np.timedelta64), "m", _Reason("a duration", "divide it by its unit, and hand over the number")),
    ((date, np.datetime64), "M", _Reason("a date", "hand over numbers in the unit of the field")),
    ((complex, np.complexfloating), "c", _Reason("a complex number", "hand over its real part, if that is meant")),
    ((str, bytes), "UST", _Reason("a text", "convert it, as in float(text)")),
)


def _word(value: Any) -> _Reason:
    """What something that is no number is, an array of such things too."""
    kind = value.dtype.kind if isinstance(value, np.ndarray) else "none"
    found = (why for types, kinds, why in _OTHERS if isinstance(value, types) or kind in kinds)
    return next(found, _Reason(_describe(value), "hand over numbers in the unit of the field"))


def _describe(value: Any) -> str:
    if value is None or value is np.ma.masked or type(value).__name__ in ("NAType", "NaTType"):
        return "a missing value"
    return f"a {type(value).__name__}"

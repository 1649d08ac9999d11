from typing import Literal

SpreadComparedOf = Literal["norms", "vectors"]

SPREAD_COMPARED_OF_VALUES: set[SpreadComparedOf] = {
    "norms",
    "vectors",
}


def check_spread_compared_of(value: str) -> SpreadComparedOf:
    if value in SPREAD_COMPARED_OF_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {SPREAD_COMPARED_OF_VALUES!r}")

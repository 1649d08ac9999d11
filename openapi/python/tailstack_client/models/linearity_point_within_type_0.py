from typing import Literal

LinearityPointWithinType0 = Literal["1 %", "20 %", "5 %", "beyond"]

LINEARITY_POINT_WITHIN_TYPE_0_VALUES: set[LinearityPointWithinType0] = {
    "1 %",
    "20 %",
    "5 %",
    "beyond",
}


def check_linearity_point_within_type_0(value: str) -> LinearityPointWithinType0:
    if value in LINEARITY_POINT_WITHIN_TYPE_0_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {LINEARITY_POINT_WITHIN_TYPE_0_VALUES!r}")

from typing import Literal

LinearityPointErrsType0 = Literal["none seen", "optimistic", "pessimistic"]

LINEARITY_POINT_ERRS_TYPE_0_VALUES: set[LinearityPointErrsType0] = {
    "none seen",
    "optimistic",
    "pessimistic",
}


def check_linearity_point_errs_type_0(value: str) -> LinearityPointErrsType0:
    if value in LINEARITY_POINT_ERRS_TYPE_0_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {LINEARITY_POINT_ERRS_TYPE_0_VALUES!r}")

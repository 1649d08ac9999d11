from typing import Literal

FrontPointStatus = Literal["dominated", "not tried", "out of reach", "verified"]

FRONT_POINT_STATUS_VALUES: set[FrontPointStatus] = {
    "dominated",
    "not tried",
    "out of reach",
    "verified",
}


def check_front_point_status(value: str) -> FrontPointStatus:
    if value in FRONT_POINT_STATUS_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {FRONT_POINT_STATUS_VALUES!r}")

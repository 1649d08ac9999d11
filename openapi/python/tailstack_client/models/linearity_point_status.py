from typing import Literal

LinearityPointStatus = Literal["ok", "refused"]

LINEARITY_POINT_STATUS_VALUES: set[LinearityPointStatus] = {
    "ok",
    "refused",
}


def check_linearity_point_status(value: str) -> LinearityPointStatus:
    if value in LINEARITY_POINT_STATUS_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {LINEARITY_POINT_STATUS_VALUES!r}")

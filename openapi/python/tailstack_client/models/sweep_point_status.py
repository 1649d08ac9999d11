from typing import Literal

SweepPointStatus = Literal["ok", "refused"]

SWEEP_POINT_STATUS_VALUES: set[SweepPointStatus] = {
    "ok",
    "refused",
}


def check_sweep_point_status(value: str) -> SweepPointStatus:
    if value in SWEEP_POINT_STATUS_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {SWEEP_POINT_STATUS_VALUES!r}")

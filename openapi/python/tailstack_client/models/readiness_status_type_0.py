from typing import Literal

ReadinessStatusType0 = Literal["failed", "ready", "warming up"]

READINESS_STATUS_TYPE_0_VALUES: set[ReadinessStatusType0] = {
    "failed",
    "ready",
    "warming up",
}


def check_readiness_status_type_0(value: str) -> ReadinessStatusType0:
    if value in READINESS_STATUS_TYPE_0_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {READINESS_STATUS_TYPE_0_VALUES!r}")

from typing import Literal

ReadinessStatusType1 = Literal["no database", "stopping"]

READINESS_STATUS_TYPE_1_VALUES: set[ReadinessStatusType1] = {
    "no database",
    "stopping",
}


def check_readiness_status_type_1(value: str) -> ReadinessStatusType1:
    if value in READINESS_STATUS_TYPE_1_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {READINESS_STATUS_TYPE_1_VALUES!r}")

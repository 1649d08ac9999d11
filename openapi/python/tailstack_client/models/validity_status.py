from typing import Literal

ValidityStatus = Literal["good to 1 %", "good to 20 %", "good to 5 %", "not valid"]

VALIDITY_STATUS_VALUES: set[ValidityStatus] = {
    "good to 1 %",
    "good to 20 %",
    "good to 5 %",
    "not valid",
}


def check_validity_status(value: str) -> ValidityStatus:
    if value in VALIDITY_STATUS_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {VALIDITY_STATUS_VALUES!r}")

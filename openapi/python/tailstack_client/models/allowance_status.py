from typing import Literal

AllowanceStatus = Literal["no influence", "no requirement", "spare", "too wide", "zero is not enough"]

ALLOWANCE_STATUS_VALUES: set[AllowanceStatus] = {
    "no influence",
    "no requirement",
    "spare",
    "too wide",
    "zero is not enough",
}


def check_allowance_status(value: str) -> AllowanceStatus:
    if value in ALLOWANCE_STATUS_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {ALLOWANCE_STATUS_VALUES!r}")

from typing import Literal

SweepRequestCheck = Literal["score", "verification"]

SWEEP_REQUEST_CHECK_VALUES: set[SweepRequestCheck] = {
    "score",
    "verification",
}


def check_sweep_request_check(value: str) -> SweepRequestCheck:
    if value in SWEEP_REQUEST_CHECK_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {SWEEP_REQUEST_CHECK_VALUES!r}")

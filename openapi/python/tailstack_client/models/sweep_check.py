from typing import Literal

SweepCheck = Literal["score", "verification"]

SWEEP_CHECK_VALUES: set[SweepCheck] = {
    "score",
    "verification",
}


def check_sweep_check(value: str) -> SweepCheck:
    if value in SWEEP_CHECK_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {SWEEP_CHECK_VALUES!r}")

from typing import Literal

CreateSweepCheck = Literal["score", "verification"]

CREATE_SWEEP_CHECK_VALUES: set[CreateSweepCheck] = {
    "score",
    "verification",
}


def check_create_sweep_check(value: str) -> CreateSweepCheck:
    if value in CREATE_SWEEP_CHECK_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {CREATE_SWEEP_CHECK_VALUES!r}")

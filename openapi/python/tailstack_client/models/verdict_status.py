from typing import Literal

VerdictStatus = Literal["fail", "inconclusive", "no requirement", "pass"]

VERDICT_STATUS_VALUES: set[VerdictStatus] = {
    "fail",
    "inconclusive",
    "no requirement",
    "pass",
}


def check_verdict_status(value: str) -> VerdictStatus:
    if value in VERDICT_STATUS_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {VERDICT_STATUS_VALUES!r}")

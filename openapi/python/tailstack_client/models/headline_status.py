from typing import Literal

HeadlineStatus = Literal["fail", "inconclusive", "no requirement", "pass"]

HEADLINE_STATUS_VALUES: set[HeadlineStatus] = {
    "fail",
    "inconclusive",
    "no requirement",
    "pass",
}


def check_headline_status(value: str) -> HeadlineStatus:
    if value in HEADLINE_STATUS_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {HEADLINE_STATUS_VALUES!r}")

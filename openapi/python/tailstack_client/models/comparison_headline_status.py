from typing import Literal

ComparisonHeadlineStatus = Literal["fail", "inconclusive", "no requirement", "pass"]

COMPARISON_HEADLINE_STATUS_VALUES: set[ComparisonHeadlineStatus] = {
    "fail",
    "inconclusive",
    "no requirement",
    "pass",
}


def check_comparison_headline_status(value: str) -> ComparisonHeadlineStatus:
    if value in COMPARISON_HEADLINE_STATUS_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {COMPARISON_HEADLINE_STATUS_VALUES!r}")

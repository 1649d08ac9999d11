from typing import Literal

OptimisationVerdictStatus = Literal["fail", "inconclusive", "no requirement", "pass"]

OPTIMISATION_VERDICT_STATUS_VALUES: set[OptimisationVerdictStatus] = {
    "fail",
    "inconclusive",
    "no requirement",
    "pass",
}


def check_optimisation_verdict_status(value: str) -> OptimisationVerdictStatus:
    if value in OPTIMISATION_VERDICT_STATUS_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {OPTIMISATION_VERDICT_STATUS_VALUES!r}")

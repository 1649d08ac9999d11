from typing import Literal

CouplingCaseReading = Literal["eq18", "physical"]

COUPLING_CASE_READING_VALUES: set[CouplingCaseReading] = {
    "eq18",
    "physical",
}


def check_coupling_case_reading(value: str) -> CouplingCaseReading:
    if value in COUPLING_CASE_READING_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {COUPLING_CASE_READING_VALUES!r}")

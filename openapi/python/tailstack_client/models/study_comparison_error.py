from typing import Literal

StudyComparisonError = Literal["localisation", "tcp"]

STUDY_COMPARISON_ERROR_VALUES: set[StudyComparisonError] = {
    "localisation",
    "tcp",
}


def check_study_comparison_error(value: str) -> StudyComparisonError:
    if value in STUDY_COMPARISON_ERROR_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {STUDY_COMPARISON_ERROR_VALUES!r}")

from typing import Literal

StudyComparisonRequestError = Literal["localisation", "tcp"]

STUDY_COMPARISON_REQUEST_ERROR_VALUES: set[StudyComparisonRequestError] = {
    "localisation",
    "tcp",
}


def check_study_comparison_request_error(value: str) -> StudyComparisonRequestError:
    if value in STUDY_COMPARISON_REQUEST_ERROR_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {STUDY_COMPARISON_REQUEST_ERROR_VALUES!r}")

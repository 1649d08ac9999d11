from typing import Literal

StudyLinearityRequestError = Literal["localisation", "tcp"]

STUDY_LINEARITY_REQUEST_ERROR_VALUES: set[StudyLinearityRequestError] = {
    "localisation",
    "tcp",
}


def check_study_linearity_request_error(value: str) -> StudyLinearityRequestError:
    if value in STUDY_LINEARITY_REQUEST_ERROR_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {STUDY_LINEARITY_REQUEST_ERROR_VALUES!r}")

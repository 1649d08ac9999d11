from typing import Literal

StudyCouplingRequestError = Literal["localisation", "tcp"]

STUDY_COUPLING_REQUEST_ERROR_VALUES: set[StudyCouplingRequestError] = {
    "localisation",
    "tcp",
}


def check_study_coupling_request_error(value: str) -> StudyCouplingRequestError:
    if value in STUDY_COUPLING_REQUEST_ERROR_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {STUDY_COUPLING_REQUEST_ERROR_VALUES!r}")

from typing import Literal

StudyViewsRequestError = Literal["localisation", "tcp"]

STUDY_VIEWS_REQUEST_ERROR_VALUES: set[StudyViewsRequestError] = {
    "localisation",
    "tcp",
}


def check_study_views_request_error(value: str) -> StudyViewsRequestError:
    if value in STUDY_VIEWS_REQUEST_ERROR_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {STUDY_VIEWS_REQUEST_ERROR_VALUES!r}")

from typing import Literal

StudyViewsError = Literal["localisation", "tcp"]

STUDY_VIEWS_ERROR_VALUES: set[StudyViewsError] = {
    "localisation",
    "tcp",
}


def check_study_views_error(value: str) -> StudyViewsError:
    if value in STUDY_VIEWS_ERROR_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {STUDY_VIEWS_ERROR_VALUES!r}")

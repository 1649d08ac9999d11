from typing import Literal

StudyLinearityError = Literal["localisation", "tcp"]

STUDY_LINEARITY_ERROR_VALUES: set[StudyLinearityError] = {
    "localisation",
    "tcp",
}


def check_study_linearity_error(value: str) -> StudyLinearityError:
    if value in STUDY_LINEARITY_ERROR_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {STUDY_LINEARITY_ERROR_VALUES!r}")

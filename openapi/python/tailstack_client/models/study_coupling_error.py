from typing import Literal

StudyCouplingError = Literal["localisation", "tcp"]

STUDY_COUPLING_ERROR_VALUES: set[StudyCouplingError] = {
    "localisation",
    "tcp",
}


def check_study_coupling_error(value: str) -> StudyCouplingError:
    if value in STUDY_COUPLING_ERROR_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {STUDY_COUPLING_ERROR_VALUES!r}")

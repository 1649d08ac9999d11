from typing import Literal

CouplingCaseCoupling = Literal["less", "more", "none seen"]

COUPLING_CASE_COUPLING_VALUES: set[CouplingCaseCoupling] = {
    "less",
    "more",
    "none seen",
}


def check_coupling_case_coupling(value: str) -> CouplingCaseCoupling:
    if value in COUPLING_CASE_COUPLING_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {COUPLING_CASE_COUPLING_VALUES!r}")

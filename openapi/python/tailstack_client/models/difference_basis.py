from typing import Literal

DifferenceBasis = Literal["first order", "Monte Carlo"]

DIFFERENCE_BASIS_VALUES: set[DifferenceBasis] = {
    "first order",
    "Monte Carlo",
}


def check_difference_basis(value: str) -> DifferenceBasis:
    if value in DIFFERENCE_BASIS_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {DIFFERENCE_BASIS_VALUES!r}")

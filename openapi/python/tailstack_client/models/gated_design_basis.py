from typing import Literal

GatedDesignBasis = Literal["first order", "Monte Carlo", "none"]

GATED_DESIGN_BASIS_VALUES: set[GatedDesignBasis] = {
    "first order",
    "Monte Carlo",
    "none",
}


def check_gated_design_basis(value: str) -> GatedDesignBasis:
    if value in GATED_DESIGN_BASIS_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {GATED_DESIGN_BASIS_VALUES!r}")

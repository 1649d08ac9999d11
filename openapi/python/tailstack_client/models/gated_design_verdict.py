from typing import Literal

GatedDesignVerdict = Literal["fail", "inconclusive", "not evaluated", "pass"]

GATED_DESIGN_VERDICT_VALUES: set[GatedDesignVerdict] = {
    "fail",
    "inconclusive",
    "not evaluated",
    "pass",
}


def check_gated_design_verdict(value: str) -> GatedDesignVerdict:
    if value in GATED_DESIGN_VERDICT_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {GATED_DESIGN_VERDICT_VALUES!r}")

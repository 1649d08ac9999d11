from typing import Literal

SweepPointVerdictType0 = Literal["fail", "inconclusive", "no requirement", "pass"]

SWEEP_POINT_VERDICT_TYPE_0_VALUES: set[SweepPointVerdictType0] = {
    "fail",
    "inconclusive",
    "no requirement",
    "pass",
}


def check_sweep_point_verdict_type_0(value: str) -> SweepPointVerdictType0:
    if value in SWEEP_POINT_VERDICT_TYPE_0_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {SWEEP_POINT_VERDICT_TYPE_0_VALUES!r}")

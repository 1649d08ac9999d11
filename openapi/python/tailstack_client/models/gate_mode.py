from typing import Literal

GateMode = Literal["analytic", "auto", "verify"]

GATE_MODE_VALUES: set[GateMode] = {
    "analytic",
    "auto",
    "verify",
}


def check_gate_mode(value: str) -> GateMode:
    if value in GATE_MODE_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {GATE_MODE_VALUES!r}")

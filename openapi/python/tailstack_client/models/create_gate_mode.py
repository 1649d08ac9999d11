from typing import Literal

CreateGateMode = Literal["analytic", "auto", "verify"]

CREATE_GATE_MODE_VALUES: set[CreateGateMode] = {
    "analytic",
    "auto",
    "verify",
}


def check_create_gate_mode(value: str) -> CreateGateMode:
    if value in CREATE_GATE_MODE_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {CREATE_GATE_MODE_VALUES!r}")

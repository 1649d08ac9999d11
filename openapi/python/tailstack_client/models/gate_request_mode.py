from typing import Literal

GateRequestMode = Literal["analytic", "auto", "verify"]

GATE_REQUEST_MODE_VALUES: set[GateRequestMode] = {
    "analytic",
    "auto",
    "verify",
}


def check_gate_request_mode(value: str) -> GateRequestMode:
    if value in GATE_REQUEST_MODE_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {GATE_REQUEST_MODE_VALUES!r}")

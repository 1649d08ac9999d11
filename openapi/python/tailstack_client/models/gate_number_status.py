from typing import Literal

GateNumberStatus = Literal["fail", "inconclusive", "pass"]

GATE_NUMBER_STATUS_VALUES: set[GateNumberStatus] = {
    "fail",
    "inconclusive",
    "pass",
}


def check_gate_number_status(value: str) -> GateNumberStatus:
    if value in GATE_NUMBER_STATUS_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {GATE_NUMBER_STATUS_VALUES!r}")

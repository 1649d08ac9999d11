from typing import Literal

GateRequestFailLevel = Literal["error", "warning"]

GATE_REQUEST_FAIL_LEVEL_VALUES: set[GateRequestFailLevel] = {
    "error",
    "warning",
}


def check_gate_request_fail_level(value: str) -> GateRequestFailLevel:
    if value in GATE_REQUEST_FAIL_LEVEL_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {GATE_REQUEST_FAIL_LEVEL_VALUES!r}")

from typing import Literal

CreateGateFailLevel = Literal["error", "warning"]

CREATE_GATE_FAIL_LEVEL_VALUES: set[CreateGateFailLevel] = {
    "error",
    "warning",
}


def check_create_gate_fail_level(value: str) -> CreateGateFailLevel:
    if value in CREATE_GATE_FAIL_LEVEL_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {CREATE_GATE_FAIL_LEVEL_VALUES!r}")

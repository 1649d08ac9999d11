from typing import Literal

GateFailLevel = Literal["error", "warning"]

GATE_FAIL_LEVEL_VALUES: set[GateFailLevel] = {
    "error",
    "warning",
}


def check_gate_fail_level(value: str) -> GateFailLevel:
    if value in GATE_FAIL_LEVEL_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {GATE_FAIL_LEVEL_VALUES!r}")

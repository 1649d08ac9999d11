from typing import Literal

GateRequirementError = Literal["localisation", "tcp"]

GATE_REQUIREMENT_ERROR_VALUES: set[GateRequirementError] = {
    "localisation",
    "tcp",
}


def check_gate_requirement_error(value: str) -> GateRequirementError:
    if value in GATE_REQUIREMENT_ERROR_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {GATE_REQUIREMENT_ERROR_VALUES!r}")

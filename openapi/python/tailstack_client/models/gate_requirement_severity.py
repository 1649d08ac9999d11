from typing import Literal

GateRequirementSeverity = Literal["error", "note", "off", "warning"]

GATE_REQUIREMENT_SEVERITY_VALUES: set[GateRequirementSeverity] = {
    "error",
    "note",
    "off",
    "warning",
}


def check_gate_requirement_severity(value: str) -> GateRequirementSeverity:
    if value in GATE_REQUIREMENT_SEVERITY_VALUES:
        return value
    raise TypeError(f"Unexpected value {value!r}. Expected one of {GATE_REQUIREMENT_SEVERITY_VALUES!r}")
